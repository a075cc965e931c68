"""What each area of the store stands on: an engine and a clock."""

from __future__ import annotations

import time

from sqlalchemy import Engine


class Area:
    """Holds the engine; the areas add their statements."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    @staticmethod
    def _now() -> float:
        return time.time()

"""Where the database is when nobody says."""

from __future__ import annotations

import os
from pathlib import Path


def default_database_url() -> str:
    """Returns the address of the SQLite file in the user's data folder (XDG base directories)."""
    data = os.environ.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return f"sqlite:///{Path(data) / 'fling' / 'fling.db'}"

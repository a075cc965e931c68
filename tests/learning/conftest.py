from __future__ import annotations

import pytest

from benchmarks.learning.plans import PlannedThrow, planned_throws


@pytest.fixture(scope="package")
def soonest() -> list[PlannedThrow]:
    """Soonest throws all around, by Ruckig: planned in a second."""
    return planned_throws(12, (0.0,), "ruckig")

"""An execution's public states."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from executor import shared_memory as shm
from executor.execution import Execution


@pytest.mark.parametrize(("rows", "brakes"), [(150, False), (311, False), (312, True)])
def test_a_motion_brakes_from_its_last_passage_on(rows: int, brakes: bool) -> None:
    """Its main state may come long before: a throw, with a line of 50 ticks after it."""
    nothing: Any = None
    execution: Any = Execution(nothing, nothing)
    job = SimpleNamespace(first_clock_s=-0.02, dt=0.002, lag_ticks=1.0, release_row=110)
    problem = SimpleNamespace(passages=[SimpleNamespace(ticks=lambda _, n=n: n) for n in (0, 50)])
    trajectory = SimpleNamespace(passed=(100, 250), dt=0.002, sample_rate_hz=500.0)
    execution.motions = [SimpleNamespace(problem=problem, trajectory=trajectory)]
    execution.run = SimpleNamespace(taken=0, job=job, state=shm.STREAMING, furthest=shm.STREAMING, row_count=rows)
    assert ("braking" in execution.states()) is brakes

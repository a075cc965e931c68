"""A part of the fault matrix that stands for the whole: each phase, each kind of fault, both rates.

More of it is `tests/verify/test_fault_matrix.py`; `python -m benchmarks.fault_matrix` runs all.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.system.fault_matrix import FAULT, PHASE, run_cell
from tests.system.rig import Rig

AT_500_HZ = [
    ("approach", "stream killed, dashboard stalled"),
    ("launch", "every command lost"),
    ("launch", "database locked"),
    ("launch", "output connection stalled"),
    ("before the command", "program stopped"),
    ("after the command", "cable out"),
    ("flight", "protective stop"),
    ("brake", "power lost"),
    ("way home", "stream frozen 300 ms"),
    ("calibration", "speed slider at 50 %"),
    ("replacing", "stream killed"),
]
AT_125_HZ = [
    ("approach", "control connection stalled"),
    ("launch", "daemon frozen 300 ms"),
    ("after the command", "stream killed"),
    ("before the command", "every switch lost"),
    ("replacing", "cable out"),
]


@pytest.fixture(scope="module")
def slow_rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A CB3 arm, which takes one command in 8 ms."""
    rig = Rig(tmp_path_factory.mktemp("slow"), "ur5-sim")
    rig.start()
    yield rig
    rig.stop()


@pytest.mark.parametrize(("phase", "fault"), AT_500_HZ)
def test_a_fault_at_500_hz(rig: Rig, phase: str, fault: str) -> None:
    assert run_cell(rig, PHASE[phase], FAULT[fault]).broken() == []


@pytest.mark.slow
@pytest.mark.parametrize(("phase", "fault"), AT_125_HZ)
def test_a_fault_at_125_hz(slow_rig: Rig, phase: str, fault: str) -> None:
    assert run_cell(slow_rig, PHASE[phase], FAULT[fault]).broken() == []

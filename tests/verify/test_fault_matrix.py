"""A part of the fault matrix that stands for the whole: every fault in the launch, every phase, both rates.

`python -m benchmarks.fault_matrix` runs all of it.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.system.fault_matrix import FAULTS, PHASES, run_cell
from tests.system.rig import Rig

PROCESSES = ("stream", "daemon", "another client", "gripper")  # their faults in the launch are in test_kills and others
IN_LAUNCH = tuple(fault.name for fault in FAULTS if not fault.name.startswith(PROCESSES))
AT_500_HZ = {
    "approach": (
        "stream killed, dashboard stalled",
        "daemon and stream killed",
        "cable out",
        "control connection stalled",
    ),
    "launch": ("stream killed, dashboard stalled", *IN_LAUNCH),
    "before the command": ("stream killed", "program stopped"),
    "after the command": ("daemon frozen 300 ms", "cable out"),
    "flight": ("cable out",),
    "brake": ("daemon and stream frozen 3000 ms", "power lost"),
    "way home": ("stream frozen 300 ms", "every connection silent"),
    "calibration": ("stream killed, dashboard stalled", "speed slider at 50 %"),
}
AT_125_HZ = {
    "approach": ("every connection silent",),
    "launch": ("stream killed, dashboard stalled", "daemon frozen 300 ms", "half of the states lost"),
    "after the command": ("stream killed",),
    "calibration": ("control connection stalled",),
}
PHASE = {phase.name: phase for phase in PHASES}
FAULT = {fault.name: fault for fault in FAULTS}


def cells(table: dict[str, tuple[str, ...]]) -> pytest.MarkDecorator:
    """The cells of a table as parameters."""
    return pytest.mark.parametrize(("phase", "fault"), [(phase, fault) for phase in table for fault in table[phase]])


@pytest.fixture(scope="module")
def slow_rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A CB3 arm, which takes one command in 8 ms."""
    rig = Rig(tmp_path_factory.mktemp("slow"), "ur5-sim")
    rig.start()
    yield rig
    rig.stop()


@cells(AT_500_HZ)
def test_a_fault_at_500_hz(rig: Rig, phase: str, fault: str) -> None:
    assert run_cell(rig, PHASE[phase], FAULT[fault]).broken() == []


@cells(AT_125_HZ)
def test_a_fault_at_125_hz(slow_rig: Rig, phase: str, fault: str) -> None:
    assert run_cell(slow_rig, PHASE[phase], FAULT[fault]).broken() == []

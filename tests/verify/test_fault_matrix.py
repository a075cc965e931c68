"""The fault matrix beyond what `make test` has time for: every fault in the launch, and every moment of a release.

`python -m benchmarks.fault_matrix` runs all of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.system.conftest import STALL_RETRIES
from tests.system.fault_matrix import FAULT, FAULTS, PHASE, run_cell
from tests.system.lost_objects import MOMENTS_S, STOPS, stop_between_command_and_release
from tests.system.rig import CELLS as RIG_CELLS
from tests.system.rig import Rig

pytestmark = [pytest.mark.slow, pytest.mark.flaky(reruns=STALL_RETRIES)]

PROCESSES = ("stream", "daemon", "another client", "gripper")  # their faults in the launch are in tests/system
IN_LAUNCH = tuple(fault.name for fault in FAULTS if not fault.name.startswith(PROCESSES))
AT_500_HZ = {
    "approach": (
        "stream killed, no stop gets through",
        "daemon and stream killed",
        "cable out",
        "control connection stalled",
    ),
    "launch": ("stream killed, dashboard stalled", "stream killed, no stop gets through", *IN_LAUNCH),
    "before the command": ("stream killed", "program stopped"),
    "after the command": ("daemon frozen 300 ms", "cable out"),
    "flight": ("cable out", "protective stop"),
    "brake": ("daemon and stream frozen 3000 ms", "power lost"),
    "way home": ("stream frozen 300 ms", "every connection silent"),
    "calibration": ("stream killed, dashboard stalled", "speed slider at 50 %"),
}
WITHOUT_DASHBOARD = {
    "approach": ("stream killed", "control connection stalled"),
    "launch": ("stream killed, no stop gets through", "daemon killed", "receive connection reset", "protective stop"),
    "before the command": ("program stopped",),
    "flight": ("cable out",),
    "brake": ("control connection closed",),
    "way home": ("stream frozen 300 ms",),
}
AT_125_HZ = {
    "approach": ("every connection silent",),
    "launch": ("stream killed, dashboard stalled", "daemon frozen 300 ms", "half of the states lost"),
    "after the command": ("stream killed",),
    "calibration": ("control connection stalled",),
}
CELLS = [
    (base, phase, fault)
    for base, table in (("ur5e-sim", AT_500_HZ), ("ur5e-sim-x", WITHOUT_DASHBOARD), ("ur5-sim", AT_125_HZ))
    for phase in table
    for fault in table[phase]
]


@pytest.fixture(scope="module")
def rig_of(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Rig]]:
    """Returns the rig of a shipped cell, one for all tests."""
    rigs: dict[str, Rig] = {}

    def started(base: str) -> Rig:
        if base not in rigs:
            rigs[base] = Rig(tmp_path_factory.mktemp(base), *RIG_CELLS[base])
            rigs[base].start()
        return rigs[base]

    yield started
    for rig in rigs.values():
        rig.stop()


@pytest.mark.parametrize(("base", "phase", "fault"), CELLS)
def test_a_fault(rig_of: Callable[[str], Rig], base: str, phase: str, fault: str) -> None:
    assert run_cell(rig_of(base), PHASE[phase], FAULT[fault]).broken() == []


@pytest.mark.parametrize("after_s", MOMENTS_S)
@pytest.mark.parametrize("stop", STOPS)
def test_a_stop_between_command_and_release(rig_of: Callable[[str], Rig], stop: str, after_s: float) -> None:
    rig = rig_of("ur5e-sim")
    rig.stand_up()
    stop_between_command_and_release(rig, stop, after_s)

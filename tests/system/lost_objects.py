"""What a reason tells of an object that a stop let go, or kept, beside what became of it in the simulated world."""

from __future__ import annotations

import re
import signal

import numpy as np

from store import ExecutionRow
from tests.system.rig import FAST_RAD_S, Rig

PREDICTED_M = 0.12  # [m] of a landing that is read from the states of an arm that brakes hard
STOPS = ("protective_stop", "emergency_stop", "stop_program", "speed_slider", "stream killed", "stream frozen", "abort")
MOMENTS_S = (0.0, 0.02, 0.035)  # [s] after the output has changed; the object leaves 40 ms after that


def told_landing(row: ExecutionRow) -> np.ndarray:
    """Returns the landing that the reason tells."""
    found = re.search(r"lands about at \(([-\d.]+), ([-\d.]+), ([-\d.]+)\) m", row.reason)
    assert found, row.reason
    return np.array([float(number) for number in found.groups()])


def agrees_with_the_truth(rig: Rig, row: ExecutionRow, released: int) -> None:
    """What the reason says of the object is what happened to it."""
    if len(rig.world()["releases"]) == released:
        assert "the object is held" in row.reason or "may have left" in row.reason
        assert rig.state()["gripper_holds"] is not None
        return
    rig.until(lambda: len(rig.world()["in_flight"]) == 0)
    landed = np.array(rig.world()["landings"][-1]["position_m"])
    assert np.linalg.norm(told_landing(row) - landed) < PREDICTED_M, (row.reason, landed)


def stop_between_command_and_release(rig: Rig, stop: str, after_s: float) -> None:
    """Stops a throw once its gripper was told to open; what the reason says of the object is what happened to it."""
    id = rig.launch(FAST_RAD_S)
    released = len(rig.world()["releases"])
    rig.until(lambda: rig.state()["gripper_open"], period=0.0005)
    at = rig.state()["t"]
    rig.until(lambda: rig.state()["t"] >= at + after_s, period=0.0005)
    if stop.startswith("stream"):
        rig.streamer().send_signal(signal.SIGKILL if stop.endswith("killed") else signal.SIGSTOP)
    elif stop == "abort":
        rig.store.request_abort(id)
    else:
        rig.fault(stop)
    row = rig.end(id)
    rig.recover()
    if rig.is_latched():
        rig.acknowledge()
    assert row.outcome != "completed" or row.reason == "" or stop == "abort", row.reason
    if row.outcome != "completed":
        agrees_with_the_truth(rig, row, released)

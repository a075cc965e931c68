"""The gripper's output while it holds an object: switched by another client, deaf, or taken back in a stop.

Another client switches it as any client may: by a secondary program, which runs beside ours.
"""

from __future__ import annotations

import socket
from collections.abc import Callable
from itertools import cycle
from pathlib import Path

import pytest

from store import ExecutionRow
from tests.system.lost_objects import MOMENTS_S, STOPS, agrees_with_the_truth, stop_between_command_and_release
from tests.system.rig import FAST_RAD_S, LOB, LONG_LOB, NUDGE, Rig

REST_S = 0.150  # [s] of the controller's time from the edge to rest
FUNCTIONS = {
    "tool_digital": "set_tool_digital_out",
    "standard_digital": "set_standard_digital_out",
    "configurable_digital": "set_configurable_digital_out",
}


def switch(rig: Rig, level: bool) -> None:
    """Sets the gripper's output as another client."""
    gripper = rig.cell.gripper
    function = FUNCTIONS[gripper.output]
    with socket.create_connection((rig.host, 30002)) as other:
        other.sendall(f"sec other():\n  {function}({gripper.index}, {level})\nend\n".encode())
        seen = level == gripper.open_level
        rig.until(lambda: rig.state()["gripper_open"] == seen, period=0.001)


def latched(rig: Rig, row: ExecutionRow, outcome: str) -> None:
    assert row.outcome == outcome, row.reason
    assert rig.is_latched()
    rig.acknowledge()


def approaching(rig: Rig) -> str:
    """Queues a throw from far away; returns its id on the way."""
    far = {**NUDGE, "positions": [0.9, -1.57, 1.57, -1.57, -1.57, 0.0]}
    assert rig.throw_when_ready(far).outcome == "completed"
    id = rig.queue(LONG_LOB)
    rig.until(lambda: rig.row(id).state == "approaching", period=0.001)
    rig.until(lambda: max(map(abs, rig.state()["qd"])) > 1.0, period=0.001)
    return id


def launching(rig: Rig) -> str:
    return rig.launch(FAST_RAD_S)


@pytest.mark.parametrize("begin", [approaching, launching], ids=["approach", "launch"])
def test_an_object_that_another_client_lets_go_is_released_early(rig: Rig, begin: Callable[[Rig], str]) -> None:
    id = begin(rig)
    released = len(rig.world()["releases"])
    at = rig.state()["t"]
    switch(rig, rig.cell.gripper.open_level)
    rested = rig.rest_time(at)
    row = rig.end(id)
    latched(rig, row, "released_early")
    assert "another client opened the gripper" in row.reason
    assert rested < REST_S + rig.cell.timing.lag_s  # the output itself changes one lag after the script
    agrees_with_the_truth(rig, row, released)
    assert rig.throw_when_ready(LOB).outcome == "completed"


@pytest.mark.slow
@pytest.mark.parametrize("output", ["standard_digital", "configurable_digital"])
def test_every_kind_of_output_is_watched(tmp_path: Path, output: str) -> None:
    rig = Rig(tmp_path, replace={'output = "tool_digital"': f'output = "{output}"'})
    try:
        rig.start()
        id = launching(rig)
        switch(rig, rig.cell.gripper.open_level)
        latched(rig, rig.end(id), "released_early")
    finally:
        rig.stop()


def test_a_way_without_a_throw_is_watched_too(rig: Rig) -> None:
    """A move that ends at rest may carry an object: the way home, and the motions of a calibration."""
    assert rig.throw_when_ready().outcome == "completed"
    switch(rig, not rig.cell.gripper.open_level)  # an open one is empty, and not watched
    rig.until(lambda: rig.state()["gripper_holds"] is not None)
    id = rig.queue({**NUDGE, "positions": [0.9, -1.57, 1.57, -1.57, -1.57, 0.0]})
    rig.in_launch(id)
    switch(rig, rig.cell.gripper.open_level)
    latched(rig, rig.end(id), "released_early")


def test_an_output_that_another_client_owns_besides_does_not_matter(rig: Rig) -> None:
    id = launching(rig)
    with socket.create_connection((rig.host, 30002)) as other:
        other.sendall(b"sec other():\n  set_standard_digital_out(3, True)\nend\n")
        row = rig.end(id)
        other.sendall(b"sec other():\n  set_standard_digital_out(3, False)\nend\n")
    assert (row.outcome, row.reason) == ("completed", ""), row.reason


@pytest.mark.slow
def test_an_object_that_another_client_keeps_is_not_released(tmp_path: Path) -> None:
    rig = Rig(tmp_path, replace={"delay_s = 0.040": "delay_s = 0.400"})
    try:
        rig.start()
        id = rig.queue_when_ready(LONG_LOB)
        rig.until(lambda: rig.state()["gripper_open"], period=0.001)
        switch(rig, not rig.cell.gripper.open_level)
        row = rig.end(id)
        latched(rig, row, "not_released")
        assert "another client closed the gripper" in row.reason
        agrees_with_the_truth(rig, row, 0)
    finally:
        rig.stop()


def test_an_output_that_does_not_change_when_told_is_not_released(rig: Rig) -> None:
    released = len(rig.world()["releases"])
    id = launching(rig)
    rig.fault("outputs_stuck")
    row = rig.end(id)
    rig.recover()
    latched(rig, row, "not_released")
    assert "did not change when it was told to open" in row.reason
    agrees_with_the_truth(rig, row, released)


@pytest.mark.slow
@pytest.mark.parametrize(("stop", "after_s"), [*zip(STOPS, cycle(MOMENTS_S), strict=False)])
def test_a_stop_between_command_and_release_says_where_the_object_is(rig: Rig, stop: str, after_s: float) -> None:
    """Each stop at one moment; `tests/verify` has each at every one."""
    stop_between_command_and_release(rig, stop, after_s)

"""Faults of the robot's side beyond the fault matrix: refusals, other clients, a gripper and an arm that do not obey.

R and H numbers are those of `tests.system`.
"""

from __future__ import annotations

import socket
import struct
import time

import pytest

from planner.controller_program import HEARTBEAT, REQUEST
from tests.system.rig import FAST_RAD_S, LOB, NUDGE, Rig

SEEN_S = 0.2  # [s] the executor receives a state every 40 ms
REST_S = 0.25  # [s] of the controller's time from 2.5 rad/s: stale state 40 ms, lag 20 ms, 125 ms at 20 rad/s^2, room


FOREIGN = [  # port, script of another client, word of the reason
    pytest.param(30002, "def other():\n  while True:\n    sync()\n  end\nend\n", "'other'", id="R16 plays"),
    pytest.param(30001, "movej([0, -1, 1, 0, 0, 0], a=1.4, v=1)\n", "'unnamed'", id="R16 moves"),
    pytest.param(30003, "def other():\n  no_such_function()\nend\n", "no_such_function", id="R16 does not compile"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("port", "script", "word"), FOREIGN)
def test_in_mid_launch_another_clients_script_is_a_stop(rig: Rig, port: int, script: str, word: str) -> None:
    released = len(rig.world()["releases"])
    id = rig.launch(FAST_RAD_S)
    at = rig.state()["t"]
    with socket.create_connection((rig.host, port)) as other:
        other.sendall(script.encode())
        rested = rig.rest_time(at)
        row = rig.end(id)
    latched = rig.throw(NUDGE)
    rig.acknowledge()
    assert row.outcome == "foreign_program", row.reason
    assert "another client's script took over" in row.reason
    assert word in row.reason
    assert rested < REST_S, f"{rested:.3f} s: {row.reason}"
    assert len(rig.world()["releases"]) == released
    assert rig.world()["gripper_holds"] is not None
    assert rig.state()["program"] is None  # nothing of the other script is left to move the arm
    assert latched.outcome == "refused"


def test_a_secondary_program_of_another_client_does_not_end_a_run(rig: Rig) -> None:
    id = rig.launch(FAST_RAD_S)
    with socket.create_connection((rig.host, 30002)) as other:
        other.sendall(b'sec other():\n  textmsg("beside")\nend\n')
        row = rig.end(id)
    assert row.outcome == "completed", row.reason


def test_after_a_fault_in_mid_launch_it_works_again(rig: Rig) -> None:
    """As every launch but the first has shown already."""
    following = rig.throw_when_ready()
    assert following.outcome == "completed", following.reason


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "parameters", "word"),
    [
        ("local_mode", {}, "remote control"),  # R5
        ("speed_slider", {"fraction": 0.5}, "speed slider"),  # R6
        ("mute", {"port": "dashboard"}, "dashboard"),
        ("protective_stop", {}, "protective stop"),
    ],
)
def test_preflight_refuses_in_words(rig: Rig, name: str, parameters: dict, word: str) -> None:
    before = rig.state()["q"]
    rig.fault(name, **parameters)
    time.sleep(SEEN_S)
    row = rig.throw(NUDGE)
    rig.recover()
    assert row.outcome == "refused"
    assert word in row.reason
    assert rig.state()["q"] == pytest.approx(before, abs=1e-9)
    assert rig.throw_when_ready().outcome == "completed"  # a refusal latches nothing


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "register"), [("speedj", 0), ("script", HEARTBEAT), ("script", REQUEST)], ids=lambda value: str(value)
)
def test_registers_in_use_are_a_refusal(rig: Rig, mode: str, register: int) -> None:  # R15
    with socket.create_connection((rig.host, 30004)) as other:
        other.sendall(struct.pack(">HBH", 5, 86, 2))
        other.recv(64)
        names = b"input_int_register_%d" % register
        other.sendall(struct.pack(">HB", 3 + len(names), 73) + names)
        other.recv(64)
        before = rig.state()["q"]
        row = rig.throw(NUDGE, mode)
    assert row.outcome == "refused"
    assert "in use" in row.reason
    assert rig.state()["q"] == pytest.approx(before, abs=1e-9)
    rig.acknowledge()
    assert rig.throw(NUDGE).outcome == "completed"


def test_a_gripper_that_does_not_open_releases_nothing(rig: Rig) -> None:  # H10
    released = len(rig.world()["releases"])
    rig.fault("gripper_stuck")
    row = rig.throw(LOB)
    rig.recover()
    assert row.metrics is not None
    assert row.metrics["landing_point"] is None
    assert (row.outcome, row.reason) == ("completed", "the gripper was commanded to open, but no object left it")
    assert len(rig.world()["releases"]) == released
    assert rig.throw_when_ready().outcome == "completed"


@pytest.mark.slow
def test_an_arm_that_lags_more_than_the_cell_says_is_stopped(own_rig: Rig) -> None:  # R13
    head, sim = own_rig.path.read_text().split("[sim]")
    own_rig.rewrite(head + "[sim]" + sim.replace("lag_s = 0.020", "lag_s = 0.100"))
    own_rig.start()
    row = own_rig.throw(LOB)
    assert row.outcome == "tracking", row.reason
    assert not own_rig.world()["releases"]
    assert max(map(abs, own_rig.state()["qd"])) < 1e-3
    own_rig.acknowledge()
    following = own_rig.throw({**NUDGE, "positions": own_rig.cell.home.tolist()})
    assert following.outcome == "completed", following.reason

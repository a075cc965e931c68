"""A controller of PolyScope X: no dashboard. Throws, stops, recovery and power all the same."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from tests.system.fault_matrix import FAULT, PHASE, run_cell
from tests.system.rig import ABORTED_S, FAST_RAD_S, LOB, NUDGE, POLYSCOPE_X, Rig
from tests.system.service import RigService

CELLS = [
    ("launch", "stream killed"),
    ("launch", "cable out"),  # ur_rtde crashes as it reconnects
    ("approach", "daemon and stream killed"),
    ("after the command", "control connection reset"),
]


@pytest.fixture(scope="module")
def x_rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    rig = Rig(tmp_path_factory.mktemp("x"), replace=POLYSCOPE_X)
    rig.start()
    yield rig
    rig.stop()


@pytest.fixture
def rig(x_rig: Rig) -> Rig:
    x_rig.stand_up()
    return x_rig


def test_it_throws_and_tells_its_version_and_serial_number(rig: Rig) -> None:
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((rig.host, 29999))
    row = rig.quiet_throw(LOB)
    assert row.outcome == "completed", row.reason
    assert row.metrics["landing_error_m"] < 0.01
    told = rig.robot()
    assert (told["polyscope"], told["serial_number"], told["warnings"]) == ("10.14.0", "20235500001", [])


@pytest.mark.slow
@pytest.mark.parametrize(("phase", "fault"), CELLS)
def test_a_fault(rig: Rig, phase: str, fault: str) -> None:
    assert run_cell(rig, PHASE[phase], FAULT[fault]).broken() == []


def test_an_abort_in_launch_needs_no_dashboard(rig: Rig) -> None:
    id = rig.launch(FAST_RAD_S)
    at = rig.state()["t"]
    rig.store.request_abort(id)
    assert rig.rest_time(at) < ABORTED_S
    assert rig.end(id).outcome == "aborted"
    assert not rig.is_latched()


def test_local_control_is_refused_in_the_words_of_its_pendant(rig: Rig) -> None:
    rig.fault("local_mode")
    rig.until(lambda: rig.robot()["refusals"])
    assert "in the safety overview" in rig.throw(NUDGE).reason


@pytest.mark.slow
def test_an_arm_without_power_is_powered_by_the_robot_api_when_a_person_asks(rig: Rig) -> None:
    rig.fault("power_loss")
    rig.until(lambda: rig.robot()["refusals"])
    assert "powered off (fling robot power-on)" in rig.throw(NUDGE).reason
    with RigService(rig) as service:

        def operated(action: str) -> tuple[str, str]:
            asked = service.http.post("/cells/rig/robot", json={"action": action})
            assert asked.status_code == 202, asked.text
            rig.until(lambda: rig.store.cell_status("rig").open_robot_request is None)
            told = service.http.get("/cells/rig/state").json()["robot_request"]
            assert told["id"] == asked.json()["id"]
            return told["state"], told["text"]

        assert operated("power_on") == ("done", "by the Robot API")
        assert operated("brake_release") == ("done", "by the Robot API")
        assert rig.throw_when_ready().outcome == "completed"
        state, text = operated("unlock_protective_stop")
        assert (state, "(409)" in text, "The robot is RUNNING" in text) == ("refused", True, True)
        rig.fault("protective_stop")
        assert operated("unlock_protective_stop") == ("done", "by the Robot API")
    assert rig.throw_when_ready().outcome == "completed"


@pytest.mark.slow
def test_a_robot_api_that_is_silent_keeps_nothing_from_moving(rig: Rig) -> None:
    """Nobody can tell whether it is in remote control: what it refuses, it says."""
    rig.fault("mute", port="robot_api")
    rig.fault("close_connection", role="robot_api")
    rig.until(lambda: rig.robot()["warnings"])
    assert "remote control is not known" in rig.robot()["warnings"][0]
    assert rig.throw_when_ready().outcome == "completed"

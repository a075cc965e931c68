"""Objects that have to be picked up: what the executor makes of a grip that a digital input shows."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from planner.geometry import tool_state
from tests.system.fault_matrix import FAULT, GRIP_SENSOR, INPUT_FAULTS, PHASE, ROBOTIQ, run_cell
from tests.system.lost_objects import agrees_with_the_truth
from tests.system.rig import FAST_RAD_S, LOB, LONG_LOB, Rig
from tests.system.test_gripper_output import switch

LANDED_M = 0.1  # [m] a gripper on a network takes a command up to 5 ms sooner or later, which is 5 cm here
GRIPPERS = {"input": GRIP_SENSOR, "gripper": ROBOTIQ}


@pytest.mark.parametrize("by", ["input", pytest.param("gripper", marks=pytest.mark.slow)])
def test_an_object_is_thrown_once_and_an_empty_place_refused_at_rest(own_rig: Rig, by: str) -> None:
    own_rig.set_gripper(GRIPPERS[by])
    place = tool_state(own_rig.cell, own_rig.cell.home, np.zeros(6)).p_WT.tolist()
    truth = own_rig.folder / "truth.toml"
    truth.write_text(f"[feeder]\nplaces = [{place}]\n")
    own_rig.start_simulator("--truth", str(truth), "--reveal")
    own_rig.start_executor()
    assert [each["state"] for each in own_rig.world()["objects"]] == ["on its place"]

    thrown = own_rig.throw(LOB)
    assert thrown.outcome == "completed", thrown.reason
    assert thrown.metrics["grip"] == {"held": True, "by": by, "opened_again": False}
    assert np.linalg.norm(np.subtract(thrown.metrics["landing_point"], LOB["position"])[:2]) < LANDED_M
    assert [(each["object"], each["state"]) for each in own_rig.world()["objects"]] == [(1, "landed")]

    stood = own_rig.state()
    missed = own_rig.throw(LOB)
    assert missed.outcome == "refused"
    assert "the gripper closed on nothing: " in missed.reason
    assert ("input 4 is low" if by == "input" else "reports no object") in missed.reason
    assert missed.metrics["grip"] == {"held": False, "by": by, "opened_again": True}
    assert not missed.metrics["released"]
    assert "streaming" not in own_rig.states(missed.id)
    state = own_rig.state()
    assert (state["moved_at"], state["q"]) == (stood["moved_at"], stood["q"])
    own_rig.until(lambda: own_rig.state()["gripper_open"])  # as it was before, for the next try
    assert not own_rig.is_latched()
    assert len(own_rig.world()["releases"]) == 1


@pytest.fixture(scope="module")
def sensing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """A rig whose gripper has an object again as soon as it is closed, and an input that shows it."""
    rig = Rig(tmp_path_factory.mktemp("sensing"))
    rig.set_gripper(GRIP_SENSOR)
    rig.start()
    yield rig
    rig.stop()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["speedj", "script"])
def test_an_object_that_slips_out_in_the_launch_ends_it_and_is_told(sensing: Rig, mode: str) -> None:
    sensing.stand_up()
    id = sensing.queue_when_ready(LONG_LOB, mode)
    sensing.in_launch(id, FAST_RAD_S)
    released = len(sensing.world()["releases"])
    sensing.fault("object_lost")
    row = sensing.end(id)
    assert row.outcome == "released_early", row.reason
    assert "slipped out of the gripper: input 4 went low" in row.reason
    assert row.metrics["grip"]["held"]
    assert len(sensing.world()["releases"]) == released + 1
    agrees_with_the_truth(sensing, row, released)
    assert sensing.is_latched()


def test_a_gripper_found_closed_on_nothing_stays_closed(sensing: Rig) -> None:
    sensing.stand_up()
    switch(sensing, not sensing.cell.gripper.open_level)
    sensing.until(lambda: sensing.state()["gripper_holds"] is not None)
    sensing.fault("digital_input", index=4, on=False)  # a broken wire, or an object too thin to be seen
    row = sensing.throw(LOB)
    sensing.fault("digital_input", index=4, on=True)
    assert (row.outcome, row.metrics["grip"]["held"]) == ("refused", False), row.reason
    assert not row.metrics["grip"]["opened_again"]
    assert "the gripper is closed and holds nothing: input 4 is low" in row.reason
    assert not sensing.state()["gripper_open"]


@pytest.mark.parametrize("fault", [fault.name for fault in INPUT_FAULTS])
def test_the_fault_matrix_has_it(sensing: Rig, fault: str) -> None:
    result = run_cell(sensing, PHASE["launch"], FAULT[fault])
    assert result.broken() == []
    assert result.outcome == "released_early", result.reason


@pytest.mark.slow
def test_a_cell_that_cannot_see_the_grip_says_nothing_of_it(rig: Rig, tmp_path: Path) -> None:
    assert "grip" not in rig.quiet_throw(LOB).metrics

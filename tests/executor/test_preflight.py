"""Preflight: every refusal, in plain words."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import orjson
import pytest

from executor.preflight import (
    ExecutionRefused,
    control_warnings,
    gripper_is_open,
    output_level_warnings,
    prove_plan,
    refusals,
    verify_plan,
)
from executor.robot import ControlMode, RobotState
from planner.passages import OutputSwitch, Passage
from store import ProfileRow
from tests.executor.conftest import Prepared


@pytest.fixture
def state(prepared: Prepared) -> RobotState:
    cell = prepared.cell
    return RobotState(
        seen_at=time.monotonic(), timestamp_s=1.0, q=tuple(cell.home), qd=(0.0,) * 6, target_qd=(0.0,) * 6,
        robot_mode=7, safety_bits=1, runtime_state=1, speed=1.0, outputs=0, payload_kg=cell.tool.mass_kg,
        tcp_offset=(*cell.tool.X_FT[:3, 3], 0.0, 0.0, 0.0),
    )  # fmt: skip


def test_a_robot_in_order_is_not_refused(prepared: Prepared, state: RobotState) -> None:
    assert refusals(prepared.cell, state, "remote") == []


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"robot_mode": 3}, "powered off"),
        ({"robot_mode": 5}, "brakes not released"),
        ({"robot_mode": 99}, "mode 99"),
        ({"safety_bits": 1 << 2 | 1 << 10}, "protective stop"),
        ({"safety_bits": 1 << 6}, "emergency stop"),
        ({"speed": 0.5}, "speed slider is at 50%"),
        ({"qd": (0.0, 0.2, 0.0, 0.0, 0.0, 0.0)}, "moving at 0.200 rad/s"),
        ({"payload_kg": 3.0}, "payload of 3.00 kg"),
        ({"payload_kg": 0.0}, "payload of 0.00 kg"),
        ({"tcp_offset": (0.0, 0.0, 0.1, 0.0, 0.0, 0.0)}, "70.0 mm"),
        ({"tcp_offset": (0.0, 0.0, 0.17, 0.0, 0.5, 0.0)}, "0.500 rad"),
    ],
)
def test_each_reason_is_reported(prepared: Prepared, state: RobotState, change: dict, word: str) -> None:
    reasons = refusals(prepared.cell, replace(state, **change), "remote")
    assert len(reasons) == 1
    assert word in reasons[0]


def test_all_reasons_are_reported_at_once(prepared: Prepared, state: RobotState) -> None:
    assert len(refusals(prepared.cell, replace(state, robot_mode=3, speed=0.5), "local")) == 3


@pytest.mark.parametrize(
    ("mode", "version", "word"),
    [
        ("local", (5, 11, 1), "at the top right"),
        ("local", (10, 14, 0), "in the safety overview"),
        (None, (5, 11, 1), "does not answer, and ur_rtde needs it"),
        (None, None, "the dashboard at 127.0.0."),
    ],
)
def test_remote_control_must_be_on(
    prepared: Prepared, state: RobotState, mode: ControlMode | None, version: tuple[int, ...] | None, word: str
) -> None:
    (reason,) = refusals(prepared.cell, state, mode, version)
    assert word in reason


def test_a_controller_that_does_not_know_remote_control_may_be_cb3(prepared: Prepared, state: RobotState) -> None:
    assert bool(refusals(prepared.cell, state, "unknown")) == (prepared.cell.robot.generation != "CB3")


@pytest.mark.parametrize(("mode", "word"), [(None, "does not answer"), ("unknown", "from PolyScope 10.12 on")])
def test_polyscope_x_may_move_without_a_dashboard_and_says_what_nobody_knows(
    prepared: Prepared, state: RobotState, mode: ControlMode | None, word: str
) -> None:
    assert refusals(prepared.cell, state, mode, (10, 11, 0)) == []
    (warning,) = control_warnings(mode, (10, 11, 0))
    assert word in warning
    assert control_warnings(mode, (5, 11, 1)) == control_warnings("remote", (10, 11, 0)) == []


def test_values_that_the_controller_does_not_publish_are_not_checked(prepared: Prepared, state: RobotState) -> None:
    assert refusals(prepared.cell, replace(state, payload_kg=None, tcp_offset=None), "remote") == []


def test_without_a_state_nothing_moves(prepared: Prepared) -> None:
    assert "no state" in refusals(prepared.cell, None, "remote")[0]


class TestPlan:
    """The plan is certified again, with the executor's own cell."""

    @pytest.fixture
    def document(self, prepared: Prepared) -> dict:
        return orjson.loads(prepared.document)

    def test_a_good_plan_passes(self, prepared: Prepared, document: dict) -> None:
        _, trajectory, _ = verify_plan(orjson.dumps(document), prepared.cell)
        assert np.array_equal(trajectory.q, document["trajectory"]["positions"])

    def test_a_good_plan_is_proven(self, prepared: Prepared, document: dict) -> None:
        prove_plan(orjson.dumps(document), prepared.cell)

    def test_a_plan_that_is_not_proven_is_refused_with_check_and_time(self, prepared: Prepared, document: dict) -> None:
        document["request"]["limits"] = {"velocity": 1.0}
        with pytest.raises(ExecutionRefused, match=r"is violated: violated: joint_velocity at 0\.\d+ s: \w+_joint"):
            prove_plan(orjson.dumps(document), prepared.cell)

    def test_a_plan_that_is_not_covered_is_refused_and_says_so(self, prepared: Prepared, document: dict) -> None:
        document["profile"] = "one"
        with pytest.raises(ExecutionRefused, match="not covered: profile one, whose numbers are not given"):
            prove_plan(orjson.dumps(document), prepared.cell)

    def test_a_plan_of_a_learnt_cell_is_proven_with_its_profile(self, prepared: Prepared, document: dict) -> None:
        document["profile"] = "one"
        cell = prepared.cell
        learnt = {
            "cell_sha256": cell.sha256,
            "lag_s": cell.timing.lag_s,
            "delay_s": cell.gripper.delay_s,
            "jitter_s": cell.gripper.jitter_s,
            "speed_factor": 1.0,
            "drag_coefficient": cell.object.drag_coefficient,
        }
        row = ProfileRow("one", 0.0, cell.name, cell.sha256, "test", "", orjson.dumps(learnt))
        prove_plan(orjson.dumps(document), cell, row)
        with pytest.raises(ExecutionRefused, match="made with one, not with two"):
            prove_plan(orjson.dumps(document), cell, replace(row, id="two"))

    def test_another_cell_file_is_refused(self, prepared: Prepared, document: dict) -> None:
        other = replace(prepared.cell, sha256="0" * 64)
        with pytest.raises(ExecutionRefused, match="another version of the cell"):
            verify_plan(orjson.dumps(document), other)

    def test_a_plan_of_another_profile_is_refused_and_the_adopted_one_moves_no_limit(
        self, prepared: Prepared, document: dict
    ) -> None:
        cell = prepared.cell
        numbers = {"lag_s": 0.031, "delay_s": 0.052, "jitter_s": 0.004, "drag_coefficient": 0.0}
        row = ProfileRow("one", 0.0, cell.name, cell.sha256, "test", "", orjson.dumps(numbers))
        with pytest.raises(ExecutionRefused, match="made with profile None, not one"):
            verify_plan(orjson.dumps(document), cell, row)
        with pytest.raises(ExecutionRefused, match="made with profile one, not None"):
            verify_plan(orjson.dumps({**document, "profile": "one"}), cell)
        problem, _, _ = verify_plan(orjson.dumps({**document, "profile": "one"}), cell, row)
        assert (problem.cell.timing.lag_s, problem.cell.gripper.delay_s) == (0.031, 0.052)
        for name in ("limits", "safety", "surroundings", "tool", "robot"):
            assert getattr(problem.cell, name) is getattr(cell, name)

    def test_a_flight_with_another_speed_than_the_profiles_is_refused(self, prepared: Prepared, document: dict) -> None:
        """A plan that states none is of an earlier version: its aim has the speed in it."""
        cell = prepared.cell
        numbers = {"lag_s": 0.02, "delay_s": 0.04, "jitter_s": 0.003, "drag_coefficient": 0.0}
        row = ProfileRow("one", 0.0, cell.name, cell.sha256, "t", "", orjson.dumps(numbers | {"speed_factor": 0.96}))
        with pytest.raises(ExecutionRefused, match=r"flight\.release_speed_factor = 1\.0, not 0\.96: plan again"):
            verify_plan(orjson.dumps({**document, "profile": "one"}), cell, row)
        names = ("release_speed_factor", "drag_coefficient", "drag_per_m")
        silent = {key: value for key, value in document["flight"].items() if key not in names}
        problem, _, _ = verify_plan(orjson.dumps({**document, "profile": "one", "flight": silent}), cell, row)
        assert problem.release_speed_factor == 1.0

    @pytest.mark.parametrize("name", ["positions", "velocities", "accelerations"])
    def test_a_plan_that_was_tampered_with_is_refused(self, prepared: Prepared, document: dict, name: str) -> None:
        samples = [row.copy() for row in document["trajectory"][name]]
        samples[100 % len(samples)][2] += 0.05
        tampered = {**document, "trajectory": {**document["trajectory"], name: samples}}
        with pytest.raises(ExecutionRefused, match="fails the certificate that the executor made"):
            verify_plan(orjson.dumps(tampered), prepared.cell)

    def test_a_plan_without_its_samples_is_refused(self, prepared: Prepared, document: dict) -> None:
        with pytest.raises(ExecutionRefused, match="cannot be read"):
            verify_plan(orjson.dumps({k: v for k, v in document.items() if k != "trajectory"}), prepared.cell)

    @pytest.mark.parametrize(("document", "word"), [(b"{}", "no 'cell'"), (b"[]", "be read"), (b"{", "be read")])
    def test_a_document_that_is_no_plan_is_refused(self, prepared: Prepared, document: bytes, word: str) -> None:
        with pytest.raises(ExecutionRefused, match=word):
            verify_plan(document, prepared.cell)


def test_a_plan_of_version_0_1_is_certified_as_it_was_made(prepared: Prepared) -> None:
    """It states no window, and its request had none: the robust default of today does not hold for it."""
    plan = orjson.loads(prepared.document)
    del plan["request"]["release_window_s"]
    for name in ("release_window_s", "landing_tolerance_m", "landing_shift_10ms_m", "object_path"):
        del plan["flight"][name]
    del plan["certificate"]["not_checked"]
    problem, _, _ = verify_plan(orjson.dumps(plan), prepared.cell)
    assert not problem.is_robust


@pytest.mark.parametrize("open_level", [True, False])
def test_the_gripper_is_open_at_its_own_level(prepared: Prepared, state: RobotState, open_level: bool) -> None:
    gripper = replace(prepared.cell.gripper, output="tool_digital", index=1, open_level=open_level)
    cell = replace(prepared.cell, gripper=gripper)
    assert gripper_is_open(cell, replace(state, outputs=1 << 17)) is open_level
    assert gripper_is_open(cell, replace(state, outputs=1 << 16)) is not open_level


@pytest.mark.parametrize(("outputs", "named"), [(0, ["4 is off already"]), (1 << 3 | 1 << 4, ["3 is on already"])])
def test_an_output_that_has_the_level_of_its_first_edge_is_named(
    prepared: Prepared, state: RobotState, outputs: int, named: list[str]
) -> None:
    edges = [(3, True, 0.0), (3, False, 0.1), (4, False, 0.0), (4, True, 0.1)]
    switches = tuple(OutputSwitch("standard_digital", *edge) for edge in edges)
    problem = replace(prepared.problem, passages=(Passage("a", prepared.problem.release, switches, True),))
    found = output_level_warnings(problem, prepared.trajectory, replace(state, outputs=outputs))
    assert [warning.split(":")[0].removeprefix("standard_digital ") for warning in found] == named

"""Telemetry, recording and metrics of an artificial run, computed from its plan."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import orjson
import pytest
from mcap.reader import make_reader

from executor.records import (
    Landing,
    ObservedLanding,
    RunResult,
    Telemetry,
    arm_timing,
    metrics,
    release_verdict,
    to_mcap,
    to_samples,
)
from executor.records.recording import COUNTS
from executor.records.telemetry import column_names
from executor.shared_memory import SCALARS, VECTORS
from learning import CellKnowledge, StreamedArm, learn_joint_speeds, prior_knowledge
from planner.certificate import release_flight
from store.samples import samples_csv
from tests.executor.conftest import Prepared

ABOUT = {"execution": "e", "plan": "p", "cell": "c", "cell_sha256": "0", "outcome": "completed"}


def perfect(prepared: Prepared, offset: float = 0.0) -> Telemetry:
    """Returns the telemetry of an arm that is `offset` [rad] off the plan in joint 2, and as fast as planned."""
    clock = np.arange(0.0, prepared.trajectory.duration_s, prepared.trajectory.dt)
    q, qd, _ = prepared.trajectory.at(clock)
    measured = q + np.array([0.0, offset, 0.0, 0.0, 0.0, 0.0])
    columns = {"clock_s": clock, "timestamp_s": 100.0 + clock, "host_s": 5.0 + clock, "safety_bits": clock * 0 + 1,
               "runtime_state": clock * 0 + 2, "speed_scaling": clock * 0 + 1, "digital_outputs": clock * 0,
               "digital_inputs": clock * 0, "missed_ticks": clock * 0, "call_s": clock * 0 + 3e-5}  # fmt: skip
    vectors = {"planned_q": q, "planned_qd": qd, "command": qd, "q": measured, "qd": qd, "current": qd * 0}
    scalars = np.stack([columns[name] for name in SCALARS], axis=1)
    return Telemetry(np.hstack([scalars, *(vectors[name] for name in VECTORS)]))


def ended(telemetry: Telemetry, prepared: Prepared) -> RunResult:
    sent = prepared.trajectory.release_time_s - prepared.cell.gripper.delay_s - prepared.cell.timing.lag_s
    return RunResult("completed", "", telemetry.rows, 0, True, sent, 0.0, 100.0, True)


def test_a_perfect_run_has_perfect_metrics(prepared: Prepared) -> None:
    trajectory = prepared.trajectory
    problem = prepared.problem
    telemetry = perfect(prepared)
    flight = release_flight(problem, trajectory)
    landing = Landing(100.0 + trajectory.release_time_s, flight.landing_point, "bin")
    result = replace(ended(telemetry, prepared), moved_between=(100.2, 100.3))
    found = metrics(problem, trajectory, result, landing)
    assert found["ticks"] == len(telemetry)
    assert found["gripper_moved_s"] == pytest.approx([0.2, 0.3])
    assert found["period_p50_s"] == pytest.approx(trajectory.dt)
    assert found["tracking_error_max_rad"] == found["tracking_error_max_m"] == 0.0
    assert found["release_velocity_error_rad_s"] == pytest.approx(0.0, abs=1e-9)
    assert found["gripper_opened_s"] == pytest.approx(trajectory.release_time_s)
    assert found["gripper_opened_late_s"] == pytest.approx(0.0)
    assert (found["landing_error_m"], found["landed_on"]) == (0.0, "bin")
    assert orjson.dumps(found)


def test_an_offset_shows_in_radians_and_metres(prepared: Prepared) -> None:
    found = metrics(prepared.problem, prepared.trajectory, ended(perfect(prepared, 0.01), prepared), None)
    assert found["tracking_error_max_rad"] == pytest.approx(0.01)
    assert 0.002 < found["tracking_error_max_m"] < 0.012  # 0.01 rad at 0.2 to 1.2 m
    assert found["landing_point"] is None
    assert found["gripper_moved_s"] is found["gripper_opened_s"] is None


def test_a_run_without_a_tick_has_metrics_too(prepared: Prepared) -> None:
    nothing = RunResult("aborted", "", np.empty((0, 45)), 0, False, None, 0.0, 0.0, True)
    found = metrics(prepared.problem, prepared.trajectory, nothing, None)
    assert found["ticks"] == 0
    assert found["period_p50_s"] is None
    assert found["released"] is False


@pytest.mark.parametrize(
    ("faster", "late_ticks", "outcome"),
    [(0.0, 0, None), (0.003, 0, None), (0.01, 0, "completed"), (-0.01, 0, "completed"), (0.0, 1, "late")],
)
def test_a_release_that_was_not_as_planned_has_a_verdict(
    prepared: Prepared, faster: float, late_ticks: int, outcome: str | None
) -> None:
    telemetry = perfect(prepared)
    telemetry.vector("qd")[:] *= 1.0 + faster
    run = replace(ended(telemetry, prepared), output_late_s=late_ticks * prepared.problem.dt)
    landing = Landing(run.timestamp_at_zero + prepared.trajectory.release_time_s, None)
    found = metrics(prepared.problem, prepared.trajectory, run, landing)
    assert found["release_velocity_error_share"] == pytest.approx(abs(faster), abs=1e-4)
    verdict = release_verdict(prepared.problem, prepared.trajectory, found, landing)
    assert (verdict and verdict[0]) == outcome
    assert outcome != "completed" or (verdict and "warning: at the release a joint's speed was 1.0%" in verdict[1])


def test_a_speed_that_the_profile_expects_is_no_warning(prepared: Prepared) -> None:
    """The gains are 1.04: known of, the aim has made up for them; unknown, or 8 % more than known, they are said."""
    trajectory = prepared.trajectory
    cell = prepared.cell
    nothing = np.zeros((0, 6))
    sure = replace(learn_joint_speeds(nothing, nothing), gain_std=np.full(6, 0.002), shape=50.0, scale=50.0 * 0.003**2)
    known = replace(prior_knowledge(cell), arm=StreamedArm(cell.timing.lag_s, np.full(6, 1.04)), speeds=sure)
    telemetry = perfect(prepared)
    clock = telemetry.scalar("clock_s")
    telemetry.vector("qd")[:] += known.arm.deviation(trajectory, cell.timing.lag_s, cell.robot.qd_max, clock)[1]
    run = ended(telemetry, prepared)
    landing = Landing(100.0 + trajectory.release_time_s, None)

    def verdict(knowledge: CellKnowledge | None) -> tuple[str, str] | None:
        numbers = metrics(prepared.problem, trajectory, run, landing, known=knowledge)
        return release_verdict(prepared.problem, trajectory, numbers, landing)

    assert verdict(known) is None
    said = verdict(None)
    assert said is not None and said[1].endswith("off the plan's")
    telemetry.vector("qd")[:] *= 1.08
    said = verdict(known)
    assert said is not None and said[1].endswith("rad/s beyond what the profile expects")


def test_an_arm_that_is_late_does_not_leave_its_path_and_the_lag_to_set_is_said(prepared: Prepared) -> None:
    trajectory = prepared.trajectory
    lag = prepared.cell.timing.lag_s
    off_path = metrics(prepared.problem, trajectory, ended(perfect(prepared, 0.05), prepared), None)
    assert off_path["path_error_max_m"] > prepared.cell.surroundings.clearance_m

    late_s = 0.006
    late = perfect(prepared)
    clock = late.scalar("clock_s")
    for name, samples in zip(("q", "qd"), trajectory.at(clock - late_s), strict=False):
        late.vector(name)[:] = samples
    late.vector("command")[:] = trajectory.at(clock + lag)[1]
    timing = arm_timing(prepared.cell, late, "speedj", 40.0)
    assert timing is not None
    assert timing["lag_s"] == pytest.approx(lag + late_s, abs=5e-4)
    found = metrics(prepared.problem, trajectory, ended(late, prepared), None, timing)
    assert found["path_error_max_m"] < 0.1 * prepared.cell.surroundings.clearance_m
    verdict = release_verdict(prepared.problem, trajectory, found, Landing(101.0, None))
    assert verdict is not None and verdict[0] == "completed"
    assert "set timing.lag_s to 0.02" in verdict[1]


@pytest.mark.parametrize(("kind", "observed"), [("sim", True), ("ur", False)])
def test_an_object_that_stayed_is_reported_where_that_can_be_observed(
    prepared: Prepared, kind: str, observed: bool
) -> None:
    problem = replace(prepared.problem, cell=replace(prepared.cell, link=replace(prepared.cell.link, kind=kind)))
    found = metrics(problem, prepared.trajectory, ended(perfect(prepared), prepared), None)
    verdict = release_verdict(problem, prepared.trajectory, found, None)
    assert (verdict is not None) == observed
    assert verdict is None or (verdict[0] == "completed" and "gripper" in verdict[1])


@pytest.mark.parametrize(("off_m", "std_m", "is_far"), [(0.03, 0.0, False), (1.7, 0.0, True), (0.2, 0.1, False)])
def test_a_landing_far_from_the_plan_is_not_completed_without_a_word(
    prepared: Prepared, off_m: float, std_m: float, is_far: bool
) -> None:
    planned = release_flight(prepared.problem, prepared.trajectory)
    assert planned is not None
    seen = ObservedLanding(planned.landing_point + np.array([off_m, 0.0, 0.0]), std_m)
    run = ended(perfect(prepared), prepared)
    landing = Landing(run.timestamp_at_zero + prepared.trajectory.release_time_s, None, "floor", seen)
    numbers = metrics(prepared.problem, prepared.trajectory, run, landing)
    verdict = release_verdict(prepared.problem, prepared.trajectory, numbers, landing)
    assert (verdict is not None) == is_far
    assert verdict is None or f"the object landed {off_m:.2f} m from where it was planned" in verdict[1]


def test_a_late_gripper_command_is_judged_by_the_landing(prepared: Prepared) -> None:
    """Against the flight from where the arm is then, and borne where the landing is held for a window."""
    problem = prepared.problem
    trajectory = prepared.trajectory
    run = replace(ended(perfect(prepared), prepared), output_late_s=2.0 * problem.dt)
    landing = Landing(run.timestamp_at_zero + trajectory.release_time_s, None)
    numbers = metrics(problem, trajectory, run, landing)
    verdict = release_verdict(problem, trajectory, numbers, landing)
    later = replace(trajectory, release_index=trajectory.release_index + 2)
    then = release_flight(problem, later)
    planned = release_flight(problem, trajectory)
    assert verdict and then and planned
    shift = np.linalg.norm(then.landing_point - planned.landing_point)
    assert shift > 0.005
    assert f"{1e3 * shift:.0f} mm" in verdict[1]
    generous = replace(problem, release_window_s=2.0 * problem.dt, landing_tolerance_m=2.0 * float(shift))
    assert release_verdict(generous, trajectory, numbers, landing) is None


def test_the_csv_reads_back_exactly(prepared: Prepared) -> None:
    telemetry = perfect(prepared, 0.001)
    header, *lines = samples_csv(to_samples(telemetry)).decode().splitlines()
    assert header.split(",") == column_names()
    assert np.array_equal([[float(x) for x in line.split(",")] for line in lines], telemetry.rows)


def test_the_mcap_holds_the_same_rows(prepared: Prepared) -> None:
    telemetry = perfect(prepared, 0.001)
    joints = prepared.cell.robot.joint_names
    data = to_mcap(telemetry, joints, 1000.0, [(1000.5, "streaming")], ABOUT)
    reader = make_reader(io.BytesIO(data))
    schemas = {schema.name for schema in reader.get_summary().schemas.values()}
    assert schemas == {"foxglove.JointStates", "foxglove.Log", "fling.Tick"}
    ticks = []
    measured = []
    for _, channel, message in reader.iter_messages():
        content = orjson.loads(message.data)
        if channel.topic == "/tick":
            ticks.append(content)
        elif channel.topic == "/measured":
            measured.append([joint["position"] for joint in content["joints"]])
            assert [joint["name"] for joint in content["joints"]] == list(joints)
    for name in SCALARS:
        kind = int if name in COUNTS else float
        assert [tick[name] for tick in ticks] == [kind(x) for x in telemetry.scalar(name)]
    assert np.array_equal(measured, telemetry.vector("q"))
    assert dict(next(reader.iter_metadata()).metadata) == ABOUT


def test_an_empty_recording_opens(prepared: Prepared) -> None:
    data = to_mcap(Telemetry(np.empty((0, 45))), prepared.cell.robot.joint_names, 0.0, [(1.0, "refused")], ABOUT)
    assert len(list(make_reader(io.BytesIO(data)).iter_messages())) == 1

"""Requests become problems and back; every refused field is named, all at once."""

import json
from dataclasses import replace

import numpy as np
import pytest

from planner.answer import plan_document, plan_from_document
from planner.certificate import certify
from planner.errors import InvalidProblem
from planner.planning import plan
from planner.problem import JointRelease, Opening, PointRelease, PoseRelease, TargetRelease
from planner.request import problem_from_request, request_document
from tests.planner.problems import cell

IN_BIN = {"kind": "target", "position": [1.2, 0.2, 0.0]}
POINT = {"kind": "point", "position": [0.5, 0.2, 0.6], "velocity": [0.8, 0.3, 0.8]}
STILL = {"linear": [0, 0, 0], "angular": [0, 0, 0]}
POSE = {"kind": "pose", "pose": {"position": [0, 0, 1]}, "twist": STILL}  # without an orientation


def test_kinds_and_frames():
    here = cell("sdu-table")
    world = problem_from_request({"release": POINT}, here).release
    base = problem_from_request({"release": POINT, "frame": "base"}, here).release
    assert isinstance(world, PointRelease)
    assert isinstance(base, PointRelease)
    np.testing.assert_allclose(world.p_WT, POINT["position"])
    np.testing.assert_allclose(base.p_WT, here.X_WB[:3, :3] @ POINT["position"] + here.X_WB[:3, 3])
    np.testing.assert_allclose(base.v_WT, here.X_WB[:3, :3] @ POINT["velocity"])
    turned = {"position": [0.5, 0.2, 0.6], "rotation_vector": [0.0, 0.0, np.pi / 2]}
    half = np.sqrt(0.5)
    by_quaternion = {"position": [0.5, 0.2, 0.6], "quaternion": [0.0, 0.0, half, half]}
    twist = {"linear": [0.1, 0, 0], "angular": [0, 0, 0.2]}
    one = problem_from_request({"release": {"kind": "pose", "pose": turned, "twist": twist}}, cell()).release
    other = problem_from_request({"release": {"kind": "pose", "pose": by_quaternion, "twist": twist}}, cell()).release
    assert isinstance(one, PoseRelease)
    assert isinstance(other, PoseRelease)
    np.testing.assert_allclose(one.X_WT, other.X_WT, atol=1e-12)
    joint = {"kind": "joint", "positions": [0.1] * 6, "velocities": [0.0] * 6}
    assert isinstance(problem_from_request({"release": joint}, cell()).release, JointRelease)
    target = problem_from_request(
        {"release": {"kind": "target", "position": [1, 0, 0], "min_elevation_rad": 0.4}}, cell()
    )
    assert isinstance(target.release, TargetRelease)
    assert target.release.min_elevation_rad == 0.4


def test_defaults():
    problem = problem_from_request({"release": POINT}, cell())
    np.testing.assert_array_equal(problem.start, cell().home)
    assert (problem.backend, problem.time_limit_s, problem.release_window_s) == ("auto", 120.0, 0.0)


def test_numbers_of_numpy_are_numbers():
    numbers = {"release_window_s": 0.02, "landing_tolerance_m": 0.005}
    plain = problem_from_request({"release": POINT, "limits": {"velocity": [1.0] * 6}, **numbers}, cell())
    given = {"release": POINT, "limits": {"velocity": np.ones(6)}, "singularity_distance_min": np.float32(0.25)}
    given |= {"time_limit_s": np.int64(5)} | {key: np.float32(value) for key, value in numbers.items()}
    other = problem_from_request(given, cell())
    assert other.release_window_s == pytest.approx(plain.release_window_s)
    assert other.landing_tolerance_m == pytest.approx(plain.landing_tolerance_m)
    assert (other.time_limit_s, other.limits.singularity_distance_min) == (5.0, 0.25)
    np.testing.assert_array_equal(other.limits.qd_max, plain.limits.qd_max)
    with pytest.raises(InvalidProblem, match="release_window_s"):
        problem_from_request({"release": POINT, "release_window_s": np.True_}, cell())
    for key in ("release_window_s", "landing_tolerance_m", "time_limit_s"):
        with pytest.raises(InvalidProblem, match=f"{key}: must be at most"):
            problem_from_request({"release": POINT, key: 10**400}, cell())


def test_targets_are_robust_unless_switched_off():
    here = cell()
    steady = replace(here, gripper=replace(here.gripper, jitter_s=0.0))
    shaky = replace(here, gripper=replace(here.gripper, jitter_s=0.004))
    target = {"release": {"kind": "target", "position": [1.2, 0.2, 0.0]}}
    robust = problem_from_request(target, shaky)
    assert (robust.release_window_s, robust.landing_tolerance_m) == (pytest.approx(0.012), 0.02)
    assert robust.is_robust
    assert problem_from_request(target, steady).release_window_s == 0.005
    assert not problem_from_request({**target, "release_window_s": 0.0}, shaky).is_robust
    assert not problem_from_request({"release": POINT}, shaky).is_robust


def test_a_request_for_odds_starts_without_a_window():
    target = {"release": {"kind": "target", "position": [1.2, 0.2, 0.0]}}
    asked = problem_from_request({**target, "min_hit_probability": 0.9}, cell())
    assert (asked.release_window_s, asked.landing_tolerance_m) == (0.0, 0.02)
    own = problem_from_request({**target, "min_hit_probability": 0.9, "release_window_s": 0.01}, cell())
    assert own.release_window_s == 0.01
    assert problem_from_request({**target, "min_hit_probability": 0.0}, cell()).release_window_s > 0.0


def test_the_tolerance_follows_the_bin_and_the_object():
    here = cell()
    marble = replace(here, object=replace(here.object, radius_m=0.004))
    target = {"kind": "target", "position": [1.2, 0.2, 0.0]}
    opening = {"radius_m": 0.1, "rim_height_m": 0.2}
    assert problem_from_request({"release": target}, marble).landing_tolerance_m == 0.01
    into_bin = problem_from_request({"release": {**target, "opening": opening}}, marble)
    assert into_bin.landing_tolerance_m == pytest.approx(0.096)
    assert into_bin.release.opening == Opening(0.1, 0.2)


def test_limits_tighten():
    request = {
        "release": POINT,
        "limits": {"velocity": 2.5, "acceleration": [5, 5, 5, 6, 6, 6], "jerk": 150.0},
        "singularity_distance_min": 0.1,
    }
    limits = problem_from_request(request, cell()).limits
    np.testing.assert_array_equal(limits.qd_max, np.full(6, 2.5))
    np.testing.assert_array_equal(limits.qdd_max, [5, 5, 5, 6, 6, 6])
    np.testing.assert_array_equal(limits.jerk_max, np.full(6, 150.0))
    assert limits.singularity_distance_min == 0.1


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"limits": {"velocity": 3.1}}, "limits.velocity[0]"),
        ({"limits": {"velocity": [1, 1, 1]}}, "limits.velocity"),
        ({"limits": {"jerk": 0.0}}, "limits.jerk[0]"),
        ({"limits": {"speed": 1.0}}, "limits.speed"),
        ({"singularity_distance_min": 0.01}, "singularity_distance_min"),
        ({"start": {"positions": [0.0] * 5}}, "start.positions"),
        ({"start": {"positions": [0.0, 0.0, 4.0, 0.0, 0.0, 0.0]}}, "start.positions[2]"),
        ({"start": {"positions": [float("nan")] * 6}}, "start.positions[0]"),
        ({"start": {}}, "start"),
        ({"frame": "tool"}, "frame"),
        ({"backend": "magic"}, "backend"),
        ({"time_limit_s": -1.0}, "time_limit_s"),
        ({"release_window_s": 1.0}, "release_window_s"),
        ({"landing_tolerance_m": float("inf")}, "landing_tolerance_m"),
        ({"min_hit_probability": 0.5}, "min_hit_probability"),  # of a point: there is nothing to hit
        ({"release": IN_BIN, "min_hit_probability": 1.01}, "min_hit_probability"),
        ({"release": IN_BIN, "min_hit_probability": "0.5"}, "min_hit_probability"),
        ({"release": {"kind": "catch"}}, "release.kind"),
        ({"release": {**POINT, "velocity": [1, 2]}}, "release.velocity"),
        ({"release": {**POINT, "velocity": [1, 2, "3"]}}, "release.velocity[2]"),
        ({"release": {**POSE, "pose": {"position": [0, 0, 1], "quaternion": [1, 1, 0, 0]}}}, "release.pose.quaternion"),
        ({"release": POSE}, "release.pose"),
        ({"release": {"kind": "target", "position": [1, 0, 0], "min_elevation_rad": 2.0}}, "release.min_elevation_rad"),
        ({"release": {**IN_BIN, "opening": {"radius_m": 0.01, "rim_height_m": 0.2}}}, "release.opening.radius_m"),
        ({"release": {**IN_BIN, "opening": {"radius_m": 0.1}}}, "release.opening.rim_height_m"),
        ({"release": {**IN_BIN, "opening": 0.1}}, "release.opening"),
        (
            {"release": {"kind": "target", "position": [1, 0, 0], "min_elevation_rad": 1.0, "max_elevation_rad": 0.5}},
            "release.min_elevation_rad",
        ),
    ],
)
def test_every_refusal_names_its_field(change, field):
    with pytest.raises(InvalidProblem) as refusal:
        problem_from_request({"release": POINT, **change}, cell())
    assert field in [error.field for error in refusal.value.errors]


@pytest.mark.parametrize(
    ("change", "field", "known"),
    [
        ({"relase_window_s": 0.01}, "relase_window_s", "release_window_s"),
        ({"start": {"positions": [0.0] * 6, "speeds": [0.0] * 6}}, "start.speeds", "positions"),
        ({"limits": {"speed": None}}, "limits.speed", "velocity, acceleration, jerk"),
        ({"release": {**POINT, "speed": 1.0}}, "release.speed", "kind, position, velocity"),
        ({"release": {"kind": "joint", "position": [0.0] * 6}}, "release.position", "positions"),
        ({"release": {"kind": "target", "max_speed_m_s": 2.0}}, "release.max_speed_m_s", "max_release_speed_m_s"),
        ({"release": {**POSE, "frame": "base"}}, "release.frame", "kind, pose, twist"),
        ({"release": {**POSE, "pose": {"rpy": [0, 0, 0]}}}, "release.pose.rpy", "rotation_vector"),
        ({"release": {**POSE, "twist": {**STILL, "spin": 1.0}}}, "release.twist.spin", "linear, angular"),
    ],
)
def test_unknown_fields_are_refused_with_the_known_ones(change, field, known):
    with pytest.raises(InvalidProblem) as refusal:
        problem_from_request({"release": POINT, **change}, cell())
    reasons = {error.field: error.reason for error in refusal.value.errors}
    assert reasons[field].startswith("there is no such field; ")
    assert known in reasons[field]


@pytest.mark.parametrize("turn", [[0.0, 90.0, 0.0], [4.0, 4.0, 4.0], [0.0, 0.0, -6.3]])
def test_a_rotation_of_more_than_a_full_turn_is_taken_for_degrees(turn):
    release = {**POSE, "pose": {"position": [0.5, 0.2, 0.6], "rotation_vector": turn}}
    with pytest.raises(InvalidProblem) as refusal:
        problem_from_request({"release": release}, cell())
    (error,) = refusal.value.errors
    assert error.field == "release.pose.rotation_vector"
    assert error.reason.endswith("rad, must be a full turn (6.283) at most: degrees?")
    problem_from_request({"release": {**release, "pose": {**release["pose"], "rotation_vector": [0, 0, 6.28]}}}, cell())


def test_a_limit_for_all_joints_is_refused_once():
    release = {"kind": "target", "position": [1.2, 0.3, 0.0]}
    for velocity, count in ((180.0, 1), ([180.0] * 2 + [1.0] * 4, 2)):
        with pytest.raises(InvalidProblem) as refusal:
            problem_from_request({"release": release, "limits": {"velocity": velocity}}, cell())
        assert [error.field for error in refusal.value.errors] == [f"limits.velocity[{i}]" for i in range(count)]


def test_a_limit_for_all_joints_is_refused_by_the_tightest():
    here = cell()
    here = replace(here, limits=replace(here.limits, qd_max=np.array([3.0, 2.0, 2.5, 3.0, 3.0, 3.0])))
    release = {"kind": "target", "position": [1.2, 0.3, 0.0]}
    with pytest.raises(InvalidProblem) as refusal:
        problem_from_request({"release": release, "limits": {"velocity": 9.0}}, here)
    (error,) = refusal.value.errors
    assert (error.field, error.reason) == ("limits.velocity[1]", "9 rad/s loosens the cell's limit of 2 rad/s")
    problem_from_request({"release": release, "limits": {"velocity": 2.0}}, here)
    with pytest.raises(InvalidProblem, match=r"2\.0000000001 rad/s loosens the cell's limit of 2 rad/s"):
        problem_from_request({"release": release, "limits": {"velocity": 2.0000000001}}, here)


def test_all_errors_are_reported_together():
    with pytest.raises(InvalidProblem) as refusal:
        problem_from_request({"release": {"kind": "point"}, "frame": "tool", "limits": {"velocity": 9.0}}, cell())
    fields = {error.field for error in refusal.value.errors}
    assert {"frame", "release.position", "release.velocity", "limits.velocity[0]"} <= fields


@pytest.mark.parametrize(
    "release",
    [
        POINT,
        {"kind": "joint", "positions": [0.1, -1.5, 1.2, -1.3, -1.5, 0.2], "velocities": [0.3, 0.2, 0.1, 0.0, 0.1, 0.2]},
        {
            "kind": "pose",
            "pose": {"position": [0.5, 0.2, 0.6], "rotation_vector": [0.3, -0.2, 0.9]},
            "twist": {"linear": [0.1, 0.2, 0.3], "angular": [0.4, 0.5, 0.6]},
        },
        {"kind": "target", "position": [1.2, 0.2, 0.0]},
        {"kind": "target", "position": [1.2, 0.2, 0.0], "opening": {"radius_m": 0.1, "rim_height_m": 0.2}},
        {
            "kind": "target",
            "position": [1.2, 0.2, 0.0],
            "max_release_speed_m_s": 2.5,
            "min_elevation_rad": 0.1,
            "max_elevation_rad": 0.9,
            "min_horizontal_distance_m": 0.3,
            "release_position": [0.4, 0.1, 0.6],
        },
    ],
    ids=["point", "joint", "pose", "free target", "bin", "bound target"],
)
def test_a_problem_written_as_a_request_is_read_back(release):
    here = cell("sdu-table")
    request = {"release": release, "frame": "base", "limits": {"jerk": 150.0}, "landing_tolerance_m": 0.02}
    request["release_window_s"] = 0.0
    problem = problem_from_request(request, here)
    document = json.loads(json.dumps(request_document(problem, problem.release), allow_nan=False))
    again = problem_from_request(document, here)
    assert getattr(again.release, "opening", None) == getattr(problem.release, "opening", None)
    for name, value in vars(problem.release).items():
        if name == "opening":
            continue
        read = np.asarray(getattr(again.release, name), float)
        np.testing.assert_allclose(read, np.asarray(value, float), atol=1e-12)
    for name, value in vars(problem.limits).items():
        np.testing.assert_array_equal(getattr(again.limits, name), value)
    assert (again.backend, again.time_limit_s) == (problem.backend, problem.time_limit_s)
    assert (again.release_window_s, again.landing_tolerance_m) == (0.0, 0.02)


@pytest.mark.parametrize("arm", ["ur5e-sim", "ur5-sim"])
def test_a_plan_survives_the_way_through_json(arm):
    here = cell(arm)
    request = {"cell": arm, "release": {"kind": "target", "position": [1.3, 0.3, 0.0]}}
    answer = plan(problem_from_request(request, here))
    document = json.loads(json.dumps(plan_document(answer, request, "id", "now"), allow_nan=False))
    problem, trajectory = plan_from_document(document, here)
    np.testing.assert_array_equal(trajectory.q, answer.trajectory.q)
    assert certify(problem, trajectory).valid
    release = document["release"]
    assert release["command_time_s"] == pytest.approx(
        document["release_time_s"] - here.gripper.delay_s - here.timing.lag_s
    )
    assert release["index"] / document["sample_rate_hz"] == pytest.approx(document["release_time_s"])
    assert document["flight"]["landing_point"] == pytest.approx([1.3, 0.3, 0.0], abs=1e-6)
    assert [check["name"] for check in document["certificate"]["checks"] if not check["ok"]] == []


def test_a_window_longer_than_any_is_not_cut_in_silence():
    here = replace(cell(), gripper=replace(cell().gripper, jitter_s=0.07))
    with pytest.raises(InvalidProblem, match=r"release_window_s: three times .* jitter of 0\.07 s is 0\.21 s"):
        problem_from_request({"release": IN_BIN}, here)
    assert problem_from_request({"release": IN_BIN, "release_window_s": 0.2}, here).release_window_s == 0.2
    assert problem_from_request({"release": POINT}, here).release_window_s == 0.0
    odds = {"release": IN_BIN, "min_hit_probability": 0.5}
    assert problem_from_request(odds, here).release_window_s == 0.0
    steadier = replace(here, gripper=replace(here.gripper, jitter_s=0.066))
    assert problem_from_request({"release": IN_BIN}, steadier).release_window_s == pytest.approx(0.198)

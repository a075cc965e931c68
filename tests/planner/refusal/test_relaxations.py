"""What each kind of release may relax: from an easy release to the requested one."""

from dataclasses import replace

import numpy as np
import pytest

from planner.geometry import body_model, tool_pose, tool_state
from planner.kinematics import singularity_distances
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease
from planner.refusal.relaxations import SHARE_MIN, SPEEDS, relaxations
from planner.request import release_document
from tests.planner.problems import cell, joint_problem, with_boxes

JOINT = joint_problem()
TOOL = tool_state(JOINT.cell, JOINT.release.q, JOINT.release.qd)
POSE = replace(JOINT, release=PoseRelease(TOOL.X_WT, TOOL.V_WT))
POINT = replace(JOINT, release=PointRelease(TOOL.p_WT, TOOL.v_WT))
TARGET = replace(JOINT, release=TargetRelease(np.array([1.2, 0.3, 0.0])))


@pytest.mark.parametrize("problem", [JOINT, POINT, TARGET], ids=lambda problem: type(problem.release).__name__)
def test_a_share_of_one_is_as_requested(problem):
    asked = release_document(problem.release)
    for relaxation in (next(relaxations(problem)), list(relaxations(problem))[-1]):
        assert release_document(relaxation(1.0)) == asked


def test_the_whole_pose_is_as_requested_but_for_rounding():
    for relaxation in (next(relaxations(POSE)), list(relaxations(POSE))[-1]):
        assert pytest.approx(POSE.release.X_WT, abs=1e-12) == relaxation(1.0).X_WT
        assert pytest.approx(POSE.release.V_WT) == relaxation(1.0).V_WT


@pytest.mark.parametrize("problem", [JOINT, POSE, POINT], ids=lambda problem: type(problem.release).__name__)
def test_the_mildest_relaxation_is_of_the_speed_alone(problem):
    slower = next(relaxations(problem))
    half = release_document(slower(0.5))
    speeds = {"joint": ("velocities",), "pose": ("twist",), "point": ("velocity",)}[half["kind"]]
    asked = release_document(problem.release)
    assert {key: value for key, value in half.items() if key not in speeds} == {
        key: value for key, value in asked.items() if key not in speeds
    }
    assert not replace(problem, release=slower(0.0)).ends_at_rest


def test_of_a_move_to_rest_no_speed_is_relaxed():
    (relaxation,) = relaxations(replace(JOINT, release=JointRelease(JOINT.release.q, np.zeros(6))))
    assert relaxation(0.5).q == pytest.approx((JOINT.start + JOINT.release.q) / 2.0)


@pytest.mark.parametrize("problem", [JOINT, POSE, POINT], ids=lambda problem: type(problem.release).__name__)
def test_the_last_relaxation_leads_to_the_start(problem):
    *_, last = relaxations(problem)
    near = last(0.0)
    home = tool_pose(problem.cell, problem.start)[:3, 3]
    match near:
        case JointRelease(q, _):
            assert np.abs(q - problem.start).max() <= SHARE_MIN * np.abs(JOINT.release.q - problem.start).max() + 1e-9
        case PoseRelease(X_WT=X):
            assert np.linalg.norm(X[:3, 3] - home) == pytest.approx(SHARE_MIN * np.linalg.norm(TOOL.p_WT - home))
        case PointRelease(p, _):
            assert np.linalg.norm(p - home) == pytest.approx(SHARE_MIN * np.linalg.norm(TOOL.p_WT - home))


@pytest.mark.parametrize("kind", [PointRelease, PoseRelease])
def test_a_place_out_of_reach_moves_to_one_within_it_at_the_same_velocity(kind):
    far = TOOL.X_WT.copy()
    far[:3, 3] = [3.0, 0.3, 0.5]
    velocity = 0.3 * TOOL.V_WT
    release = PoseRelease(far, velocity) if kind is PoseRelease else PointRelease(far[:3, 3], velocity[:3])
    _, moved, *_ = relaxations(replace(JOINT, release=release))
    easy = release_document(moved(0.0))
    asked = release_document(release)
    key = "twist" if kind is PoseRelease else "velocity"
    assert easy[key] == asked[key]
    place = np.array(easy["pose"]["position"] if kind is PoseRelease else easy["position"])
    assert np.linalg.norm(place - JOINT.cell.X_WB[:3, 3]) < 1.3
    assert place[0] > 0.3  # towards what was asked for


def test_a_velocity_beyond_every_place_is_asked_for_more_slowly():
    fast = PointRelease(np.array([0.6, 0.2, 0.5]), np.array([20.0, 0.0, 0.0]))
    speeds = [np.linalg.norm(each(1.0).v_WT) / 20.0 for each in relaxations(replace(JOINT, release=fast))]
    assert speeds == pytest.approx([1.0, SPEEDS[-1], 1.0])


def test_a_target_below_the_floor_is_lifted_onto_it():
    for relaxation in relaxations(replace(JOINT, release=TargetRelease(np.array([1.2, 0.3, -0.2])))):
        assert relaxation(1.0).p_W == pytest.approx([1.2, 0.3, 0.0])


def test_of_a_target_millimetres_were_meant_for_a_share_of_one_is_within_a_throw():
    for relaxation in relaxations(replace(JOINT, release=TargetRelease(np.array([1200.0, 300.0, 0.0])))):
        assert np.linalg.norm(relaxation(1.0).p_W) < 10.0


def test_the_release_position_of_a_target_is_given_up_last():
    release = TargetRelease(np.array([1.2, 0.3, 0.0]), release_position=np.array([0.4, 0.0, 0.7]))
    kept = [each(1.0).release_position is not None for each in relaxations(replace(JOINT, release=release))]
    assert kept == sorted(kept, reverse=True)
    assert True in kept
    assert False in kept


def test_past_a_box_a_target_is_moved_a_little_first():
    here = with_boxes(cell(), ([1.1, -0.5, 0.0], [1.4, 0.02, 0.15]))
    asked = np.array([1.2, 0.0, 0.1])
    problem = replace(JOINT, cell=here, release=TargetRelease(asked))
    places = np.array([relaxation(0.0).p_W - asked for relaxation in relaxations(problem)])
    on_top, below, left, right, behind = places[:5].tolist()
    assert on_top == pytest.approx([0.0, 0.0, 0.05])
    assert below == pytest.approx([0.0, 0.0, -0.1])
    assert (left, right) == (pytest.approx([0.0, 0.2, 0.0]), pytest.approx([0.0, -0.2, 0.0]))
    assert behind == pytest.approx([0.2, 0.0, 0.0])


def test_an_easy_target_is_in_front_of_a_box():
    here = with_boxes(cell(), ([0.6, -1.0, 0.0], [0.7, 1.0, 1.0]))
    problem = replace(JOINT, cell=here, release=TargetRelease(np.array([2.0, 0.0, 0.0])))
    easy = [relaxation(0.0).p_W for relaxation in relaxations(problem)]
    assert any(0.2 < p[0] < 0.6 - here.object.radius_m and abs(p[1]) < 1e-9 for p in easy)


def test_the_closest_place_has_a_posture_away_from_singularities():
    """As found by another way: some drawn posture near home has the place."""
    _, moved, *_ = relaxations(replace(JOINT, release=PointRelease(np.array([3.0, 0.3, 0.5]), np.zeros(3) + 0.2)))
    place = moved(0.0).p_WT
    rng = np.random.default_rng(0)
    q = JOINT.start + rng.uniform(-np.pi, np.pi, (200_000, 6))
    near = np.linalg.norm(tool_pose(JOINT.cell, q)[:, :3, 3] - place, axis=1) < 0.05
    q = q[near]
    regular = singularity_distances(JOINT.cell.robot, q).minimum > JOINT.limits.singularity_distance_min
    assert (body_model(JOINT.cell).clearances(q[regular]).least > 0.0).any()

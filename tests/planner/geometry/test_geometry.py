"""Distances against brute force, capsules against MuJoCo and the arm's dimensions, pairs against sampling."""

import itertools

import mujoco
import numpy as np
import pytest
from scipy.optimize import minimize

from planner.cell import Box, ToolCapsule
from planner.geometry import (
    SELF_CLEARANCE_M,
    arm_capsules,
    body_capsules,
    capsule_endpoints,
    never_clear,
    object_pairs,
    point_segment_distance,
    segment_segment_distance,
    segment_shape_distance,
    self_collision_pairs,
)
from planner.geometry.capsules import Capsule
from planner.kinematics import link_poses
from planner.robots import ROBOT_NAMES, robot
from planner.rotations import matrix_to_quaternion, pose, rotation_vector_to_matrix

RNG = np.random.default_rng(13)
LOWER = np.array([-0.3, -0.2, -0.5])
UPPER = np.array([0.4, 0.1, 0.2])
TOOL = (ToolCapsule(np.zeros(3), np.array([0.0, 0.0, 0.15]), 0.05),)
HOME = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])


def segments(count):
    """Random segments, and the awkward: points, parallel, on one line, crossing, along an axis."""
    p0, p1 = RNG.normal(size=(2, count, 3))
    e = np.eye(3)
    awkward = [(e[0], e[0]), (0 * e[0], e[0]), (e[1], e[0] + e[1]), (2 * e[0], 3 * e[0]), (-e[2], e[2]), (-e[0], e[0])]
    awkward += [(0.3 * e[0], 0.8 * e[0]), (e[0] + 1e-12 * e[1], -e[0]), (0.1 * e[2], 0.1 * e[2])]
    return np.concatenate([p0, [a for a, _ in awkward]]), np.concatenate([p1, [b for _, b in awkward]])


def squared_distance_at_best(p0, p1, q0, q1):
    """Smallest distance of two segments by a bounded quadratic programme from several starts."""

    def gap(x):
        return p0 + x[0] * (p1 - p0) - q0 - x[1] * (q1 - q0)

    def value(x):
        g = gap(x)
        return g @ g, 2 * np.array([g @ (p1 - p0), -g @ (q1 - q0)])

    starts = itertools.product([0.0, 0.5, 1.0], repeat=2)
    found = [minimize(value, s, jac=True, bounds=[(0, 1)] * 2, options={"ftol": 1e-15, "gtol": 1e-12}) for s in starts]
    return np.sqrt(min(f.fun for f in found))


@pytest.mark.slow
def test_segments_against_a_bounded_quadratic_programme():
    p0, p1 = segments(12)
    first, second = (index.ravel() for index in np.indices((len(p0), len(p0))))
    distance = segment_segment_distance(p0[first], p1[first], p0[second], p1[second])
    for i in range(0, len(first), 3):
        expected = squared_distance_at_best(p0[first[i]], p1[first[i]], p0[second[i]], p1[second[i]])
        assert distance[i] == pytest.approx(expected, abs=2e-6)
    swapped = segment_segment_distance(p1[second], p0[second], p0[first], p1[first])
    np.testing.assert_allclose(distance, swapped, rtol=0, atol=1e-12)
    np.testing.assert_allclose(distance[first == second], 0.0, atol=1e-12)


def test_nearly_parallel_segments():
    tilt = np.logspace(-16, -1, 40)[:, None] * np.array([0.0, 1.0, 0.0])
    base = np.zeros((40, 3))
    along = np.tile([1.0, 0.0, 0.0], (40, 1))
    above = np.array([0.2, 0.0, 0.3])
    distance = segment_segment_distance(base, along, base + above - tilt / 2, along + above + tilt / 2)
    np.testing.assert_allclose(distance, 0.3, rtol=0, atol=1e-9)


def test_points_against_dense_sampling_of_a_segment():
    rng = np.random.default_rng(5)
    x = rng.uniform(-1.0, 1.0, (2, 20, 3))
    (p0, p1) = rng.uniform(-0.5, 0.5, (2, 3))
    on_it = p0 + np.linspace(0.0, 1.0, 20001)[:, None] * (p1 - p0)
    sampled = np.linalg.norm(x[..., None, :] - on_it, axis=-1).min(axis=-1)
    np.testing.assert_allclose(point_segment_distance(x, p0, p1), sampled, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(point_segment_distance(x[0, 0], p0, p1), sampled[0, 0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(point_segment_distance(x, p0, p0), np.linalg.norm(x - p0, axis=-1), rtol=1e-14)


def test_boxes_against_dense_sampling():
    p0, p1 = segments(200)
    t = np.linspace(0.0, 1.0, 20001)
    distance = segment_shape_distance(p0, p1, Box(LOWER, UPPER))
    for i in range(0, len(p0), 2):
        points = p0[i] + t[:, None] * (p1[i] - p0[i])
        sampled = np.linalg.norm(points - np.clip(points, LOWER, UPPER), axis=1).min()
        length = np.linalg.norm(p1[i] - p0[i])
        assert -1e-12 <= sampled - distance[i] <= length / 20000


@pytest.mark.parametrize(
    ("p0", "p1", "expected"),
    [
        ([-1, 0, 0], [1, 0, 0], 0.0),  # through
        ([0, 0, 0], [0, 0, 0], 0.0),  # a point inside
        ([1.4, 0, 0], [1.4, 0, 0], 1.0),  # a point outside
        ([-1, 1.1, 0], [1, 1.1, 0], 1.0),  # along a face
        ([0.5, 0.3, -0.1], [0.7, 0.1, -0.1], np.sqrt(0.045)),  # past an edge
    ],
)
def test_boxes_in_closed_form(p0, p1, expected):
    assert segment_shape_distance(p0, p1, Box(LOWER, UPPER)) == pytest.approx(expected, abs=1e-12)


def solid(capsule):
    """MuJoCo refuses a capsule that is a sphere."""
    if (capsule.p0 == capsule.p1).all():
        return f'type="sphere" pos="{text(capsule.p0)}"'
    return f'type="capsule" fromto="{text(capsule.p0)} {text(capsule.p1)}"'


def mujoco_distances(robot_, capsules, pairs, q):
    """Surface distances by MuJoCo, of capsules placed one by one (m, len(pairs))."""
    bodies = "".join(f'<body mocap="true"><geom size="{c.radius_m}" {solid(c)}/></body>' for c in capsules)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    out = []
    for X in link_poses(robot_, q):
        for i, c in enumerate(capsules):
            x, y, z, w = matrix_to_quaternion(X[c.frame, :3, :3])
            data.mocap_pos[i] = X[c.frame, :3, 3]
            data.mocap_quat[i] = [w, x, y, z]
        mujoco.mj_kinematics(model, data)
        out.append([mujoco.mj_geomDistance(model, data, i, j, 10.0, None) for i, j in pairs])
    return np.array(out)


def text(vector):
    return " ".join(f"{x:.17g}" for x in vector)


def surface_distances(capsules, pairs, ends):
    first, second = np.array(pairs).T
    radius = np.array([c.radius_m for c in capsules])
    gap = segment_segment_distance(ends[:, first, 0], ends[:, first, 1], ends[:, second, 0], ends[:, second, 1])
    return gap - radius[first] - radius[second]


@pytest.mark.parametrize("name", ["ur3", "ur5e", "ur20"])
def test_distances_between_the_links_agree_with_mujoco(name):
    arm = robot(name)
    capsules = body_capsules(arm, TOOL)
    q = RNG.uniform(-np.pi, np.pi, (40, 6))
    pairs = self_collision_pairs(arm, TOOL)
    found = surface_distances(capsules, pairs, capsule_endpoints(arm, capsules, q))
    expected = mujoco_distances(arm, capsules, pairs, q)
    apart = expected > 1e-3  # inside one another, MuJoCo reports a depth with a meaning of its own
    np.testing.assert_allclose(found[apart], expected[apart], rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_pairs_left_out_never_meet_or_always_do(name):
    arm = robot(name)
    capsules = body_capsules(arm, TOOL)
    pairs = self_collision_pairs(arm, TOOL)
    others = [pair for pair in itertools.combinations(range(len(capsules)), 2) if pair not in pairs]
    q = RNG.uniform(arm.q_lower, arm.q_upper, (4000, 6))
    near = surface_distances(capsules, others, capsule_endpoints(arm, capsules, q)) < SELF_CLEARANCE_M
    assert np.all(near.all(axis=0) | ~near.any(axis=0))


@pytest.mark.parametrize(("radius_m", "is_ever_clear"), [(0.1, True), (0.12, True), (0.13, False), (0.15, False)])
def test_a_thick_tool_loses_no_pair_and_is_named(radius_m, is_ever_clear):
    arm = robot("ur5e")
    thick = (ToolCapsule(np.zeros(3), np.array([0.0, 0.0, 0.15]), radius_m),)
    capsules = body_capsules(arm, thick)
    pairs = self_collision_pairs(arm, thick)
    beside = [(i, j) for i, j in pairs if (capsules[i].name, capsules[j].name) == ("wrist_1", "tool_0")]
    assert len(beside) == 1
    q = RNG.uniform(arm.q_lower, arm.q_upper, (4000, 6))
    most = surface_distances(capsules, beside, capsule_endpoints(arm, capsules, q)).max()
    assert (most > SELF_CLEARANCE_M) == is_ever_clear
    named = [(pair.names, most <= pair.most_m + 1e-9 < SELF_CLEARANCE_M) for pair in never_clear(arm, thick)]
    assert named == ([] if is_ever_clear else [(("wrist_1", "tool_0"), True)])


def test_a_large_object_loses_no_pair():
    arm = robot("ur5e")
    p_FT = np.array([0.0, 0.0, 0.05])
    held = Capsule(6, p_FT, p_FT, 0.2, "object")
    links = [body_capsules(arm, TOOL)[i].name for i, _ in object_pairs(arm, TOOL, held)]
    assert "wrist_1" in links


def test_known_pairs_of_the_ur5e():
    capsules = body_capsules(robot("ur5e"), TOOL)
    names = {(capsules[i].name, capsules[j].name) for i, j in self_collision_pairs(robot("ur5e"), TOOL)}
    assert {("base", "forearm"), ("shoulder", "wrist_2"), ("upper_arm", "tool_0"), ("forearm", "wrist_3")} <= names
    assert not names & {("base", "shoulder"), ("upper_arm", "elbow"), ("wrist_2", "wrist_3"), ("wrist_3", "tool_0")}


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_the_usual_home_is_free_and_the_folded_arm_is_not(name):
    arm = robot(name)
    capsules = body_capsules(arm, TOOL)
    pairs = self_collision_pairs(arm, TOOL)
    folded = np.array([0.0, -1.57, 3.1, 0.0, -1.57, 0.0])
    distances = surface_distances(capsules, pairs, capsule_endpoints(arm, capsules, np.array([HOME, folded])))
    assert distances[0].min() > 0.01
    assert distances[1].min() < 0.0


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_capsules_hold_the_centres_of_mass(name):
    """Published centres of mass lie inside their link's capsules: the offsets have the right side and size."""
    arm = robot(name)
    capsules = arm_capsules(arm)
    ends = capsule_endpoints(arm, capsules, np.zeros(6))
    X = link_poses(arm, np.zeros(6))
    own = {1: ("base", "shoulder"), 2: ("shoulder", "upper_arm", "upper_arm_start", "elbow")}
    own |= {3: ("elbow", "forearm", "forearm_start", "wrist_1")}
    own |= {4: ("wrist_1", "wrist_2"), 5: ("wrist_2", "wrist_3"), 6: ("wrist_3",)}
    for i, link in enumerate(arm.links, start=1):
        centre = X[i, :3, :3] @ link.com + X[i, :3, 3]
        inside = [
            segment_segment_distance(ends[k, 0], ends[k, 1], centre, centre) - c.radius_m
            for k, c in enumerate(capsules)
            if c.name in own[i]
        ]
        assert min(inside) < 0.0, link.name


def test_endpoints_are_placed_in_the_world():
    arm = robot("ur5e")
    X_WB = pose([0.1, 0.2, 0.3], rotation_vector_to_matrix([0.1, 0.0, 2.0]))
    capsules = body_capsules(arm, TOOL)
    in_base = capsule_endpoints(arm, capsules, HOME)
    in_world = capsule_endpoints(arm, capsules, HOME, X_WB)
    assert in_base.shape == (len(capsules), 2, 3)
    np.testing.assert_allclose(in_world, in_base @ X_WB[:3, :3].T + X_WB[:3, 3], rtol=0, atol=1e-14)
    flange = link_poses(arm, HOME)[6]
    np.testing.assert_allclose(in_base[-1, 1], flange[:3, 3] + 0.15 * flange[:3, 2], rtol=0, atol=1e-14)

"""The kernel against its numpy oracle: function by function, and in certificates and candidates."""

import copy
import pickle
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.backends import ruckig_otg
from planner.cell import Box, Cell, ToolCapsule
from planner.certificate import certify
from planner.dynamics import joint_torques
from planner.flight import fly, landing_states, paths, positions_after
from planner.geometry import body_model, segment_segment_distance, segment_shape_distance
from planner.kinematics import forward, inverse_branches, jacobian, link_poses
from planner.native import Pinned, libraries, loops
from planner.problem import JointRelease, PointRelease, TargetRelease, ThrowProblem
from planner.robots import ROBOT_NAMES, robot
from planner.rotations import pose, rotation_vector_to_matrix
from planner.seeds import Candidate, allocate_velocity, candidates
from planner.trajectory import Trajectory, integrate
from tests.planner.native.examples import EXAMPLES
from tests.planner.native.oracle import twin
from tests.planner.problems import cell

CLOSE = 1e-9  # [m, N m, -] of certificate values
# [-] of the largest value, or absolute where that is below 1: a hundred roundings of the longest sum, which differ by
# the order of its terms
ROUNDING = 1e-12
EXAMPLES_EACH = 20
SOURCES = Path(loops.__file__).parent / "kernel"


@pytest.fixture
def numpy_alone(monkeypatch):
    """Returns a function that puts the oracle in the place of the kernel, for all that follows."""

    def replace_kernel():
        for name in EXAMPLES:
            monkeypatch.setattr(loops, name, twin(name))

    return replace_kernel


def cells() -> list[Cell]:
    """Every arm: some mounted askew, with capsules on the tool, boxes or a heavy object."""
    rng = np.random.default_rng(7)
    found = []
    base = cell()
    for i, name in enumerate(ROBOT_NAMES):
        arm = robot(name)
        here = base
        limits = {key: getattr(arm, key) for key in ("q_lower", "q_upper", "qd_max", "qdd_max", "tau_max")}
        here = replace(here, robot=arm, limits=replace(here.limits, **limits))
        if i % 2:
            turned = rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3))
            here = replace(here, X_WB=pose([0.1, -0.2, 1.5], turned))
        if i % 3 == 0:
            capsules = [ToolCapsule(*rng.uniform(-0.1, 0.1, (2, 3)), 0.03), ToolCapsule(*np.zeros((2, 3)), 0.05)]
            X_FT = pose([0.03, -0.05, 0.2], rotation_vector_to_matrix([0.3, 0.2, -0.4]))
            here = replace(here, tool=replace(here.tool, X_FT=X_FT, capsules=tuple(capsules)))
        if i % 3 == 1:
            here = replace(here, object=replace(here.object, mass_kg=2.5))
        if i % 2 == 0:
            corners = [rng.uniform([-1.0, -0.1, -1.0], [0.0, 0.9, 0.0]) for _ in range(2)]
            boxes = tuple(Box(corner, corner + 0.3) for corner in corners)
            here = replace(here, surroundings=replace(here.surroundings, keep_out=boxes))
        found.append(here)
    return found


def motions(here: Cell, count: int):
    """Random launches of Ruckig with their brakes; many collide or overload a joint."""
    rng = np.random.default_rng(ROBOT_NAMES.index(here.robot.name))
    for _ in range(count):
        q = here.home + rng.uniform(-1.5, 1.5, 6)
        qd = rng.uniform(-0.7, 0.7, 6) * here.limits.qd_max
        problem = ThrowProblem(here, here.home, JointRelease(q, qd), here.limits)
        yield problem, ruckig_otg.solve(problem, Candidate(q, qd, 0.0, "test")).trajectory


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_every_function_gives_the_numbers_of_its_oracle(name):
    rng = np.random.default_rng(1)
    for _ in range(EXAMPLES_EACH):
        arguments = EXAMPLES[name](rng)
        found = getattr(loops, name)(*arguments)
        with np.errstate(invalid="ignore"):
            expected = np.asarray(twin(name)(*arguments))
        assert found.shape == expected.shape
        scale = max(1.0, np.abs(expected[np.isfinite(expected)]).max(initial=0.0))
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=ROUNDING * scale)


def test_every_function_has_an_oracle():
    made_here = [of.__name__ for of in vars(loops).values() if getattr(of, "__module__", "") == loops.__name__]
    public = {name for name in made_here if not name.startswith("_")}
    assert set(EXAMPLES) == set(libraries.SIGNATURES) == public


@pytest.mark.slow
@pytest.mark.parametrize("here", cells(), ids=lambda here: here.robot.name)
def test_certificates_are_the_same_with_and_without_it(here, numpy_alone):
    drawn = list(motions(here, 6))
    compiled = [certify(*each) for each in drawn]
    numpy_alone()
    for with_it, without in zip(compiled, (certify(*each) for each in drawn), strict=True):
        assert [(c.name, c.ok) for c in with_it.checks] == [(c.name, c.ok) for c in without.checks]
        values = [[check.value for check in each.checks] for each in (with_it, without)]
        np.testing.assert_allclose(*values, rtol=CLOSE, atol=CLOSE)


@pytest.mark.parametrize("here", cells(), ids=lambda here: here.robot.name)
def test_clearances_and_torques_are_the_same_with_and_without_it(here, numpy_alone):
    q, qd, qdd = np.random.default_rng(3).uniform(-3.0, 3.0, (3, 40, 6))

    def results():
        free = body_model(here).clearances(q)
        tau = joint_torques(here.robot, q, qd, qdd, [0.3, -0.2, -9.8])
        return link_poses(here.robot, q, here.X_WB), free.floor, free.keep_out, free.self_collision, tau

    compiled = results()
    numpy_alone()
    for with_it, without in zip(compiled, results(), strict=True):
        np.testing.assert_allclose(with_it, without, rtol=1e-12, atol=1e-12)


def test_poses_are_the_same_to_the_bit(numpy_alone):
    q = np.random.default_rng(1).uniform(-6.0, 6.0, (100, 6))
    compiled = [link_poses(robot(name), q) for name in ROBOT_NAMES]
    numpy_alone()
    for name, found in zip(ROBOT_NAMES, compiled, strict=True):
        np.testing.assert_array_equal(found, link_poses(robot(name), q))


def test_what_cannot_be_evaluated_stays_so():
    """A NaN must not be clamped to a distance that passes a check."""
    p0, p1, q0, q1 = np.random.default_rng(2).uniform(-1.0, 1.0, (4, 12, 3))
    for i, ends in enumerate((p0, p1, q0, q1)):
        ends[3 * i : 3 * i + 3][np.eye(3, dtype=bool)] = np.nan
    assert np.isnan(segment_segment_distance(p0, p1, q0, q1)).all()
    assert np.isnan(segment_shape_distance(p0[:6], p1[:6], Box(np.full(3, -0.1), np.full(3, 0.1)))).all()
    q = np.zeros((1, 6))
    q[0, 2] = np.nan
    assert np.isnan(body_model(cell()).clearances(q).self_collision).all()
    assert np.isnan(joint_torques(robot("ur5e"), q, q, q, [0.0, 0.0, -9.8])).any()


def test_the_signatures_are_those_of_the_source():
    source = "\n".join(each.read_text() for each in SOURCES.glob("*.c"))
    declared = dict(re.findall(r"^(?:WIDEST )?void (\w+)\(([^)]*)\)", source, re.MULTILINE))
    for name, signature in libraries.SIGNATURES.items():
        parameters = [" ".join(each.split()) for each in declared[name].split(",")]
        kinds = ["a" if "*" in each or each.startswith("in ") else each[0] for each in parameters]
        assert "".join(kinds).translate(str.maketrans("cd", "nx")) == signature, name


def test_arrays_read_in_place_move_with_their_copies():
    jerk = np.random.default_rng(6).uniform(-1.0, 1.0, (5, 6))
    motion = Trajectory(500.0, *integrate(*np.zeros((3, 6)), jerk, 0.002), release_index=5)
    expected = motion.at(0.005)
    for copied in (pickle.loads(pickle.dumps(motion)), copy.deepcopy(motion)):
        np.testing.assert_array_equal(copied.at(0.005), expected)
        assert copied.samples.of_shapes(*3 * [(6, 6)], (5, 6)) != motion.samples.of_shapes(*3 * [(6, 6)], (5, 6))
    with pytest.raises(ValueError, match="instead of"):
        loops.joint_extremes(0.002, Pinned(*jerk[:4]))


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match="instead of"):
        loops.shape_distances(np.zeros((3, 3)), np.zeros((2, 3)), np.zeros(3, np.intp), np.zeros((1, 20)))


@pytest.mark.slow
def test_flights_with_drag_are_the_same_with_and_without_it(numpy_alone):
    """With one that never lands, and one that is released below the plane on its way up."""
    rng = np.random.default_rng(4)
    p = rng.uniform([-1.0, -1.0, 0.5], [1.0, 1.0, 1.5], (8, 3))
    v = rng.uniform([-3.0, -3.0, -2.0], [3.0, 3.0, 5.0], (8, 3))
    p[0] = [0.0, 0.0, 0.1]
    v[0] = [1.0, 0.0, 0.5]
    p[1] = [0.0, 0.0, 0.1]
    v[1] = [1.0, 0.0, 4.0]
    times = np.concatenate([np.zeros((8, 1)), np.cumsum(rng.uniform(0.0, 0.03, (8, 20)), axis=1)], axis=1)

    def computed():
        each = [fly(*state, 0.3, 9.81, 0.2) for state in zip(p, v, strict=True)]
        apexes = [np.nan if flight is None else flight.apex_height_m for flight in each]
        landed = landing_states(p, v, 0.3, 9.81, 0.2)
        return paths(p, v, times, 9.81, 0.2), positions_after(p, v, times[:, -1], 9.81, 0.2), *landed, np.array(apexes)

    compiled = computed()
    numpy_alone()
    for found, expected in zip(compiled, computed(), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)
    assert np.isnan(compiled[-1]).tolist() == [True] + 7 * [False]
    np.testing.assert_allclose(compiled[0][:, -1], compiled[1], rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("row", [-1, 7])
def test_indices_of_no_row_are_refused(row):
    with pytest.raises(IndexError):
        loops.end_points(np.zeros((2, 7, 4, 4)), np.array([0, row]), np.zeros((2, 2, 3)))


def test_nothing_has_no_distances():
    none = np.zeros((0, 3))
    assert segment_segment_distance(none, none, none, none).shape == (0,)
    assert segment_shape_distance(none, none, Box(np.zeros(3), np.ones(3))).shape == (0,)
    assert body_model(cell()).clearances(np.zeros((0, 6))).least.shape == (0,)


@pytest.mark.parametrize("name", ROBOT_NAMES)
def test_inverse_kinematics_is_the_same_with_and_without_it(name, numpy_alone):
    """With poses out of reach, and one with joint 6 free."""
    q = np.random.default_rng(8).uniform(-3.0, 3.0, (40, 6))
    q[0, 4] = 0.0
    X = forward(robot(name), q)
    X[1:6, :3, 3] *= 3.0
    compiled = inverse_branches(robot(name), X)
    assert np.isnan(compiled[0]).any()
    assert np.isfinite(compiled[0][0]).any()
    numpy_alone()
    for found, expected in zip(compiled, inverse_branches(robot(name), X), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("release", [PointRelease, TargetRelease])
def test_candidates_are_the_same_with_and_without_it(release, numpy_alone):
    here = cell()
    places = (np.array([0.4, -0.3, 0.6]), np.array([0.5, 0.2, 0.3])), (np.array([-1.2, 0.9, 0.1]),)
    problem = ThrowProblem(here, here.home, release(*places[release is TargetRelease]), here.limits)
    compiled = candidates(problem)
    numpy_alone()
    for found, expected in zip(compiled, candidates(problem), strict=True):
        np.testing.assert_allclose([found.q, found.qd], [expected.q, expected.qd], rtol=0.0, atol=CLOSE)


def test_velocities_of_lowered_shares_are_exact(numpy_alone):
    """Also where joints are weighted a million apart: they give the tool its velocity with and without the kernel."""
    arm = robot("ur5e")
    rng = np.random.default_rng(9)
    J = jacobian(arm, rng.uniform(-3.0, 3.0, (400, 6)))[:, :3]
    v = rng.uniform(-1.5, 1.5, (400, 3))
    least = allocate_velocity(J, v, 2.0**20 * arm.qd_max)  # nothing to be lowered, and the same weights
    compiled = allocate_velocity(J, v, arm.qd_max)
    lowered = np.flatnonzero((compiled != least).any(axis=1))
    assert len(lowered) > 20
    numpy_alone()
    for qd in (compiled, allocate_velocity(J, v, arm.qd_max)):
        shares = [(np.abs(each[lowered]) / arm.qd_max).max(axis=1) for each in (qd, least)]
        assert np.mean(shares[0] < shares[1]) > 0.9  # not all: it is no descent
        np.testing.assert_allclose((J @ qd[..., None])[lowered, :, 0], v[lowered], rtol=0.0, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["least_norms", "largest_shares", "lower_shares", "penalised_bounds"])
def test_wider_instructions_change_no_bit(name, tmp_path_factory, monkeypatch):
    """Compares nothing on a processor that has them not."""
    narrow = libraries.kernel(_narrow(tmp_path_factory.getbasetemp()))
    rng = np.random.default_rng(11)
    arguments = EXAMPLES[name](rng)
    wide = getattr(loops, name)(*arguments)
    monkeypatch.setattr(loops, "kernel", lambda: narrow)
    np.testing.assert_array_equal(getattr(loops, name)(*arguments), wide)


def _narrow(folder: Path) -> Path:
    """Returns the kernel compiled without wider instructions."""
    made = folder / "narrow.so"
    if not made.exists():
        flags = ["-O3", "-ffp-contract=off", "-fno-math-errno", "-w", "-DWIDEST=", "-shared", "-fPIC"]
        sources = [str(source) for source in SOURCES.glob("*.c")]
        subprocess.run(["cc", *flags, *sources, "-o", str(made), "-lm"], check=True)
    return made

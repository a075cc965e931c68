"""The flight and the grip against dense samples by the plain functions: distances, accelerations, the way out."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.arm_capsules.truth import flight_gaps
from planner.backends import ruckig_otg
from planner.certificate import certify
from planner.certificate.curves import motion_curves
from planner.errors import Infeasible, SolverFailed
from planner.flight import fly, path
from planner.geometry import body_capsules, capsule_endpoints, tool_pose, tool_state
from planner.kinematics import tcp_acceleration
from planner.planning import plan
from planner.problem import Opening, TargetRelease, ThrowProblem
from planner.seeds import candidates
from tests.planner.problems import ideal_cell as cell
from tests.planner.problems import joint_problem, with_boxes, with_clearance, with_jitter

STEP_S = 0.001  # of the dense samples
SAMPLED_M = 0.004  # half a step at 8 m/s: how much closer a flight may come between dense samples


def throw(here, target, opening=None, **changes):
    """A throw to a target past whatever stands in the way, and the problem with everything in it."""
    release = TargetRelease(np.array(target))
    free = ThrowProblem(with_boxes(here), here.home, release, here.limits)
    asked = ThrowProblem(here, here.home, replace(release, opening=opening), here.limits, **changes)
    for candidate in candidates(free)[:6]:
        try:
            return asked, ruckig_otg.solve(free, candidate).trajectory
        except (Infeasible, SolverFailed):
            continue
    raise SolverFailed("no motion")


def with_factor(here, factor):
    return replace(here, gripper=replace(here.gripper, release_speed_factor=factor))


def random_throws(count, seed, window_s=0.0, drag=0.0, factor=1.0, here=None):
    rng = np.random.default_rng(seed)
    found = 0
    given = here
    names = ("ur5e-sim", "ur3e-sim", "ur10e-sim", "ur5-sim")
    while found < count:
        here = with_factor(given or cell(names[found % 4]), factor)
        boxes = []
        here = replace(here, object=replace(here.object, drag_coefficient=drag))
        for _ in range(rng.integers(0, 4)):
            angle = rng.uniform(-np.pi, np.pi)
            distance = rng.uniform(0.5, 1.3)
            size = rng.uniform(0.02, 0.3, 3)
            middle = distance * np.array([np.cos(angle), np.sin(angle), 0.0])
            boxes.append((middle - size * [1, 1, 0], middle + size * [1, 1, 4]))
        angle = rng.uniform(-np.pi, np.pi)
        distance = rng.uniform(0.25, 1.6)
        target = [distance * np.cos(angle), distance * np.sin(angle), rng.uniform(0.0, 0.5)]
        opening = Opening(rng.uniform(0.05, 0.2), rng.uniform(0.0, 0.4)) if rng.random() < 0.4 else None
        try:
            tolerance = 5.0 if window_s > 0.0 else 0.0
            asked = throw(
                with_boxes(here, *boxes), target, opening, release_window_s=window_s, landing_tolerance_m=tolerance
            )
        except (Infeasible, SolverFailed):
            continue
        found += 1
        yield asked


def test_without_a_window_three_deviations_of_the_gripper_count_as_one():
    """As in a window as long, but for the landing: the object may leave early or late, and must get away."""
    refused = 0
    for problem, trajectory in random_throws(12, 31):
        windowed = certify(replace(problem, release_window_s=0.015, landing_tolerance_m=5.0), trajectory)
        jittery = certify(replace(problem, cell=with_jitter(problem.cell, 0.005)), trajectory)
        alike = [check for check in windowed.checks if check.name != "landing_window"]
        assert list(jittery.checks) == alike
        refused += certify(problem, trajectory).valid and not jittery.valid
    assert refused > 0


def test_a_box_that_only_a_late_release_meets_is_in_the_way_unless_the_gripper_opens_in_time():
    problem = joint_problem(cell=with_jitter(cell(), 0.002))
    trajectory = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
    here = problem.cell
    late = trajectory.release_time_s + 0.006
    q, qd, _ = trajectory.at(np.array([trajectory.release_time_s, late]))
    places = []
    for joints, speeds in zip(q, qd, strict=True):
        tool = tool_state(here, joints, speeds)
        flight = fly(tool.p_WT, tool.v_WT, problem.plane_z, problem.gravity)
        s = 0.5 * flight.time_of_flight_s
        places.append(tool.p_WT + tool.v_WT * s - [0.0, 0.0, 0.5 * problem.gravity * s * s])
        aside = np.array([-tool.v_WT[1], tool.v_WT[0]]) / np.hypot(*tool.v_WT[:2])
    aside *= np.sign((places[1] - places[0])[:2] @ aside)
    edge = places[1][:2] + aside * (here.object.radius_m - 1e-4)
    away = edge + 0.05 * np.sign(aside)
    height = places[1][2] + np.array([-0.02, 0.02])
    box = [*np.minimum(edge, away), height[0]], [*np.maximum(edge, away), height[1]]
    walled = replace(problem, cell=with_boxes(here, box))
    check = certify(walled, trajectory).check("flight_clearance")
    assert (check.ok, check.detail) == (False, "box 0")
    assert check.value == pytest.approx(-1e-4, abs=5e-5)
    in_time = replace(walled, cell=with_jitter(walled.cell, 0.0))
    assert certify(in_time, trajectory).check("flight_clearance").ok
    assert plan(walled).certificate.check("flight_clearance").ok  # the same release, accelerated otherwise


def flown(problem, trajectory, delay):
    """Times on the trajectory and places of the object until it has landed, and of the highest.

    On the floor or a box where it touches it, in the air where its centre passes the target's height.
    """
    release = trajectory.release_time_s + delay
    X_WT, V_WT = tool_state(problem.cell, *trajectory.at(release)[:2])
    s = np.arange(0.0, 2.0, STEP_S)
    x = path(X_WT[:3, 3], problem.cell.gripper.release_speed_factor * V_WT[:3], s, problem.gravity, problem.drag)
    around = problem.cell.surroundings
    plane = problem.plane_z
    radius = problem.cell.object.radius_m
    apex = int(x[:, 2].argmax())
    landed = x[:, 2] < plane
    tops = [(box.upper[2], box.lower[:2], box.upper[:2]) for box in around.keep_out]
    tops += [(around.floor_z_m, np.full(2, -np.inf), np.full(2, np.inf))]
    target = problem.release.p_W
    opening = problem.release.opening
    below = [top for top in tops if ((target[:2] >= top[1]) & (target[:2] <= top[2])).all() and top[0] <= plane + 1e-9]
    for top, lower, upper in sorted(below, key=lambda top: top[0])[-1:]:  # the highest
        if plane - radius < top and x[:, 2].max() >= top + radius:
            over = (x[:, 2] < top + radius) & ((x[:, :2] >= lower) & (x[:, :2] <= upper)).all(axis=1)
            in_bin = opening is None or np.hypot(*(x - target).T[:2]) < opening.radius_m
            landed = landed | over & in_bin
    landed = apex + int(np.argmax(landed[apex:]))
    return release + s[:landed], x[:landed], apex


def from_segment(x, start, end):
    along = end - start
    share = ((x - start) * along).sum(axis=-1) / np.maximum((along * along).sum(axis=-1), 1e-18)
    return np.linalg.norm(x - start - np.clip(share, 0.0, 1.0)[..., None] * along, axis=-1)


def dense_gap(problem, trajectory, delays=(0.0,)):
    """Least distance of the object's surface from links, boxes and wall, and from the tool 10 ms after it is clear."""
    here = problem.cell
    radius = problem.cell.object.radius_m
    gaps = []
    for delay in delays:
        t, x, apex = flown(problem, trajectory, delay)
        capsules = body_capsules(here.robot, here.tool.capsules)
        ends = capsule_endpoints(here.robot, capsules, trajectory.at(t)[0], here.X_WB)
        for i, capsule in enumerate(capsules):
            gap = from_segment(x, ends[:, i, 0], ends[:, i, 1]) - capsule.radius_m - radius
            if capsule.frame == 6 or gap[0] < 0.0:
                left = np.argmax(gap >= 0.0) + round(0.01 / STEP_S) if (gap >= 0.0).any() else len(gap)
                gap = gap[left:][gap[left:] < 0.0]
            gaps += [gap.min()] if len(gap) else []
        for box in here.surroundings.keep_out:
            gaps.append((np.linalg.norm(x - np.clip(x, box.lower, box.upper), axis=1) - radius).min())
        if problem.release.opening is not None:
            rho = np.hypot(*(x - problem.release.p_W).T[:2])
            z = x[:, 2] - problem.release.p_W[2]
            mouth = problem.release.opening.radius_m
            rim = problem.release.opening.rim_height_m
            entered = (np.arange(len(x)) >= apex) & (rho < mouth) & (z < rim)
            gap = np.hypot(rho - mouth, z - np.clip(z, 0.0, rim))[~entered] - radius
            gaps += [gap.min()] if len(gap) else []
    return min(gaps)


@pytest.mark.parametrize(
    ("count", "window_s", "drag", "factor"),
    [(16, 0.0, 0.0, 1.0), (8, 0.015, 0.0, 1.0), (4, 0.0, 1.5, 1.0), (1, 0.009, 1.5, 1.0),
     (6, 0.0, 0.0, 0.9), (4, 0.015, 0.0, 0.9), (4, 0.015, 0.0, 1.2), (1, 0.009, 1.5, 1.2)],
)  # fmt: skip
def test_the_flights_clearance_is_below_dense_samples_and_close(count, window_s, drag, factor):
    answers = []
    for problem, trajectory in random_throws(count, 31, window_s, drag, factor):
        check = certify(problem, trajectory).check("flight_clearance")
        least = dense_gap(problem, trajectory, np.linspace(-window_s, window_s, 7) if window_s else (0.0,))
        if check.ok:
            assert check.value <= least + SAMPLED_M
            assert check.value >= least - 0.04
        else:
            assert least < SAMPLED_M
        answers.append(check.ok)
    assert count < 4 or any(answers)
    assert count < 8 or not all(answers)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "radius_m"), [("arm", 0.05), ("bin", 0.06), ("box", 0.05)])
def test_in_the_air_everything_counts_until_the_centre_passes_the_plane(kind, radius_m):
    """A thick object comes within its radius of the target's height long before the target."""
    rng = np.random.default_rng(5)
    late = 0
    here = replace(cell(), object=replace(cell().object, radius_m=radius_m))
    for _ in range(60):
        angle = rng.uniform(-np.pi, np.pi)
        distance = rng.uniform(*(0.1, 0.5) if kind == "arm" else (0.7, 1.3))
        target = np.array([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(0.3, 1.0)])
        opening = Opening(radius_m + rng.uniform(0.0, 0.03), rng.uniform(0.0, 0.05)) if kind == "bin" else None
        size = rng.uniform(0.005, 0.1, 3)
        boxes = [(target - size, target + size * [1.0, 1.0, 0.0] - [0, 0, 1e-3])] if kind == "box" else []
        try:
            problem, trajectory = throw(with_boxes(here, *boxes), target, opening)
        except (Infeasible, SolverFailed):
            continue
        least = dense_gap(problem, trajectory)
        check = certify(problem, trajectory).check("flight_clearance")
        assert not check.ok or least > -SAMPLED_M, target
        on_floor = replace(here.surroundings, floor_z_m=target[2], keep_out=problem.cell.surroundings.keep_out)
        touched = certify(replace(problem, cell=replace(here, surroundings=on_floor)), trajectory)
        late += touched.check("flight_clearance").ok and not check.ok
    assert late > 0


def test_a_throw_through_a_wall_is_refused():
    here = cell()
    problem, trajectory = throw(here, [1.3, 0.2, 0.0])
    assert certify(problem, trajectory).check("flight_clearance").ok
    _, x, _ = flown(problem, trajectory, 0.0)
    middle = x[2 * len(x) // 3]
    wall = with_boxes(here, ([middle[0] - 0.01, -1.0, 0.0], [middle[0] + 0.01, 1.0, middle[2]]))
    blocked = replace(problem, cell=wall)
    check = certify(blocked, trajectory).check("flight_clearance")
    assert not check.ok
    assert check.detail == "box 0"


@pytest.mark.parametrize("clearance_m", [0.02, 0.05])
def test_the_object_keeps_the_cells_flight_clearance_from_a_post(clearance_m):
    here = with_clearance(cell(), clearance_m)
    problem, trajectory = throw(here, [1.3, 0.2, 0.0])
    _, x, _ = flown(problem, trajectory, 0.0)
    near = x[len(x) // 2]
    aside = here.object.radius_m + clearance_m
    for gap, ok in ((0.004, True), (-0.004, False)):
        side = near[1] + aside + gap
        post = with_boxes(here, ([near[0] - 0.005, side, 0.0], [near[0] + 0.005, side + 0.01, near[2] + 0.2]))
        check = certify(replace(problem, cell=post), trajectory).check("flight_clearance")
        assert (check.ok, check.limit) == (ok, clearance_m)
        assert ok or (check.detail == "box 0" and check.value < clearance_m)


def test_the_object_keeps_the_clearance_from_the_links_themselves():
    near = 0
    certified = 0
    for problem, trajectory in random_throws(24, 11):
        touches_nothing = certify(problem, trajectory).check("flight_clearance").ok
        kept = replace(problem, cell=with_clearance(problem.cell, 0.1))
        if certify(kept, trajectory).check("flight_clearance").ok:
            gaps = flight_gaps(kept, trajectory, 0.0)
            assert min(gap for part, gap in gaps.items() if part not in ("foot", "base")) > 0.1 - 1e-6
            certified += 1
        else:
            near += touches_nothing
    assert certified > 3
    assert near > 0


def test_beside_its_target_the_object_comes_as_near_to_a_box_as_it_lies_there():
    here = with_clearance(cell(), 0.02)
    radius = here.object.radius_m
    wall = with_boxes(here, ([1.0, 0.2 + radius + 0.01, 0.0], [1.6, 0.5, 0.4]))
    problem, trajectory = throw(wall, [1.3, 0.2, 0.0])
    (of_wall,), _ = problem.flight_clearances
    assert of_wall == pytest.approx(0.005)
    check = certify(problem, trajectory).check("flight_clearance")
    near = dense_gap(problem, trajectory)
    assert check.detail == "box 0"
    assert check.limit == of_wall
    assert check.ok == (near >= of_wall)
    assert check.value <= near + SAMPLED_M


@pytest.mark.parametrize("radius_m", [0.02, 0.0])
def test_an_object_of_any_size_meets_a_box(radius_m):
    here = cell()
    here = replace(here, object=replace(here.object, radius_m=radius_m))
    problem, trajectory = throw(here, [1.3, 0.2, 0.0])
    _, x, _ = flown(problem, trajectory, 0.0)
    middle = x[2 * len(x) // 3]
    wall = with_boxes(here, ([middle[0] - 0.1, -1.0, 0.0], [middle[0] + 0.1, 1.0, middle[2] + 0.3]))
    assert certify(problem, trajectory).check("flight_clearance").ok
    assert not certify(replace(problem, cell=wall), trajectory).check("flight_clearance").ok


def test_a_target_may_stand_on_a_box_but_not_in_it_nor_against_its_side():
    here = cell()
    table = ([1.1, -0.1, 0.0], [1.5, 0.5, 0.3])
    on_top, trajectory = throw(with_boxes(here, table), [1.3, 0.2, 0.3])
    assert certify(on_top, trajectory).check("flight_clearance").ok
    inside = with_boxes(here, ([1.1, -0.1, 0.0], [1.5, 0.5, 0.31]))
    assert not certify(replace(on_top, cell=inside), trajectory).check("flight_clearance").ok
    just_within = with_boxes(here, ([1.299, -0.1, 0.2], [1.5, 0.5, 0.5]))
    check = certify(replace(on_top, cell=just_within), trajectory).check("flight_clearance")
    assert (check.value, check.ok, check.detail) == (pytest.approx(-0.001 - here.object.radius_m), False, "box 0")
    beside = with_boxes(here, ([1.301, -0.1, 0.0], [1.5, 0.5, 0.5]))
    check = certify(replace(on_top, cell=beside), trajectory).check("flight_clearance")
    assert not check.ok
    below = replace(here, surroundings=replace(here.surroundings, floor_z_m=0.31))
    assert certify(replace(on_top, cell=below), trajectory).check("flight_clearance").detail == "floor"


def flat_throw(here, y, window_s):
    """A throw without rise to a target in the air: problem, motion, its velocity, and where it comes a radius above."""
    release = TargetRelease(np.array([1.3, y, 0.7]), max_elevation_rad=0.0)
    problem = ThrowProblem(here, here.home, release, here.limits, release_window_s=window_s, landing_tolerance_m=0.1)
    trajectory = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
    state = tool_state(here, trajectory.q[trajectory.release_index], trajectory.qd[trajectory.release_index])
    touch = fly(state.p_WT, state.v_WT, 0.7 + here.object.radius_m, problem.gravity).landing_point
    return problem, trajectory, state.v_WT, touch


@pytest.mark.parametrize("window_s", [0.0, 0.001])
def test_a_wall_is_met_between_the_touch_of_the_plane_and_a_target_in_the_air(window_s):
    """A flat flight comes within its radius of the target's height well before the target: nothing stops it there."""
    here = cell()
    problem, trajectory, _, touch = flat_throw(here, 0.3, window_s)
    x = touch[0] + 1.01 * here.object.radius_m + (0.002 if window_s else 0.0)
    assert x < 1.2995
    for top, ok in ((1.5, False), (0.7, False), (0.7 - here.object.radius_m, True)):
        walled = with_boxes(here, ([x, -2.0, 0.0], [x + 0.0005, 2.0, top]))
        check = certify(replace(problem, cell=walled), trajectory).check("flight_clearance")
        assert check.ok == ok
        assert ok or check.detail == "box 0"


@pytest.mark.parametrize("window_s", [0.0, 0.001])
def test_the_object_comes_onto_a_box_over_its_edge(window_s):
    """A sphere that comes over its edge too low meets the box that carries the target, which counts only then."""
    here = cell()
    problem, trajectory, v, touch = flat_throw(here, 0.0, window_s)
    late = np.hypot(*v[:2]) * 2.0 * window_s
    assert touch[0] + late < 1.295
    for top in (0.7, 0.7 - 0.5 * here.object.radius_m):
        for edge, ok in ((touch[0] - late - 1e-4, True), (1.2999, False)):
            table = with_boxes(here, ([edge, -1.0, 0.5], [1.6, 1.0, top]))
            check = certify(replace(problem, cell=table), trajectory).check("flight_clearance")
            assert (check.ok, check.value > 0.01, check.detail == "box 0") == (ok, ok, not ok)


def test_what_the_object_lands_on_counts_in_no_value_and_what_is_beside_it_does():
    here = cell()
    problem, trajectory, _, touch = flat_throw(here, 0.0, 0.0)
    table = ([touch[0] - 0.01, -1.0, 0.65], [1.6, 1.0, 0.7])
    below = ([1.27, -0.5, 0.0], [1.5, 0.5, 0.645])
    aside = touch[1] + 0.055
    radius = here.object.radius_m
    post = ([touch[0] - 0.1, aside, 0.0], [touch[0] - 0.05, aside + 0.1, 0.7])

    def of(*boxes):
        shown = replace(problem, cell=with_boxes(here, *boxes))
        check = certify(shown, trajectory).check("flight_clearance")
        (curve,) = (curve for curve in motion_curves(shown, trajectory) if curve.name == "flight_clearance")
        assert check.ok
        assert check.value - 1e-9 <= curve.series[0].values.min()
        return check

    assert of(table).value == of(table, below).value > 0.1
    assert of(table, post).detail == "box 1"
    assert 0.03 < of(table, post).value < 0.055 - radius + 0.01


def test_a_target_at_the_height_of_the_centre_on_a_table_is_on_it():
    here = cell()
    top = 0.3 - here.object.radius_m
    for height in (0.3, top + here.object.radius_m, 0.3 + 4e-17, 0.3 + 6e-17):
        table = with_boxes(here, ([0.8, -0.5, 0.1], [1.6, 0.5, top]))
        problem = ThrowProblem(table, here.home, TargetRelease(np.array([1.2, 0.1, height])), here.limits)
        assert problem.surfaces[0].height_m == top


def test_a_slab_flush_with_the_floor_leaves_the_curve_of_the_flight_be():
    here = with_boxes(cell(), ([0.4, -2.0, -1.0], [2.0, 2.0, 0.0]))
    clear = 0
    for y in np.linspace(-0.6, 0.6, 9):
        problem = ThrowProblem(here, here.home, TargetRelease(np.array([1.2, y, 0.0])), here.limits)
        trajectory = ruckig_otg.solve(problem, candidates(problem)[0]).trajectory
        (curve,) = (curve for curve in motion_curves(problem, trajectory) if curve.name == "flight_clearance")
        value = certify(problem, trajectory).check("flight_clearance").value
        clear += value >= 0.0
        assert value < 0.0 or curve.series[0].values.min() >= value - 1e-9 > 0.0
    assert clear >= 5


@pytest.mark.parametrize("window_s", [0.0, 0.001])
def test_the_object_lands_on_what_adjoins_and_is_as_high(window_s):
    """A table of two halves is one surface, and what ends lower beside it is not met by what lies on the table."""
    here = cell()
    problem, trajectory, v, touch = flat_throw(here, 0.0, window_s)
    late = np.hypot(*v[:2]) * 2.0 * window_s
    radius = here.object.radius_m
    edge = touch[0] - late - 1e-4
    seam = 0.5 * (touch[0] + late + problem.release.p_W[0])
    assert seam - touch[0] < radius
    assert 1.3 - seam < radius
    whole = ([edge, -1.0, 0.5], [1.6, 1.0, 0.7])
    halves = ([edge, -1.0, 0.5], [seam, 1.0, 0.7]), ([seam, -1.0, 0.4], [1.6, 1.0, 0.7])
    beyond = ([edge, -1.0, 0.5], [1.305, 1.0, 0.7]), ([1.305, -1.0, 0.5], [1.6, 1.0, 0.69])
    before = ([edge - 0.3, -1.0, 0.5], [edge, 1.0, 0.69]), whole
    checks = [
        certify(replace(problem, cell=with_boxes(here, *boxes)), trajectory).check("flight_clearance")
        for boxes in ([whole], halves, beyond, before)
    ]
    assert all(check.ok for check in checks)
    assert checks[1].value == pytest.approx(checks[0].value, abs=1e-9)
    assert all(check.value < 0.03 < checks[0].value for check in checks[2:])  # what is lower beside it still counts
    lowered = [with_boxes(here, (whole[0], [1.6, 1.0, top])) for top in (0.7 - 0.5 * radius, 0.7 - 1.01 * radius)]
    assert all(certify(replace(problem, cell=each), trajectory).check("flight_clearance").ok for each in lowered)
    apart = with_boxes(here, ([edge, -1.0, 0.5], [seam, 1.0, 0.7]), ([seam + 1e-3, -1.0, 0.4], [1.6, 1.0, 0.7]))
    assert not certify(replace(problem, cell=apart), trajectory).check("flight_clearance").ok  # it lands on the other
    ridge = with_boxes(here, whole, ([1.3 - 1e-3, -1.0, 0.7], [1.6, 1.0, 0.8]))
    assert not certify(replace(problem, cell=ridge), trajectory).check("flight_clearance").ok


def flat_landing(radius_m):
    """A thick object thrown flat, its target two radii below: problem, motion, and where its centre is at a height."""
    problem, trajectory, v, _ = flat_throw(cell(), 0.0, 0.0)
    p = tool_state(problem.cell, *(each[trajectory.release_index] for each in (trajectory.q, trajectory.qd))).p_WT

    def at_height(z):
        return fly(p, v, z, problem.gravity).landing_point

    here = replace(problem.cell, object=replace(problem.cell.object, radius_m=radius_m))
    release = replace(problem.release, p_W=at_height(p[2] - 2.0 * radius_m))
    return replace(problem, cell=here, release=release), trajectory, at_height


@pytest.mark.parametrize("below", ["table", "floor"])
def test_what_is_below_a_plate_is_no_surface_beside_it(below):
    """The sphere touches it before the plate that carries the target, whose side it strikes then."""
    problem, trajectory, at_height = flat_landing(0.04)
    here = problem.cell
    target = problem.release.p_W
    rest = target[2] - 0.004
    lying = [([0.5, -1.0, 0.4], [2.0, 1.0, rest])] if below == "table" else []
    here = replace(here, surroundings=replace(here.surroundings, floor_z_m=rest if below == "floor" else 0.0))
    struck = at_height(rest + 0.04)[0] + 0.05
    assert struck < target[0] - 0.01
    for edge, ok in ((at_height(target[2] + 0.04)[0] - 1e-4, True), (struck, False)):
        plate = ([edge, -1.0, rest - 0.01], [2.0, 1.0, target[2]])
        asked = replace(problem, cell=with_boxes(here, *lying, plate))
        assert certify(asked, trajectory).check("flight_clearance").ok == ok
        assert (dense_gap(asked, trajectory) >= -SAMPLED_M) == ok


@pytest.mark.parametrize("window_s", [0.0, 0.001])
@pytest.mark.parametrize("below", ["table", "floor"])
def test_what_is_higher_counts_until_the_object_lies_at_its_target(below, window_s):
    """It touches what the target is on, and would go on through a wall, or under a shelf, in front of the target."""
    problem, trajectory, at_height = flat_landing(0.04)
    problem = replace(problem, release_window_s=window_s, landing_tolerance_m=0.1 if window_s else 0.0)
    target = problem.release.p_W
    top = float(problem.release.p_W[2])
    touch = at_height(top + 0.04)
    late = 0.02 if window_s else 0.0
    under = [([0.0, -1.0, 0.4], [2.0, 1.0, top])] if below == "table" else []
    floor = replace(problem.cell.surroundings, floor_z_m=top if below == "floor" else 0.0)
    problem = replace(problem, cell=replace(problem.cell, surroundings=floor))

    def is_met(*boxes):
        asked = replace(problem, cell=with_boxes(problem.cell, *under, *boxes))
        check = certify(asked, trajectory).check("flight_clearance")
        assert check.ok or check.detail == f"box {len(under)}"
        return not check.ok

    assert not is_met()
    x = touch[0] + 0.041 + late  # not touched in the air, and left before the object is at its target
    assert target[0] - x > 0.042 + late
    for height, met in ((0.3, True), (0.01, True), (0.0011, True), (0.0009, False), (0.0, False)):
        assert is_met(([x, -1.0, top - 0.01], [x + 1e-3, 1.0, top + height])) == met
    along = (target - touch)[:2]
    beside = touch[1] + (x + 1e-3 - touch[0]) * along[1] / along[0]
    for room, met in ((-1e-3, True), (1e-3 + 0.1 * late, False)):
        y = beside + (0.04 + room) * np.hypot(*along) / along[0]
        assert is_met(([x, y, top], [x + 1e-3, 1.0, top + 0.3])) == met
        shelf = ([x, -1.0, top + 0.08 + room], [target[0] - 0.05 - late, 1.0, top + 0.3])
        assert is_met(shelf) == met


@pytest.mark.parametrize("on_floor", [True, False])
def test_no_flight_lands_beside_its_bin(on_floor):
    """It touches what the bin stands on more than a radius before the bin, and its centre passes below the rim."""
    problem, trajectory, at_height = flat_landing(0.04)
    here = problem.cell
    target = problem.release.p_W
    stands = replace(here, surroundings=replace(here.surroundings, floor_z_m=target[2] if on_floor else 0.0))
    stands = with_boxes(stands, *([] if on_floor else [([0.3, -1.0, 0.4], [2.0, 1.0, target[2]])]))
    assert 0.3 < at_height(target[2] + 0.04)[0] < target[0] - 0.06 - 0.04
    for radius_m, rim_height_m in ((0.045, 0.035), (0.06, 0.06)):
        binned = replace(
            problem, cell=stands, release=replace(problem.release, opening=Opening(radius_m, rim_height_m))
        )
        assert not certify(binned, trajectory).check("flight_clearance").ok
    assert certify(replace(problem, cell=stands), trajectory).check("flight_clearance").ok


@pytest.mark.parametrize("radius_m", [0.3, 0.6])
def test_no_flight_comes_through_the_bottom_of_a_bin(radius_m):
    """From beside the bin and from below it: past the mouth's edge it would fall in all the same."""
    problem, trajectory = throw(cell("ur3e-sim"), [0.3, 0.1, 0.8], Opening(radius_m, 0.02))
    check = certify(problem, trajectory).check("flight_clearance")
    assert (check.ok, check.detail) == (False, "rim")
    assert check.value < -0.015


@pytest.mark.parametrize("rim_height_m", [0.1, 0.3])
def test_the_sphere_enters_a_bin_with_its_radius_to_spare(rim_height_m):
    """The smallest mouth that is certified is the one that dense samples find."""
    here = cell()
    problem, trajectory = throw(here, [1.3, 0.2, 0.0])
    radii = np.linspace(0.03, 0.3, 28)
    asked = [replace(problem, release=replace(problem.release, opening=Opening(r, rim_height_m))) for r in radii]
    certified = [certify(p, trajectory).check("flight_clearance").ok for p in asked]
    expected = [dense_gap(p, trajectory) >= 0.0 for p in asked]
    assert sorted(certified) == certified
    assert 0 < sum(certified) < len(radii)
    assert abs(sum(certified) - sum(expected)) <= 1


@pytest.mark.parametrize("rim_height_m", [0.05, 0.4, 0.55])
def test_arm_and_held_object_keep_clear_of_the_bin(rim_height_m):
    """The bin's block is one more keep-out box, for every capsule of the motion and for the object until it leaves."""
    here = cell()
    problem, trajectory = throw(here, [1.3, 0.2, 0.0])
    below = tool_pose(here, trajectory.q[trajectory.release_index])[:3, 3] * [1.0, 1.0, 0.0]
    release = replace(problem.release, p_W=below, opening=Opening(0.15, rim_height_m))
    check = certify(replace(problem, release=release), trajectory).check("keep_out")
    lower = below - np.array([0.15, 0.15, 0.0])
    upper = below + np.array([0.15, 0.15, rim_height_m])
    capsules = body_capsules(here.robot, here.tool.capsules)
    ends = capsule_endpoints(here.robot, capsules, trajectory.q, here.X_WB)
    along = np.linspace(0.0, 1.0, 21)[:, None]
    gaps = [
        np.linalg.norm(x - np.clip(x, lower, upper), axis=-1).min() - capsule.radius_m
        for i, capsule in enumerate(capsules)
        if capsule.frame > 0
        for x in [ends[:, i, None, 0] * (1.0 - along) + ends[:, i, None, 1] * along]
    ]
    p = tool_pose(here, trajectory.q[: trajectory.release_index + 1])[:, :3, 3]
    gaps.append(np.linalg.norm(p - np.clip(p, lower, upper), axis=1).min() - here.object.radius_m)
    assert check.detail.endswith(", bin")
    assert check.value == pytest.approx(min(gaps), abs=0.01)
    assert check.ok == (min(gaps) >= here.surroundings.clearance_m)


@pytest.mark.slow
@pytest.mark.parametrize("window_s", [0.0, 0.009])
def test_an_object_that_starts_clear_of_the_tool_may_not_be_hit_by_it(window_s):
    hits = 0
    answers = []
    for problem, trajectory in random_throws(60, 5, window_s, here=gripped_at_a_distance(0.0003)):
        check = certify(problem, trajectory).check("flight_clearance")
        delays = np.linspace(-window_s, window_s, 7) if window_s else (0.0,)
        least = min(tool_gaps(problem, trajectory, delay).min() for delay in delays)
        if least < -1e-4:
            assert not check.ok
            hits += 1
        answers.append(check.ok)
    assert hits > 3
    assert any(answers)


@pytest.mark.slow
@pytest.mark.parametrize(("window_s", "gap_m"), [(0.0, 0.00002), (0.005, 0.00002), (0.005, 0.0001), (0.02, 0.00002)])
def test_no_release_of_a_window_may_be_hit_where_the_arm_accelerates(window_s, gap_m):
    """Object and tool are apart for milliseconds alone, at other times for each release."""
    hits = 0
    for problem, trajectory in accelerated_throws(gripped_at_a_distance(gap_m), 120, window_s):
        delays = np.linspace(-window_s, window_s, 7) if window_s else (0.0,)
        if min(tool_gaps(problem, trajectory, delay).min() for delay in delays) < -3e-4:
            assert not certify(problem, trajectory).check("flight_clearance").ok
            hits += 1
    assert hits > 9


def test_an_object_that_leaves_the_tool_it_overlaps_is_not_hit_by_it():
    """In every release of the window it begins within the tool's capsule, and then it only gets farther away."""
    left = 0
    for problem, trajectory in accelerated_throws(gripped_at_a_distance(-0.0002), 60, 0.02):
        gaps = [tool_gaps(problem, trajectory, delay) for delay in np.linspace(-0.02, 0.02, 9)]
        if all((np.diff(each[:60]) > 0.0).all() and (each[60:] > 0.0).all() for each in gaps):
            check = certify(problem, trajectory).check("flight_clearance")
            assert check.ok or check.detail != "tool_0"
            left += 1
    assert left > 3


def test_no_release_of_a_window_may_be_hit_by_a_tool_that_leans_over_the_object():
    """The object begins deep within the tool's capsule; releases milliseconds apart come out of it far apart."""
    hits = 0
    window_s = 0.0067
    steps = 10
    for aside_m in ([0.0410, -0.0200, 0.0594], [0.0271, 0.0028, 0.0699], [0.0448, -0.0378, 0.0497]):
        for problem, trajectory in accelerated_throws(gripped_within(aside_m), 8, window_s):
            least = 0.0
            for delay in np.linspace(-window_s, window_s, 41):
                gaps = tool_gaps(problem, trajectory, delay) - problem.cell.object.radius_m
                was_clear = np.convolve(gaps > 0.0, np.ones(steps), "full")[: len(gaps)] >= steps
                least = min(least, gaps[np.maximum.accumulate(was_clear)].min(initial=0.0))
            if least < -1e-4:
                assert not certify(problem, trajectory).check("flight_clearance").ok
                hits += 1
    assert hits > 1


def test_releases_that_come_out_of_the_tool_smoothly_are_not_taken_for_grazes():
    """From 29 to 133 ms, at most 6 ms later for each of the release; instants beside the release are 2 ms apart."""
    window_s = 0.04
    problem, trajectory = next(itertools.islice(random_throws(60, 5, window_s), 58, None))
    gaps = [tool_gaps(problem, trajectory, d) - problem.cell.object.radius_m for d in np.linspace(-0.04, 0.04, 81)]
    assert all((each[np.argmax(each > 0.0) :] > 0.0).all() for each in gaps)
    assert certify(problem, trajectory).check("flight_clearance").ok


def accelerated_throws(here, count, window_s):
    """Throws to random targets by Ruckig with the soonest acceleration at the release, and their problems."""
    rng = np.random.default_rng(3)
    made = 0
    while made < count:
        angle = rng.uniform(-np.pi, np.pi)
        distance = rng.uniform(0.25, 1.6)
        release = TargetRelease(np.array([distance * np.cos(angle), distance * np.sin(angle), rng.uniform(0.0, 0.5)]))
        tolerance_m = 5.0 if window_s else 0.0
        problem = ThrowProblem(
            here, here.home, release, here.limits, release_window_s=window_s, landing_tolerance_m=tolerance_m
        )
        try:
            motions = [ruckig_otg.solve(problem, each, "free").trajectory for each in candidates(problem)[:4]]
        except (Infeasible, SolverFailed):
            continue
        made += len(motions)
        yield from ((problem, motion) for motion in motions)


def gripped_at_a_distance(gap_m):
    """A cell whose object, a point, is held beside the tool's capsule, by a gripper that is open to all sides."""
    here = cell()
    tcp = here.tool.X_FT[:3, 3]
    (capsule, *_) = here.tool.capsules
    length = np.linalg.norm(tcp)
    return gripped_beside(here, replace(capsule, to_m=tcp * (1.0 - (capsule.radius_m + gap_m) / length)), 0.0)


def gripped_within(aside_m):
    """A cell whose tool's capsule ends `aside_m` from the object, which has a gripper that is open to all sides."""
    here = cell()
    capsule = replace(here.tool.capsules[0], to_m=here.tool.X_FT[:3, 3] + aside_m, radius_m=0.03)
    return gripped_beside(here, capsule, 0.025)


def gripped_beside(here, capsule, radius_m):
    tool = replace(here.tool, capsules=(capsule,))
    thing = replace(here.object, radius_m=radius_m)
    return replace(here, tool=tool, object=thing, gripper=replace(here.gripper, opening_direction=None))


def tool_gaps(problem, trajectory, delay):
    here = problem.cell
    t, x, _ = flown(problem, trajectory, delay)
    (index,) = (i for i, c in enumerate(body_capsules(here.robot, here.tool.capsules)) if c.frame == 6)
    ends = capsule_endpoints(here.robot, body_capsules(here.robot, here.tool.capsules), trajectory.at(t)[0], here.X_WB)
    return from_segment(x, ends[:, index, 0], ends[:, index, 1]) - here.tool.capsules[0].radius_m


@pytest.mark.parametrize("window_s", [0.0, 0.009])
def test_grip_and_way_out_are_those_of_dense_samples(window_s):
    tolerance = 5.0 if window_s else 0.0
    for seed, limit in ((1, [1e3]), (2, [1e3, 2e3, 3e3])):
        for problem, trajectory in random_throws(3, seed, window_s):
            here = problem.cell
            gripper = replace(
                here.gripper,
                opening_direction=np.array([0.0, 0.6, 0.8]),
                opening_cone_rad=np.pi,
                hold_acceleration_m_s2=np.array(limit),
            )
            asked = replace(problem, cell=replace(here, gripper=gripper), landing_tolerance_m=tolerance)
            certificate = certify(asked, trajectory)
            felt = dense_grip(problem, trajectory, window_s, limit)
            assert certificate.check("grip_acceleration").value == pytest.approx(felt, rel=0.05)
            angle = dense_way_out(problem, trajectory, window_s, np.array([0.0, 0.6, 0.8]))
            assert certificate.check("opening_direction").value == pytest.approx(angle, abs=0.02)
            for share, ok in ((0.98, False), (1.05, True)):
                hold = share * worst_share(felt, limit) * np.array(limit)
                tight = replace(gripper, opening_cone_rad=share * angle, hold_acceleration_m_s2=hold)
                judged = certify(replace(asked, cell=replace(here, gripper=tight)), trajectory)
                assert judged.check("opening_direction").ok == ok
                if len(limit) == 1:
                    assert judged.check("grip_acceleration").ok == ok


def worst_share(felt, limit):
    return felt / limit[0] if len(limit) == 1 else 1.0


def dense_grip(problem, trajectory, window_s, limit):
    """What the grip holds at most, where its share of the limit is largest."""
    here = problem.cell
    t = np.linspace(0.0, min(trajectory.release_time_s + window_s, trajectory.duration_s), 4000)
    q, qd, qdd = trajectory.at(t)
    a = tcp_acceleration(here.robot, q, qd, qdd, here.tool.X_FT)[:, :3] @ here.X_WB[:3, :3].T + [0.0, 0.0, 9.81]
    if len(limit) == 1:
        return np.linalg.norm(a, axis=1).max()
    in_tool = np.abs(np.einsum("nij,ni->nj", tool_pose(here, q)[:, :3, :3], a))
    axis = int((in_tool / limit).max(axis=0).argmax())
    return in_tool[:, axis].max()


def dense_way_out(problem, trajectory, window_s, direction):
    """The widest angle of the way of the object in the tool, from its first millimetre to its radius."""
    widest = 0.0
    radius = problem.cell.object.radius_m
    for delay in np.linspace(-window_s, window_s, 7) if window_s else (0.0,):
        t, x, _ = flown(problem, trajectory, delay)
        X_WT = tool_pose(problem.cell, trajectory.at(t)[0])
        apart = np.einsum("nij,ni->nj", X_WT[:, :3, :3], x - X_WT[:, :3, 3])[1:]
        size = np.linalg.norm(apart, axis=1)
        on_way = slice(
            int(np.argmax(size >= 0.001)), int(np.argmax(size >= radius)) if (size >= radius).any() else None
        )
        widest = max(widest, np.arccos(apart[on_way] @ direction / size[on_way]).max())
    return widest


def test_without_numbers_of_the_gripper_its_checks_are_named_as_not_made():
    here = cell()
    gripper = replace(here.gripper, opening_direction=None, hold_acceleration_m_s2=None)
    problem, trajectory = throw(replace(here, gripper=gripper), [1.3, 0.2, 0.0])
    assert {"grip_acceleration", "opening_direction"} <= set(certify(problem, trajectory).not_checked)

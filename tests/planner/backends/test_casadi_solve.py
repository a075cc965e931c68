"""The optimal control back end from problem to trajectory, verified by the certificate."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner import flight
from planner.backends import casadi_nlp, ruckig_otg
from planner.backends.casadi_nlp import (
    DEFAULT_MARGINS,
    SolveOptions,
    answer,
    flight_rows,
    layout,
    object_path,
    parameters,
    release_rows,
    solver,
)
from planner.backends.casadi_nlp.instance import Instance
from planner.cell import Box, Cell, ToolCapsule, load_cell, shape_of
from planner.certificate import certify
from planner.errors import SolverFailed
from planner.geometry import body_model
from planner.problem import JointRelease, Opening, PointRelease, TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from planner.seeds import Candidate, InitialGuess, Seed, candidates
from planner.trajectory import Trajectory
from tests.planner.problems import with_boxes, with_shapes

CELLS = Path(__file__).parents[3] / "cells"
TARGET = TargetRelease(np.array([0.9, -0.5, 0.0]))  # its first seed is not stuck beside a singularity


@pytest.fixture(scope="module")
def cell() -> Cell:
    return load_cell(CELLS / "ur5e-sim.toml")


def _problem(cell: Cell, release: object, **more: float) -> ThrowProblem:
    return ThrowProblem(cell, cell.home, release, cell.limits, **more)  # pyright: ignore[reportArgumentType]


def _solve(problem: ThrowProblem, seeds: int = 3) -> tuple[Trajectory, Candidate, Trajectory]:
    """Returns the first certified answer, its candidate and Ruckig's motion to that."""
    attempts = []
    for candidate in candidates(problem)[:seeds]:
        by_ruckig = ruckig_otg.solve(problem, candidate).trajectory
        guess: InitialGuess = by_ruckig
        margins: casadi_nlp.Margins | None = casadi_nlp.DEFAULT_MARGINS
        while margins is not None and len(attempts) < 12:
            try:
                solution = casadi_nlp.solve(problem, Seed(candidate, guess), SolveOptions(margins))
            except SolverFailed as error:
                attempts.append(error.status)
                break
            made = solution.trajectory
            failures = certify(problem, made).failures
            if not failures:
                return made, candidate, by_ruckig
            attempts.append(str(failures))
            guess = made
            margins = margins.widened(failures, lambda _at_s: 1.0)
    pytest.fail(f"no candidate gave a certified motion: {attempts}")


@pytest.mark.parametrize("jitter_s", [0.0, 0.0015])
def test_an_object_let_go_of_early_or_late_falls_into_the_bin_as_well(cell: Cell, jitter_s: float) -> None:
    """Whatever the gripper's jitter: a margin at the rim for the mean flight alone came to no motion."""
    cell = replace(cell, gripper=replace(cell.gripper, jitter_s=jitter_s))
    bin_ = Opening(radius_m=0.13, rim_height_m=0.13)
    problem = _problem(cell, TargetRelease(np.array([-0.347, -1.195, 0.18]), opening=bin_))
    candidate = candidates(problem)[0]
    guess = ruckig_otg.solve(problem, candidate).trajectory
    margins = replace(casadi_nlp.DEFAULT_MARGINS, mouth_m=0.01)
    made = casadi_nlp.solve(problem, Seed(candidate, guess), SolveOptions(margins)).trajectory
    found = certify(problem, made).check("flight_clearance")
    assert found.ok, found


def test_a_joint_release_is_sooner_than_ruckig_and_not_below_the_bound(cell: Cell) -> None:
    q = cell.home + np.array([0.8, 0.4, -0.5, 0.3, 0.2, 0.1])
    release = JointRelease(q, np.array([1.5, 1.0, -0.8, 0.5, 0.0, 0.0]))
    made, candidate, by_ruckig = _solve(_problem(cell, release))
    assert candidate.bound_s <= made.release_time_s < by_ruckig.release_time_s
    assert np.array_equal(made.q[made.release_index], release.q)


def test_a_target_is_hit_sooner_than_by_ruckig(cell: Cell) -> None:
    made, _, by_ruckig = _solve(_problem(cell, TARGET))
    assert made.release_time_s < 0.95 * by_ruckig.release_time_s


def test_a_window_keeps_the_landing(cell: Cell) -> None:
    problem = _problem(cell, TARGET, release_window_s=0.02, landing_tolerance_m=0.01)
    made, _, _ = _solve(problem)
    assert certify(problem, made).check("landing_window").value <= 0.01


def test_a_point_leaves_the_posture_free(cell: Cell) -> None:
    made, _, by_ruckig = _solve(_problem(cell, PointRelease(np.array([0.5, 0.3, 0.6]), np.array([0.8, 0.8, 0.8]))))
    assert made.release_time_s <= by_ruckig.release_time_s


def test_drag_is_aimed_against(cell: Cell) -> None:
    light = replace(cell, object=replace(cell.object, drag_coefficient=0.47, radius_m=0.03, mass_kg=0.02))
    made, _, _ = _solve(_problem(light, TARGET), seeds=6)
    assert made.duration_s > made.release_time_s


def test_boxes_are_kept_out_of(cell: Cell) -> None:
    free, _, _ = _solve(_problem(cell, TARGET))
    box = Box(np.array([-0.9, -0.4, 0.75]), np.array([-0.2, 0.1, 1.2]))
    walled = replace(cell, surroundings=replace(cell.surroundings, keep_out=(box,)))
    assert not certify(_problem(walled, TARGET), free).check("keep_out").ok
    made, _, _ = _solve(_problem(walled, TARGET), seeds=6)
    assert certify(_problem(walled, TARGET), made).check("keep_out").ok


def _before_wall(cell: Cell, spare_m: float) -> Cell:
    """The cell with a wall behind the arm alone, as far from its home as is required and `spare_m` [m]."""
    lower = np.array([-3.0, -2.0, -1.0])
    upper = np.array([-2.0, 2.0, 3.0])
    gap_m = float(body_model(with_boxes(cell, (lower, upper))).clearances(cell.home[None]).keep_out[0])
    return with_boxes(cell, (lower, upper + np.array([gap_m - spare_m, 0.0, 0.0])))


@pytest.mark.parametrize("spare_m", [1e-5, 0.001, 0.005])
@pytest.mark.parametrize("window_s", [0.0, 0.01])
def test_a_start_close_to_a_box_is_left_as_soon_as_without_the_box(cell: Cell, spare_m: float, window_s: float) -> None:
    """The start has the clearance that is required, but not the optimiser's margin on top of it."""
    problem = _problem(cell, TARGET, release_window_s=window_s, landing_tolerance_m=0.02 * (window_s > 0.0))
    beside = replace(problem, cell=_before_wall(cell, spare_m))
    (free, _, _), (made, _, _) = _solve(problem, seeds=1), _solve(beside, seeds=1)
    assert made.release_time_s <= free.release_time_s + 3 * problem.dt


def test_rows_beside_a_given_state_ask_for_no_more_clearance_than_it_has(cell: Cell) -> None:
    """The start and the release are as far from the wall as is required, but the optimiser's distance is smaller."""
    walled = _before_wall(cell, 0.0)
    problem = _problem(walled, JointRelease(cell.home, np.full(6, 0.3)))
    instance = Instance.of(problem, Seed(candidates(problem)[0]), DEFAULT_MARGINS)
    index = instance.row_index
    bounds = instance.arguments["lbg"]
    least = {k + offset: float(bounds[index.rows[name, k]][0])
             for name, offset in (("keep_out", 0.0), ("keep_out_middle", 0.5)) for k in index.knots[name]}  # fmt: skip
    short = least[0.5]
    assert -0.03 < short < -DEFAULT_MARGINS.shape_m + 0.001
    launch = instance.stages.launch
    beside = {0.5, 1.0, launch - 1.0, launch - 0.5, launch + 0.5, launch + 1.0}
    assert {place: bound for place, bound in least.items() if place in beside} == dict.fromkeys(beside, short)
    assert least[float(launch)] == -np.inf  # the release itself is given
    assert {bound for place, bound in least.items() if place not in {*beside, launch}} == {0.0}


def test_a_move_that_ends_at_rest_has_no_brake(cell: Cell) -> None:
    made, _, _ = _solve(_problem(cell, JointRelease(cell.home + 0.3, np.zeros(6))))
    assert made.release_index == len(made.q) - 1


def test_without_an_initial_guess(cell: Cell) -> None:
    problem = _problem(cell, JointRelease(cell.home + 0.3, np.array([1.0, 0.5, 0.0, 0.0, 0.0, 0.0])))
    made = casadi_nlp.solve(problem, Seed(candidates(problem)[0])).trajectory
    assert certify(problem, made).valid


def test_the_same_request_gives_the_same_motion(cell: Cell) -> None:
    problem = _problem(cell, TARGET)
    first, _, _ = _solve(problem)
    other, _, _ = _solve(_problem(cell, JointRelease(cell.home + 0.2, np.zeros(6))))
    second, _, _ = _solve(problem)
    assert len(other.q) > 0
    assert np.array_equal(first.q, second.q)


ANOTHER_PROCESS = """
import hashlib
from tests.planner.backends.test_casadi_solve import CELLS, TARGET, _problem, solve_once
from planner.cell import load_cell
print(hashlib.sha256(solve_once(_problem(load_cell(CELLS / "ur5e-sim.toml"), TARGET)).q.tobytes()).hexdigest())
"""


def solve_once(problem: ThrowProblem) -> Trajectory:
    candidate = candidates(problem)[0]
    return casadi_nlp.solve(problem, Seed(candidate, ruckig_otg.solve(problem, candidate).trajectory)).trajectory


@pytest.mark.slow
def test_another_process_gives_the_same_motion(cell: Cell) -> None:
    own = hashlib.sha256(solve_once(_problem(cell, TARGET)).q.tobytes()).hexdigest()
    command = [sys.executable, "-c", ANOTHER_PROCESS]
    made = subprocess.run(command, cwd=CELLS.parent, env=os.environ, check=True, capture_output=True, text=True)
    assert made.stdout.strip() == own


def test_a_passed_deadline_ends_the_solve_and_is_reported(cell: Cell) -> None:
    release = PointRelease(np.array([0.5, 0.3, 0.6]), np.array([0.8, 0.8, 0.8]))
    problem = _problem(cell, release, release_window_s=0.02, landing_tolerance_m=0.01)
    candidate = candidates(problem)[0]
    seed = Seed(candidate, ruckig_otg.solve(problem, candidate).trajectory)
    with pytest.raises(SolverFailed, match="out of time") as failed:
        casadi_nlp.solve(problem, seed, SolveOptions(deadline_s=0.0))
    assert failed.value.iterations == 0


def test_a_launch_takes_no_tick_more_than_its_solution(cell: Cell) -> None:
    """Those that end shortly before a tick are those in which a tick can be lost."""
    fractions = []
    for x in np.linspace(0.9, 1.4, 41):
        problem = _problem(cell, TargetRelease(np.array([x, 0.3, 0.0])))
        candidate = candidates(problem)[0]
        seed = Seed(candidate, ruckig_otg.initial_guess(problem, candidate))
        instance = Instance.of(problem, seed, DEFAULT_MARGINS)
        calls = solver.Solver(None, instance.first_groups | {"passing"}, math.inf)
        instance, found = answer._solved(instance, (candidate.q, candidate.qd), calls)
        ticks = found.release_time_s / problem.dt
        made = answer._on_ticks(instance, found, calls)
        assert made.release_index == np.ceil(ticks)
        fractions.append(ticks % 1.0)
    assert np.any(np.array(fractions) > 0.8)


def test_125_hz() -> None:
    made, _, _ = _solve(_problem(load_cell(CELLS / "ur5-sim.toml"), TARGET), seeds=6)
    assert made.sample_rate_hz == 125


def test_many_tool_capsules_are_wrapped(cell: Cell) -> None:
    spheres = tuple(ToolCapsule(np.array([0, 0, z]), np.array([0.01, 0, z]), 0.03) for z in (0.0, 0.05, 0.1, 0.15))
    wrapped = parameters.wrapped_tool_capsules(replace(cell, tool=replace(cell.tool, capsules=spheres)))
    p0, p1, radius = wrapped[-1]
    assert len(wrapped) == 2
    for capsule in spheres[1:]:
        along = np.clip((capsule.from_m - p0) @ (p1 - p0) / ((p1 - p0) @ (p1 - p0)), 0, 1)
        assert np.linalg.norm(capsule.from_m - p0 - along * (p1 - p0)) + 0.03 <= radius + 1e-9


def test_the_aim_is_moved_against_drag(cell: Cell) -> None:
    light = replace(cell, object=replace(cell.object, drag_coefficient=0.47, radius_m=0.03, mass_kg=0.02))
    p = np.array([0.0, 0.0, 0.5])
    v = np.array([2.0, 0.0, 1.0])
    aim = release_rows.drag_free_aim(_problem(light, TARGET), np.array([1.0, 0.0, 0.0]), p, v)
    assert aim[0] > 1.0


RELEASED_AT = np.array([0.8, 0.5, -0.6, 0.7, 0.2, 0.3])  # [rad/s]
AT_THEIR_LIMIT = [(0,), (1, 2), (0, 3), (0, 1, 2, 3), (0, 1, 2, 3, 4, 5)]


@pytest.mark.parametrize("room", [0.0, 1e-9, 1e-5])
@pytest.mark.parametrize("joints", AT_THEIR_LIMIT, ids=str)
def test_a_release_on_the_speed_limit_is_solved(cell: Cell, joints: tuple[int, ...], room):
    """Two opposite inequalities that touch leave an interior-point method to rounding: this must not depend on it."""
    q = cell.home + np.array([0.6, 0.3, -0.4, 0.3, 0.2, 0.3])
    qd_max = cell.limits.qd_max.copy()
    qd_max[list(joints)] = np.abs(RELEASED_AT[list(joints)]) * (1.0 + room)
    problem = replace(_problem(cell, JointRelease(q, RELEASED_AT)), limits=replace(cell.limits, qd_max=qd_max))
    candidate = candidates(problem)[0]
    guess = ruckig_otg.solve(problem, candidate).trajectory
    solution = casadi_nlp.solve(problem, Seed(candidate, guess))
    assert solution.status.startswith("solved")
    assert certify(problem, solution.trajectory).valid
    # A joint that cruises at its limit does so a little below it here, to leave room for the tick grid.
    assert solution.trajectory.release_time_s <= 1.02 * guess.release_time_s


def test_a_point_released_close_to_the_tool_speed_limit_is_solved(cell: Cell) -> None:
    release = PointRelease(np.array([-0.6, -0.25, 0.5]), np.array([-0.9, 0.0, 0.6]))
    limit = float(np.linalg.norm(release.v_WT)) / 0.99  # the optimiser keeps 1.5 % free on the way
    problem = replace(_problem(cell, release), limits=replace(cell.limits, tcp_speed_max=limit))
    candidate = candidates(problem)[0]
    guess = ruckig_otg.solve(problem, candidate).trajectory
    solution = casadi_nlp.solve(problem, Seed(candidate, guess))
    assert solution.status.startswith("solved")


def _violated_on_own_path(instance: Instance) -> set[str]:
    """Returns the groups of rows that the first solution violates, with the path of the object that it throws."""
    calls = solver.Solver(None, frozenset({"flight", "passing"}), math.inf)
    z = calls._with_groups(instance, instance.arguments)
    found = {"x0": instance.with_object(z), "p": solver._with_path_of(instance, z)}
    return solver._violated_groups(instance, {**instance.arguments, **found})


@pytest.mark.parametrize("window_s", [0.0, 0.02])
def test_the_brake_is_clear_of_the_flight_that_is_found(window_s: float) -> None:
    """Thrown back over the arm: in one solve, though the release is not the candidate's."""
    cell = load_cell(CELLS / "ur3e-sim.toml")
    start = np.array([0.55, -2.541, 0.079, -0.293, -0.523, 0.286])
    window = {"release_window_s": window_s, "landing_tolerance_m": 0.02} if window_s else {}
    problem = replace(_problem(cell, TargetRelease(np.array([-0.114, 0.321, 0.0])), **window), start=start)
    candidate = candidates(problem)[0]
    found = Instance.of(problem, Seed(candidate, ruckig_otg.initial_guess(problem, candidate)), DEFAULT_MARGINS)
    without_states = replace(found, stages=replace(found.stages, aims=False))
    assert "passing" not in _violated_on_own_path(found)
    assert "passing" in _violated_on_own_path(without_states)


@pytest.mark.parametrize("height_m", [0.0, 0.3])
@pytest.mark.parametrize("carried", [False, True])
def test_the_path_of_an_object_with_drag_is_its_flight(cell: Cell, carried: bool, height_m: float) -> None:
    """From its position and velocity at the release, where these are variables; in the air until the centre passes."""
    cell = replace(cell, object=replace(cell.object, drag_coefficient=0.5))
    problem = _problem(cell, replace(TARGET, p_W=TARGET.p_W + np.array([0.0, 0.0, height_m])))
    q = candidates(problem)[0].q
    qd = candidates(problem)[0].qd
    p, v = object_path.thrown_state(problem, q, qd)
    numbers = layout.OBJECT_PATH.split(object_path.path_parameters(problem, q, qd, 0.0, carried))
    ends = problem.plane_z + (0.0 if height_m else cell.object.radius_m)
    known = flight.fly(p, v, ends, problem.gravity, problem.drag)
    assert layout.STANDING.split(object_path.standing_parameters(problem, 0.0))["ground"] == pytest.approx(ends)
    without_drag = flight.fly(p, v, float(numbers["ground"][0]), problem.gravity)
    assert known is not None
    assert without_drag is not None
    share = float(numbers["lands"][0])
    assert share == float(carried)
    landing_s = float(numbers["landing"][0]) + share * without_drag.time_of_flight_s
    assert landing_s == pytest.approx(known.time_of_flight_s, abs=1e-9)
    t = np.linspace(0.0, landing_s, 9)
    powers = np.vander(t, layout.PATH_TERMS, increasing=True)
    places = powers @ numbers["path"].reshape(layout.PATH_TERMS, 3) + share * (p + np.outer(t, v))
    assert places == pytest.approx(flight.path(p, v, t, problem.gravity, problem.drag), abs=2e-4)
    assert abs(float(numbers["landing"][0])) > 1e-4  # what drag adds is no part of the variables


@pytest.mark.parametrize(("edge_m", "top_m", "holds"), [(0.3, 0.3, True), (0.002, 0.3, False), (0.002, 0.27, None)])
def test_the_edge_of_a_box_that_carries_the_target_is_passed_with_room(
    cell: Cell, edge_m: float, top_m: float, holds: bool | None
) -> None:
    """The one that the flight comes in by, at the sphere's height there; none where it is a radius lower."""
    target = np.array([1.2, 0.0, 0.3])
    cell = with_boxes(cell, ([target[0] - edge_m, -0.5, 0.1], [2.0, 0.5, top_m]))
    problem = _problem(cell, TargetRelease(target))
    candidate = candidates(replace(problem, cell=with_boxes(cell)))[0]
    (p, v) = object_path.thrown_state(problem, candidate.q, candidate.qd)
    radius = cell.object.radius_m
    edges = layout.FLIGHT.split(flight_rows.flight_parameters(problem, candidate, DEFAULT_MARGINS, target))["edges"]
    rows = edges.reshape(layout.FLIGHT_EDGES, -1)
    used = rows[np.any(rows[:, 4:7] != 0.0, axis=1)]
    if holds is None:
        assert len(used) == 0
        return
    (row,) = used
    t = (row[3] - row[:2] @ p[:2]) / (row[:2] @ v[:2] + row[2])
    at_edge = flight.path(p, v, [t], problem.gravity)[0]
    assert at_edge[0] == pytest.approx(target[0] - edge_m)
    assert row[4:] == pytest.approx([0.0, 0.0, 1.0, top_m + radius + DEFAULT_MARGINS.flight_m])
    assert (at_edge[2] >= row[7]) == holds


def test_of_many_shapes_those_that_the_flight_passes_most_closely_give_its_edges(cell: Cell) -> None:
    rng = np.random.default_rng(4)
    for _ in range(10):
        shapes = []
        for kind in rng.choice(["box", "cylinder"], 60):
            X = pose(rng.uniform([-1.2, -1.2, 0.2], [1.2, 1.2, 0.8]), rotation_vector_to_matrix(rng.normal(size=3)))
            shapes.append(shape_of(str(kind), X, rng.uniform(0.02, 0.15, 3 if kind == "box" else 2)))
        problem = _problem(with_shapes(cell, *shapes), TargetRelease(np.array([1.0, 0.3, 0.1])))
        candidate = candidates(replace(problem, cell=with_boxes(cell)))[0]
        arcs = flight_rows._flight(problem, candidate)
        gaps = problem.flight_clearances[0].tolist()
        ways = [flight_rows._way_of(problem, each, arcs, gap) for each, gap in zip(shapes, gaps, strict=True)]
        expected = [edge for _, edges in sorted(ways, key=lambda way: way[0]) for edge in edges]
        assert flight_rows._shape_edges(problem, arcs, 0.0) == expected[: layout.FLIGHT_EDGES]


def test_a_solve_ends_where_its_release_is_of_no_use(cell: Cell) -> None:
    release = PointRelease(np.array([0.5, 0.3, 0.6]), np.array([0.8, 0.8, 0.8]))
    problem = _problem(cell, release, release_window_s=0.01, landing_tolerance_m=0.01)
    candidate = candidates(problem)[0]
    seed = Seed(candidate, ruckig_otg.initial_guess(problem, candidate))
    made = casadi_nlp.solve(problem, seed)
    in_time = casadi_nlp.solve(problem, seed, SolveOptions(latest_s=made.trajectory.release_time_s + problem.dt))
    assert np.array_equal(in_time.trajectory.q, made.trajectory.q)
    with pytest.raises(SolverFailed, match="no sooner than another") as late:
        casadi_nlp.solve(problem, seed, SolveOptions(latest_s=0.5 * made.trajectory.release_time_s))
    assert late.value.iterations < made.iterations

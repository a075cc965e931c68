"""Candidates of targets behind walls and in bins, and of points with a palm: their objects get out and past."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from planner.cell import Box, Cell, shape_of
from planner.errors import TIME_LIMIT, Infeasible, SolverFailed, nothing_found
from planner.flight import launch_velocity
from planner.geometry import Arcs, tool_state
from planner.planning import SearchHints, plan
from planner.problem import Opening, TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from planner.seeds import candidates, flight_filter
from planner.seeds.flight_filter import clear_flights, least_room, no_clear_flight
from planner.seeds.sampling import blocked_flights
from tests.planner.problems import contact_cell as cell

WALL = Box(np.array([0.8, -0.6, 0.0]), np.array([0.85, 0.6, 0.7]))


def walled(here: Cell, *boxes: Box) -> Cell:
    return replace(here, surroundings=replace(here.surroundings, keep_out=boxes))


def arcs_of(problem: ThrowProblem) -> Arcs:
    found = candidates(problem)
    tool = tool_state(problem.cell, np.array([c.q for c in found]), np.array([c.qd for c in found]))
    return Arcs.onto(tool.p_WT, tool.v_WT, problem.plane_z, problem.gravity, problem.cell.object.radius_m)


def distance_from(box: Box, arcs: Arcs) -> np.ndarray:
    t = np.linspace(0.0, 1.0, 500)[:, None] * arcs.until_s
    x = np.stack([arcs.at(row) for row in t])
    return np.linalg.norm(x - np.clip(x, box.lower, box.upper), axis=-1).min(axis=0)


def test_candidates_pass_over_a_wall_that_those_without_it_meet() -> None:
    target = TargetRelease(np.array([1.15, 0.1, 0.1]))
    plain, behind = (ThrowProblem(c, c.home, target, c.limits) for c in (cell(), walled(cell(), WALL)))
    assert np.any(distance_from(WALL, arcs_of(plain)) < 0.02)
    over = arcs_of(behind)
    assert np.all(distance_from(WALL, over) > 0.02)
    assert np.all(np.linalg.norm(over.v, axis=1) <= plain.limits.tcp_speed_max)


def test_candidates_come_down_through_the_mouth() -> None:
    here = cell()
    mouth = Opening(0.08, 0.15)
    problem = ThrowProblem(here, here.home, TargetRelease(np.array([0.9, 0.3, 0.05]), opening=mouth), here.limits)
    arcs = arcs_of(problem)
    assert len(arcs.p) >= 6
    assert np.all(arcs.room_in_mouth(problem.release.p_W, mouth.radius_m, mouth.rim_height_m) >= 0.0)


def test_the_few_clear_flights_from_a_given_place_are_found() -> None:
    """Of a wall and a bin's mouth hardly any of the flights from one place is clear."""
    mouth = Opening(0.05, 0.15)
    few = 0
    release = TargetRelease(np.array([1.15, 0.1, 0.1]), opening=mouth)
    problem = ThrowProblem(walled(cell(), WALL), cell().home, release, cell().limits)
    rng = np.random.default_rng(0)
    t = np.linspace(0.2, 1.6, 2000)
    for candidate in candidates(problem) * 3:
        place = tool_state(problem.cell, candidate.q, candidate.qd).p_WT + rng.uniform(-0.05, 0.05, 3)
        p = np.tile(place, (len(t), 1))
        v = launch_velocity(p, release.p_W, t, problem.gravity)
        clear = clear_flights(problem, release, p, v) & (np.linalg.norm(v, axis=1) < problem.limits.tcp_speed_max)
        if not 0.01 < clear.mean() < 0.1:
            continue
        few += 1
        found = candidates(replace(problem, release=replace(release, release_position=place)))
        places = np.array([tool_state(problem.cell, each.q, each.qd).p_WT for each in found])
        np.testing.assert_allclose(places, np.tile(place, (len(found), 1)), atol=1e-4)
    assert few > 10


def test_a_target_may_stand_on_a_box_but_not_in_one() -> None:
    target = TargetRelease(np.array([1.0, 0.2, 0.3]))
    table = Box(np.array([0.8, 0.0, 0.0]), np.array([1.2, 0.4, 0.3]))
    here = walled(cell(), table)
    assert candidates(ThrowProblem(here, here.home, target, here.limits))
    for rounding in (0.1 + 0.2, 0.3 + 9e-7):
        here = walled(cell(), replace(table, upper=np.array([1.2, 0.4, rounding])))
        assert candidates(ThrowProblem(here, here.home, target, here.limits))
    here = walled(cell(), replace(table, upper=np.array([1.2, 0.4, 0.6])))
    with pytest.raises(Infeasible) as caught:
        candidates(ThrowProblem(here, here.home, target, here.limits))
    assert caught.value.violations[0].constraint == "flight_clearance"


@pytest.mark.parametrize("above_m", [0.0, 0.025])
@pytest.mark.parametrize("on_table", [True, False])
def test_candidates_do_not_go_on_into_what_stands_before_the_target(on_table: bool, above_m: float) -> None:
    """A thick object that comes down flat touches the table, or the floor, before a wall, and the target behind it."""
    here = replace(cell(), object=replace(cell().object, radius_m=0.08))
    top = 0.3 if on_table else 0.0
    target = np.array([1.2, 0.1, top + above_m])
    lies = np.array([1.2, 0.1, top + 0.08])
    table = [Box(np.array([0.4, -0.5, 0.0]), np.array([1.8, 0.8, top]))] if on_table else []
    rng = np.random.default_rng(2)
    free = 0
    blocked = 0
    for _ in range(40):
        place = target[:2] + rng.uniform([-0.3, -0.15], [0.05, 0.15])
        height = rng.choice([0.02, 0.1, 0.5])
        post = Box(np.array([*place, top]), np.array([*place + 0.01, top + height]))
        problem = ThrowProblem(walled(here, *table, post), here.home, TargetRelease(target), here.limits)
        p = target + np.column_stack([-rng.uniform(0.3, 0.8, 100), rng.uniform(-0.3, 0.3, 100), np.full(100, 0.3)])
        t = rng.uniform(0.1, 0.5, (100, 1))
        v = (target - p) / t + np.array([0.0, 0.0, 0.5 * problem.gravity]) * t
        room = least_room(problem, problem.release, p, v)
        arcs = Arcs.onto(p, v, top, problem.gravity, 0.08)
        touched = arcs.at(arcs.until_s)
        x = touched + np.linspace(0.0, 1.0, 400)[:, None, None] * (lies - touched)
        gap = np.linalg.norm(x - np.clip(x, post.lower, post.upper), axis=-1).min(axis=0) - 0.08
        assert np.all(room[gap < -1e-4] < 0.0)
        in_air = arcs.room_beside_box(post.lower, post.upper, 0.006) >= 0.0
        assert np.all(room[in_air & (gap > 0.001)] >= -1e-9)
        free = free + np.sum(in_air & (gap > 0.001))
        blocked = blocked + np.sum(in_air & (gap < 0.0))
    assert min(free, blocked) > 50


def test_a_wall_that_no_flight_clears_is_blamed_not_the_postures_within_it() -> None:
    here = walled(cell(), Box(np.array([0.75, -1.0, 0.0]), np.array([0.8, 1.0, 1.6])))
    target = TargetRelease(np.array([0.95, 0.0, 0.0]))
    with pytest.raises(Infeasible) as caught:
        candidates(ThrowProblem(here, here.home, target, here.limits))
    (violation,) = caught.value.violations
    assert violation.constraint == "flight_clearance"
    assert violation.value < 0.0
    assert violation.detail.startswith("box 0: the best of ")
    lower = walled(cell(), Box(np.array([0.75, -1.0, 0.0]), np.array([0.8, 1.0, 1.6 + violation.value - 0.001])))
    assert blocked_flights(ThrowProblem(lower, here.home, target, here.limits), target) is None


def test_the_obstacle_that_the_best_flight_lacks_room_at_is_named() -> None:
    """Of two flights and two walls: the flight that lacks less counts, and the wall that it lacks that at."""
    walls = [Box(np.array([x, -1.0, 0.0]), np.array([x + 0.01, 1.0, top])) for x, top in ((0.5, 0.7), (1.0, 0.9))]
    problem = ThrowProblem(walled(cell(), *walls), cell().home, TargetRelease(np.array([1.5, 0.0, 0.0])), cell().limits)
    p = np.tile([0.0, 0.0, 0.5], (2, 1))
    v = np.array([[1.5 / t, 0.0, -0.5 / t + 4.905 * t] for t in (0.5, 0.7)])
    rooms = least_room(problem, problem.release, p, v)
    assert rooms[0] < rooms[1] < 0.0
    violation = no_clear_flight(problem, problem.release, p, v, 2)
    assert violation.value == pytest.approx(rooms[1])
    named, others = violation.detail.split("; ")
    assert named == "box 1: the best of 2 flights tried comes so close to it"
    assert others == "others meet box 0"
    higher = walled(cell(), walls[0], replace(walls[1], upper=walls[1].upper + np.array([0.0, 0.0, rooms[1] - 1e-6])))
    assert least_room(replace(problem, cell=higher), problem.release, p, v)[1] >= 0.0


def test_flights_to_a_target_in_the_air_are_followed_to_it() -> None:
    """A flat one is within its radius of the target's height from 12 cm before it."""
    here = cell()
    p = np.array([[0.4, 0.0, 0.72]])
    v = np.array([[4.0, 0.0, 0.0]])
    ahead_m = 4.0 * np.sqrt(2.0 * 0.07 / 9.81)
    target = TargetRelease(np.array([0.4 + ahead_m, 0.0, 0.65]))
    before = target.p_W - [0.05, 0.3, 0.65]
    edge = target.p_W - [0.01, 0.3, 0.3]
    for box, clear in (
        (Box(before, before + np.array([0.001, 0.6, 1.5])), False),  # a wall just before the target
        (Box(before, before + np.array([0.001, 0.6, 0.65])), False),  # one that ends at the height carries nothing
        (Box(before, before + np.array([0.001, 0.6, 0.62])), True),
        (Box(edge, edge + np.array([0.5, 0.6, 0.3])), False),  # a table's edge under the target
        (Box(edge - np.array([0.2, 0.0, 0.0]), edge + np.array([0.5, 0.6, 0.3])), True),
    ):
        problem = ThrowProblem(walled(here, box), here.home, target, here.limits)
        assert (least_room(problem, target, p, v)[0] >= 0.0) == clear, box
    arm = ThrowProblem(here, here.home, replace(target, p_W=np.array([0.0, 0.0, 0.25])), here.limits)
    onto = np.array([[-0.4, 0.0, 0.3]])  # flat, through the shoulder
    t = np.sqrt(2.0 * 0.05 / 9.81)
    assert least_room(arm, arm.release, onto, np.array([[0.4 / t, 0.0, 0.0]]))[0] < 0.0


def test_a_flight_that_ends_beside_a_lower_box_keeps_its_distance_from_the_edge() -> None:
    """A box grown by the radius as a cube would be met 4.5 cm aside and as much below, where 13 mm are left."""
    here = replace(cell(), object=replace(cell().object, radius_m=0.05))
    target = TargetRelease(np.array([1.0, 0.0, 0.5]))
    p = np.array([[0.6, 0.0, 0.8]])
    v = np.array([[0.4 / 0.4, 0.0, (0.5 * 9.81 * 0.16 - 0.3) / 0.4]])
    for aside, below, clear in ((0.045, 0.045, True), (0.03, 0.03, False), (-0.3, 0.045, True), (0.045, 0.0, False)):
        lower = np.array([1.0 + aside, -0.2, 0.0])
        box = Box(lower, np.array([1.4, 0.2, 0.5 - below]))
        problem = ThrowProblem(walled(here, box), here.home, target, here.limits)
        assert (least_room(problem, target, p, v)[0] >= 0.0) == clear, (aside, below)


def test_few_candidates_are_kept_where_a_thorough_search_finds_none(monkeypatch: pytest.MonkeyPatch) -> None:
    here = walled(cell(), WALL)
    problem = ThrowProblem(here, here.home, TargetRelease(np.array([1.15, 0.1, 0.1])), here.limits)
    found = candidates(problem)
    module = sys.modules["planner.seeds.candidates"]
    states = module.target_states

    def refused(*arguments: object, thorough: bool = False) -> object:
        if thorough:
            raise Infeasible([])
        return states(*arguments)

    monkeypatch.setattr(module, "target_states", refused)
    monkeypatch.setattr(module, "FEW", len(found) + 1)
    assert len(candidates(problem)) == len(found)


def test_after_the_deadline_no_thorough_search_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    here = walled(cell(), WALL)
    problem = ThrowProblem(here, here.home, TargetRelease(np.array([1.15, 0.1, 0.1])), here.limits)
    found = candidates(problem)
    module = sys.modules["planner.seeds.candidates"]
    states = module.target_states

    def once(problem: ThrowProblem, target: object) -> object:
        return states(problem, target)

    monkeypatch.setattr(module, "target_states", once)
    monkeypatch.setattr(module, "FEW", len(found) + 1)
    assert len(candidates(problem, 0.0)) == len(found)

    def none(problem: ThrowProblem, target: object) -> object:
        raise Infeasible([nothing_found("joint_position", "none drawn")])

    monkeypatch.setattr(module, "target_states", none)
    with pytest.raises(SolverFailed) as cut_short:
        candidates(problem, 0.0)
    assert cut_short.value.status == TIME_LIMIT
    with pytest.raises(SolverFailed) as refusal:
        plan(replace(problem, time_limit_s=1e-9), SearchHints(offers_nearest=False))
    assert refusal.value.status == TIME_LIMIT
    assert [violation.detail for violation in refusal.value.violations] == ["none drawn"]


def test_a_bin_that_no_flight_enters_says_what_the_best_one_lacks() -> None:
    here = cell()
    rims = {}
    for rim in (0.5, 0.7):
        target = TargetRelease(np.array([1.2, 0.3, 0.0]), opening=Opening(0.045, rim))
        with pytest.raises(Infeasible) as caught:
            candidates(ThrowProblem(here, here.home, target, here.limits))
        (violation,) = caught.value.violations
        assert violation.constraint == "flight_clearance"
        assert violation.detail.startswith("the rim of the bin: the best of ")
        rims[rim] = violation.value
    assert rims[0.7] < rims[0.5] < 0.0


def among_shapes(seed: int) -> ThrowProblem:
    """A target among sixty shapes of every kind, high and low, some beneath the target's plane."""
    rng = np.random.default_rng(seed)
    shapes = []
    for kind in rng.choice(["box", "cylinder", "sphere", "capsule"], 60):
        X = pose(rng.uniform([-1.5, -1.5, 0.0], [1.5, 1.5, 0.9]), rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3)))
        sizes = rng.uniform(0.02, 0.2, 3 if kind == "box" else 2)
        sizes[1] *= kind != "sphere"
        shapes.append(shape_of(str(kind), X, sizes))
    here = walled(cell(), *shapes)
    return ThrowProblem(here, here.home, TargetRelease(np.array([0.9, 0.3, 0.2 * (seed % 2)])), here.limits)


@pytest.mark.parametrize("seed", range(4))
def test_shapes_that_no_flight_comes_near_to_change_no_answer(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = among_shapes(seed)
    rng = np.random.default_rng(seed)
    p = rng.uniform([-0.8, -0.8, 0.1], [0.8, 0.8, 1.2], (2000, 3))
    t = rng.uniform(0.2, 1.2, (2000, 1))
    v = (problem.release.p_W - p) / t + 0.5 * problem.gravity * t * np.array([0.0, 0.0, 1.0])
    found = least_room(problem, problem.target, p, v)
    monkeypatch.setattr(flight_filter, "_comes_near", lambda shape, lowest, highest, reach_m: np.full(len(p), True))
    every = least_room(problem, problem.target, p, v)
    assert 100 < (every < 0.0).sum() < 1900
    np.testing.assert_array_equal(found < 0.0, every < 0.0)
    np.testing.assert_array_equal(found[every < 0.0], every[every < 0.0])

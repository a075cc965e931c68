"""Landings of a body that is no ball, for every release of an interval: proven between the releases evaluated.

The releases are parted into cells, about one that is evaluated each. At an instant t of the flight, that of a release
dr later differs little: with bounds V, A on the tool's speed and acceleration, W, B on its angular velocity and
acceleration, the release speed factor f, the time s since the release and g(s) of `planner.spin.growth`, the centre is
elsewhere by no more than dr (|1 - f| V + f A s + (g + k V^2) s), horizontally without g, and the body is turned by no
more than dr (B + W^2) g(s): at the release both begin alike, but that the tool went on to accelerate. So the lowest
point of every flight in the cell is within some d of the one evaluated. They all come down after that one is down to d
above the height, and before it is down to d below. In this time no centre moves faster than f V aside, and no body
turns faster than it can in flight. Cells that this does not decide are halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import ThrownBody
from planner.certificate.bounds import joint_rates
from planner.certificate.samples import ArmSamples, MotionSamples, ticks_around_release
from planner.problem import ThrowProblem
from planner.spin import fastest_turn, growth
from planner.touchdown import Touchdowns

CELL_S = 0.001  # [s] of the first cells, at most: as the window is sampled
LATER_S = 0.1  # [s] after the landing evaluated by which those of a cell must have come; few differ by a hundredth
FLOOR_INSTANTS = 24  # [-] of a flight that are compared with the floor, to tell what is certainly too low
UNKNOWN_M = 100.0  # [m] stands for how far the flights of a cell are apart that never land
CELLS_MAX = 2000  # [-] evaluated for one proof: more decide little, as a cell is a microsecond then
ACCURACY = 2e-3  # [m, rad] by which a bound that is told may be below the least found: halving the cells costs as much


@dataclass(frozen=True)
class LeavingBounds:
    """Bounds over the releases: on the tool's velocity, acceleration, angular velocity and its derivative."""

    v: float
    a: float
    w: float
    b: float


class LandingCells(NamedTuple):
    """Landings of n cells of releases.

    Attributes:
        at_s, half_s: releases that are evaluated, and how far each cell reaches from there (n,) [s].
        touchdowns: of the releases that are evaluated.
        earliest_s, latest_s: times, on the trajectory's clock, between which every release of a cell lands (n,) [s];
            from minus infinity and to infinity where that is not known.
        aside_m, turned_rad: how far at most the place of any landing of the cell is from the one evaluated, and by how
            much the body is turned against it (n,).
        falling_s: times, on that clock, from which on until the earliest landing every flight of the cell is above (n,)
            [s].
        floor_s: times until which no body of the cell touches the floor (n,) [s], on that clock.
        floor_gap_m: heights above the floor of the flights evaluated, at a few instants until they land (n,) [m]. Of a
            landing on the floor the last two are infinite.
    """

    at_s: Array
    half_s: Array
    touchdowns: Touchdowns
    earliest_s: Array
    latest_s: Array
    aside_m: Array
    turned_rad: Array
    falling_s: Array
    floor_s: Array
    floor_gap_m: Array


class Spans(NamedTuple):
    """What is proven of n cells, as of `LandingCells`."""

    at_s: Array
    half_s: Array
    earliest_s: Array
    latest_s: Array
    falling_s: Array


class CellProof(NamedTuple):
    """Lower bound on what is left over all cells, the release where it is least [s], and whether it is proven."""

    value: float
    at_s: float
    proven: bool


def touchdowns_of(problem: ThrowProblem, arm: ArmSamples) -> Touchdowns:
    """Returns the flights of the cell's body from every instant of a motion."""
    return problem.touchdowns(arm.p_WT.T, arm.v_WT.T, arm.R_WT, arm.links.angular_velocity[:, 5].T)


@lru_cache(maxsize=4)  # the releases of a motion, for the checks that ask for them
def leaving_bounds(motion: MotionSamples, span_s: float) -> LeavingBounds:
    """Returns bounds on the tool over the releases up to `span_s` [s] from the nominal one, and a tick beyond."""
    trajectory = motion.trajectory
    tick_s = 1.0 / trajectory.sample_rate_hz
    first, last = ticks_around_release(trajectory, span_s + tick_s)
    last = min(max(last, first + 1), len(trajectory.q) - 1)
    rates = joint_rates(trajectory, np.array([min(first, last - 1), last]))
    _, a, *_ = (motion.body.tool_lever @ rates.by_derivative)[:, 0].tolist()
    w, b, _ = rates.sums[:, -1, 0].tolist()
    b += 0.5 * w * w  # each axis is turned by the joints before it
    arm = _sampled(motion, span_s)
    gap_s = float(np.diff(arm.t).max(initial=0.0)) / 2.0
    v = float(np.linalg.norm(arm.v_WT, axis=0).max()) + a * gap_s
    w = min(w, float(np.linalg.norm(arm.links.angular_velocity[:, 5], axis=0).max()) + b * gap_s)
    return LeavingBounds(v, a, w, b)


def _sampled(motion: MotionSamples, span_s: float) -> ArmSamples:
    """Returns the arm at the first cells of the releases up to `span_s` [s] from the nominal one."""
    at_s, _ = _first_cells(motion, span_s)
    released_s = motion.trajectory.release_time_s
    return motion.at(np.unique([released_s - span_s, *at_s, released_s + span_s]))


def _first_cells(motion: MotionSamples, span_s: float) -> tuple[Array, Array]:
    """Returns releases (n,) [s] and how far the cell of each reaches (n,) [s]: the nominal one without a span."""
    count = 1 if span_s == 0.0 else 2 * int(np.ceil(span_s / CELL_S)) + 1
    half_s = span_s / count
    places = np.arange(count, dtype=np.float64) - (count - 1) / 2.0
    return motion.trajectory.release_time_s + 2.0 * half_s * places, np.full(count, half_s)


@lru_cache(maxsize=4)  # likewise
def first_cells(motion: MotionSamples, span_s: float) -> LandingCells:
    """Returns the cells with which a proof over the releases up to `span_s` [s] from the nominal one begins."""
    return _cells(motion, *_first_cells(motion, span_s), leaving_bounds(motion, span_s))


def _cells(motion: MotionSamples, at_s: Array, half_s: Array, bounds: LeavingBounds) -> LandingCells:
    """Returns cells about releases (n,) [s] that reach `half_s` (n,) [s] from there; see the module."""
    problem = motion.problem
    touchdowns = touchdowns_of(problem, motion.at(at_s))
    thing = touchdowns.thing
    factor = problem.release_speed_factor
    gravity, drag = problem.gravity, problem.drag
    time_s = touchdowns.time_s
    s = time_s + LATER_S + half_s
    fastest = factor * bounds.v + gravity * s
    turning = fastest_turn(thing.inertia_kg_m2, bounds.w)
    longest_s = float(np.nan_to_num(s).max(initial=0.0))
    turned = (bounds.b + bounds.w**2) * growth(thing.inertia_kg_m2, bounds.w, longest_s)
    aside = abs(1.0 - factor) * bounds.v + factor * bounds.a * s + drag * fastest**2 * s
    off_m = np.nan_to_num((aside + gravity * s + thing.outer_radius_m * turned) * half_s, nan=UNKNOWN_M)
    apex_s = (1.0 + factor * bounds.a / gravity) * half_s
    # A flight of the cell begins up to `half_s` before the one evaluated, and is as far above at its begin.
    begins = off_m + (factor * bounds.v + thing.outer_radius_m * turning + gravity * half_s) * half_s
    from_s = np.maximum(touchdowns.falling_s - apex_s, 0.0)
    rows = np.arange(len(at_s))
    above = touchdowns.lowest(rows, from_s) > touchdowns.height_m + begins
    exact = (half_s == 0.0) & np.isfinite(time_s)
    early_s = np.where(exact, time_s, touchdowns.first_below(touchdowns.height_m + off_m, from_s))
    late_s = touchdowns.first_below(touchdowns.height_m - off_m, touchdowns.falling_s + apex_s)
    late_s = np.where(exact, time_s, late_s)
    known = np.isfinite(time_s) & (above | exact) & (late_s <= time_s + LATER_S)
    known &= exact | touchdowns.has_touched(touchdowns.height_m - off_m, late_s)
    lasts_s = np.where(known, np.maximum(late_s - time_s, time_s - early_s), np.inf)
    return LandingCells(
        at_s,
        half_s,
        touchdowns,
        np.where(known, at_s + early_s, -np.inf),
        np.where(known, at_s + late_s, np.inf),
        np.where(known, aside * half_s + factor * bounds.v * lasts_s, np.inf),
        np.where(known, turned * half_s + turning * lasts_s, np.inf),
        at_s + from_s,
        *_floor(problem, touchdowns, (at_s, from_s), (off_m, begins)),
    )


def _floor(
    problem: ThrowProblem, touchdowns: Touchdowns, times: tuple[Array, Array], heights: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Returns `floor_s` and `floor_gap_m` of cells (n,).

    Of a landing on the floor they tell of the flight until it may fall: from there on the floor is what it lands on.

    Args:
        problem: its cell.
        touchdowns: of the releases that are evaluated.
        times: of these, and how long after them the first flight of each cell may fall [s].
        heights: how far the flights of each cell are from the one evaluated, at most, and the height above the floor
            from which all of them begin above it [m].
    """
    (at_s, from_s) = times
    (off_m, begins) = heights
    floor_z = problem.cell.surroundings.floor_z_m
    is_on_floor = not touchdowns.is_in_air and touchdowns.height_m <= floor_z
    rows = np.arange(len(off_m))
    begin = np.zeros(len(off_m))
    above = touchdowns.lowest_point(rows, begin) > floor_z + begins
    until_s = np.where(above, touchdowns.first_below(floor_z + off_m, begin, of_body=True), -np.inf)
    if is_on_floor:
        until_s = np.where(until_s >= from_s, np.inf, until_s)
    flown_s = touchdowns.falling_s if is_on_floor else np.nan_to_num(touchdowns.time_s)
    gaps = [touchdowns.lowest_point(rows, share * flown_s) for share in np.linspace(0.0, 1.0, FLOOR_INSTANTS)]
    return at_s + until_s, np.min(gaps, axis=0) - floor_z


def prove(
    motion: MotionSamples, span_s: float, judge: Callable[[LandingCells], tuple[Array, Array]], accuracy: float
) -> tuple[CellProof, list[Spans]]:
    """Returns a lower bound on what is left for every release up to `span_s` [s] from the nominal one.

    Args:
        motion: the motion.
        span_s: largest deviation of the release [s].
        judge: function of cells that returns what is left at the releases evaluated (n,), not a number where one never
            lands, and by how much less it may be in the rest of each cell (n,).
        accuracy: by how much the bound may be below the least found; infinite: the sign alone matters.

    Returns:
        The proof, and the cells that it rests on, from which those that are not decided are missing.
    """
    accuracy = max(accuracy, ACCURACY)
    bounds = leaving_bounds(motion, span_s)
    cells = first_cells(motion, span_s)
    found = CellProof(np.inf, motion.trajectory.release_time_s, proven=True)
    least = np.inf
    used: list[Spans] = []
    evaluated = 0
    while True:
        evaluated += len(cells.at_s)
        left, off = judge(cells)
        worst = int(np.nan_to_num(left, nan=-np.inf).argmin())
        if not left[worst] >= 0.0:
            return CellProof(float(left[worst]), float(cells.at_s[worst]), proven=True), used
        least = min(least, float(left[worst]))
        bound = left - off
        undecided = (bound < 0.0) | (bound < least - accuracy)
        decided = np.where(undecided, np.inf, bound)
        first = int(decided.argmin())
        if decided[first] < found.value:
            found = CellProof(float(decided[first]), float(cells.at_s[first]), proven=True)
        used.append(_chosen(cells, ~undecided))
        if not undecided.any():
            return found, used
        if evaluated > CELLS_MAX:
            proven = bool((bound >= 0.0).all())
            value = min(found.value, float(bound[undecided].min())) if proven else least
            return CellProof(value, float(cells.at_s[worst]), proven), [*used, _chosen(cells, undecided & (bound >= 0))]
        quarter = 0.5 * cells.half_s[undecided]
        at_s = np.concatenate([cells.at_s[undecided] - quarter, cells.at_s[undecided] + quarter])
        cells = _cells(motion, at_s, np.concatenate([quarter, quarter]), bounds)


def _chosen(cells: LandingCells, chosen: Mask) -> Spans:
    """Returns what is proven of the `chosen` cells."""
    each = (cells.at_s, cells.half_s, cells.earliest_s, cells.latest_s, cells.falling_s)
    return Spans._make(values[chosen] for values in each)


def hull_places(touchdowns: Touchdowns) -> Array:
    """Returns the centres (balls, n, 3) [m] of a body's hull at the landings that are evaluated."""
    thing: ThrownBody = touchdowns.thing
    x = touchdowns.centres_at(touchdowns.time_s)
    along = touchdowns.axes_at(touchdowns.time_s) @ thing.hull_axis_O
    return x + np.array(thing.balls_m)[:, None, None] * along

"""Checks of a motion in which several grippers let go: each is certified as if it were the only one, then all together.

A part is the motion as one gripper sees it, with what the others hold as load and shape of the tool (`ReleasePart`).
Before the release of a part its own object and the later ones are held, after it the later ones: so at every instant
the load that is there is that of some part, as long as the instants at which two grippers may open keep apart.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from planner.arrays import Array
from planner.certificate.bounds import point_bound
from planner.certificate.certificate import Certificate, Check, NotChecked, at_least
from planner.certificate.passages import crowded_outputs, wrong_order
from planner.certificate.release import release_flight
from planner.certificate.samples import MotionSamples
from planner.flight import path
from planner.problem import ReleasePart, ThrowProblem
from planner.trajectory import Trajectory

COMMANDS_APART = 1.5  # [ticks] at which two commands are in ticks of their own, however they are rounded
RELEASE_STEP_S = 0.0005  # [s] largest spacing of the releases at which flights are compared
STEP_S = 0.005  # [s] spacing of the instants at which they are


def merged(problem: ThrowProblem, parts: Sequence[Certificate], common: Sequence[Check]) -> Certificate:
    """Returns the certificate of a motion: of each check the worst of its parts, whose detail names the passage."""
    names = [problem.passages[part.release].name for part in problem.parts]
    found = [
        replace(check, detail=f"{name}: {check.detail}" if check.detail else name)
        for name, certificate in zip(names, parts, strict=True)
        for check in certificate.checks
    ]
    return _worst([*found, *common], [name for certificate in parts for name in certificate.not_checked])


def with_kept(certificate: Certificate, kept: Sequence[Check | NotChecked]) -> Certificate:
    """Returns a certificate with checks of grippers that let nothing go: of each name the worst is told."""
    if not kept:
        return certificate
    checked = [check for check in kept if isinstance(check, Check)]
    unchecked = [check.name for check in kept if isinstance(check, NotChecked)]
    return _worst([*certificate.checks, *checked], [*certificate.not_checked, *unchecked])


def _worst(checks: Sequence[Check], not_checked: Sequence[str]) -> Certificate:
    """Returns a certificate with the worst of the checks of each name, of equals the first."""
    found: dict[str, Check] = {}
    for check in checks:
        found[check.name] = min(found.get(check.name, check), check, key=_room)
    return Certificate(tuple(found.values()), tuple(dict.fromkeys(not_checked)))


def _room(check: Check) -> tuple[bool, float]:
    """Returns the sort key of one check among those of its name: failed ones first, then by what is left."""
    margin = -math.inf if math.isnan(check.margin) else check.margin
    return check.ok, margin / max(abs(check.limit), 1e-9)


def together(problem: ThrowProblem, trajectory: Trajectory, motions: Sequence[MotionSamples]) -> list[Check]:
    """Returns the checks that no part can make by itself.

    Args:
        problem, trajectory: of the whole motion.
        motions: samples of its parts.
    """
    wrong = wrong_order(problem, trajectory) or crowded_outputs(problem, trajectory)
    if wrong is not None:
        return [wrong]
    lets_go = [pair for pair in zip(problem.parts, motions, strict=True) if pair[1].problem.throws]
    if len(lets_go) < 2:
        return []
    return [_releases_apart(problem, lets_go), *filter(None, [_flights_apart(problem, lets_go)])]


def _releases_apart(problem: ThrowProblem, lets_go: Sequence[tuple[ReleasePart, MotionSamples]]) -> Check:
    """Returns the check that no two grippers may open at once, nor are told to in one tick.

    The value is the time from the last instant at which one may open to the first of the next, less what two commands
    lack of keeping apart.
    """
    found = []
    for (one, first), (other, second) in pairwise(lets_go):
        at_s = second.trajectory.release_time_s
        apart_s = at_s - first.trajectory.release_time_s
        free_s = apart_s - first.problem.opening_spread_s - second.problem.opening_spread_s
        names = f"{problem.passages[one.release].name} and {problem.passages[other.release].name}"
        found.append(at_least("releases_apart", free_s, 0.0, "s", at_s, names))
    limit_s = COMMANDS_APART * problem.dt
    for (one, first), (other, second) in combinations(lets_go, 2):
        told = [each.trajectory.release_time_s - each.problem.cell.gripper.delay_s for each in (first, second)]
        names = f"{problem.passages[one.release].name} and {problem.passages[other.release].name}"
        detail = f"commands of {names}"
        at_s = second.trajectory.release_time_s
        found.append(at_least("releases_apart", abs(told[1] - told[0]), limit_s, "s", at_s, detail))
    return min(found, key=lambda check: (check.ok, check.margin))


class _Flown(NamedTuple):
    """Flights of one object, from releases that are evaluated.

    Attributes:
        x: places at the instants (n, k, 3) [m]; NaN before the release.
        lands_s: time by which the nominal flight has ended, and the latest release as long after it [s].
        off_m: by how much a flight between two of the releases may be off the nearer one's, at most [m].
        bends_m_s2: bound on its acceleration beyond free fall [m/s^2].
    """

    x: Array
    off_m: float
    bends_m_s2: float


def _flights_apart(problem: ThrowProblem, lets_go: Sequence[tuple[ReleasePart, MotionSamples]]) -> Check | None:
    """Returns the check that no two objects in the air come closer than the flight clearance, whenever they leave.

    Until the first of them lands. Two flights are compared at releases and instants h apart; between instants their
    distance vector is within b h^2/8 of its chord, with b what bends the one against the other: drag alone. Between
    releases a flight x(t; r) moves by |dx/dr| <= |1 - f| V + t (g + k W^2 + f A), with V, A the speed and acceleration
    of the tool, f the release speed factor and W the speed in the air (see `release`).
    """
    required = problem.cell.surroundings.flight_clearance_m
    found = []
    for (one, first), (other, second) in combinations(lets_go, 2):
        ends = [_lands_s(each) for each in (first, second)]
        if not all(map(math.isfinite, ends)):
            continue
        begin_s = second.trajectory.release_time_s - second.problem.opening_spread_s
        t = np.arange(begin_s, max(min(ends), begin_s) + 2.0 * STEP_S, STEP_S)
        a, b = (_flown(each, t) for each in (first, second))
        apart = a.x[:, None] - b.x[None]
        turn = 0.5 * np.linalg.norm(np.diff(apart, axis=2), axis=3)
        bend = (a.bends_m_s2 + b.bends_m_s2) * STEP_S**2 / 8.0
        nearest = np.linalg.norm(apart, axis=3)
        gaps = np.minimum(nearest[..., :-1], nearest[..., 1:]) - turn - bend - a.off_m - b.off_m
        gaps = np.where(np.isnan(gaps), np.inf, gaps).min(axis=(0, 1))
        k = int(gaps.argmin())
        value = float(gaps[k]) - first.problem.cell.object.radius_m - second.problem.cell.object.radius_m
        names = f"{problem.passages[one.release].name} and {problem.passages[other.release].name}"
        found.append(at_least("flights_apart", value, required, "m", float(t[k]), names))
    return min(found, key=lambda check: check.margin, default=None)


def _lands_s(motion: MotionSamples) -> float:
    """Returns the time by which an object has landed that leaves as late as it may [s]; infinite if it never does."""
    flight = release_flight(motion.problem, motion.trajectory)
    if flight is None:
        return math.inf
    return motion.trajectory.release_time_s + flight.time_of_flight_s + motion.problem.opening_spread_s


def _flown(motion: MotionSamples, t: Array) -> _Flown:
    """Returns the flights of an object at instants (k,) [s], from releases over the spread of its gripper."""
    problem = motion.problem
    spread_s = problem.opening_spread_s
    released_s = motion.trajectory.release_time_s
    count = 2 * math.ceil(spread_s / RELEASE_STEP_S) + 1
    r = released_s + np.linspace(-spread_s, spread_s, count)
    step_s = 2.0 * spread_s / max(count - 1, 1)
    arm = motion.at(r)
    factor = problem.release_speed_factor
    x = np.full((count, len(t), 3), np.nan)
    for i in range(count):
        s = t - r[i]
        flies = s >= -STEP_S  # the path goes on backwards to the instant before the release
        x[i, flies] = _path(arm.p_WT[:, i], factor * arm.v_WT[:, i], s[flies], problem)
    lasts_s = float(t[-1] - r[0])
    jerk = float(point_bound(motion.body.tool_lever, motion.rates, 3).max())
    acceleration = float(np.linalg.norm(arm.a_WT, axis=0).max()) + 0.5 * step_s * jerk
    speed = float(arm.tool_speed.max()) + 0.5 * step_s * acceleration
    drag = problem.drag * (factor * speed + problem.gravity * lasts_s) ** 2
    off = abs(1.0 - factor) * speed + lasts_s * (problem.gravity + drag + factor * acceleration)
    return _Flown(x, 0.5 * step_s * off, drag)


def _path(p: Array, v: Array, s: Array, problem: ThrowProblem) -> Array:
    """Returns the path (n, 3) [m] of an object at increasing times (n,) [s]; before 0 as it would be without drag."""
    x = path(p, v, np.maximum(s, 0.0), problem.gravity, problem.drag)
    x[s < 0.0] = path(p, v, s[s < 0.0], problem.gravity)
    return x

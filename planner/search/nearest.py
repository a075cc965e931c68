"""Nearest feasible request: what could be done instead of an infeasible request.

Requirements are relaxed one after the other, the mildest relaxation first: a speed is reduced, a position is moved into
reach, a target is brought closer; at last the whole release is drawn towards the start, where it is always feasible.
For each relaxation the largest feasible share of the request is found by bisection, by Ruckig's motions, which take
least time. Where something stands in the way of a target, the optimiser tries a few nearer ones, also beyond it; and it
is asked for more of a release window that the motion found does not keep. Every release that is returned has a
certified motion.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from planner.arrays import Array
from planner.certificate import certify
from planner.errors import Infeasible, SolverFailed, Violation
from planner.geometry import tool_pose
from planner.problem import JointRelease, PointRelease, PoseRelease, Release, TargetRelease, ThrowProblem
from planner.rotations import matrix_to_rotation_vector, pose, rotation_vector_to_matrix
from planner.search.auto import search_optimised
from planner.search.blocked_postures import blocked_postures
from planner.search.feasible_releases import PlacedRelease, feasible_releases, moved, position
from planner.search.incumbent import CertifiedSolution, PlanningSearch, certified
from planner.search.policy import FIRST_SEEDS_POLICY
from planner.search.proofs import refuse_impossible
from planner.search.ranking import Ranking
from planner.search.sequential import VARIANTS_BY_BACKEND, Solve
from planner.search.way_home import find_way_home
from planner.seeds import Candidate, candidates, farthest_reach

Relaxation = Callable[[float], Release]  # of a share s: 0 fully relaxed, 1 as requested or as close as possible

BISECTIONS = 6  # the share is found to 1/64
SHARE_MIN = 0.02  # [-] of the requested speed or displacement; tried first
SLOWER = (0.3, 0.05)  # [-] of the requested speed, tried where no other position allows the full speed
# Constraints on the position, which a slower release breaks, too.
POSITION_CONSTRAINTS = {"reach", "joint_position", "floor", "keep_in", "keep_out", "self_collision"}
OBSTACLE_CONSTRAINTS = {"flight_clearance", "keep_out"}  # where a target beyond what is in the way may be nearer
UNDER_M = 0.2  # [m] from below the tool at the start, towards the target: an easy throw
COMFORTABLE_REACH = 0.6  # [-] of the arm's reach: positions there have many postures
STEPS_OUT, NEAREST_OUT = 24, 8  # distances tried from the base to there; those from a third of it on are targets
BESIDE_M = 0.05  # [m] between the object and a box that an easy target is in front of
MOTIONS_MAX, LATE_MOTIONS_MAX = 30, 20  # motions certified, about 5 ms each; after the request's deadline
WINDOW_SHARE = 0.9  # [-] of the largest share: a smaller one is preferred if it keeps the release window
SHARES_MAX = 3  # [-] largest shares whose motion's end is searched for a way home; in vain that takes some seconds
CANDIDATES_MAX, FEW_CANDIDATES = 6, 2  # tried for one release, thoroughly or not
BEYOND_M = (0.05, 0.1, 0.2)  # [m] farther from the base than a target that something stands before
NEARER_SHARES = (0.25, 0.5)  # [-] of the distance from the requested target to the nearest one found
WINDOW_SHARES = (1.0, 0.5, 0.25)  # [-] of the requested release window
WINDOW_STEP_S, DECIMALS = 1e-4, 4  # [s] windows are rounded down to it: no gripper knows less
ROUNDING = 1e-9  # [-] of a number of steps


class Feasibility:
    """Decides whether relaxed problems have a certified motion, on a budget of work; Ruckig's stand in for others.

    Attributes:
        deadline_s: of the request, on the clock of `time.perf_counter`.
        motions: certified so far.
    """

    def __init__(self, deadline_s: float) -> None:
        self.deadline_s = deadline_s
        self.motions = 0

    @property
    def exhausted(self) -> bool:
        """Whether the budget is spent."""
        late = time.perf_counter() > self.deadline_s
        return self.motions >= (LATE_MOTIONS_MAX if late else MOTIONS_MAX)

    def motion(self, problem: ThrowProblem, thorough: bool) -> CertifiedSolution | None:
        """Returns a certified motion, None where none was found; a thorough search tries more candidates and variants.

        Where the start or the cell's home is blocked, there is none.
        """
        if blocked_postures(problem):
            return None
        variants = VARIANTS_BY_BACKEND.get(problem.backend, VARIANTS_BY_BACKEND["ruckig"])[::-1]  # the gentlest first
        try:
            found = candidates(problem, wide=thorough)[: CANDIDATES_MAX if thorough else FEW_CANDIDATES]
        except Infeasible:
            return None
        for solve, candidate in product(variants if thorough else variants[:1], found):
            if self.exhausted:
                return None
            motion = self._certified(problem, solve, candidate)
            if motion is not None:
                return motion
        return None

    def _certified(self, problem: ThrowProblem, solve: Solve, candidate: Candidate) -> CertifiedSolution | None:
        """Returns a back end's motion to a candidate, None where it is not certified."""
        self.motions += 1
        try:
            found = certified(problem.backend, problem, solve(problem, candidate))
        except SolverFailed:
            return None
        return found if found.is_valid else None


def nearest_problem(search: PlanningSearch, violations: Sequence[Violation]) -> ThrowProblem | None:
    """Returns the closest problem that has a certified motion; None if none was found.

    A release window is the last thing to be asked for: the motion that was found without it gives its own.

    Args:
        search: without an answer.
        violations: of its refusal.
    """
    problem, broken = search.problem, {violation.constraint for violation in violations}
    if search.nominal is not None:
        return _with_more_of_window(search, _with_own_window(problem, search.nominal), WINDOW_SHARES[1:])
    found = _relaxed(search, broken)
    if all(violation.proven for violation in violations) and not broken & OBSTACLE_CONSTRAINTS:
        return found  # out of reach: that is said at once
    if found is not None:
        found = _with_more_of_window(search, found, WINDOW_SHARES)
    return _nearer_target(search, found)


def _relaxed(search: PlanningSearch, broken: set[str]) -> ThrowProblem | None:
    """Returns the problem with the mildest relaxation that has a certified motion; None if none was found."""
    problem, feasibility = search.problem, Feasibility(search.deadline_s)
    nominal = replace(problem, release_window_s=0.0) if problem.is_robust else problem
    for relaxation, thorough in _relaxations(problem, broken):
        shares = _feasible_shares(nominal, relaxation, feasibility, thorough)[:SHARES_MAX]
        found = list(_with_ways_home(problem, relaxation, shares))
        if found:
            return found[-1] if found[-1].release_window_s == problem.release_window_s else found[0]
        if feasibility.exhausted:
            break
    return None


def _with_more_of_window(search: PlanningSearch, found: ThrowProblem, shares: Iterable[float]) -> ThrowProblem:
    """Returns a problem with the first of these shares of the requested window that the optimiser has a motion for.

    Those that are no longer than its own are not tried.
    """
    for share in shares:
        wider = replace(found, release_window_s=_rounded_down(share * search.problem.release_window_s))
        if wider.release_window_s > found.release_window_s and _is_answered(search, wider):
            return wider
    return found


def _nearer_target(search: PlanningSearch, found: ThrowProblem | None) -> ThrowProblem | None:
    """Returns the problem with a nearer target than the one found, if the optimiser finds a motion to one.

    A few are tried, the nearest first: between the two, and farther from the base than the requested one.
    """
    release = search.problem.release
    if not isinstance(release, TargetRelease):
        return found
    p, base = release.p_W, search.problem.cell.X_WB[:3, 3]
    away = np.array([*(p - base)[:2], 0.0])
    tried = [(d, p + d * away / np.linalg.norm(away)) for d in BEYOND_M if away.any()]
    if found is not None:
        assert isinstance(found.release, TargetRelease)
        step = found.release.p_W - p
        apart = float(np.linalg.norm(step))
        tried = [each for each in tried if each[0] < apart] + [(s * apart, p + s * step) for s in NEARER_SHARES]
    for _, place in sorted(tried, key=lambda each: each[0]):
        nearer = replace(search.problem, release=replace(release, p_W=place))
        if _is_answered(search, nearer):
            return nearer
    return found


def _is_answered(search: PlanningSearch, problem: ThrowProblem) -> bool:
    """Returns whether the optimiser comes to an answer of a problem from its first seeds; of `auto` alone."""
    if problem.backend != "auto":
        return False
    inner = PlanningSearch(problem, search.deadline_s)
    try:
        refuse_impossible(problem)
        search_optimised(inner, Ranking(problem, candidates(problem)), FIRST_SEEDS_POLICY)
    except Infeasible:
        return False
    search.extend_deadline(inner.loading_s)
    return inner.answer is not None and find_way_home(problem, inner.answer)[0] is not None


def _with_ways_home(
    problem: ThrowProblem, relaxation: Relaxation, shares: Iterable[tuple[float, CertifiedSolution]]
) -> Iterator[ThrowProblem]:
    """Yields the problems of feasible shares whose motion has a way home, up to one that keeps the release window.

    Those are little smaller than the first one. The optimiser's motions do not keep a window: of these one is enough.
    """
    least = 0.0
    for share, motion in shares:
        if share < least:
            return
        found = replace(problem, release=relaxation(share))
        if find_way_home(replace(found, release_window_s=0.0), motion)[0] is None:
            continue
        kept = _with_own_window(found, motion)
        yield kept
        if kept.release_window_s == problem.release_window_s or "casadi" in (problem.backend, motion.backend):
            return
        least = least or WINDOW_SHARE * share


def _with_own_window(problem: ThrowProblem, nominal: CertifiedSolution) -> ThrowProblem:
    """Returns the problem with the largest part of its release window that a motion keeps.

    The optimiser's motion depends on the window that is asked for, so that only the nominal release is sure of it.
    """
    if not problem.is_robust:
        return problem
    motion, found = nominal.solution.trajectory, replace(problem, release_window_s=0.0)
    if "casadi" in (problem.backend, nominal.backend):
        return found
    if certify(problem, motion).valid:
        return problem
    kept, failed = 0.0, problem.release_window_s
    for _ in range(BISECTIONS):
        window_s = (kept + failed) / 2.0
        narrower = replace(problem, release_window_s=window_s)
        if certify(narrower, motion).valid:
            kept, found = window_s, narrower
        else:
            failed = window_s
    return replace(found, release_window_s=_rounded_down(kept))


def _rounded_down(window_s: float) -> float:
    """Returns a window in whole steps of `WINDOW_STEP_S` [s]; what keeps a longer one keeps it."""
    steps = math.floor(window_s / WINDOW_STEP_S + ROUNDING)
    return round(steps * WINDOW_STEP_S, DECIMALS)


def _relaxations(problem: ThrowProblem, broken: set[str]) -> Iterator[tuple[Relaxation, bool]]:
    """Yields relaxations, the mildest first, and whether each deserves a thorough search."""
    release = problem.release
    if isinstance(release, TargetRelease):
        yield from ((relaxation, True) for relaxation in _closer_targets(problem, release))
        return
    if not problem.ends_at_rest and not broken & POSITION_CONSTRAINTS:
        yield partial(_slower, release), True
    if isinstance(release, PoseRelease | PointRelease):
        yield from ((relaxation, False) for relaxation in _elsewhere(problem, release))
    if isinstance(release, PoseRelease):  # without the orientation: a point with the same velocity
        point = PointRelease(release.X_WT[:3, 3], release.V_WT[:3])
        yield from ((relaxation, False) for relaxation in _elsewhere(problem, point))
    yield partial(_towards_start, problem, release), True


def _feasible_shares(
    problem: ThrowProblem, relaxation: Relaxation, feasibility: Feasibility, thorough: bool
) -> list[tuple[float, CertifiedSolution]]:
    """Returns feasible shares, each with a motion, the largest first; found by bisection, unless 0 is infeasible."""
    first = feasibility.motion(replace(problem, release=relaxation(0.0)), thorough)
    if first is None:
        return []
    feasible, failed = [(0.0, first)], [1.0]
    for _ in range(BISECTIONS):
        if feasibility.exhausted:
            break
        share = (feasible[-1][0] + failed[-1]) / 2.0
        motion = feasibility.motion(replace(problem, release=relaxation(share)), False)
        if motion is not None:
            feasible.append((share, motion))
        else:
            failed.append(share)
    for share in reversed(failed):  # what few candidates could not do, more may
        motion = feasibility.motion(replace(problem, release=relaxation(share)), True)
        if motion is None:
            break
        feasible.append((share, motion))
    return feasible[::-1]


def _slower(release: Release, share: float) -> Release:
    """Returns the release with a share of its speed."""
    share = max(share, SHARE_MIN)
    match release:
        case JointRelease(q, qd):
            return JointRelease(q, share * qd)
        case PoseRelease(X, V):
            return PoseRelease(X, share * V)
        case PointRelease(p, v):
            return PointRelease(p, share * v)
    return release


def _elsewhere(problem: ThrowProblem, release: PlacedRelease) -> Iterator[Relaxation]:
    """Yields relaxations from other positions to the requested one, with the requested speed as far as possible."""
    requested = position(release)
    farthest = _within(problem.cell.X_WB[:3, 3], requested, farthest_reach(problem))
    for speed in (1.0, *SLOWER):
        slowed = _slower(release, speed)
        assert isinstance(slowed, PoseRelease | PointRelease)
        for feasible in feasible_releases(problem, slowed):
            yield partial(_moved_between, slowed, position(feasible), farthest)


def _moved_between(release: PlacedRelease, near: Array, far: Array, share: float) -> Release:
    return moved(release, _between(near, far, share))


def _towards_start(problem: ThrowProblem, release: Release, share: float) -> Release:
    """Returns the release drawn towards a standstill at the start."""
    share, X_W0 = max(share, SHARE_MIN), tool_pose(problem.cell, problem.start)
    match release:
        case JointRelease(q, qd):
            return JointRelease(_between(problem.start, q, share), share * qd)
        case PointRelease(p, v):
            return PointRelease(_between(X_W0[:3, 3], p, share), share * v)
        case PoseRelease(X, V):
            turn = share * matrix_to_rotation_vector(X[:3, :3] @ X_W0[:3, :3].T)
            R_WT = rotation_vector_to_matrix(turn) @ X_W0[:3, :3]
            return PoseRelease(pose(_between(X_W0[:3, 3], X[:3, 3], share), R_WT), share * V)
    return release


def _closer_targets(problem: ThrowProblem, release: TargetRelease) -> Iterator[Relaxation]:
    """Yields relaxations that start from an easy target: towards the requested one, ahead of the tool, or below it.

    A target below the floor is lifted onto it.
    """
    x, y, z = release.p_W
    release = replace(release, p_W=np.array([x, y, max(z, problem.cell.surroundings.floor_z_m)]))
    farthest, tool = _farthest_throw(problem, release), tool_pose(problem.cell, problem.start)[:3, 3]
    under = np.array([*_within(tool[:2], release.p_W[:2], UNDER_M), release.p_W[2]])
    releases = [release] if release.release_position is None else [release, replace(release, release_position=None)]
    for requested in releases:
        for direction in (release.p_W, tool):
            easy = _comfortable_target(problem, direction, release.p_W[2])
            yield partial(_target_between, requested, easy, farthest)
        yield partial(_target_between, requested, under, farthest)


def _target_between(release: TargetRelease, near: Array, far: Array, share: float) -> Release:
    return replace(release, p_W=_between(near, far, share))


def _comfortable_target(problem: ThrowProblem, direction: Array, height: float) -> Array:
    """Returns a target (3,) well within reach, in the direction of a position (3,), at a height [m] if reachable.

    It is in front of the first keep-out box on the way, if that leaves room.
    """
    cell = problem.cell
    base, reach = cell.X_WB[:3, 3], COMFORTABLE_REACH * farthest_reach(problem)
    away = direction[:2] - base[:2]
    length = float(np.linalg.norm(away))
    along = away / length if length > 1e-6 else np.array([1.0, 0.0])
    z = min(height, base[2] + cell.robot.d[0] + reach)
    distance = np.linspace(0.0, reach, STEPS_OUT + 1)[:, None]
    p = np.column_stack([base[:2] + distance * along, np.full(len(distance), z)])
    return p[_unblocked(problem, p)]


def _unblocked(problem: ThrowProblem, p: Array) -> int:
    """Returns the row of `p` (n, 3) before the first one from `NEAREST_OUT` on that a box blocks, or the last."""
    room = problem.cell.object.radius_m + BESIDE_M
    blocked = np.zeros(len(p), dtype=bool)
    for box in problem.cell.surroundings.keep_out:
        blocked |= np.all((p >= box.lower - room) & (p <= box.upper + room), axis=1)
    ahead = np.flatnonzero(blocked[NEAREST_OUT:])
    return NEAREST_OUT + int(ahead[0]) - 1 if len(ahead) and ahead[0] else len(p) - 1


def _farthest_throw(problem: ThrowProblem, release: TargetRelease) -> Array:
    """Returns the target (3,), or the farthest position on the way to it that a throw within the speed limits reaches.

    Source: range of a throw from height h at speed v, v/g sqrt(v^2 + 2 g h).
    """
    base, reach, g = problem.cell.X_WB[:3, 3], farthest_reach(problem), problem.gravity_at_tool_speed
    v = min(problem.limits.tcp_speed_max, release.max_speed_m_s)
    height = max(base[2] + reach - release.p_W[2], 0.0)
    near = np.array([*base[:2], release.p_W[2]])
    return _within(near, release.p_W, reach + v / g * np.sqrt(v * v + 2.0 * g * height))


def _within(centre: Array, p: Array, radius: float) -> Array:
    """Returns `p`, or the closest position to it within a radius of the centre."""
    distance = float(np.linalg.norm(p - centre))
    return p if distance <= radius else centre + (p - centre) * radius / distance


def _between(near: Array, far: Array, share: float) -> Array:
    return near + share * (far - near)

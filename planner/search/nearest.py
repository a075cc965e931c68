"""Nearest feasible request: what could be done instead of an infeasible request.

Requirements are relaxed one after the other, the mildest relaxation first: a speed is reduced, a position is moved into
reach, a target is brought closer; at last the whole release is drawn towards the start, where it is always feasible.
For each relaxation the largest feasible share of the request is found by bisection, by Ruckig's motions, which take
least time. Where the refusal is not proven, or about an obstacle, and start and home are free, the optimiser is asked
then: for more of a release window than the motion found keeps, and for nearer targets, also around the requested one.
Every release that is returned has a certified motion.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from planner.arrays import Array
from planner.certificate import certify
from planner.errors import BackendUnavailable, Infeasible, SolverFailed, Violation
from planner.geometry import tool_pose
from planner.problem import JointRelease, PointRelease, PoseRelease, Release, TargetRelease, ThrowProblem
from planner.rotations import matrix_to_rotation_vector, pose, rotation_vector_to_matrix
from planner.search.blocked_postures import blocked_postures
from planner.search.feasible_releases import (
    PlacedRelease,
    Relaxation,
    between,
    closer_targets,
    feasible_releases,
    moved,
    position,
    within,
)
from planner.search.proofs import refuse_impossible
from planner.search.record import CertifiedSolution, PlanningSearch, certified
from planner.search.search import MOTIONS, Solve, search_candidates
from planner.search.way_home import find_way_home
from planner.seeds import Candidate, candidates, farthest_reach

BISECTIONS = 6  # the share is found to 1/64
SHARE_MIN = 0.02  # [-] of the requested speed or displacement; tried first
SLOWER = (0.3, 0.05)  # [-] of the requested speed, tried where no other position allows the full speed
# Constraints on the position, which a slower release breaks, too.
POSITION_CONSTRAINTS = {"reach", "joint_position", "floor", "keep_in", "keep_out", "self_collision"}
OBSTACLE_CONSTRAINTS = {"flight_clearance", "keep_out"}  # where a target beyond what is in the way may be nearer
MOTIONS_MAX = 30
LATE_MOTIONS_MAX = 20  # motions certified, about 5 ms each; after the request's deadline
WINDOW_SHARE = 0.9  # [-] of the largest share: a smaller one is preferred if it keeps the release window
SHARES_MAX = 3  # [-] largest shares whose motion's end is searched for a way home; in vain that takes some seconds
CANDIDATES_MAX = 6
FEW_CANDIDATES = 2  # tried for one release, thoroughly or not
# [m] From the requested target: farther from the base, past what it stands behind; and where something is in the way,
# to either side, and below a target in the air.
BEYOND_M = (0.05, 0.1, 0.2)
BESIDE_M = (0.05, 0.1)
LOWER_M = (0.05, 0.1, 0.2)
NEARER_SHARES = (0.25, 0.5)  # [-] of the distance from the requested target to the nearest one found
WINDOW_SHARES = (1.0, 0.5, 0.25)  # [-] of the requested release window
# [-] What the optimiser may spend on targets, and on windows: most of what it finds takes 100 to 300 iterations.
ITERATIONS_MAX = 900
ANSWERS_MAX = 3
SEEDS_MAX = 2  # [-] of the optimiser for one of them
WINDOW_STEP_S = 1e-4
DECIMALS = 4  # [s] windows are rounded down to it: no gripper is timed more finely
ROUNDING = 1e-9  # [-] of a number of steps
TINY_M = 1e-6  # [m] targets that are no farther apart are the same


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
        variants = MOTIONS.get(problem.backend, MOTIONS["ruckig"])[::-1]  # the gentlest first
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


class Optimiser:
    """Decides whether other problems have an answer by the optimiser's first seeds, on a budget of work.

    Attributes:
        search: whose deadline and back end count.
        iterations: spent so far.
        answers: found so far, each of which is searched for a way home.
    """

    def __init__(self, search: PlanningSearch) -> None:
        self.search = search
        self.iterations = 0
        self.answers = 0

    def finds(self, problem: ThrowProblem) -> bool:
        """Returns whether there is a certified motion with a way home; not where the budget is spent."""
        spent = self.iterations >= ITERATIONS_MAX or self.answers >= ANSWERS_MAX or self.search.out_of_time
        if spent or problem.backend != "auto":
            return False
        inner = PlanningSearch(problem, self.search.deadline_s)
        try:
            refuse_impossible(problem)
            search_candidates(inner, candidates(problem))
        except (Infeasible, BackendUnavailable):
            return False
        self.search.extend_deadline(inner.loading_s)
        self.iterations += inner.iterations
        if inner.best is None:
            return False
        self.answers += 1
        return find_way_home(problem, inner.best)[0] is not None


def nearest_problem(search: PlanningSearch, violations: Sequence[Violation]) -> ThrowProblem | None:
    """Returns the closest problem that has a certified motion; None if none was found.

    A release window is the last thing to be asked for. A motion that lacks nothing else is offered with its own, or
    with as much more of the window as the optimiser finds a motion for.

    Args:
        search: without an answer.
        violations: of its refusal.
    """
    problem = search.problem
    broken = {violation.constraint for violation in violations}
    if search.nominal is not None and _has_way_home(problem, search.nominal):
        found = _with_own_window(problem, search.nominal)
        return _with_more_of_window(Optimiser(search), found, WINDOW_SHARES[1:])
    found = _relaxed(search, broken)
    is_proven = all(violation.proven for violation in violations) and not broken & OBSTACLE_CONSTRAINTS
    if is_proven or blocked_postures(problem):  # that is said at once
        return found
    found = _nearer_target(Optimiser(search), found, bool(broken & OBSTACLE_CONSTRAINTS))
    return found if found is None else _with_more_of_window(Optimiser(search), found, WINDOW_SHARES)


def _relaxed(search: PlanningSearch, broken: set[str]) -> ThrowProblem | None:
    """Returns the problem with the mildest relaxation that has a certified motion; None if none was found."""
    problem = search.problem
    feasibility = Feasibility(search.deadline_s)
    nominal = replace(problem, release_window_s=0.0) if problem.is_robust else problem
    for relaxation, thorough in _relaxations(problem, broken):
        shares = _feasible_shares(nominal, relaxation, feasibility, thorough)[:SHARES_MAX]
        found = list(_with_ways_home(problem, relaxation, shares))
        if found:
            return found[-1] if found[-1].release_window_s == problem.release_window_s else found[0]
        if feasibility.exhausted:
            break
    return None


def _with_more_of_window(optimiser: Optimiser, found: ThrowProblem, shares: Sequence[float]) -> ThrowProblem:
    """Returns a problem with as much more of the requested window as the optimiser has a motion for.

    That is the first of these shares that it has one for, or half way from there to the share before. The problem
    itself where that is none, or no more than it has. What was refused is not asked again.
    """
    requested = optimiser.search.problem
    before = 1.0
    for share in shares:
        wider = _with_share_of_window(requested, found, share)
        is_refused = share == 1.0 and _same(requested.release, found.release)
        if wider.release_window_s > found.release_window_s and not is_refused and optimiser.finds(wider):
            still_wider = _with_share_of_window(requested, found, (share + before) / 2.0)
            return still_wider if share < 1.0 and optimiser.finds(still_wider) else wider
        before = share
    return found


def _with_share_of_window(requested: ThrowProblem, found: ThrowProblem, share: float) -> ThrowProblem:
    window_s = share * requested.release_window_s
    return replace(found, release_window_s=window_s if share == 1.0 else _rounded_down(window_s))


def _nearer_target(optimiser: Optimiser, found: ThrowProblem | None, is_obstructed: bool) -> ThrowProblem | None:
    """Returns the problem with a nearer target than the one found, if the optimiser finds a motion to one, or that one.

    A few are tried, the nearest first: between the two, and around the requested one.
    """
    problem = optimiser.search.problem
    release = problem.release
    apart = math.inf
    if not isinstance(release, TargetRelease):
        return found
    easier = release
    places = [release.p_W, *_around(problem, release.p_W, is_obstructed)]
    if found is not None and isinstance(found.release, TargetRelease):
        apart = _apart(release, found.release)
        easier = found.release  # which may begin anywhere
        places += [between(release.p_W, found.release.p_W, share) for share in NEARER_SHARES]
    nearer = [replace(problem, release=replace(easier, p_W=place)) for place in places]
    nearer = [each for each in nearer if _apart(release, each.release) < apart and not _same(release, each.release)]
    nearer.sort(key=lambda each: _apart(release, each.release))
    return next((each for each in nearer if optimiser.finds(each)), found)


def _around(problem: ThrowProblem, p_W: Array, is_obstructed: bool) -> Iterator[Array]:
    """Yields places (3,) around a target: farther from the base, and beside, below or on top of what is in the way."""
    away = np.array([*(p_W - problem.cell.X_WB[:3, 3])[:2], 0.0])
    if (length := np.linalg.norm(away)) > TINY_M:
        ahead = away / length
        yield from (p_W + d * ahead for d in BEYOND_M)
        across = np.array([-ahead[1], ahead[0], 0.0])
        yield from (p_W + side * d * across for d in BESIDE_M for side in (1.0, -1.0) if is_obstructed)
    floor_z = problem.cell.surroundings.floor_z_m
    boxes = problem.cell.surroundings.keep_out
    yield from (p_W - [0.0, 0.0, d] for d in LOWER_M if is_obstructed and p_W[2] - d >= floor_z)
    yield from (np.array([*p_W[:2], box.upper[2]]) for box in boxes if box.depth(p_W) >= 0.0)


def _apart(release: Release, other: Release) -> float:
    """Returns the distance of two targets [m]; infinite for other releases, unless they are the same."""
    if isinstance(release, TargetRelease) and isinstance(other, TargetRelease):
        return float(np.linalg.norm(release.p_W - other.p_W))
    return 0.0 if release is other else math.inf


def _same(release: Release, other: Release) -> bool:
    """Returns whether two releases are the same, or throws to one target that may both begin anywhere, or neither."""
    if not isinstance(release, TargetRelease) or not isinstance(other, TargetRelease):
        return release is other
    anywhere = [each.release_position is None for each in (release, other)]
    return _apart(release, other) < TINY_M and anywhere[0] == anywhere[1]


def _has_way_home(problem: ThrowProblem, motion: CertifiedSolution) -> bool:
    """Returns whether there is a way home from the end of a motion, which need not keep the release window."""
    return find_way_home(replace(problem, release_window_s=0.0), motion)[0] is not None


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
        if not _has_way_home(found, motion):
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
    motion = nominal.solution.trajectory
    if "casadi" in (problem.backend, nominal.backend):
        return replace(problem, release_window_s=0.0)
    if certify(problem, motion).valid:
        return problem
    kept = 0.0
    failed = problem.release_window_s
    for _ in range(BISECTIONS):
        window_s = (kept + failed) / 2.0
        if certify(replace(problem, release_window_s=window_s), motion).valid:
            kept = window_s
        else:
            failed = window_s
    return replace(problem, release_window_s=_rounded_down(kept))


def _rounded_down(window_s: float) -> float:
    """Returns a window in whole steps of `WINDOW_STEP_S` [s]; what keeps a longer one keeps it."""
    steps = math.floor(window_s / WINDOW_STEP_S + ROUNDING)
    return round(steps * WINDOW_STEP_S, DECIMALS)


def _relaxations(problem: ThrowProblem, broken: set[str]) -> Iterator[tuple[Relaxation, bool]]:
    """Yields relaxations, the mildest first, and whether each deserves a thorough search."""
    release = problem.release
    if isinstance(release, TargetRelease):
        yield from ((relaxation, True) for relaxation in closer_targets(problem, release))
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
    feasible = [(0.0, first)]
    failed = [1.0]
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
    farthest = within(problem.cell.X_WB[:3, 3], requested, farthest_reach(problem))
    for speed in (1.0, *SLOWER):
        slowed = _slower(release, speed)
        assert isinstance(slowed, PoseRelease | PointRelease)
        for feasible in feasible_releases(problem, slowed):
            yield partial(_moved_between, slowed, position(feasible), farthest)


def _moved_between(release: PlacedRelease, near: Array, far: Array, share: float) -> Release:
    return moved(release, between(near, far, share))


def _towards_start(problem: ThrowProblem, release: Release, share: float) -> Release:
    """Returns the release drawn towards a standstill at the start."""
    share = max(share, SHARE_MIN)
    X_W0 = tool_pose(problem.cell, problem.start)
    match release:
        case JointRelease(q, qd):
            return JointRelease(between(problem.start, q, share), share * qd)
        case PointRelease(p, v):
            return PointRelease(between(X_W0[:3, 3], p, share), share * v)
        case PoseRelease(X, V):
            turn = share * matrix_to_rotation_vector(X[:3, :3] @ X_W0[:3, :3].T)
            R_WT = rotation_vector_to_matrix(turn) @ X_W0[:3, :3]
            return PoseRelease(pose(between(X_W0[:3, 3], X[:3, 3], share), R_WT), share * V)
    return release

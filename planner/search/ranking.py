"""Candidates in the order in which they are tried, with Ruckig's times to them."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from typing import overload

import numpy as np

from planner.arrays import Array
from planner.backends import ruckig_otg
from planner.flight import path
from planner.geometry import Arcs, body_model, segment_segment_distance
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.search.incumbent import CertifiedSolution
from planner.seeds import Candidate, Seed, aspects, first_rows, least_times_to_aspects
from planner.trajectory import Trajectory

RANKED_MAX = 24  # candidates of least lower bound that are considered; a pose's others are full turns away
TIMED_MAX = 8  # of these are ranked by Ruckig's launch time
UNDERCUT = 0.75  # [-] of the lower bound of an aspect's soonest candidate: 29 of 32 throws release later than that
# [-] The same for a point. With 0.9 six of 240 points release later than with 0.85, by up to a twentieth.
UNDERCUT_OF_POINT = 0.85
# [-] Times the release time of a point's answer: largest lower bound of what is tried because it is unlike it. Of 1,780
# points 13 are sooner by over a hundredth than without a largest one, and 14 later.
LATE_AT_POINT = 1.3
# [-] Release time, less the time that an acceleration takes to its limit, over the lower bound of a target's soonest
# candidate: later throws are stuck in a local minimum. Of 239 targets the 40 slowest by this hold 9 of the 14 answers
# that are more than a tenth late, and with a release window the 20 slowest 12 of 16 (by the bound alone, 7 and 9).
SLOW = 1.05
SLOW_ROBUST = 1.4
SLOW_GIVEN = 1.05  # [-] release time over the least bound, where a release state is given
# [-] The same where the joints are free, as from a given point: of 1,146 one is later by over 1 % than with 1.05.
SLOW_FREE = 1.15
SEEDS_AN_ASPECT = 2  # [-] the optimiser fails from one seed and not from another, but rarely finds another motion
# [s] That an acceleration takes to its limit in a gentle guess, without a release window. By it in first seeds 54 of
# 1,670 targets release sooner by over a hundredth, and 10 later; with a window as many are later as sooner.
GENTLE_RAMP_S = 0.1
# [-] Times the soonest arrival: the stages of a longer guess are too long for the soonest motion (0.04 s became 0.066).
# Half of the targets from random starts begin gently then.
GENTLE_LONGER = 1.5
PATH_SHARES = np.linspace(0.15, 0.9, 6)  # [-] of the straight joint path to a candidate, checked for obstacles
FLIGHT_STEP_S = 0.02  # [s] between the instants at which a flight is compared with the arm
FLANGE = 6  # frame of the flange: the object starts within the tool's shapes
OBSTACLE_DEPTH_M = 0.02  # [m] penetration on that path which the optimiser still gets around


@dataclass(frozen=True, eq=False)
class RankedCandidate:
    """A candidate with Ruckig's times to it, and a note of what was tried from it and what was made in advance.

    Attributes:
        problem: that it is a release state for.
        candidate: the state.
        given: motion through it that the optimiser starts from; None for Ruckig's.
        tried: what was tried from it.
        made: Ruckig's motions to it.
    """

    problem: ThrowProblem
    candidate: Candidate
    given: Trajectory | None = None
    tried: set[str] = field(default_factory=set)
    made: dict[ruckig_otg.LaunchVariant, CertifiedSolution] = field(default_factory=dict)

    @cached_property
    def arrival_s(self) -> float:
        """Least time of the slowest joint alone, with free acceleration at the release [s]; infinite if refused."""
        arrival = ruckig_otg.arrival(self.problem, self.candidate)
        return float("inf") if arrival is None else arrival.time_s

    @cached_property
    def launch_s(self) -> float:
        """Ruckig's launch time with zero acceleration at the release [s]; infinite if refused."""
        return ruckig_otg.launch_time(self.problem, self.candidate)

    @cached_property
    def seed(self) -> Seed:
        """The optimiser's seed: the motion that is given, or else Ruckig's to the candidate, if there is one."""
        return self._seed_under(self.problem) if self.given is None else Seed(self.candidate, self.given)

    @cached_property
    def gentle_seed(self) -> Seed:
        """The optimiser's seed with Ruckig's motion of so little jerk that an acceleration takes `GENTLE_RAMP_S`.

        It is `seed` where a motion is given, where the request allows no more jerk than that, and where the gentle
        motion is more than `GENTLE_LONGER` as long.
        """
        limits = self.problem.limits
        jerk_max = np.minimum(limits.jerk_max, limits.qdd_max / GENTLE_RAMP_S)
        if self.given is not None or np.array_equal(jerk_max, limits.jerk_max):
            return self.seed
        gentle = self._seed_under(replace(self.problem, limits=replace(limits, jerk_max=jerk_max)))
        motion = gentle.initial_guess
        is_usable = motion is not None and motion.release_time_s <= GENTLE_LONGER * self.arrival_s
        return gentle if is_usable else self.seed

    def _seed_under(self, problem: ThrowProblem) -> Seed:
        """Returns the seed with Ruckig's motion within a problem's limits; without a motion where it has no launch."""
        refused = self.launch_s == float("inf")
        return Seed(self.candidate, None if refused else ruckig_otg.initial_guess(problem, self.candidate))

    def bound_s(self, variant: ruckig_otg.LaunchVariant) -> float:
        """Lower bound on the release time of Ruckig's motion to the candidate [s]."""
        return self.arrival_s if variant == "free" else max(self.arrival_s, self.launch_s)

    def first_try(self, what: str) -> bool:
        """Returns whether this was not tried from the candidate before, and notes that it is now."""
        untried = what not in self.tried
        self.tried.add(what)
        return untried


class Ranking(Sequence[RankedCandidate]):
    """Candidates in the order in which they are tried: the first `TIMED_MAX` by Ruckig's launch time, then by bound.

    If the straight joint path to the first is obstructed, those with a free path come first; likewise for a point, if
    the object would meet the arm as it is at the release, as only another posture is a remedy. The order is worked out
    when it is first asked for: a release state whose soonest arrival is certified needs no launch times.
    """

    def __init__(
        self, problem: ThrowProblem, candidates: Sequence[Candidate], motions: Sequence[Trajectory] = ()
    ) -> None:
        """Takes candidates by ascending lower bound on the launch time, and motions through the first of them."""
        pairs = zip_longest(candidates, motions)
        self.problem, ranked = problem, [RankedCandidate(problem, candidate, given) for candidate, given in pairs]
        self.settled: set[int] = set()
        self._by_bound = ranked[:RANKED_MAX]
        self._others = ranked[RANKED_MAX:]

    @cached_property
    def _ordered(self) -> list[RankedCandidate]:
        first = sorted(self._by_bound[:TIMED_MAX], key=lambda ranked: ranked.launch_s)
        if not all(_paths_free(first[:1])):
            first = [first[i] for i in np.argsort(np.logical_not(_paths_free(first)), kind="stable")]
        if not all(_flights_clear(first[:1])):
            first = [first[i] for i in np.argsort(np.logical_not(_flights_clear(first)), kind="stable")]
        return [*first, *self._by_bound[TIMED_MAX:]]

    def __len__(self) -> int:
        return len(self._by_bound)

    @overload
    def __getitem__(self, index: int) -> RankedCandidate: ...

    @overload
    def __getitem__(self, index: slice) -> list[RankedCandidate]: ...

    def __getitem__(self, index: int | slice) -> RankedCandidate | list[RankedCandidate]:
        return self._ordered[index]

    def by_aspect(self) -> Iterator[RankedCandidate]:
        """Yields the first candidate of every aspect, then the second of those that are not settled by then."""
        ranked = [*self._ordered, *self._others]
        aspect = np.array([self._aspect[each] for each in ranked])
        for _ in range(SEEDS_AN_ASPECT):
            first = first_rows(aspect)
            yield from (ranked[row] for row in first if aspect[row] not in self.settled)
            rest = np.delete(np.arange(len(ranked)), first)
            ranked = [ranked[row] for row in rest]
            aspect = aspect[rest]

    def by_bound(self) -> list[RankedCandidate]:
        """Returns the candidates by ascending lower bound, those with an obstructed path among them."""
        return self._by_bound

    def unlike(self, motion: Trajectory) -> list[RankedCandidate]:
        """Returns the candidates of a motion's aspect that nothing was tried from, the least like its release first.

        That is the one with the joint whose velocity differs most: within an aspect, most of what is sooner than an
        answer turns some joint the other way. Of a given point those are left out whose lower bound is late beside the
        answer.
        """
        k = motion.release_index
        is_point = isinstance(self.problem.release, PointRelease)
        qd = motion.qd[k]
        aspect = int(aspects(self.problem.cell.robot, motion.q[k][None])[0])
        latest_s = LATE_AT_POINT * motion.release_time_s if is_point else float("inf")
        soon = [each for each in (*self._ordered, *self._others) if each.candidate.bound_s <= latest_s]
        found = [each for each in soon if not each.tried and self._aspect[each] == aspect]
        return sorted(found, key=lambda each: -float(np.abs(each.candidate.qd - qd).max()))

    def _is_settled(self, ranked: RankedCandidate) -> bool:
        """Returns whether a candidate's aspect is settled, and the release state is not given."""
        return not self.problem.fixes_joints and self._aspect[ranked] in self.settled

    def settle(self, ranked: RankedCandidate, release_s: float) -> None:
        """Notes that the optimiser came from a candidate to a release at `release_s` [s], infinite for too late.

        That settles its aspect, unless a throw hardly improves on the candidate: it is stuck in a poor local minimum.
        """
        aspect = self._aspect[ranked]
        is_slow = self._is_slow_throw(release_s, self._least_bounds[aspect])
        if not isinstance(self.problem.release, TargetRelease) or not is_slow or release_s == float("inf"):
            self.settled.add(aspect)

    def is_slow(self, release_s: float) -> bool:
        """Returns whether an answer at `release_s` [s] is slow beside the least lower bound of all candidates."""
        if isinstance(self.problem.release, TargetRelease):
            return self._is_slow_throw(release_s, self._least_bound_s)
        # how much a window delays a release that is given is not known
        share = SLOW_GIVEN if self.problem.fixes_joints else SLOW_FREE
        return not self.problem.is_robust and release_s > share * self._least_bound_s

    def leaves_much_to_gain(self, release_s: float) -> bool:
        """Returns whether an answer at `release_s` [s] is not near the least bound, or the release state is given."""
        return self.problem.fixes_joints or release_s > SLOW_FREE * self._least_bound_s

    def _is_slow_throw(self, release_s: float, bound_s: float) -> bool:
        """Returns whether a throw to a target at `release_s` [s] is slow beside a bound that knows no jerk [s]."""
        limits = self.problem.limits
        share = SLOW_ROBUST if self.problem.is_robust else SLOW
        return release_s > share * bound_s + float((limits.qdd_max / limits.jerk_max).max())

    def least_time(self, ranked: RankedCandidate) -> float:
        """Returns a lower bound [s] on the release time of what the optimiser makes of a candidate.

        It keeps the release state, where that is given, and the aspect.
        """
        if self.problem.fixes_joints:
            return ranked.candidate.bound_s
        return float(self._least_by_aspect[self._aspect[ranked]])

    def may_be_sooner(self, ranked: RankedCandidate, release_s: float) -> bool:
        """Returns whether the optimiser may come from a candidate to a release before `release_s` [s].

        Not where its aspect is settled. Proven is the least time alone: in other aspects than the start's, a throw to a
        target rarely releases before `UNDERCUT` of its candidate's bound, and one from a given point before
        `UNDERCUT_OF_POINT` of it.
        """
        if self._is_settled(ranked):
            return False
        least_s = self.least_time(ranked)
        if least_s > 0.0 and not self.problem.fixes_joints:
            share = UNDERCUT if isinstance(self.problem.release, TargetRelease) else UNDERCUT_OF_POINT
            least_s = max(least_s, share * ranked.candidate.bound_s)
        return least_s < release_s

    @property
    def _least_bound_s(self) -> float:
        return min(self._least_bounds.values(), default=0.0)

    @cached_property
    def _least_bounds(self) -> dict[int, float]:
        """The least lower bound of the candidates of every aspect that there are [s]."""
        ranked = sorted([*self._by_bound, *self._others], key=lambda each: -each.candidate.bound_s)
        return {self._aspect[each]: each.candidate.bound_s for each in ranked}

    @cached_property
    def _least_by_aspect(self) -> Array:
        return least_times_to_aspects(self.problem)

    @cached_property
    def _aspect(self) -> dict[RankedCandidate, int]:
        """The aspect of every candidate."""
        ranked = [*self._by_bound, *self._others]
        q = np.array([each.candidate.q for each in ranked]).reshape(-1, 6)
        return dict(zip(ranked, aspects(self.problem.cell.robot, q).tolist(), strict=True))

    def by_arrival(self) -> Iterator[RankedCandidate]:
        """Yields the `TIMED_MAX` of least bound by the slowest joint's own time, and times no more than it has to.

        A candidate can only arrive after its bound, so the soonest timed one comes before all with a later bound.
        """
        waiting = self._by_bound[:TIMED_MAX]
        timed = []
        while waiting or timed:
            while waiting and (not timed or waiting[0].candidate.bound_s < timed[0].arrival_s):
                insort(timed, waiting.pop(0), key=lambda ranked: ranked.arrival_s)
            yield timed.pop(0)


def released(motion: Trajectory, label: str) -> Candidate:
    """Returns the release state of a motion as a candidate."""
    return Candidate(motion.q[motion.release_index], motion.qd[motion.release_index], 0.0, label)


def _paths_free(ranking: Sequence[RankedCandidate]) -> list[bool]:
    """Returns for every candidate whether its straight joint path is free, up to `OBSTACLE_DEPTH_M`."""
    problem = ranking[0].problem
    steps = np.array([ranked.candidate.q for ranked in ranking]) - problem.start
    q = problem.start + np.multiply.outer(PATH_SHARES, steps)
    least = body_model(problem.cell_with_bin).clearances(q.reshape(-1, 6)).least.reshape(len(PATH_SHARES), -1)
    return (least.min(axis=0) > -OBSTACLE_DEPTH_M).tolist()


def _flights_clear(ranking: Sequence[RankedCandidate]) -> list[bool]:
    """Returns for every candidate of a point whether the object's flight is clear of the arm at rest in its posture.

    The arm brakes on: that clears more than half of the flights that meet it here, so none is dropped.
    """
    problem = ranking[0].problem if ranking else None
    if problem is None or problem.ends_at_rest or not isinstance(problem.release, PointRelease):
        return [True] * len(ranking)
    release = problem.release
    body = body_model(problem.cell_with_bin)
    radius = problem.cell.object.radius_m
    arc = Arcs.onto(release.p_WT, release.v_WT, problem.plane_z, problem.gravity_at_tool_speed, radius)
    x = path(arc.p, arc.v, np.arange(FLIGHT_STEP_S, float(arc.until_s), FLIGHT_STEP_S), arc.gravity, problem.drag)
    links = np.flatnonzero(body.frames < FLANGE)
    ends = body.end_points(body.link_poses(np.array([ranked.candidate.q for ranked in ranking])))[links]
    p0, p1 = np.moveaxis(ends, (1, 2), (0, -1))[:, :, :, None]
    gaps = segment_segment_distance(x, x, p0, p1) - body.radii[links, None, None] - radius
    return (gaps.min(axis=(0, 2), initial=np.inf) >= 0.0).tolist()

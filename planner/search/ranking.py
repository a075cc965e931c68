"""Candidates in the order in which the optimiser begins from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from planner.backends import ruckig_otg
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds import Candidate, InitialGuess, Seed, aspects, least_times_to_aspects
from planner.trajectory import Trajectory

UNDERCUT = 0.8  # [-] of its lower bound: no throw from a candidate of another aspect is expected to release before that
POSTURE_DECIMALS = 6  # of cosines and sines, by which postures are told apart
GENTLE_RAMP_S = 0.1  # [s] that an acceleration takes to its limit in a gentle guess
GENTLE_LONGER = 1.5  # [-] times the soonest arrival: a longer guess has stages too long for the soonest motion


@dataclass(frozen=True, eq=False)
class Ranked:
    """A candidate with what Ruckig knows of it.

    Attributes:
        problem: that it is a release state for.
        candidate: the state.
        aspect: that it lies in; of a given release its posture, which others share that differ by whole turns.
        least_s: no motion that the optimiser makes of it is expected to release before [s].
        given: motion through it that the optimiser begins from; None for Ruckig's.
        tried: whether the optimiser began from it.
    """

    problem: ThrowProblem
    candidate: Candidate
    aspect: int
    least_s: float
    given: Trajectory | None = None
    tried: set[str] = field(default_factory=set)

    @cached_property
    def arrival_s(self) -> float:
        """Least time of the slowest joint alone [s]; infinite if Ruckig refuses the state."""
        arrival = ruckig_otg.arrival(self.problem, self.candidate)
        return float("inf") if arrival is None else arrival.time_s

    def guess(self, attempt: int) -> tuple[ThrowProblem, Seed]:
        """Returns limits to keep, and Ruckig's motion to the candidate from which the optimiser begins.

        A throw to a target without a window begins gently at first, with so little jerk that an acceleration takes a
        while to its limit, unless that is long; others begin with Ruckig's own motion. What came to nothing from that
        begins the other way, then with half of the jerk, then with a quarter: what keeps that keeps the request's.
        """
        self.tried.add("optimiser")
        if self.given is not None:
            return self.problem, Seed(self.candidate, self.given)
        limits = self.problem.limits
        problem = self.problem
        if attempt > 1:
            problem = replace(problem, limits=replace(limits, jerk_max=0.5 ** (attempt - 1) * limits.jerk_max))
        elif (attempt == 0) == (isinstance(problem.release, TargetRelease) and not problem.is_robust):
            jerk_max = np.minimum(limits.jerk_max, limits.qdd_max / GENTLE_RAMP_S)
            motion = self._motion(replace(problem, limits=replace(limits, jerk_max=jerk_max)))
            if motion is not None and motion.release_time_s <= GENTLE_LONGER * self.arrival_s:
                return problem, Seed(self.candidate, motion)
        return problem, Seed(self.candidate, self._motion(problem))

    def _motion(self, problem: ThrowProblem) -> InitialGuess | None:
        refused = ruckig_otg.launch_time(self.problem, self.candidate) == float("inf")
        return None if refused else ruckig_otg.initial_guess(problem, self.candidate)


def ranked(problem: ThrowProblem, found: Sequence[Candidate]) -> list[Ranked]:
    """Returns candidates by ascending lower bound, as they are given."""
    if problem.fixes_joints:
        postures = [tuple(np.round([np.cos(each.q), np.sin(each.q)], POSTURE_DECIMALS).ravel()) for each in found]
        return [
            Ranked(problem, each, postures.index(of), each.bound_s) for each, of in zip(found, postures, strict=True)
        ]
    of = aspects(problem.cell.robot, np.array([each.q for each in found]).reshape(-1, 6)).tolist()
    least = least_times_to_aspects(problem)
    proven = [float(least[aspect]) for aspect in of]  # 0 in the start's own
    expected = [UNDERCUT * each.bound_s if s > 0.0 else 0.0 for each, s in zip(found, proven, strict=True)]
    return [Ranked(problem, *each) for each in zip(found, of, np.maximum(proven, expected).tolist(), strict=True)]


def by_aspect(order: Sequence[Ranked], rounds: int) -> Iterator[Ranked]:
    """Yields the first of every aspect, then the second, and so on for so many rounds."""
    for k in range(rounds):
        seen: dict[int, int] = {}
        for each in order:
            seen[each.aspect] = seen.get(each.aspect, -1) + 1
            if seen[each.aspect] == k:
                yield each


def unlike(order: Sequence[Ranked], motion: Trajectory) -> list[Ranked]:
    """Returns the untried candidates of a motion's aspect, the one first whose joint velocities differ most from its.

    What is sooner than an answer turns some joint the other way, as a rule.
    """
    k = motion.release_index
    aspect = int(aspects(order[0].problem.cell.robot, motion.q[k][None])[0])
    found = [each for each in order if not each.tried and each.aspect == aspect]
    return sorted(found, key=lambda each: -float(np.abs(each.candidate.qd - motion.qd[k]).max()))


def again(problem: ThrowProblem, motion: Trajectory) -> Ranked:
    """Returns a motion's release, with the motion: its stages, even over it now, may lead to a sooner one."""
    k = motion.release_index
    return Ranked(problem, Candidate(motion.q[k], motion.qd[k], 0.0, "answer"), 0, 0.0, motion)

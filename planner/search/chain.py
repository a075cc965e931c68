"""The search for a motion through several passages: leg by leg, certified as one.

    the joint states of every passage, those nearest to the passage before
      → a graph: a node a state, an edge a leg from one passage to the next, as long as its fastest motion
      → the shortest way through it, which chooses the branches of the inverse kinematics for the whole chain
      → Ruckig's motion along it, first with accelerations at the passages that make it sooner → certificate
      → the leg in which a check fails is made gentler, or left out; and again
      → nothing certified: throws at its end by themselves, from a motion through what is before

A state is passed with zero acceleration, or with that at which the tool keeps its twist, as far as the graph knows;
along a way, with what makes the legs beside it sooner, where that is certified. A point, whose orientation is free, is
passed in postures near those of its neighbours, too, and an object is let go of as in throws of its own. A line is one
node, too, which takes its time: its motion follows from the branch. Counts alone decide what is tried; the only clock
is the request's time limit.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from planner.arrays import Array
from planner.backends import ruckig_otg
from planner.backends.solution import Solution
from planner.certificate import SINGULARITY_WINDOW_S, Check
from planner.errors import Infeasible, SolverFailed, Violation, nothing_found
from planner.kinematics import inverse_velocity, jacobian, singularity_distances, tcp_acceleration
from planner.passages import passed_until, released_first
from planner.problem import ThrowProblem
from planner.releases import SteadyLine
from planner.search.passing import State, passing_accelerations
from planner.search.record import PlanningSearch
from planner.search.search import search_candidates
from planner.search.tool_lines import line_motions
from planner.search.turns import LEAVES_S, PACES, search_in_turn, thrown_last
from planner.seeds import Candidate, candidates, near_candidates
from planner.trajectory import Trajectory

STATES = 24  # [-] joint states kept of a passage: a pose has eight branches, each with full turns and two accelerations
MOTIONS = 200  # [-] motions looked at leg by leg, at most: two along a way, with chosen accelerations and without
THROWN_FROM = 2  # [-] postures of the passage before that throws of their own are looked for from, besides the start
THROWN_SHARE = 0.9  # [-] of the accelerations, in these throws: legs on ticks reach no state at the limit
BESIDE = 6  # [-] of these of each neighbour a point is passed in postures nearby
WAYS = 1000  # [-] ways looked at: most that do not come to a motion have a leg that Ruckig refuses
EASED = 0.8  # [-] of the time to a passage with an instant of its own: chosen accelerations seldom spare more
ROUNDING = 1e-6  # [ticks] of a duration in floating point
OF_RELEASE = (
    "flight_clearance",
    "flights_apart",
    "landing",
    "landing_window",
    "opening_direction",
)  # checks that the release decides
Piece = tuple[Array, Array, Array]  # the same at one tick or more (n, 6): of a state, a line or a leg
REST: Piece = (np.empty((0, 6)), np.empty((0, 6)), np.empty((0, 6)))  # stands for rest, anywhere


def search_chain(search: PlanningSearch) -> None:
    """Searches for a certified motion through the passages of a problem, to its end.

    Args:
        search: updated in place.

    Raises:
        Infeasible: a passage has no joint state, or no motion was certified; names the passage, or the leg.
        SolverFailed: the deadline ended the search before that.
    """
    throws = thrown_last(search.problem)
    only_throws = 1 < throws == len(search.problem.passages)
    if only_throws:
        search_in_turn(search)
    if search.best is not None:
        search.note_end()
        return
    begun_s = time.perf_counter()
    before = len(search.rejected)  # throws in turn
    legs = _legs(search)
    for _ in range(WAYS):
        left = MOTIONS - (len(search.rejected) - before)
        way = legs.shortest()
        if way is None or search.best is not None or left == 0 or search.out_of_time:
            break
        search.step(1)
        _try(search, legs, way, left)
    search.note_end()
    tried = len(search.certified) + len(search.rejected) - before
    search.log_attempt("ruckig", f"leg by leg: {len(search.certified)} of {tried} motions certified", begun_s)
    if throws and not only_throws and search.best is None and not search.out_of_time:
        _throw_last(search, throws)
        search.note_end()
    if search.best is None:
        raise search.failure([legs.obstacle()])


def _throw_last(search: PlanningSearch, throws: int) -> None:
    """Searches for a motion that ends with throws of their own, from where other passages have been passed.

    Args:
        search: updated in place.
        throws: how many of the last passages are throws.
    """
    number = len(search.problem.passages) - throws
    if number == 0:
        search_in_turn(search)
        return
    with search.inner(search.problem.up_to(number)) as inner:
        search_chain(inner)
    if inner.best is not None:
        search_in_turn(search, inner.best)


def _try(search: PlanningSearch, legs: _Legs, way: list[int], at_most: int) -> None:
    """Makes and certifies the motion along a way; what stands in its way is noted with its leg.

    Args:
        search, legs: updated in place.
        way: to be tried.
        at_most: motions that may be certified.

    Raises:
        Infeasible: the outputs contradict each other, which no other way mends.
    """
    sooner = _motion(_eased(legs, way), way)
    if sooner is not None:
        is_valid = search.certify("ruckig", Solution(sooner, "leg by leg, accelerations free")).is_valid
        if is_valid or at_most == 1:
            return
    motion = _motion(legs, way)
    if motion is None:
        return
    found = search.certify("ruckig", Solution(motion, "leg by leg"))
    if found.is_valid:
        return
    blamed = set()
    for failed, release_index in found.examination.failed_releases:
        violation = failed.as_violation()
        if failed.name == "passage" and failed.unit == "s":
            raise Infeasible([violation])
        leg, ends = _leg_of(search.problem, motion, failed, release_index)
        if leg not in blamed:
            blamed.add(leg)
            legs.give_way(leg, way, violation, ends)


def _motion(legs: _Legs, way: list[int]) -> Trajectory | None:
    """Returns the motion along a way; None where a leg is refused, which is noted."""
    made = [legs.piece(0, way)]
    passed = []
    tick = 0
    for number in range(len(way) - 1):
        try:
            made.append(legs.samples(number, way, tick))
        except SolverFailed as failure:
            obstacle = next(iter(failure.violations), nothing_found("motion", str(failure)))
            legs.give_way(number, way, obstacle)
            return None
        tick += len(made[-1][0]) - 1
        passed.append(tick + legs.lead(number + 1, way[number + 1]))
        made.append(legs.piece(number + 1, way))
        tick += legs.lasts(number + 1, way[number + 1])
    return _joined(legs.problem, made, passed)


def _is_free(legs: _Legs, number: int) -> bool:
    """Returns whether a passage may have any acceleration: in no line, at no rest, and where nothing leaves."""
    passage = legs.problem.passages[number]
    return legs.lasts(number + 1) == 0 and not passage.state.is_at_rest and not passage.releases


def _eased(legs: _Legs, way: Sequence[int]) -> _Legs:
    """Returns the legs of one way, with the accelerations that make it sooner at every state where they are free."""
    passages = legs.problem.passages
    ends = [(_last(legs.piece(i, way)), _first(legs.states[i + 1][way[i + 1]])) for i in range(len(way) - 1)]
    free = [i < len(passages) and _is_free(legs, i) for i in range(len(way) - 2)]
    states = [list(each) for each in legs.states]
    for i, qdd in enumerate(passing_accelerations(legs.problem, ends, free)):
        if free[i]:
            q, qd, _ = legs.piece(i + 1, way)
            states[i + 1][way[i + 1]] = (q, qd, qdd[None])
    ticks, paces = ([each.copy() for each in arrays] for arrays in (legs.ticks, legs.paces))
    return replace(legs, states=states, ticks=ticks, paces=paces, obstacles={})


def _leg_of(problem: ThrowProblem, motion: Trajectory, failed: Check, release_index: int) -> tuple[int, bool]:
    """Returns the number of the leg in which a check fails, or that leads to the line, or to the release of the flight.

    With it, whether the passage at its end is to blame.

    Args:
        problem, motion: as made.
        failed: the check.
        release_index: sample of the release that it is of.
    """
    if failed.name in OF_RELEASE:
        return motion.passed.index(release_index), True
    at_s = math.inf if failed.at_s is None else failed.at_s
    leg = int(np.searchsorted(np.array(passed_until(problem.passages, motion)) * motion.dt, at_s))
    return leg, leg < len(motion.passed) and at_s > motion.passed[leg] * motion.dt


def _joined(problem: ThrowProblem, pieces: Sequence[Piece], begun: Sequence[int]) -> Trajectory:
    """Returns the motion of pieces in a row, each of which begins in the last state of the one before.

    Args:
        problem: that it is for.
        pieces: start, legs and passages.
        begun: ticks at which passages begin, and perhaps the end.
    """
    arrays = [np.concatenate([piece[k][int(i > 0) :] for i, piece in enumerate(pieces)]) for k in range(3)]
    passed = tuple(begun[: len(problem.passages)])
    released = released_first(problem.passages, passed)
    return Trajectory(1.0 / problem.dt, *arrays, release_index=released, passage_indices=passed)


@dataclass(eq=False)
class _Legs:
    """The legs between the joint states of start, passages and end.

    Attributes:
        problem: gives limits and tick.
        names: of start, passages and end, in words.
        states: samples of each from every joint state in which it may begin; see `REST`.
        leads: of each, ticks from where samples that last begin to where it is passed.
        ticks: from every state of one to every state of the next by the fastest leg (n, m): whole numbers, whose sums
            are exact; infinite for none.
        paces: number of the pace of each leg (n, m).
        obstacles: what stood in the way of a leg last, by its number.
        soonest: ticks at which passages with a time of their own can be passed, of all ways so far.
    """

    problem: ThrowProblem
    names: list[str]
    states: list[list[Piece]]
    leads: list[int]
    ticks: list[Array]
    paces: list[Array]
    obstacles: dict[int, Violation] = field(default_factory=dict)
    soonest: dict[int, float] = field(default_factory=dict)

    def shortest(self) -> list[int] | None:
        """Returns the number of the state of each on the shortest way; None where there is none. Bellman, 1957."""
        cost = np.zeros(1)
        came_from = []
        for number, ticks in enumerate(self.ticks):
            total = cost[:, None] + ticks
            came_from.append(total.argmin(axis=0))
            cost = self._in_time(number, total.min(axis=0))
        last = int(cost.argmin())
        if not math.isfinite(cost[last]):
            return None
        way = [last]
        for back in reversed(came_from):
            way.append(int(back[way[-1]]))
        return way[::-1]

    def _in_time(self, number: int, arrivals: Array) -> Array:
        """Returns when the states at the end of a leg are passed (m,) [ticks], at the soonest; infinite where too late.

        `arrivals` are the ticks at which the fastest legs lead there.
        """
        if number >= len(self.problem.passages):
            return arrivals
        passage = self.problem.passages[number]
        leads = np.array([self.lead(number + 1, state) for state in range(len(arrivals))])
        first = passage.first_tick(1.0 / self.problem.dt) - leads
        in_time = np.maximum(arrivals, first)
        if passage.at_s is None:
            return in_time
        soonest = min(float((arrivals + leads).min()), self.soonest.get(number, math.inf))
        self.soonest[number] = soonest
        if soonest > passage.first_tick(1.0 / self.problem.dt) and math.isfinite(soonest):
            late = Violation(
                "passage", soonest * self.problem.dt, passage.at_s, "s", detail="the soonest that was found"
            )
            self.obstacles[number] = late.within(self.leg_name(number))
        return np.where(EASED * arrivals > first, math.inf, in_time)

    def piece(self, number: int, way: Sequence[int]) -> Piece:
        """Returns the samples of start, passage or end on a way."""
        return self.states[number][way[number]]

    def lead(self, number: int, state: int) -> int:
        """Returns the ticks from where the samples of one of a passage's states begin to where it is passed."""
        return self.leads[number] if self.lasts(number, state) else 0

    def lasts(self, number: int, state: int = 0) -> int:
        """Returns the number of ticks that start, a passage or the end lasts, in one of its states."""
        return max(len(self.states[number][state][0]) - 1, 0)

    def samples(self, number: int, way: Sequence[int], begun: int | None = None) -> Piece:
        """Returns the samples of a leg of a way, at its present pace.

        Args:
            number: of the leg.
            way: that it is on.
            begun: tick at which it begins; None: it takes as long as it does.

        Raises:
            SolverFailed: Ruckig refuses its states, it is passed too late, or it comes too near to a singularity beside
                a passage.
        """
        start = _last(self.piece(number, way))
        end = _first(self.states[number + 1][way[number + 1]])
        pace = PACES[int(self.paces[number][way[number], way[number + 1]])]
        problem = self.problem
        timed = None if begun is None or number >= len(problem.passages) else problem.passages[number]
        lead = self.lead(number + 1, way[number + 1])
        least_s = 0.0 if timed is None else (timed.first_tick(1.0 / problem.dt) - lead - (begun or 0)) * problem.dt
        made = ruckig_otg.leg(problem, start, end, pace, least_s)
        self._check_singularities(number, made[0])
        tick = (begun or 0) + len(made[0]) - 1 + lead
        if timed is not None and not timed.is_in_time(tick, 1.0 / problem.dt):
            late = Violation("passage", tick * problem.dt, timed.at_s, "s", detail="no motion was found to be in time")
            raise SolverFailed(str(late), violations=[late])
        return made

    def _check_singularities(self, number: int, q: Array) -> None:
        """Looks at the postures (n, 6) of a leg beside its passages, which is quick: most legs that fail, fail there.

        Raises:
            SolverFailed: one is too near to a singularity.
        """
        problem = self.problem
        ticks = round(SINGULARITY_WINDOW_S / problem.dt)
        passages = problem.passages
        leaves = number > 0 and not passages[number - 1].state.is_at_rest
        arrives = number < len(passages) and not passages[number].state.is_at_rest
        beside = np.concatenate([q[: ticks * leaves], q[len(q) - min(ticks * arrives, len(q)) :]])
        if len(beside) == 0:
            return
        least = float(singularity_distances(problem.cell.robot, beside).minimum.min())
        limit = problem.limits.singularity_distance_min
        if least < limit:
            found = Violation("singularity_distance", least, limit, "1", detail="beside a passage")
            raise SolverFailed(str(found), violations=[found])

    def give_way(self, number: int, way: Sequence[int], obstacle: Violation, ends: bool = False) -> None:
        """Makes a leg gentler, or leaves it out after the last pace.

        Args:
            number: of the leg.
            way: that it is on.
            obstacle: what stands in its way.
            ends: whether the state at its end does, whichever leg leads there.
        """
        at = (way[number], way[number + 1])
        is_within = ends and self.lasts(number + 1) > 0
        self.obstacles[number] = obstacle.within(self.names[number + 1] if is_within else self.leg_name(number))
        if ends:
            self.ticks[number][:, at[1]] = math.inf
            return
        for pace in range(int(self.paces[number][at]) + 1, len(PACES)):
            self.paces[number][at] = pace
            with suppress(SolverFailed):
                self.ticks[number][at] = self.lasts(number, at[0]) + len(self.samples(number, way)[0]) - 1
                return
        self.ticks[number][at] = math.inf

    def leg_name(self, number: int) -> str:
        """Returns a leg in words."""
        return f"leg {number + 1}, from {self.names[number]} to {self.names[number + 1]}"

    def obstacle(self) -> Violation:
        """Returns what stands in the way of every motion: of the leg on which no way goes on, else of the last."""
        reached = np.ones(1, bool)
        for number, ticks in enumerate(self.ticks):
            reached = np.isfinite(ticks[reached]).any(axis=0)
            if not reached.any():
                refused = nothing_found("motion", "no joint motion within the limits leads there")
                return self.obstacles.get(number, refused.within(self.leg_name(number)))
        if not self.obstacles:
            return nothing_found("motion", "no chain of joint states was found through all passages")
        return self.obstacles[max(self.obstacles)]


def _legs(search: PlanningSearch) -> _Legs:
    """Returns the legs of a problem, with the ticks of their fastest motions.

    Raises:
        Infeasible: a passage or the end has no joint state; names it.
        SolverFailed: the deadline passed before one was found.
    """
    problem = search.problem
    asked = [f"passage {each.name!r}" for each in problem.passages]
    if problem.end is not None:
        asked.append("the end")
    names = ["the start"]
    leads = [0]
    q, qd, qdd = problem.start_state
    states: list[list[Piece]] = [[(q[None], qd[None], qdd[None])]]
    alone = [problem.alone(number) for number in range(len(asked))]
    found = [_found(search, name, one) for name, one in zip(asked, alone, strict=True)]
    for number, one in enumerate(alone):
        after = found[number + 1] if number + 1 < len(found) else []
        lead = math.ceil(one.opening_spread_s / one.dt) + 1
        thrown = _thrown(search, one, states[-1], lead) if one.throws else []
        leads.append(lead if one.throws else 0)
        both = [*thrown, *found[number], *_between(one, states[-1], after)]
        states.append(_kept(problem, both, states[-1], after))
        names.append(asked[number])
    if problem.end is None:
        names.append("rest")
        states.append([REST])
        leads.append(0)
    ticks = []
    for before, after in pairwise(states):
        rows = [[ruckig_otg.least_leg_time(problem, _last(a), _first(b)) for b in after] for a in before]
        lasting = np.array([len(piece[0]) - 1 for piece in before])
        ticks.append(lasting[:, None] + np.ceil(np.array(rows) / problem.dt - ROUNDING))
    return _Legs(problem, names, states, leads, ticks, [np.zeros(each.shape, np.int64) for each in ticks])


def _first(piece: Piece) -> State | None:
    return (piece[0][0], piece[1][0], piece[2][0]) if len(piece[0]) else None


def _last(piece: Piece) -> State:
    return piece[0][-1], piece[1][-1], piece[2][-1]


def _found(search: PlanningSearch, name: str, alone: ThrowProblem) -> list[Piece]:
    """Returns the samples of a passage from the joint states in which it keeps every limit by itself."""
    begun_s = time.perf_counter()
    try:
        found = candidates(alone, search.deadline_s)
        if isinstance(alone.release, SteadyLine):
            return [*line_motions(alone, [each.q for each in found])]
    except Infeasible as refusal:
        search.log_attempt("candidates", f"no joint state of {name}", begun_s)
        violations = [each if alone.throws else each.in_passing() for each in refusal.violations]
        raise Infeasible([each.within(name) for each in violations], attempts=search.log) from None
    return _samples(alone, found)


def _samples(problem: ThrowProblem, found: Sequence[Candidate]) -> list[Piece]:
    """Returns the samples of candidates, without acceleration, and with that at which the tool keeps its twist."""
    if not found:
        return []
    q = np.array([each.q for each in found])
    qd = np.array([each.qd for each in found])
    steady = _steady(problem, q, qd)
    usable = (np.abs(steady) <= problem.limits.qdd_max).all(axis=1) & steady.any(axis=1)
    kinds = ((q, qd, np.zeros_like(q)), (q[usable], qd[usable], steady[usable]))
    return [(a[None], b[None], c[None]) for arrays in kinds for a, b, c in zip(*arrays, strict=True)]


def _thrown(search: PlanningSearch, alone: ThrowProblem, before: Sequence[Piece], lead: int) -> list[Piece]:
    """Returns the samples about the release of throws of their own, from rest in the start and in the passage before.

    Candidates are what the optimiser starts from; a leg alone does not move them to where the object clears a rim, or
    lands within its tolerance early and late. How it does follows from the motion while it may leave, which is kept.

    Args:
        search: of the chain.
        alone: the problem of the throw alone.
        before: samples of the passage before.
        lead: ticks before the release with which they begin.
    """
    if search.problem.backend != "auto":
        return []
    rest = lead + round(LEAVES_S / alone.dt)
    states: list[Piece] = []
    limits = replace(alone.limits, qdd_max=THROWN_SHARE * alone.limits.qdd_max)
    alone = replace(alone, limits=limits)
    for q in [search.problem.start, *(piece[0][-1] for piece in before[:THROWN_FROM])]:
        with search.inner(alone.at_rest_from(q)) as own:
            search_candidates(own, candidates(own.problem, search.deadline_s))
        for each in own.by_rank():
            motion = each.solution.trajectory
            k = motion.release_index
            if k >= lead and k + rest < len(motion.q):
                about = slice(k - lead, k + rest + 1)
                states.append((motion.q[about], motion.qd[about], motion.qdd[about]))
    return states


def _between(alone: ThrowProblem, before: Sequence[Piece], after: Sequence[Piece]) -> list[Piece]:
    """Returns the samples of passing a point in postures near those before and after, and in the middle of both."""
    point = alone.release.point_state
    if point is None:
        return []
    left = np.array([piece[0][-1] for piece in before[:BESIDE]])
    right = np.array([piece[0][0] for piece in after[:BESIDE]]).reshape(-1, 6)
    middle = ((left[:, None] + right) / 2.0).reshape(-1, 6)
    return _samples(alone, near_candidates(alone, point, np.concatenate([left, right, middle])))


def _steady(problem: ThrowProblem, q: Array, qd: Array) -> Array:
    """Returns the accelerations (n, 6) with which the tool keeps its twist; zero next to a singularity."""
    robot = problem.cell.robot
    X_FT = problem.cell.tool.X_FT
    regular = singularity_distances(robot, q).minimum > problem.limits.singularity_distance_min
    qdd = np.zeros_like(q)
    bias = tcp_acceleration(robot, q[regular], qd[regular], qdd[regular], X_FT)
    qdd[regular] = -inverse_velocity(jacobian(robot, q[regular], X_FT), bias)
    return qdd


def _kept(problem: ThrowProblem, found: list[Piece], before: Sequence[Piece], after: Sequence[Piece]) -> list[Piece]:
    """Returns the states that are kept: half of them on the shortest way from any before to any after.

    The others are the soonest from rest, with which `found` begins. The way is measured by the time that the joints
    need at their greatest speed.
    """
    q = np.array([piece[0][0] for piece in found])
    needed_s = np.zeros(len(q))
    for row, neighbours in ((-1, before), (0, after)):
        at = np.array([piece[0][row] for piece in neighbours])
        if len(at):
            needed_s += (np.abs(q[:, None] - at) / problem.limits.qd_max).max(axis=2).min(axis=1)
    nearest = np.argsort(needed_s, kind="stable").tolist()
    kept = dict.fromkeys([*nearest[: STATES // 2], *range(STATES // 2), *nearest[STATES // 2 :]])
    return [found[i] for i in list(kept)[:STATES] if i < len(found)]

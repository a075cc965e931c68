"""Plans with a least hit probability: release time is traded for odds, in steps of which each is stricter."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from jobs.planning.aiming import forecast_beside_target, hit_probability, plan_aimed
from learning import CellKnowledge
from planner.certificate import release_flight
from planner.errors import TIME_LIMIT, Infeasible, PlannerError, SolverFailed, Violation
from planner.planning import Plan, SearchHints
from planner.problem import TIME_LIMIT_S, ThrowProblem
from planner.progress import SILENT, ProgressMeter
from planner.request import WINDOW_MAX_S, request_document

# [-] half widths of the windows in standard deviations of the release's timing. Measured on four targets of the default
# cell, calibrated, with 3 ms of jitter: odds of 5 cm are 0.42 to 0.64 without a window, 0.73 to 0.84 with 1, 0.95 to
# 0.99 with 3 and 0.97 to 0.99 with 5.
WINDOW_DEVIATIONS = (1.0, 2.0, 3.0, 5.0)
# [-] of the release speed of the plan before: a slower object flies less far for an error of the arm's speed, which no
# window protects against.
SPEED_SHARE = 0.9
SPEED_STEPS = 3
ODDS_STEP = 1e-3  # [-] the nearest request asks for the best odds, rounded down to this


@dataclass(frozen=True)
class _Step:
    """A plan to try: with a release window [s], or with at most a share of the last plan's release speed [-]."""

    kind: str
    value: float


def plan_for_odds(
    problem: ThrowProblem, least: float, known: CellKnowledge, is_learnt: bool, meter: ProgressMeter = SILENT
) -> Plan:
    """Returns the soonest plan of those tried whose hit probability is at least `least`.

    The request's own window is tried first, then longer ones, then slower throws with the longest. Each keeps what
    the one before had to keep, so that its release is no sooner. A back end other than `auto` plans as asked for, once.

    Args:
        problem: of a target; its window is the shortest one to try.
        least: hit probability [-], above 0.
        known: what is known of the cell.
        is_learnt: whether that comes from a profile; then every plan is aimed with it.
        meter: tells an observer of the progress.

    Raises:
        Infeasible: no motion, or none with these odds; then `nearest` asks for the best odds that were found.
        SolverFailed: the time limit ended the search before that.
    """
    search = _OddsSearch(problem, least, known, is_learnt, meter)
    for step in _steps(problem, known):
        found = search.tried(step)
        if found is not None:
            return found
    raise search.failure()


class _OddsSearch:
    """The plans that were tried for a hit probability: the best of them, the last one, and what ended their kind."""

    def __init__(
        self, problem: ThrowProblem, least: float, known: CellKnowledge, is_learnt: bool, meter: ProgressMeter
    ) -> None:
        self.problem = problem
        self.least = least
        self.known = known
        self.aims_with = known if is_learnt else None
        self.hints = SearchHints(meter=meter)
        self.until = time.perf_counter() + problem.time_limit_s
        self.is_late = False
        self.ended: set[str] = set()
        self.last: tuple[ThrowProblem, Plan] | None = None
        self.best: tuple[float, ThrowProblem, Plan] | None = None

    def tried(self, step: _Step) -> Plan | None:
        """Returns the plan of a step where it reaches the odds.

        Raises:
            PlannerError: there is no plan at all, as of the first step.
        """
        rest_s = self.until - time.perf_counter()
        self.is_late = self.is_late or rest_s <= 0.0
        if self.is_late or step.kind in self.ended:
            return None
        asked = self._stricter(step)
        try:
            found = plan_aimed(replace(asked, time_limit_s=rest_s), self.aims_with, self.hints)
        except PlannerError as error:
            return self._refused(step, error)
        self.is_late = found.was_cut_short
        value = hit_probability(self.problem, found, forecast_beside_target(found, self.known))
        self.last = asked, found
        if self.best is None or value > self.best[0]:
            self.best = value, asked, found
        return found if value >= self.least else None

    def failure(self) -> Infeasible | SolverFailed:
        """Returns the refusal, once no step reached the odds."""
        assert self.best is not None  # the first step raises where it has no plan
        value, asked, found = self.best
        radius = self.problem.hit_radius_m
        detail = f"of landing within {radius:g} m of the target, the best of the plans tried"
        violations = [Violation("hit_probability", value, self.least, "-", detail=detail)]
        attempts = [attempt.__dict__ for attempt in found.attempts]
        if self.is_late:
            asked = replace(asked, time_limit_s=max(asked.time_limit_s, TIME_LIMIT_S))
        nearest = _asking_for(asked, value)
        if self.is_late:
            return SolverFailed(TIME_LIMIT, attempts=attempts, violations=violations, nearest=nearest)
        return Infeasible(violations, nearest, attempts)

    def _refused(self, step: _Step, error: PlannerError) -> None:
        """Ends the steps of this kind: further ones are stricter still."""
        if self.last is None:
            raise error
        self.is_late = self.is_late or (isinstance(error, SolverFailed) and error.status == TIME_LIMIT)
        self.ended.add(step.kind)

    def _stricter(self, step: _Step) -> ThrowProblem:
        """Returns what to plan next."""
        if self.last is None:
            return self.problem
        asked, found = self.last
        if step.kind == "window":
            return replace(asked, release_window_s=step.value, landing_tolerance_m=self.problem.hit_radius_m)
        flight = release_flight(found.problem, found.trajectory)
        assert flight is not None and asked.target is not None  # it has just been planned to a target
        slower = replace(asked.target, max_speed_m_s=step.value * flight.speed_m_s)
        return asked.with_release(asked.release.with_target(slower))


def _steps(problem: ThrowProblem, known: CellKnowledge) -> Iterator[_Step]:
    """Yields what to try: the request itself, longer windows, slower throws."""
    longest = problem.release_window_s
    yield _Step("window", longest)
    if problem.backend != "auto":
        return
    for deviations in WINDOW_DEVIATIONS:
        width = min(deviations * known.release_std_s, WINDOW_MAX_S)
        if width > longest:
            longest = width
            yield _Step("window", width)
    yield from [_Step("speed", SPEED_SHARE)] * SPEED_STEPS


def _asking_for(problem: ThrowProblem, value: float) -> Mapping[str, Any]:
    """Returns the request that states a problem and asks for a hit probability, rounded down."""
    document = request_document(problem, problem.release)
    return document | {"min_hit_probability": math.floor(value / ODDS_STEP) * ODDS_STEP}

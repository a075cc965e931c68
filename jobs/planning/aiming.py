"""Plans for a learnt cell: the aim is moved until the predicted landing is on the target; and the odds of a hit."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from learning import CellKnowledge, LandingForecast
from planner.answer import aimed_problem
from planner.arrays import Array
from planner.errors import TIME_LIMIT, Infeasible, InvalidProblem, SolverFailed
from planner.planning import ORDINARY, Plan, SearchHints, plan
from planner.problem import ThrowProblem

AIM_M = 0.001  # [m] distance of the predicted landing from the target that is good enough
AIM_ROUNDS = 3  # plans at most: the shift carries over from plan to plan but where the posture changes


def plan_aimed(problem: ThrowProblem, known: CellKnowledge | None, hints: SearchHints = ORDINARY) -> Plan:
    """Returns a plan whose predicted landing is on the target; without knowledge, or a target, the plan as asked for.

    Where no throw into a bin passes as far inside the rim as it lands from the middle, the landing alone is brought
    there, once, and kept if that is the better aim.

    Args:
        problem: as requested.
        known: what is known of the cell.
        hints: of the search for each plan.

    Raises:
        PlannerError: as of `planner.planning.plan`, for the request's own target.
    """
    until = time.perf_counter() + problem.time_limit_s
    found = plan(problem, hints)
    target = problem.target
    if known is None or target is None or problem.names_gripper:
        return found
    best = found
    made = [found]
    least = np.inf
    shift = np.zeros(3)
    is_whole = True
    for remaining in range(AIM_ROUNDS, 0, -1):
        guess = known.predicted(found.problem, found.trajectory)
        place = place_of_target(problem, found)[:2]
        miss = float(np.linalg.norm(guess.aimed - place))
        if miss < least:
            best = found
            least = miss
        if least < AIM_M or remaining == 1 or not is_whole:
            break
        misses = [guess.aimed - place]
        if remaining == AIM_ROUNDS and guess.at_rim is not None:
            misses.append(guess.center - place)
        shifts = [shift - np.append(each, 0.0) for each in misses]
        try:
            met = found.problem.moving
            lands_at_s = None if met is None else met.at_s
            further = replace(hints, offers_nearest=False, nearby=found.trajectory, lands_at_s=lands_at_s)
            found, shift = _plan_nearest(until, problem, shifts, further)
            made.append(found)
        except (Infeasible, InvalidProblem):  # for every aim: the plan in hand remains
            break
        except SolverFailed:
            return _after(made, best, was_cut_short=True)
        is_whole = shift is shifts[0]
    return _after(made, best, best.was_cut_short or found.was_cut_short)


def _after(made: Sequence[Plan], best: Plan, was_cut_short: bool) -> Plan:
    """Returns the best of the plans that were made, with the attempts and the time of them all."""
    attempts = tuple(attempt for each in made for attempt in each.attempts)
    solve_time_s = sum(each.solve_time_s for each in made)
    return replace(best, attempts=attempts, solve_time_s=solve_time_s, was_cut_short=was_cut_short)


def _plan_nearest(
    until: float, problem: ThrowProblem, shifts: Sequence[Array], hints: SearchHints
) -> tuple[Plan, Array]:
    """Returns the plan for the first of some shifts of the aim (3,) [m] that has one, and that shift.

    Raises:
        PlannerError: as of `_plan_until`, for the last one.
    """
    for shift in shifts[:-1]:
        with suppress(Infeasible):
            return _plan_until(until, aimed_problem(problem, shift), hints), shift
    return _plan_until(until, aimed_problem(problem, shifts[-1]), hints), shifts[-1]


def _plan_until(until: float, problem: ThrowProblem, hints: SearchHints) -> Plan:
    """Returns a plan of a search that ends at an instant of `time.perf_counter` [s].

    Raises:
        PlannerError: as of `planner.planning.plan`; also where the instant has passed.
    """
    rest_s = until - time.perf_counter()
    if rest_s <= 0.0:
        raise SolverFailed(TIME_LIMIT)
    return plan(replace(problem, time_limit_s=rest_s), hints)


def learnt_fields(problem: ThrowProblem, found: Plan, known: CellKnowledge, profile_id: str | None) -> dict[str, Any]:
    """Returns what a plan's document says of profile, aim and odds; nobody knows those of several grippers.

    Args:
        problem: as requested.
        found: the plan.
        known: what is known of the cell.
        profile_id: of the profile that it comes from; None: of the cell file.
    """
    fields: dict[str, Any] = {"profile": profile_id, "aim": None, "hit_probability": None, "landing_ellipse": None}
    aimed = found.problem.target
    target = problem.target
    if target is None or aimed is None or problem.names_gripper:
        return fields
    place = place_of_target(problem, found)
    if profile_id is not None:
        fields["aim"] = {"position": aimed.p_W.tolist(), "shift_m": (aimed.p_W - place).tolist()}
    guess = forecast_beside_target(found, known)
    radius = problem.hit_radius_m
    interval = list(guess.hit_interval(place[:2], radius))
    value = hit_probability(problem, found, guess)
    fields["hit_probability"] = {"value": value, "interval": interval, "profile": profile_id, "radius_m": radius}
    fields["landing_ellipse"] = {"center": guess.center.tolist(), "covariance_m2": guess.covariance.tolist()}
    return fields


def place_of_target(problem: ThrowProblem, found: Plan) -> Array:
    """Returns where the target of a problem is as a plan's object lands (3,) [m]; the aim may be beside it."""
    assert problem.target is not None
    met = found.problem.moving
    return problem.target.p_W if met is None else met.p_W - found.problem.aim_shift


def hit_probability(problem: ThrowProblem, found: Plan, guess: LandingForecast) -> float:
    """Returns the probability that a plan with this forecast hits the target of a problem [-]."""
    return guess.hit_probability(place_of_target(problem, found)[:2], problem.hit_radius_m)


def forecast_beside_target(found: Plan, known: CellKnowledge) -> LandingForecast:
    """Returns where throws of a plan land beside its target, which may be elsewhere than it is believed to be."""
    guess = known.predicted(found.problem, found.trajectory)
    met = found.problem.moving
    if met is None or met.uncertainty is None:
        return guess
    return guess.beside_target(met.uncertainty.position_std_m)

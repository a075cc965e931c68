"""Candidate release states, from which every back end starts, sorted by a lower bound on the launch time.

A joint state is one candidate; a tool pose has one for each branch and each full turn of the inverse kinematics. A
point adds tool orientations, a target adds release positions and flight times: both are drawn from a fixed
quasi-random sequence, so the same request always has the same candidates.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from planner.arrays import Array
from planner.errors import TIME_LIMIT, Infeasible, SolverFailed, Violation, nothing_found
from planner.geometry import ToolState, body_model, twist_in_base
from planner.kinematics import (
    inverse,
    inverse_velocity,
    jacobian,
    singularity_distances,
)
from planner.problem import ThrowProblem
from planner.releases import Target
from planner.rotations import invert_pose, unit_hint
from planner.seeds.aspects import aspects, first_rows
from planner.seeds.flight_filter import has_flight_obstacles
from planner.seeds.sampling import FEW, blocked_flights, point_states, target_states
from planner.seeds.soonest_states import STATES_MAX, least_time
from planner.seeds.state_limits import POSITION_SLACK, SIEVES, States

DECIMALS = 9  # [rad, rad/s] of candidates for a target: finer than what the optimiser heeds
NO_STATES = "no joint state was found whose flight hits the target within the requested bounds"
NO_INVERSE = "the inverse kinematics has no solution for this pose, joint limits ignored"


@dataclass(frozen=True, eq=False)
class Candidate:
    """A joint state at the release.

    Attributes:
        q: positions (6,) [rad].
        qd: velocities (6,) [rad/s].
        bound_s: lower bound on the time of a launch from the problem's start [s].
        label: its origin, for the attempt log.
    """

    q: Array
    qd: Array
    bound_s: float
    label: str


class InitialGuess(Protocol):
    """A motion through a release from which a solver starts: a `Trajectory`, or Ruckig's motion off the tick grid."""

    @property
    def release_time_s(self) -> float:
        """Time of the release [s]."""
        ...

    @property
    def duration_s(self) -> float:
        """Time of standstill [s]."""
        ...

    def at(self, t: Array, /) -> tuple[Array, Array, Array]:
        """Returns q, qd, qdd (n, 6) at times `t` (n,) [s]."""
        ...


class NoCandidates(Infeasible):
    """Of the release states that were looked at none keeps every limit.

    Attributes:
        violations: of the state closest to the limits.
        tried: how many states there were, and how many kept which limits, in words.
    """

    def __init__(self, violations: Sequence[Violation], tried: str) -> None:
        super().__init__(violations)
        self.tried = tried


@dataclass(frozen=True, eq=False)
class Seed:
    """A candidate with the motion that a solver starts from; None leaves the motion to the solver."""

    candidate: Candidate
    initial_guess: InitialGuess | None = None


def candidates(problem: ThrowProblem, deadline_s: float = math.inf) -> list[Candidate]:
    """Returns the release states that keep every limit themselves, by ascending lower bound on the launch time.

    Args:
        problem: the problem.
        deadline_s: on `time.perf_counter`; no further states are drawn after it.

    Raises:
        Infeasible: there is none; the violations give the reason.
        SolverFailed: the deadline passed before one was found.
    """
    release = problem.release
    if release.joint_state is not None:
        q, qd = release.joint_state
        states = States(q[None], qd[None])
        _check_joint_positions(problem, q)
    elif release.tool_state is not None:
        states = _tool_states(problem, release.tool_state)
    elif release.point_state is not None:
        states = States(*point_states(problem, release.point_state))
    else:
        assert release.target is not None
        return _rounded(problem, _target_candidates(problem, release.target, deadline_s))
    return _usable(problem, states)


def usable_candidates(problem: ThrowProblem, q: Array, qd: Array) -> list[Candidate]:
    """Returns those of given release states that keep every limit themselves, by ascending lower bound.

    Args:
        problem: the problem.
        q: positions (n, 6) [rad].
        qd: velocities (n, 6) [rad/s].

    Raises:
        Infeasible: none does; the violations are those of the state closest to the limits.
    """
    return _usable(problem, States(q, qd))


def _target_candidates(problem: ThrowProblem, target: Target, deadline_s: float) -> list[Candidate]:
    """Returns the candidates for a target; where obstacles leave too few, from a thorough search.

    Raises:
        Infeasible: there are none.
        SolverFailed: the deadline passed before the thorough search.
    """
    try:
        found = _usable(problem, States(*target_states(problem, target)))
        refusal = None
    except Infeasible as error:
        found = []
        refusal = error
    leaves_few = has_flight_obstacles(problem) or problem.body is not None
    if len(found) < FEW and target.release_position is None and leaves_few:
        if time.perf_counter() >= deadline_s:
            if refusal is None:
                return found
            raise SolverFailed(TIME_LIMIT, violations=refusal.violations)
        try:
            return _usable(problem, States(*target_states(problem, target, thorough=True)))
        except Infeasible as error:
            blocked = blocked_flights(problem, target) if refusal else None
            refusal = refusal and (error if blocked is None else _like(error, blocked))
    if refusal is not None:
        raise refusal
    return found


def _like(refusal: Infeasible, violation: Violation) -> Infeasible:
    """Returns a refusal for another reason, which tells the same of what was looked at."""
    return NoCandidates([violation], refusal.tried) if isinstance(refusal, NoCandidates) else Infeasible([violation])


def _rounded(problem: ThrowProblem, found: list[Candidate]) -> list[Candidate]:
    """Returns candidates rounded to `DECIMALS`, within the velocity limits.

    What a candidate is computed from differs in its last bits between machines. So do the hundreds of numbers of the
    motion to it that the optimiser begins from, and one of them may be rounded the other way.
    """
    limit = problem.limits.qd_max
    q, qd = (np.round([getattr(each, name) for each in found], DECIMALS) for name in ("q", "qd"))
    states = zip(found, q, np.clip(qd, -limit, limit), strict=True)
    return [replace(each, q=its_q, qd=its_qd) for each, its_q, its_qd in states]


def _usable(problem: ThrowProblem, states: States) -> list[Candidate]:
    """Returns the states that keep every limit, by ascending lower bound.

    Raises:
        NoCandidates: none does; the violations are those of the state closest to the limits.
        Infeasible: there are no states.
    """
    if len(states.q) == 0:
        raise Infeasible([nothing_found("joint_position", NO_STATES)])
    kept = states
    counts = []
    try:
        for words, sieve in SIEVES:
            counts.append(f"none {words}")
            before = kept
            kept = kept.at(sieve(problem, kept))
            counts[-1:] = [f"{len(kept.q)} {words}"] if len(kept.q) < len(before.q) else []
        counts.append("none clear of everything")
        bound = least_time(kept.q - problem.start, kept.qd, problem.limits, problem.start_qd)
        order = np.lexsort([*kept.q.T[::-1], bound])
        return _clear(problem, kept.at(order), bound[order])
    except Infeasible as refusal:
        raise NoCandidates(refusal.violations, f"{_number(problem, states)}: {', '.join(counts)}") from None


def _number(problem: ThrowProblem, states: States) -> str:
    """Returns how many states are looked at, in words: the best of many where the release leaves something free."""
    if problem.release.joint_state is not None:
        return "the release state"
    if len(states.q) == 1:
        return "the only release state found"
    return f"{len(states.q)} release states" if problem.fixes_joints else f"the best {len(states.q)} release states"


def _clear(problem: ThrowProblem, states: States, bound: Array) -> list[Candidate]:
    """Returns the sorted states in which the arm is clear of everything: of the first `STATES_MAX`, or of all.

    A pose has hundreds of states, most of them full turns away. Of states that are all distinct, the soonest of every
    aspect are looked at too.
    """
    kind = problem.release.__class__.__name__
    good = []
    least = np.empty(0)
    body = body_model(problem.cell_with_bin)
    for rows in (slice(0, STATES_MAX), slice(STATES_MAX, len(bound))):
        if good or rows.start >= len(bound):
            break
        free = states.at(rows).of_postures(lambda q: body.clearances(q, problem.holds_object).least)
        good += (np.flatnonzero(free >= 0.0) + rows.start).tolist()
        least = np.concatenate([least, free])
    if states.posture is None and len(least) < len(bound):
        first = first_rows(aspects(problem.cell.robot, states.q))
        first = first[first >= len(least)]
        good += first[body.clearances(states.q[first], problem.holds_object).least >= 0.0].tolist()
    if good:
        return [Candidate(states.q[i], states.qd[i], float(bound[i]), f"{kind} {i}") for i in good]
    best = states.q[int(least.argmax())]
    raise Infeasible(body.violations_at(best, problem.holds_object))


def _check_joint_positions(problem: ThrowProblem, q: Array) -> None:
    """Raises `NoCandidates` with every joint position that is outside its limits."""
    limits = problem.limits
    outside = np.flatnonzero((q < limits.q_lower - POSITION_SLACK) | (q > limits.q_upper + POSITION_SLACK))
    if len(outside):
        violations = [_joint_violation(problem, joint, q[joint]) for joint in outside.tolist()]
        raise NoCandidates(violations, "the release state: outside the joints' position limits")


def _joint_violation(problem: ThrowProblem, joint: int, q: float) -> Violation:
    """Returns the violation by a joint's position `q` [rad] outside its limits."""
    lower = problem.limits.q_lower[joint]
    upper = problem.limits.q_upper[joint]
    detail = f"{problem.cell.robot.joint_names[joint]} at the release{unit_hint(q)}"
    return Violation("joint_position", float(q), float(lower if q < lower else upper), "rad", detail=detail)


def _tool_states(problem: ThrowProblem, tool: ToolState) -> States:
    """Returns the joint states of every branch and turn that have the tool's pose and twist.

    Raises:
        Infeasible: the pose is out of reach, or no branch is inside the joint limits.
    """
    cell = problem.cell
    limits = problem.limits
    X_BT = invert_pose(cell.X_WB) @ tool.X_WT
    found = inverse(cell.robot, X_BT, cell.tool.X_FT, limits.q_lower, limits.q_upper)
    if found.reach_excess_m > 0.0:
        raise Infeasible([_reach_violation(problem, tool.X_WT[:3, 3], found.reach_excess_m)])
    if len(found.q) == 0:
        raise Infeasible([_joint_limit_violation(problem, X_BT)])
    V_BT = twist_in_base(cell, tool.V_WT)
    states = States(found.q, np.zeros_like(found.q), found.branch)
    usable = states.of_postures(lambda q: singularity_distances(cell.robot, q).minimum) > 1e-6
    if not usable.any():
        return states
    states = states.at(usable)
    qd = states.of_postures(lambda q: inverse_velocity(jacobian(cell.robot, q, cell.tool.X_FT), V_BT))
    return replace(states, qd=qd)


def _reach_violation(problem: ThrowProblem, p_W: Array, excess_m: float) -> Violation:
    """Returns the violation by a position (3,) that is `excess_m` beyond the arm's reach."""
    distance = float(np.linalg.norm(p_W - problem.cell.X_WB[:3, 3]))
    return Violation("reach", distance, distance - excess_m, "m", detail="distance from the arm's base")


def _joint_limit_violation(problem: ThrowProblem, X_BT: Array) -> Violation:
    """Returns the joint limit broken by the branch closest to the limits."""
    limits = problem.limits
    anywhere = inverse(problem.cell.robot, X_BT, problem.cell.tool.X_FT).q
    if len(anywhere) == 0:
        return nothing_found("joint_position", NO_INVERSE)
    over = np.maximum(limits.q_lower - anywhere, anywhere - limits.q_upper)
    best = int(over.max(axis=1).argmin())
    joint = int(over[best].argmax())
    return _joint_violation(problem, joint, anywhere[best, joint])

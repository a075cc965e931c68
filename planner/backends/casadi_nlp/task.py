"""Solving one request: launch and brake of least time, then the same on whole ticks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import answer, exactness, window
from planner.backends.casadi_nlp.guess import Guess
from planner.backends.casadi_nlp.layout import STEP, TIME, TIME_SCALE
from planner.backends.casadi_nlp.margins import CLOSE, Margins
from planner.backends.casadi_nlp.request import Request, Start, arguments, guess, whole_shape
from planner.backends.casadi_nlp.solving import Solving, machine
from planner.errors import SolverFailed
from planner.flight import fly
from planner.problem import PointRelease, TargetRelease, ThrowProblem
from planner.seeds.candidates import Candidate
from planner.solution import Solution
from planner.timing.grid import grid_limits
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]

EXTRA_TICKS = (1, 2, 3)  # given to launch and brake where the first whole number of ticks does not do
WINDOW_ROUNDS = 3  # further solutions at most that bring the landings of a window back into the tolerance
OVER = 1.5  # [-] of what a landing was beyond it, between two knots: what they are held to in addition
DRAG_ROUNDS = 3  # corrections of the aim for drag; each leaves a tenth of the error or less


def solve(
    problem: ThrowProblem,
    candidate: Candidate,
    warm_start: Guess | None,
    deadline_s: float,
    margins: Margins,
    fine: bool,
    stubborn: bool,
) -> Solution:
    """Returns the motion of least release time next to a candidate. See docs/optimal-control.md.

    Args:
        problem: what is asked.
        candidate: where to begin; `joint` and `pose` are held to it.
        warm_start: a motion to it, best Ruckig's; None: a plain one is made up.
        deadline_s: on `time.perf_counter`, when to stop trying.
        margins: kept free of what is only looked at on knots.
        fine: whether to take more stages, and hold all rows at once.
        stubborn: whether the slow second solver is asked where the first gives up.

    Raises:
        SolverFailed: no motion was found in time.
    """
    whole = whole_shape(problem, fine)
    solving = Solving(whole, deadline_s, frozenset(whole.groups) if fine else margins.held, stubborn)
    motion = _motion(problem, candidate, warm_start)
    request = _request(problem, candidate, margins)
    if problem.is_robust and margins == CLOSE:  # with others, the first guess is a solution before
        nominal = _without_window(problem, candidate, motion, solving, margins)
        try:
            return _from(nominal, request, solving)
        except SolverFailed:
            pass  # now and then the window is found from the first guess where it is not from the fastest throw
    return _from(motion, request, solving)


def _from(motion: dict[str, Any], request: Request, solving: Solving) -> Solution:
    """Returns the solution from a first guess."""
    start = guess(solving.table, request.problem, motion)
    z = solving.solve(arguments(request, solving.table, start))
    task = _Task(request.problem, request.candidate, solving)
    solution = task.finish(request, z)
    return task.within_window(request, z, solution) if request.problem.is_robust else solution


def _without_window(
    problem: ThrowProblem, candidate: Candidate, motion: dict[str, Any], solving: Solving, margins: Margins
) -> dict[str, Any]:
    """Returns the best motion for the nominal instant alone, from which the window is easily found."""
    nominal = replace(problem, release_window_s=0.0, landing_tolerance_m=0.0)
    first = Solving(whole_shape(nominal), solving.deadline_s, solving.groups, solving.stubborn)
    start = guess(first.table, nominal, motion)
    try:
        z = first.solve(arguments(_request(nominal, candidate, margins), first.table, start))
    except SolverFailed:
        return motion
    finally:
        solving.iterations, solving.groups = first.iterations, first.groups
    return _as_motion(answer.knots(z, first.whole))


def _request(problem: ThrowProblem, candidate: Candidate, margins: Margins) -> Request:
    limits = grid_limits(problem.reachable, problem.dt)
    return Request(problem, candidate, limits, _aim(problem, candidate), margins)


@dataclass(frozen=True)
class _Task:
    """One call, once it is solved."""

    problem: ThrowProblem
    candidate: Candidate
    solving: Solving

    def finish(self, request: Request, z: Vector) -> Solution:
        """Returns the solution on whole ticks: as found with a wait at rest, solved again for them, or longer.

        Raises:
            SolverFailed: the limits are broken on the grid whatever is tried.
        """
        dt, found, status = self.problem.dt, answer.knots(z, self.solving.whole), self.solving.status
        brake = answer.whole_ticks(found.brake_s, dt) if self.solving.whole.brake else 0
        ticks = (answer.whole_ticks(found.release_s, dt), brake)
        made, request = self._made(request, found, ticks)
        if answer.joints_within(self.problem, made):
            return self._solution(made, status)
        polished = self._polished(request, z, ticks)
        if polished is not None:
            return self._solution(polished, status)
        for extra in EXTRA_TICKS:
            slower = (ticks[0] + extra, ticks[1] + extra * bool(ticks[1]))
            made, _ = self._made(request, found, slower)
            if answer.joints_within(self.problem, made):
                return self._solution(made, status)
        raise SolverFailed("the solution does not fit the ticks", self.solving.iterations)

    def within_window(self, request: Request, z: Vector, solution: Solution) -> Solution:
        """Returns the solution, made again where its landings leave the tolerance on ticks or between the knots."""
        problem, over = self.problem, 0.0
        for _ in range(WINDOW_ROUNDS):
            made, found = solution.trajectory, answer.knots(z, self.solving.whole)
            missed = window.misses(problem, made.at, made.release_time_s)
            more = window.beyond(problem, missed)
            if not more.any() or not np.isfinite(more).all():
                break
            over = over + OVER * more
            moved = missed - window.misses(problem, found.at, found.release_s)
            request = replace(request, shift=moved[:: window.LOOKS] + over)
            start = guess(self.solving.table, problem, _as_motion(found))
            again = self.solving.lazily(arguments(request, self.solving.table, start), polish=False)
            if again is None:
                break
            z, solution = again, self.finish(request, again)
        return solution

    def _polished(self, request: Request, z: Vector, ticks: tuple[int, int]) -> Trajectory | None:
        """Returns the motion solved again with its times fixed to `ticks`, None where that breaks a limit or fails."""
        dt, solving = self.problem.dt, self.solving
        start = Start(_restarted(z, ticks, dt), z[:-1, STEP] * TIME_SCALE, (ticks[0] * dt, sum(ticks) * dt))
        again = solving.lazily(arguments(request, solving.table, start), polish=True)
        if again is None:
            return None
        made, _ = self._made(request, answer.knots(again, solving.whole), ticks)
        return made if answer.joints_within(self.problem, made) else None

    def _solution(self, made: Trajectory, status: str) -> Solution:
        return Solution(made, status, self.solving.iterations, self.solving.groups)

    def _made(self, request: Request, found: answer.Knots, ticks: tuple[int, int]) -> tuple[Trajectory, Request]:
        """Returns the trajectory through the exact release, and the request with the aim that drag asks for."""
        problem, slope = self.problem, machine(self.solving.whole).blocks["release"].slope
        state = (found.q[found.launch], found.qd[found.launch])
        aim = request.aim
        for _ in range(DRAG_ROUNDS if problem.drag > 0.0 else 1):
            state = exactness.exact_release(problem, self.candidate, slope, state, aim)
            if isinstance(problem.release, TargetRelease):
                aim = exactness.drag_free_aim(problem, problem.release.p_W, *exactness.tool_point(problem, *state))
        if problem.drag > 0.0:
            state = exactness.exact_release(problem, self.candidate, slope, state, aim)
        return answer.trajectory(problem, found, state, ticks), replace(request, aim=aim)


def _restarted(z: Vector, ticks: tuple[int, int], dt: float) -> Vector:
    """Returns the variables with the times of the fixed problem; the rest is near enough."""
    z = z.copy()
    z[-1, TIME] = sum(ticks) * dt / TIME_SCALE
    return z


def _aim(problem: ThrowProblem, candidate: Candidate) -> Vector:
    """Returns where the drag-free flight is to land (3,) [m]: for a target with drag, as from the candidate."""
    release = problem.release
    if isinstance(release, PointRelease):
        p, v = release.p_WT, release.v_WT
    else:
        p, v = exactness.tool_point(problem, candidate.q, candidate.qd)
    if isinstance(release, TargetRelease):
        return exactness.drag_free_aim(problem, release.p_W, p, v)
    flight = None if problem.ends_at_rest else fly(p, v, problem.plane_z, problem.gravity)
    return np.array([p[0], p[1], problem.plane_z]) if flight is None else flight.landing_point


def _motion(problem: ThrowProblem, candidate: Candidate, warm_start: Guess | None) -> dict[str, Any]:
    if warm_start is not None:
        return {"release_s": warm_start.release_time_s, "end_s": warm_start.duration_s, "state": warm_start.at}
    return _plain_motion(problem, candidate)


def _as_motion(found: answer.Knots) -> dict[str, Any]:
    return {"release_s": found.release_s, "end_s": float(found.t[-1]), "state": found.at}


def _plain_motion(problem: ThrowProblem, candidate: Candidate) -> dict[str, Any]:
    """A made-up first guess: a cubic to the release in twice the least time, then even braking."""
    release = max(2.0 * candidate.bound_s, 0.2)
    slowing = max(float(np.max(np.abs(candidate.qd) / problem.limits.qdd_max)) * 1.5, 0.1)
    d, v = candidate.q - problem.start, candidate.qd

    def state(t: Vector) -> tuple[Vector, Vector, Vector]:
        s = np.minimum(t, release)[:, None]
        c2, c3 = 3 * d / release**2 - v / release, v / release**2 - 2 * d / release**3
        after = np.clip(t - release, 0.0, slowing)[:, None]
        q = problem.start + c2 * s**2 + c3 * s**3 + v * (after - after**2 / (2 * slowing))
        qd = 2 * c2 * s + 3 * c3 * s**2 - v * after / slowing
        return q, qd, np.where(t[:, None] < release, 2 * c2 + 6 * c3 * s, -v / slowing)

    return {"release_s": release, "end_s": release + (0.0 if problem.ends_at_rest else slowing), "state": state}

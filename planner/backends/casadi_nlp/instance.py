"""Instance: one problem and one candidate as the numbers that a solver is called with."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.bounds import Bounds
from planner.backends.casadi_nlp.flight_rows import constrains_flight, flight_parameters
from planner.backends.casadi_nlp.functions import evaluate
from planner.backends.casadi_nlp.layout import LAZY_GROUPS, NZ, OUT_STAGES, QD, QDD, STEP, TIME, Q, StageLayout, Vector
from planner.backends.casadi_nlp.margins import DEFAULT_MARGINS, Margins
from planner.backends.casadi_nlp.object_path import (
    initial_aim,
    leaving_time,
    path_parameters,
    standing_parameters,
    thrown_state,
)
from planner.backends.casadi_nlp.parameters import (
    arm_parameters,
    box_parameters,
    closest_arm,
    release_parameters,
    scale_parameters,
    variable_scales,
)
from planner.backends.casadi_nlp.symbols import FLIGHT_ROWS, FORMULAS, LEAVING_ROWS
from planner.backends.casadi_nlp.transcription import Transcription, transcription
from planner.cell import Limits
from planner.kinematics import SINGULARITIES, signed_singularity_distances
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds import Candidate, InitialGuess, Seed
from planner.timing import CubicGuess, grid_limits

Arguments = dict[str, Vector]

# Stages of launch and brake. A jerk-optimal motion has few switches, and braking is not hurried: more stages gain
# nothing.
STAGES = 8, 3
# [-] Of its initial length that a step may have. Motions dip below the floor in a stage of twice the others' length.
LONGEST_STEP = 2.5
BRAKE_WEIGHT = 0.05  # [-] cost of a second of braking, relative to a second of launch
JERK_WEIGHT = 1e-3  # [-] cost of the mean squared scaled jerk: decides for joints that have time to spare
STEP_WEIGHT = 6e-2  # [-] cost of the mean squared relative change of a step: keeps steps from collapsing
# Of `LAZY_GROUPS`: distances from the arm, the surroundings and boxes, with the margins on them.
CLEARANCES = {"clearance": ("self_m", "floor_m", "keep_in_m"), "keep_out": ("box_m",)}
LONGEST_BRAKE_STEP = 1.5  # [-] of the mean step of a brake that was solved alone
AT_REST_GROUPS = ("effort", "clearance")  # of `LAZY_GROUPS`: without boxes, of a move that ends at rest
USUAL_GROUPS = (*AT_REST_GROUPS, "grip", "flight", "passing")  # the same of a throw, with a known gripper
TARGET_GROUPS = (*AT_REST_GROUPS, "grip", "flight", "standing", "passing")  # the same of a throw to a target

# Stages in half a release window, at most, and their least duration [s]. One alone releases 2 to 3 % later than four.
# More converge less often; they release a little sooner in windows beyond 30 ms.
WINDOW_STAGES = 3
WINDOW_STAGE_S = 0.005
ROUNDING = 1e-9  # [-] of a number of stages
DECIMALS = 9  # of arguments in units of one: finer than what a solver heeds, coarser than floating point differs


def stage_layout(problem: ThrowProblem, margins: Margins) -> StageLayout:
    """Returns the stages that a problem needs, with every lazy group of rows that applies to it.

    Args:
        problem: the problem.
        margins: on every limit; they decide which groups there are.
    """
    groups = _applicable_groups(problem, margins)
    boxes = _box_slots(problem)
    launch, brake = STAGES
    if problem.ends_at_rest:
        return StageLayout(launch, 0, 0, groups, boxes)
    window = window_stages(problem)
    aims = isinstance(problem.release, TargetRelease)
    return StageLayout(launch + window, brake + window, window, groups, boxes, aims)


def _applicable_groups(problem: ThrowProblem, margins: Margins) -> tuple[str, ...]:
    applies = {
        "keep_out": _box_slots(problem) > 0,
        "grip": problem.cell.gripper.hold_acceleration_m_s2 is not None and not problem.ends_at_rest,
        "flight": constrains_flight(problem),
        "standing": isinstance(problem.release, TargetRelease),
        "leaving": margins.leaves,
        "passing": not problem.ends_at_rest,
    }
    return tuple(group for group in LAZY_GROUPS if applies.get(group, True))


def _box_slots(problem: ThrowProblem) -> int:
    """Returns the least number of slots that hold the keep-out boxes, a bin among them; the most if none does."""
    boxes = len(problem.cell_with_bin.surroundings.keep_out)
    return next((slots for slots in (0, *layout.BOX_SLOTS) if slots >= boxes), layout.KEEP_OUT_BOXES)


def window_stages(problem: ThrowProblem) -> int:
    """Returns the number of stages in half the release window, 0 without a window.

    A requested release state or velocity leaves a window little to choose: one stage is enough.
    """
    if not problem.is_robust:
        return 0
    if not isinstance(problem.release, TargetRelease):
        return 1
    fitting = math.floor(problem.release_window_s / max(WINDOW_STAGE_S, problem.dt) + ROUNDING)
    return max(1, min(WINDOW_STAGES, fitting))


def common_layouts() -> list[StageLayout]:
    """Returns the layouts whose solvers are built ahead of requests."""
    (launch, brake) = STAGES
    n = WINDOW_STAGES
    throws = ((launch, brake, 0), (launch + n, brake + n, n))
    usual = _subsets(USUAL_GROUPS)
    braking = [groups for groups in usual if "passing" in groups]
    layouts = [StageLayout(*stages, groups=groups) for stages in throws for groups in usual]
    layouts += [StageLayout(*stages, groups=groups, aims=True) for stages in throws for groups in braking]
    layouts += [StageLayout(*stages, groups=TARGET_GROUPS, aims=True) for stages in throws]
    layouts += [StageLayout(0, brake, groups=groups) for groups in braking]
    return layouts + [StageLayout(launch, 0, groups=each) for each in _subsets(AT_REST_GROUPS)]


def _subsets(groups: tuple[str, ...]) -> list[tuple[str, ...]]:
    return [subset for size in range(len(groups) + 1) for subset in combinations(groups, size)]


@dataclass(frozen=True, eq=False)
class Instance:
    """One problem near one candidate, as a solver is called with it.

    Attributes:
        problem: the problem.
        candidate: the release state to start from; `joint` and `pose` releases are held to it.
        margins: on every limit.
        stages: the layout, with every group of rows that applies.
        limits: of the joints, less what the tick grid needs.
        aim: landing point of the drag-free flight (3,) [m].
        initial: initial guess of the variables (N + 1, NZ), in SI units.
        steps: lengths (N,) [s] that the solution's steps are kept close to.
        fixed_times: times of release and end [s], if they are fixed.
        landing_offsets: added to the landing error at each knot of the window (2 n + 1, 2) [m].
        brake_step_max_s: of each step of the brake [s].
        fitted_at: release state q, qd (6,) at which the formulas' arm is closest to a calibrated one; by default the
            candidate.
    """

    problem: ThrowProblem
    candidate: Candidate
    margins: Margins
    stages: StageLayout
    limits: Limits
    aim: Vector
    initial: Vector
    steps: Vector
    fixed_times: tuple[float, float] | None = None
    landing_offsets: Vector | float = 0.0
    brake_step_max_s: float = math.inf
    fitted_at: tuple[Vector, Vector] | None = None

    @staticmethod
    def of(problem: ThrowProblem, seed: Seed, margins: Margins) -> Instance:
        """Returns the instance of a seed."""
        candidate = seed.candidate
        guess = seed.initial_guess or CubicGuess(problem, candidate)
        stages = stage_layout(problem, margins)
        limits = grid_limits(problem.reachable, problem.dt)
        aim = initial_aim(problem, candidate)
        initial, steps = _variables_along(guess, stages, problem)
        return Instance(problem, candidate, margins, stages, limits, aim, initial, steps)

    def from_guess(self, guess: InitialGuess, landing_offsets: Vector | float) -> Instance:
        """Returns the instance with another initial guess and other offsets of the landings."""
        initial, steps = _variables_along(guess, self.stages, self.problem)
        return replace(self, initial=initial, steps=steps, landing_offsets=landing_offsets)

    def with_reserve(self, guess: InitialGuess, reserve: float) -> Instance:
        """Returns the instance with another reserve for the tick grid, one of `planner.timing.RESERVES`, and guess."""
        limits = grid_limits(self.problem.reachable, self.problem.dt, reserve)
        return replace(self.from_guess(guess, self.landing_offsets), limits=limits)

    def on_times(self, solution: Vector, release_s: float, end_s: float) -> Instance:
        """Returns this instance with the solution (N + 1, NZ), in SI units, as initial guess and its times fixed."""
        initial = solution.copy()
        initial[0, TIME] = -release_s
        initial[-1, TIME] = end_s - release_s
        steps = solution[:-1, STEP]
        return replace(self, initial=initial, steps=steps, fixed_times=(release_s, end_s))

    def brake_alone(self, z: Vector, stretch: float | None) -> Instance:
        """Returns the instance of a brake from the release of a motion.

        Args:
            z: variables (N + 1, NZ) of the motion, in SI units.
            stretch: duration of even braking, which the guess is, over that of the motion's brake [-]; None for that
                brake itself.
        """
        brake = z[self.stages.launch :]
        q = brake[0, Q]
        qd = brake[0, QD]
        if stretch is not None:
            brake = _even_braking(q, qd, _brake_times(stretch * float(brake[-1, TIME]), self.stages, self.problem))
        stages = replace(self.stages, launch=0, aims=False)
        candidate = replace(self.candidate, q=q, qd=qd)
        margins = replace(self.margins, local=tuple(each for each in self.margins.local if each.phase >= 1.0))
        return replace(self, candidate=candidate, stages=stages, margins=margins, initial=brake, steps=brake[:-1, STEP])

    def with_brake(self, z: Vector, brake: Vector) -> Instance:
        """Returns the instance with a motion's launch and another brake as initial guess, variables in SI units.

        A brake from a long guess can be one long stage and two short ones: that looks past what is between.
        """
        launch = z[: self.stages.launch]
        longest_s = LONGEST_BRAKE_STEP * float(brake[:-1, STEP].mean())
        steps = np.concatenate([launch[:, STEP], brake[:-1, STEP]])
        return replace(self, initial=np.concatenate([launch, brake]), steps=steps, brake_step_max_s=longest_s)

    @property
    def transcription(self) -> Transcription:
        """The problem of its layout."""
        return transcription(self.stages)

    @cached_property
    def shared_parameters(self) -> dict[str, Vector]:
        """The parameter vectors of `layout.SHARED`."""
        return {
            "scales": scale_parameters(self.limits, float(self.steps.max())),
            "arm": self._arm(),
            "release": release_parameters(self.problem, self.aim),
            "boxes": box_parameters(self.problem.cell_with_bin, self.margins.box_m),
            "flight": flight_parameters(self.problem, self.candidate, self.margins, self.aim),
            # Also where the initial guess is a failed motion: beside its own path fewer solves succeed.
            **self.object_paths(self.candidate.q, self.candidate.qd),
            "standing": standing_parameters(self.problem, self.margins.standing_m),
        }

    def object_paths(self, q: Vector, qd: Vector) -> dict[str, Vector]:
        """Returns the `OBJECT_PATH` vectors of both objects, for joint states (6,) at the release."""
        paths = path_parameters(self.problem, q, qd, self.margins.passing_m, len(self.stages.objects))
        return {name: np.round(path, DECIMALS) for name, path in paths.items()}

    def with_object(self, z: Vector) -> Vector:
        """Returns a solver's variables: those of the arm (N + 1, NZ), scaled, and the object's, rounded."""
        pieces = [z.ravel()[: self.transcription.row_index.core]]
        for first in self.stages.objects:
            release = z[first] * self.scales
            thrown = np.concatenate(thrown_state(self.problem, release[Q], release[QD]))
            pieces.append(np.tile(np.round(thrown, DECIMALS), self.stages.stages + 1 - first))
        return np.concatenate(pieces)

    def _arm(self) -> Vector:
        """Returns the `ARM` vector; for a calibrated arm, of the closest arm that the formulas know."""
        cell = self.problem.cell
        vector = arm_parameters(cell, self.limits, self.margins)
        if cell.robot.fixed is not None:
            q, qd = self.fitted_at or (self.candidate.q, self.candidate.qd)
            for name, values in closest_arm(cell, q, qd).items():
                vector[layout.ARM.slices[name]] = values
        return vector

    @cached_property
    def scales(self) -> Vector:
        """Scales of one stage's variables (NZ,): scaled variables times these are in SI units."""
        return variable_scales(self.shared_parameters["scales"])

    @cached_property
    def arguments(self) -> Arguments:
        """Initial guess, parameters and bounds, by the names of a solver's arguments; rounded to `DECIMALS`.

        What they are computed from differs in its last bits between machines, and between the C kernel and numpy. Where
        a solve is ill-conditioned, that would decide whether it succeeds.
        """
        bounds = self._bounds()
        index = self.transcription.row_index
        lower, upper = (bounds.x / self.scales).reshape(2, -1)[:, : index.core]
        free = np.full(index.variables - index.core, np.inf)
        lower = np.append(lower, -free)
        upper = np.append(upper, free)
        exact = {
            "x0": self.with_object(self.initial / self.scales),
            "p": np.concatenate([*self.shared_parameters.values(), self._costs()]),
            "lbx": lower,
            "ubx": upper,
            "lbg": bounds.g[0],
            "ubg": bounds.g[1],
        }
        return {name: np.round(value, DECIMALS) for name, value in exact.items()}

    def _bounds(self) -> Bounds:
        problem = self.problem
        margins = self.margins
        bounds = Bounds(self.transcription.row_index, self.scales[QD])
        clearances = {group: self._given_clearances(group) for group in CLEARANCES if group in self.stages.groups}
        bounds.limit_joints(self.limits, margins.position_rad, self._given())
        for group, limits in self._group_limits().items():
            bounds.limit_group(group, *limits)
        for group, given in clearances.items():
            widened = [getattr(margins, name) - getattr(DEFAULT_MARGINS, name) for name in CLEARANCES[group]]
            bounds.limit_clearances(group, given, np.array(widened))
        bounds.free_flights_after_release(self.stages.window > 0)
        bounds.add_local_margins(margins.local, self.steps)
        for group, given in clearances.items() if self.stages.launch else ():
            bounds.ease_first_stage(group, given[0])
        bounds.fix_ends(problem.start)
        bounds.limit_steps(self.steps, LONGEST_STEP, self.brake_step_max_s)
        if "leaving" in self.stages.groups:
            bounds.follow_object(leaving_time(problem))
        if not problem.ends_at_rest and self.limits.singularity_distance_min > 0.0:  # 0 does not limit: sides are free
            distance = margins.singularity * self.limits.singularity_distance_min
            bounds.avoid_singularities(self._singularity_sides(), distance)
            window_s = problem.release_window_s if self.stages.window else 0.0
            bounds.watch_long_enough(window_s, self.steps, margins.watched)
        bounds.set_release(problem, self.candidate)
        if problem.is_robust:
            window_s = problem.release_window_s
            tolerance_m = problem.landing_tolerance_m
            bounds.hold_window(window_s, tolerance_m, margins.window, self.landing_offsets)
        if self.fixed_times is not None:
            bounds.fix_times(*self.fixed_times)
        return bounds

    def _singularity_sides(self) -> Vector:
        """Returns the candidate's signed distances (3,) in the order of block "singularity"."""
        signed = signed_singularity_distances(self.problem.cell.robot, self.candidate.q)
        distances = dict(zip(SINGULARITIES, signed, strict=True))
        return np.array([distances[name] for name in ("elbow", "wrist", "shoulder")])

    def _group_limits(self) -> dict[str, tuple[Vector, Vector]]:
        """Returns the lower and upper bounds of every lazy group's rows."""
        margins, inf, torque = self.margins, np.inf, np.full(6, self.margins.torque)
        limits = {"effort": (np.append(-torque, -inf), np.append(torque, margins.tcp_speed**2))}
        if "grip" in self.stages.groups:
            axes = np.full(3, margins.grip)
            limits["grip"] = np.append(-axes, -inf), np.append(axes, margins.grip**2)
        counts = {"flight": FLIGHT_ROWS.size, "standing": 1, "leaving": LEAVING_ROWS.size, "passing": 1}
        for group, count in counts.items():
            if group in self.stages.groups:
                limits[group] = np.zeros(count), np.full(count, inf)
        return limits

    def _given_clearances(self, group: str) -> Vector:
        """Returns the rows (k, n) of a group of clearances at the k fixed joint positions, the start first [m].

        They are smaller than the true clearances, and the margins are taken off.
        """
        p = np.concatenate([self.shared_parameters[piece] for piece in FORMULAS[group].parameters])
        value = self.transcription.blocks[group].value
        states = np.pad(self._given(), ((0, 0), (0, NZ - 6)))
        return np.array([evaluate(value, state, p)[0].ravel() for state in states])

    def _given(self) -> list[Vector]:
        """Returns the joint positions (6,) that the problem fixes [rad]."""
        return [self.problem.start, self.candidate.q] if self.problem.fixes_joints else [self.problem.start]

    def _costs(self) -> Vector:
        """Returns the `COST` parameters of every stage; with fixed times only jerk and steps have a cost."""
        n = len(self.steps)
        time = np.where(np.arange(n) < self.stages.launch, 1.0, BRAKE_WEIGHT)
        weights = {
            "time": time if self.fixed_times is None else np.zeros(n),
            "jerk": np.full(n, JERK_WEIGHT / n / 6),
            "step": np.full(n, STEP_WEIGHT / n),
            "initial_step": self.steps / self.scales[STEP],
        }
        return np.stack([weights[name] for name in layout.COST.sizes]).T.ravel()


def _even_braking(q: Vector, qd: Vector, t: Vector) -> Vector:
    """Returns the variables (k, NZ) of braking evenly from q, qd (6,), in SI units, at times (k,) from 0 to the end."""
    duration_s = float(t[-1])
    z = np.zeros((len(t), NZ))
    z[:, Q] = q + np.outer(t - t**2 / (2.0 * duration_s), qd)
    z[:, QD] = np.outer(1.0 - t / duration_s, qd)
    z[:, QDD] = -qd / duration_s
    z[:, TIME] = t
    z[:-1, STEP] = np.diff(t)
    return z


def _brake_times(duration_s: float, stages: StageLayout, problem: ThrowProblem) -> Vector:
    """Returns the times of the knots after the last release, from 0 to the end of the brake [s].

    Where the object is followed out of the grip, the first stages take as long as that, unless hardly any is left.
    """
    count = stages.brake - stages.window
    out_s = leaving_time(problem)
    if "leaving" not in stages.groups or duration_s < out_s * (1.0 + 0.5 / OUT_STAGES):
        return np.linspace(0.0, duration_s, count + 1)
    rest = np.linspace(out_s, duration_s, count - OUT_STAGES + 1)
    return np.append(np.linspace(0.0, out_s, OUT_STAGES + 1), rest[1:])


def _variables_along(guess: InitialGuess, stages: StageLayout, problem: ThrowProblem) -> tuple[Vector, Vector]:
    """Returns variables (N + 1, NZ) and steps (N,) [s] along a motion, with knots at the ends of the window."""
    release = guess.release_time_s
    end = guess.duration_s
    n = stages.window
    around = problem.release_window_s if n else 0.0
    first = max(release - around, release / 2)
    last = min(release + around, (release + end) / 2)
    pieces = (0.0, first, stages.launch - n), (first, release, n), (release, last, n)
    t = np.concatenate([[0.0], *(np.linspace(start, stop, count + 1)[1:] for start, stop, count in pieces)])
    if stages.brake > n:
        t = np.append(t, last + _brake_times(end - last, stages, problem)[1:])
    q, qd, qdd = guess.at(t)
    steps = np.diff(t)
    controls = np.column_stack([np.diff(qdd, axis=0) / steps[:, None], steps])
    return np.column_stack([q, qd, qdd, t - release, np.pad(controls, ((0, 1), (0, 0)))]), steps

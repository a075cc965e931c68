"""Instance: one problem and one candidate as the numbers that a solver is called with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.bounds import Bounds, watched_stages, watched_time
from planner.backends.casadi_nlp.flight_rows import constrains_flight, flight_parameters
from planner.backends.casadi_nlp.functions import all_blocks, evaluate
from planner.backends.casadi_nlp.layout import (
    DECIMALS,
    LAZY_GROUPS,
    NZ,
    OUT_STAGES,
    QD,
    STEP,
    TIME,
    Q,
    StageLayout,
    Vector,
)
from planner.backends.casadi_nlp.margins import Margins
from planner.backends.casadi_nlp.object_path import (
    leaving_time,
    path_parameters,
    standing_parameters,
    thrown_state,
)
from planner.backends.casadi_nlp.parameters import (
    arm_parameters,
    nearest_shapes,
    room_parameters,
    scale_parameters,
    shape_parameters,
    variable_scales,
)
from planner.backends.casadi_nlp.release_rows import aim_from, release_parameters, window_stages
from planner.backends.casadi_nlp.symbols import FORMULAS, cost_parameters
from planner.backends.casadi_nlp.transcription import RowIndex, row_index
from planner.backends.casadi_nlp.tuning import BRAKE_STAGES, LAUNCH_STAGES
from planner.cell import Limits
from planner.kinematics import SINGULARITIES, signed_singularity_distances
from planner.problem import ThrowProblem
from planner.seeds import Candidate, InitialGuess, Seed
from planner.timing import CubicGuess, grid_limits

Arguments = dict[str, Vector]

NOT_NEGATIVE = np.zeros(1), np.full(1, np.inf)  # bounds of every row of a group
CLEARANCES = ("clearance", "keep_out", "rooms")  # of `LAZY_GROUPS`: distances from the arm, surroundings and shapes


def stage_layout(problem: ThrowProblem, margins: Margins) -> StageLayout:
    """Returns the stages that a problem needs, with every lazy group of rows that applies to it.

    Args:
        problem: the problem.
        margins: on every limit; they decide which groups there are.
    """
    groups = _applicable_groups(problem, margins)
    shapes = _shape_slots(problem) if "keep_out" in groups else 0
    if problem.ends_at_rest:
        return StageLayout(LAUNCH_STAGES, 0, 0, groups, shapes)
    window = window_stages(problem)
    return StageLayout(
        LAUNCH_STAGES + window, BRAKE_STAGES + window, window, groups, shapes, problem.target is not None
    )


def _applicable_groups(problem: ThrowProblem, margins: Margins) -> tuple[str, ...]:
    applies = {
        "keep_out": _shape_slots(problem) > 0 and margins.heeds_shapes,
        "rooms": len(problem.cell.surroundings.rooms) > 0,
        "grip": problem.cell.gripper.hold_acceleration_m_s2 is not None and not problem.ends_at_rest,
        "flight": constrains_flight(problem),
        "standing": problem.target is not None,
        "leaving": margins.leaves,
        "passing": not problem.ends_at_rest,
    }
    return tuple(group for group in LAZY_GROUPS if applies.get(group, True))


def _shape_slots(problem: ThrowProblem) -> int:
    """Returns the least number of slots that hold the keep-out shapes, a bin among them; the most if none does."""
    shapes = len(problem.cell_with_bin.surroundings.keep_out)
    return next((slots for slots in (0, *layout.SHAPE_SLOTS) if slots >= shapes), layout.KEEP_OUT_SHAPES)


@dataclass(frozen=True, eq=False)
class Instance:
    """One problem near one candidate, as a solver is called with it.

    Attributes:
        problem: the problem.
        seed: the release state to start from, which `joint` and `pose` releases are held to, and a motion through it.
        margins: on every limit.
        stages: the layout, with every group of rows that applies.
        limits: of the joints, less what the tick grid needs.
        aim: landing point of the drag-free flight (3,) [m].
        initial: initial guess of the variables (N + 1, NZ), in SI units.
        steps: lengths (N,) [s] that the solution's steps are kept close to.
        fixed_times: times of start and end [s], the release at 0, if they are fixed.
        landing_offsets: added to the landing error at each knot of the window (2 n + 1, 2) [m].
        release_offsets: by which the formulas' `RELEASE_ROWS` are to differ from what is asked, for a calibrated arm.
    """

    problem: ThrowProblem
    seed: Seed
    margins: Margins
    stages: StageLayout
    limits: Limits
    aim: Vector
    initial: Vector
    steps: Vector
    fixed_times: tuple[float, float] | None = None
    landing_offsets: Vector | float = 0.0
    release_offsets: Vector | float = 0.0

    @staticmethod
    def of(problem: ThrowProblem, seed: Seed, margins: Margins) -> Instance:
        """Returns the instance of a seed."""
        candidate = seed.candidate
        guess = seed.initial_guess or CubicGuess(problem, candidate)
        stages = stage_layout(problem, margins)
        limits = grid_limits(problem.reachable, problem.dt)
        aim = aim_from(problem, candidate.q, candidate.qd)
        initial, steps = _variables_along(guess, stages, problem)
        watched_s = watched_time(problem.planned_window_s, problem.dt)
        stages = replace(stages, watched=watched_stages(steps[: stages.launch], stages.window, watched_s))
        return Instance(problem, seed, margins, stages, limits, aim, initial, steps)

    def from_guess(self, guess: InitialGuess, landing_offsets: Vector | float) -> Instance:
        """Returns the instance with another initial guess and other offsets of the landings."""
        initial, steps = _variables_along(guess, self.stages, self.problem)
        return replace(self, initial=initial, steps=steps, landing_offsets=landing_offsets)

    def without_window(self) -> Instance:
        """Returns the instance of the same throw without its release window."""
        nominal = replace(self.problem, release_window_s=0.0, landing_tolerance_m=0.0)
        return Instance.of(nominal, self.seed, self.margins)

    def with_reserve(self, guess: InitialGuess, reserve: float) -> Instance:
        """Returns the instance with another reserve for the tick grid, one of `planner.timing.RESERVES`, and guess."""
        limits = grid_limits(self.problem.reachable, self.problem.dt, reserve)
        return replace(self.from_guess(guess, self.landing_offsets), limits=limits)

    def on_times(self, solution: Vector, launch_s: float, brake_s: float) -> Instance:
        """Returns this instance with a solution (N + 1, NZ), in SI units, as initial guess and its durations fixed."""
        initial = solution.copy()
        initial[0, TIME] = -launch_s
        initial[-1, TIME] = brake_s
        return replace(self, initial=initial, steps=solution[:-1, STEP], fixed_times=(-launch_s, brake_s))

    @property
    def candidate(self) -> Candidate:
        """The release state of the seed."""
        return self.seed.candidate

    @property
    def first_groups(self) -> frozenset[str]:
        """Groups of rows that are included from the first solve.

        Those whose margin was widened; and those of a flight that is free, as a solution without its rows
        would be far from one with.
        """
        return self.margins.widened_groups | ({"flight"} if self.stages.aims else set())

    @property
    def row_index(self) -> RowIndex:
        """The rows of its layout."""
        return row_index(self.stages)

    @cached_property
    def shared_parameters(self) -> dict[str, Vector]:
        """The parameter vectors of `layout.SHARED`."""
        around = self.problem.cell_with_bin
        return {
            "scales": scale_parameters(self.limits, float(self.steps.max())),
            "arm": arm_parameters(self.problem.cell, self.limits, self.margins),
            "release": release_parameters(self.problem, self.aim),
            "shapes": shape_parameters(around, nearest_shapes(around, self.initial[:, Q]), self.margins.shape_m),
            "flight": flight_parameters(self.problem, self.candidate, self.margins, self.aim),
            # Also where the initial guess is a failed motion: beside its own path fewer solves succeed.
            "object_path": self.object_path(self.candidate.q, self.candidate.qd),
            "standing": standing_parameters(self.problem, self.margins.standing_m),
            "rooms": room_parameters(self.problem.cell, self.initial[:, Q], self.margins.keep_in_m),
        }

    def object_path(self, q: Vector, qd: Vector) -> Vector:
        """Returns the `OBJECT_PATH` vector for joint states (6,) at the release."""
        path = path_parameters(self.problem, q, qd, self.margins.passing_m, self.stages.has_thrown)
        return np.round(path, DECIMALS)

    def with_object(self, z: Vector) -> Vector:
        """Returns a solver's variables: those of the arm (N + 1, NZ), scaled, and the object's, rounded."""
        pieces = [z.ravel()[: self.row_index.core]]
        if self.stages.has_thrown:
            release = z[self.stages.launch] * self.scales
            thrown = np.concatenate(thrown_state(self.problem, release[Q], release[QD]))
            pieces.append(np.tile(np.round(thrown, DECIMALS), self.stages.stages + 1 - self.stages.launch))
        return np.concatenate(pieces)

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
        index = self.row_index
        lower, upper = (bounds.x / self.scales).reshape(2, -1)[:, : index.core]
        free = np.full(index.variables - index.core, np.inf)
        lower = np.append(lower, -free)
        upper = np.append(upper, free)
        costs = cost_parameters(self.stages, self.steps / self.scales[STEP], self.fixed_times is not None)
        exact = {
            "x0": self.with_object(self.initial / self.scales),
            "p": np.concatenate([*self.shared_parameters.values(), costs]),
            "lbx": lower,
            "ubx": upper,
            "lbg": bounds.g[0],
            "ubg": bounds.g[1],
        }
        return {name: np.round(value, DECIMALS) for name, value in exact.items()}

    def _bounds(self) -> Bounds:
        problem = self.problem
        margins = self.margins
        bounds = Bounds(self.row_index, self.scales[QD])
        bounds.limit_joints(self.limits, margins.position_rad, self._given())
        limits = self._group_limits()
        for group in self.stages.groups:
            bounds.limit_group(group, *limits.get(group, NOT_NEGATIVE))
            if group in CLEARANCES:
                bounds.ease_beside_given(group, self._given_clearances(group))
        bounds.free_flights_after_release(self.stages.window > 0)
        bounds.fix_ends(*problem.start_state)
        bounds.limit_steps(self.steps)
        if "leaving" in self.stages.groups:
            bounds.follow_object(leaving_time(problem))
        if not problem.ends_at_rest and self.limits.singularity_distance_min > 0.0:  # 0 does not limit: sides are free
            distance = margins.singularity * self.limits.singularity_distance_min
            bounds.avoid_singularities(self._singularity_sides(), distance)
            bounds.watch_long_enough(watched_time(problem.planned_window_s, problem.dt))
        bounds.set_release(problem, self.candidate, self.release_offsets)
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
        """Returns the lower and upper bounds of the lazy groups whose rows are not just kept from being negative."""
        margins = self.margins
        inf = np.inf
        torque = np.full(6, margins.torque)
        grip = np.full(3, margins.grip)
        return {
            "effort": (np.append(-torque, -inf), np.append(torque, margins.tcp_speed**2)),
            "grip": (np.append(-grip, -inf), np.append(grip, margins.grip**2)),
        }

    def _given_clearances(self, group: str) -> Vector:
        """Returns the rows (k, n) of a group of clearances at the k fixed joint positions, the start first [m].

        They are smaller than the true clearances, and the margins are taken off.
        """
        p = np.concatenate([self.shared_parameters[piece] for piece in FORMULAS[group].parameters])
        value = all_blocks()[group].value
        states = np.pad(self._given(), ((0, 0), (0, NZ - 6)))
        return np.array([evaluate(value, state, p)[0].ravel() for state in states])

    def _given(self) -> list[Vector]:
        """Returns the joint positions (6,) that the problem fixes [rad]."""
        return [self.problem.start, self.candidate.q] if self.problem.fixes_joints else [self.problem.start]


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

"""Samples of a motion at coarse instants, with link poses and rate bounds: computed once, shared by the checks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.arrays import Array, Index
from planner.cell import Cell, Limits, ThrownBody
from planner.certificate.bounds import LowerBound, Proof, Rates, joint_rates, prove_above
from planner.certificate.loads import LoadBounds, load_bounds, loads_of
from planner.dynamics import (
    TorqueTerms,
    elbow_points,
    empty_bodies,
    fastest,
    loaded_bodies,
    tool_points,
    torque_terms,
)
from planner.geometry import BodyModel, body_model
from planner.kinematics import LinkMotion, dot
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

KNOTS = 64  # [-] instants of a trajectory that are evaluated first; bisection adds others where it must
SPACING_S = (0.008, 0.016)  # [s] least and largest spacing of these knots
TICK_ROUNDING = 1e-6  # [ticks] by which a window of whole ticks may exceed them in floating point
WINDOW_STEP_S = 0.001  # [s] largest spacing in the release window; curvature bounds hold in between
DISTANCE_ACCURACY = 5e-4  # [m; - of a singularity] by which the bound on a distance may be below the least one found
SHARE_ACCURACY = 2e-3  # [-] of a limit, likewise
SPARSE = 2  # [-] distances are evaluated at one of so many knots: most are far from their limit


@dataclass(frozen=True, eq=False)
class ArmSamples:
    """The arm at k instants.

    Attributes:
        cell: the arm's.
        t: [s] (k,).
        X_WL: poses of base and links in the world (k, 7, 4, 4).
        links: their motion, in the world.
        p_WT: position of the tool centre point (3, k) [m].
    """

    cell: Cell
    t: Array
    X_WL: Array
    links: LinkMotion
    p_WT: Array

    @cached_property
    def v_WT(self) -> Array:
        """Velocity of the tool centre point (3, k) [m/s]."""
        return self.links.velocity(self.p_WT)

    @cached_property
    def R_WT(self) -> Array:
        """Axes of the tool (k, 3, 3)."""
        return self.X_WL[:, 6, :3, :3] @ self.cell.tool.X_FT[:3, :3]

    @cached_property
    def a_WT(self) -> Array:
        """Acceleration of the tool centre point (3, k) [m/s^2]."""
        return self.links.acceleration(self.p_WT)

    @cached_property
    def felt(self) -> Array:
        """Acceleration of the tool centre point against free fall (3, k) [m/s^2], which the gripper feels."""
        return self.a_WT + np.array([[0.0], [0.0], [self.cell.surroundings.gravity_m_s2]])

    @cached_property
    def tool_speed(self) -> Array:
        """Speed of the tool centre point (k,) [m/s]."""
        return np.sqrt(dot(self.v_WT, self.v_WT))

    @cached_property
    def flange_speed(self) -> Array:
        """Speed of the flange's centre (k,) [m/s]."""
        return fastest(self.links, tool_points(self.cell)[1:])

    @cached_property
    def elbow_speed(self) -> Array:
        """Speed of the elbow (k,) [m/s]."""
        return fastest(self.links, elbow_points(self.cell))

    @cached_property
    def watched_speed(self) -> Array:
        """Speed of the fastest of tool centre point, flange and elbow (k,) [m/s]."""
        return np.maximum(np.maximum(self.elbow_speed, self.flange_speed), self.tool_speed)

    @cached_property
    def torques(self) -> TorqueTerms:
        """Joint torques without the object (6, k), and what each kilogram of it adds (6, k); with their terms."""
        cell = self.cell
        falling = np.array([0.0, 0.0, -cell.surroundings.gravity_m_s2])
        return torque_terms(self.links, empty_bodies(cell), falling, cell.tool.X_FT[:3, 3])

    @cached_property
    def loaded_torques(self) -> TorqueTerms:
        """Joint torques with the object held, and their terms (6, k): a ball as a point mass, a body with inertia."""
        cell = self.cell
        if not isinstance(cell.object, ThrownBody):
            return TorqueTerms(*(empty + cell.object.mass_kg * per_kilogram for empty, per_kilogram in self.torques))
        falling = np.array([0.0, 0.0, -cell.surroundings.gravity_m_s2])
        whole, held, momentum = torque_terms(self.links, loaded_bodies(cell), falling, cell.tool.X_FT[:3, 3])
        return TorqueTerms(whole[0], held[0], momentum[0])


class MotionSamples:
    """A problem and a trajectory, evaluated at knots: first and last sample, the release and its window, some between.

    Attributes:
        problem, trajectory: as given.
        is_told: whether the checks tell bounds as their values, for which every tick is a knot; otherwise they decide
            alone, in a third of the time.
        body: model of the cell's arm, tool and object.
    """

    def __init__(self, problem: ThrowProblem, trajectory: Trajectory, is_told: bool = False) -> None:
        self.problem = problem
        self.trajectory = trajectory
        self.is_told = is_told
        self.body: BodyModel = body_model(problem.cell_with_bin)

    @property
    def distance_accuracy(self) -> float:
        """By how much a bound on a distance may be off the worst one found [m, -]; anything where none is told."""
        return DISTANCE_ACCURACY if self.is_told else math.inf

    @property
    def share_accuracy(self) -> float:
        """By how much a bound on a share of a limit may be off the worst one found [-], likewise."""
        return SHARE_ACCURACY if self.is_told else math.inf

    @cached_property
    def limits(self) -> Limits:
        """The problem's limits; where it says more than the arm can do, the arm's own."""
        return self.problem.limits.within(self.problem.cell.robot)

    @cached_property
    def tool_speed_max(self) -> float:
        """Largest speed of the tool centre point [m/s]: the problem's, and the arm's safety limit."""
        safe = self.problem.cell.safety.tool_speed_m_s
        return self.limits.tcp_speed_max if safe is None else min(self.limits.tcp_speed_max, safe)

    @cached_property
    def knots(self) -> Index:
        """Indices of the samples that are evaluated first (m,)."""
        trajectory, last = self.trajectory, len(self.trajectory.q) - 1
        spacing = min(max(trajectory.duration_s / KNOTS, SPACING_S[0]), SPACING_S[1])
        stride = 1 if self.is_told else max(1, round(spacing * trajectory.sample_rate_hz))
        passed = (trajectory.release_index, *trajectory.passage_indices)
        return _merged(np.arange(0, last, stride), *passed, *self._object_changes, last)

    @cached_property
    def sparse(self) -> Index:
        """Indices of the knots at which distances are evaluated first; first, release and last among them."""
        last = len(self.knots) - 1
        changes = np.searchsorted(self.knots, self._object_changes)
        return _merged(np.arange(0, last, 1 if self.is_told else SPARSE), self.release_knot, *changes, last)

    @cached_property
    def release_knot(self) -> int:
        """Index of the release among the knots."""
        return int(np.searchsorted(self.knots, self.trajectory.release_index))

    @property
    def gone_from_s(self) -> float:
        """Time from which the object may have left [s]: the first that the gripper may open at, a knot.

        Infinite for a motion that throws nothing, -infinite for one without the object.
        """
        return self._change_s(0)

    @property
    def held_until_s(self) -> float:
        """Time until which the object may still be held [s]: the last that the gripper may open at, a knot.

        Infinite for a motion that throws nothing, -infinite for one without the object.
        """
        return self._change_s(1)

    def _change_s(self, end: int) -> float:
        """Returns the time of one end of the span in which the object may be held or gone [s]."""
        if not self.problem.holds_object:
            return -math.inf
        return float(self.trajectory.t[self._object_changes[end]]) if self.problem.throws else math.inf

    def worse_of(self, t: Array, held: Array, empty: Array) -> Array:
        """Returns values (..., k) at times `t` (k,) with the object while it is held, without it once it is gone.

        Where it may be either, the larger value.
        """
        before = t < self.gone_from_s
        after = t > self.held_until_s
        return np.where(before, held, np.where(after, empty, np.maximum(held, empty)))

    @cached_property
    def _object_changes(self) -> tuple[int, int]:
        """Samples between which the object may be held or gone: the opening's spread, rounded outwards."""
        return ticks_around_release(self.trajectory, self.problem.opening_spread_s)

    @cached_property
    def at_knots(self) -> ArmSamples:
        """The arm at the knots."""
        rows = self.knots
        trajectory = self.trajectory
        return self._arm(trajectory.t[rows], (trajectory.q[rows], trajectory.qd[rows], trajectory.qdd[rows]))

    @cached_property
    def in_window(self) -> ArmSamples:
        """The arm at instants of the release window, every millisecond or less."""
        return self._around_release(self.problem.release_window_s)

    @cached_property
    def in_spread(self) -> ArmSamples:
        """The arm at instants at which the gripper may open, likewise."""
        spread = self.problem.opening_spread_s
        return self.in_window if spread == self.problem.release_window_s else self._around_release(spread)

    def _around_release(self, half_s: float) -> ArmSamples:
        released = self.trajectory.release_time_s
        return self.at(released + np.linspace(-half_s, half_s, 2 * math.ceil(half_s / WINDOW_STEP_S) + 1))

    @cached_property
    def ends(self) -> Array:
        """Ends of the body's capsules in the world at the knots (c, 2, 3, m) [m]."""
        return self.body.end_points(self.at_knots.X_WL)

    @cached_property
    def rates(self) -> Rates:
        """Rate bounds of the joints between neighbouring knots."""
        return joint_rates(self.trajectory, self.knots)

    @cached_property
    def load_bounds(self) -> LoadBounds:
        """Bounds on what moves the loads between neighbouring knots."""
        return load_bounds(loads_of(self.problem.cell), self.rates, self.problem.gravity)

    @cached_property
    def sparse_speeds(self) -> Array:
        """Largest joint speeds between neighbouring sparse knots (6, k) [rad/s]."""
        return np.maximum.reduceat(self.rates.qd, self.sparse[:-1], axis=1)

    def at(self, t: Array) -> ArmSamples:
        """Returns the arm at times (k,) [s]."""
        return self._arm(t, self.trajectory.at(t))

    def poses_at(self, t: Array) -> Array:
        """Returns poses of base and links in the world (k, 7, 4, 4) at times (k,) [s]."""
        X_WL, which = self.distinct_poses(t)
        return X_WL[which]

    def distinct_poses(self, t: Array) -> tuple[Array, Index]:
        """Returns poses of base and links (n, 7, 4, 4) at the distinct ones of times (...), and which (...) of them."""
        distinct, which = np.unique(t, return_inverse=True)
        return self.body.link_poses(self.trajectory.at(distinct)[0]), which.reshape(t.shape)

    def prove(
        self,
        room: Callable[[ArmSamples], Array],
        rates: Array,
        required: float,
        lower_bound: LowerBound,
        accuracy: float,
        count: int | None = None,
    ) -> Proof:
        """Returns the proof that what the arm leaves of limits is at least `required` at every instant.

        Args:
            room: function of the arm at k instants that returns what is left (items, k).
            rates, required, lower_bound, accuracy: as of `prove_above`, from the first knot on.
            count: number of the knots up to which it is to hold; None: to the end.
        """

        def evaluate(t: Array, item: Index) -> Array:
            return room(self.at(t))[item, np.arange(len(t))]

        arm = self.at_knots
        return prove_above(evaluate, arm.t[:count], room(arm)[:, :count], rates, required, lower_bound, accuracy)

    def _arm(self, t: Array, state: tuple[Array, Array, Array]) -> ArmSamples:
        q, qd, qdd = state
        X_WL = self.body.link_poses(q)
        links = LinkMotion(X_WL, qd, qdd)
        cell = self.problem.cell
        return ArmSamples(cell, t, X_WL, links, links.on_flange(cell.tool.X_FT[:3, 3]))


def ticks_around_release(trajectory: Trajectory, window_s: float) -> tuple[int, int]:
    """Returns the first and the last sample of a window around the release, rounded outwards to whole ticks.

    Args:
        trajectory: the motion; what lies before or after it is left out.
        window_s: half of the window [s].
    """
    return ticks_around(trajectory, trajectory.release_index, window_s)


def ticks_around(trajectory: Trajectory, index: int, window_s: float) -> tuple[int, int]:
    """Returns the first and the last sample of a window around another one, as of `ticks_around_release`."""
    reach = math.ceil(window_s * trajectory.sample_rate_hz - TICK_ROUNDING)
    return max(0, index - reach), min(len(trajectory.q) - 1, index + reach)


def _merged(rows: Index, *more: int) -> Index:
    """Returns increasing `rows` with `more` inserted."""
    merged = np.sort(np.concatenate([rows, more]))
    return merged[np.concatenate([[True], merged[1:] > merged[:-1]])]

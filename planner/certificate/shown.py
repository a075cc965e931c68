"""Curves of a motion over time, each with the limits that the certificate holds it to, for people to look at.

The values come from the functions that the checks are made of, at samples of the trajectory. A check proves its bound
between samples too, so its value may lie a little beyond its curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.arrays import Array, Index
from planner.cell import CONTACT_M
from planner.certificate.clearance import moving_heights, pair_gaps, shape_gaps
from planner.certificate.flight import Flights, flights_of
from planner.certificate.grip import felt_sizes
from planner.certificate.safety_limits import WATCHED
from planner.certificate.samples import ArmSamples, MotionSamples, ticks_around
from planner.certificate.tool import SINGULARITY_WINDOW_S
from planner.certificate.torque import torque_sizes
from planner.dynamics import tool_points
from planner.geometry import SELF_CLEARANCE_M
from planner.kinematics import SINGULARITIES, signed_singularity_distances
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

INSTANTS_MAX = 2000  # [-] of one curve: four seconds at 500 Hz; a longer motion is shown at every other tick, or fewer
FLIGHT_STEP_S = 0.005  # [s] between the instants of a flight


@dataclass(frozen=True, eq=False)
class Series:
    """One quantity over time.

    Attributes:
        name: of the joint, point, shape or singularity.
        values: (k,), in the curve's unit; NaN where there is none.
        lower, upper: its limits; None where it has none.
    """

    name: str
    values: Array
    lower: float | None = None
    upper: float | None = None


@dataclass(frozen=True, eq=False)
class Curve:
    """Quantities that one check of the certificate judges.

    Attributes:
        name: of the check.
        unit: of values and limits; "1" for a plain number.
        t: instants (k,) [s].
        series: the quantities.
        holds_until_next: whether a value holds until the next instant; otherwise the quantity is continuous.
        limited: span in which the limits hold [s]; None: everywhere.
    """

    name: str
    unit: str
    t: Array
    series: tuple[Series, ...]
    holds_until_next: bool = False
    limited: tuple[float, float] | None = None


class ShownMotion:
    """A motion at the instants that are shown: every tick, or evenly spaced ones with the release and the last."""

    def __init__(self, problem: ThrowProblem, trajectory: Trajectory) -> None:
        self.problem = problem
        self.trajectory = trajectory
        self.motion = MotionSamples(problem, trajectory)

    @cached_property
    def rows(self) -> Index:
        """Samples that are shown (k,)."""
        count = len(self.trajectory.q)
        every = np.arange(0, count, math.ceil(count / INSTANTS_MAX))
        return np.union1d(every, [self.trajectory.release_index, count - 1])

    @property
    def t(self) -> Array:
        """Their times (k,) [s]."""
        return self.trajectory.t[self.rows]

    @cached_property
    def arm(self) -> ArmSamples:
        """The arm there."""
        return self.motion.at(self.t)

    @cached_property
    def ends(self) -> Array:
        """Ends of the body's capsules there (c, 2, 3, k) [m]."""
        return self.motion.body.end_points(self.arm.X_WL)

    def of_joints(
        self, name: str, unit: str, values: Array, lower: Array, upper: Array, holds_until_next: bool = False
    ) -> Curve:
        """Returns the curve of a quantity (k, 6) of every joint with its limits (6,)."""
        names = self.problem.cell.robot.joint_names
        rows = zip(names, values.T, lower.tolist(), upper.tolist(), strict=True)
        return Curve(name, unit, self.t, tuple(Series(*row) for row in rows), holds_until_next)

    def of_one(
        self, name: str, unit: str, values: Array, *, lower: float | None = None, upper: float | None = None
    ) -> Curve:
        """Returns the curve of one quantity (k,)."""
        return Curve(name, unit, self.t, (Series(name, values, lower, upper),))


def motion_curves(problem: ThrowProblem, trajectory: Trajectory) -> tuple[Curve, ...]:
    """Returns the curves of a motion: of its joints, torques, speeds, clearances, singularity distances and flight."""
    shown = ShownMotion(problem, trajectory)
    return tuple(curve for curves in CURVES for curve in curves(shown))


def _joints(shown: ShownMotion) -> list[Curve]:
    limits = shown.motion.limits
    trajectory = shown.trajectory
    rows = shown.rows
    jerk = np.append(trajectory.jerk, np.zeros((1, trajectory.q.shape[1])), axis=0)[rows]  # at rest after the end
    speed = limits.qd_max
    bend = limits.qdd_max
    jolt = limits.jerk_max
    return [
        shown.of_joints("joint_position", "rad", trajectory.q[rows], limits.q_lower, limits.q_upper),
        shown.of_joints("joint_velocity", "rad/s", trajectory.qd[rows], -speed, speed),
        shown.of_joints("joint_acceleration", "rad/s^2", trajectory.qdd[rows], -bend, bend),
        shown.of_joints("joint_jerk", "rad/s^3", jerk, -jolt, jolt, holds_until_next=True),
        shown.of_joints("joint_torque", "N m", torque_sizes(shown.motion, shown.arm).T, 0.0 * bend, limits.tau_max),
    ]


def _speeds(shown: ShownMotion) -> list[Curve]:
    arm = shown.arm
    safety = shown.problem.cell.safety
    tool, flange = (point.name for point in tool_points(shown.problem.cell))
    points = (
        Series(tool, arm.tool_speed, None, shown.motion.tool_speed_max),
        Series(flange, arm.flange_speed, None, safety.tool_speed_m_s),
    )
    return [Curve("tcp_speed", "m/s", shown.t, points)]


def _watched(shown: ShownMotion) -> list[Curve]:
    motion = shown.motion
    return [
        shown.of_one(each.name, each.unit, each.sizes(motion, shown.arm), upper=each.limit(motion)) for each in WATCHED
    ]


def _clearances(shown: ShownMotion) -> list[Curve]:
    motion = shown.motion
    t = shown.t
    ends = shown.ends
    around = motion.body.cell.surroundings  # with the bin of the request
    found = [shown.of_one("floor", "m", moving_heights(motion, t, ends).min(axis=0), lower=around.clearance_m)]
    if len(motion.body.pairs):
        found.append(
            shown.of_one("self_collision", "m", pair_gaps(motion, t, ends).min(axis=0), lower=SELF_CLEARANCE_M)
        )
    if around.keep_out:
        gaps = shape_gaps(motion, t, ends).min(axis=1)
        required = (around.clearance_m + around.further_clearances).tolist()
        rows = zip(around.keep_out_names, gaps, required, strict=True)
        found.append(Curve("keep_out", "m", t, tuple(Series(*row) for row in rows)))
    if around.keep_in:
        inside = motion.body.wall_distances(ends)
        rows = zip(around.keep_in_names, inside, around.keep_in_clearances.tolist(), strict=True)
        found.append(Curve("keep_in", "m", t, tuple(Series(*row) for row in rows)))
    return found


def _singularities(shown: ShownMotion) -> list[Curve]:
    problem = shown.problem
    distances = np.abs(signed_singularity_distances(problem.cell.robot, shown.trajectory.q[shown.rows]))
    required = None if problem.ends_at_rest else problem.limits.singularity_distance_min
    series = tuple(Series(name, d, required) for name, d in zip(SINGULARITIES, distances.T, strict=True))
    passed = shown.trajectory.passed
    first, _ = ticks_around(shown.trajectory, passed[0], SINGULARITY_WINDOW_S)
    _, last = ticks_around(shown.trajectory, passed[-1], SINGULARITY_WINDOW_S)
    span = (float(shown.trajectory.t[first]), float(shown.trajectory.t[last]))
    return [Curve("singularity_distance", "1", shown.t, series, limited=None if problem.ends_at_rest else span)]


def _grip(shown: ShownMotion) -> list[Curve]:
    if not shown.problem.holds_object:
        return []
    limit = shown.problem.cell.gripper.hold_acceleration_m_s2
    until = shown.motion.held_until_s
    axes = limit is not None and len(limit) == 3
    felt = np.where(shown.t > until, np.nan, np.atleast_2d(felt_sizes(shown.arm, axes)))
    limits = [None] if limit is None else limit.tolist()
    names = "xyz" if axes else ("grip_acceleration",)
    series = tuple(Series(n, v, None, upper) for n, v, upper in zip(names, felt, limits, strict=True))
    return [Curve("grip_acceleration", "m/s^2", shown.t, series)]


def _flight(shown: ShownMotion) -> list[Curve]:
    """Returns the distance of the object's surface from what it might meet, of a release on time."""
    if not shown.problem.throws:
        return []
    flights = flights_of(shown.motion)
    if flights.end is None:
        return []
    begin = flights.released_s
    end = flights.end[1]
    t = np.linspace(begin, end, 1 + max(1, math.ceil((end - begin) / FLIGHT_STEP_S)))
    required = flights.clearance_m
    return [Curve("flight_clearance", "m", t, (Series("object", required + _least_gaps(flights, t), required),))]


def _least_gaps(flights: Flights, t: Array) -> Array:
    """Returns the least gaps (k,) [m] at `t` (k,), beyond the clearance.

    As in the check, what does not let go of the object at once is left out, and what it lands on, unless that is met.
    """
    count = len(flights.names) - (flights.opening is None)
    x = flights.positions(np.full(len(t), flights.released_s), t)
    gaps = flights.gaps_along(x, t)[:count]
    gripped = flights.gripped
    gaps[gripped[gaps[gripped, 0] < 0.0]] = np.inf
    gaps[flights.carriers[:count, None] & (gaps >= -CONTACT_M)] = np.inf
    return gaps.min(axis=0)


CURVES: tuple[Callable[[ShownMotion], list[Curve]], ...] = (
    _joints,
    _speeds,
    _watched,
    _clearances,
    _singularities,
    _grip,
    _flight,
)

"""A motion as people look at it: curves of quantities over time, each with the limits that its check holds it to.

The values come from the functions that the checks are made of, at samples of the trajectory. A check proves its bound
between samples too, so its value may lie a little beyond its curve.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.arrays import Array, Index
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

INSTANTS_MAX = 2000  # [-] of one curve: four seconds at 500 Hz; a longer motion is shown at every other tick, or fewer


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

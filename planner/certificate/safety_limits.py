"""Checks of the limits that the arm's own safety system watches: speed of the elbow, momentum, power, stops.

To add one, write a function of its sizes and a line in `WATCHED`, which certificate and curves read; its limit is a
line in `planner.cell.SAFETY_LIMITS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.cell import SAFETY_LIMITS
from planner.certificate.bounds import (
    LowerBound,
    curvature_bound,
    kinked_bound,
    point_bound,
)
from planner.certificate.certificate import ROUNDING, Check, NotChecked, at_most
from planner.certificate.loads import watched_levers
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.certificate.shown import Curve, ShownMotion
from planner.certificate.stopping import (
    Worst,
    stopping_distances,
    stopping_times,
    worst_stopping_distance,
    worst_stopping_time,
)
from planner.dynamics import empty_bodies, momentum

Sizes = Callable[[MotionSamples, ArmSamples], Array]


@dataclass(frozen=True)
class WatchedQuantity:
    """A quantity that the arm's safety system limits.

    Attributes:
        key: of its limit, in `SAFETY_LIMITS`.
        sizes: function of a motion and the arm at k instants that returns it there (k,).
        worst: function of a motion and the limit that returns the largest value, or a bound on it; its time [s]; and
            whether the limit is proven at every instant.
    """

    key: str
    sizes: Sizes
    worst: Callable[[MotionSamples, float], Worst]

    @property
    def name(self) -> str:
        """Name of the check."""
        return SAFETY_LIMITS[self.key].check

    @property
    def unit(self) -> str:
        """Its unit."""
        return SAFETY_LIMITS[self.key].unit

    def limit(self, motion: MotionSamples) -> float | None:
        """Returns the limit that the motion's cell states; None without one."""
        return getattr(motion.problem.cell.safety, self.key)

    def check(self, motion: MotionSamples) -> Check | NotChecked:
        """Checks that the quantity is nowhere above its limit."""
        limit = self.limit(motion)
        if limit is None:
            return NotChecked(self.name)
        value, at_s, proven = self.worst(motion, limit)
        return at_most(self.name, value, limit, self.unit, at_s).provided(proven)


def momentum_sizes(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns the sizes of the momentum (k,) [kg m/s] of arm, tool, and the object while it may be held.

    The larger one where the object may be held or gone.
    """
    empty = momentum(arm.links, empty_bodies(arm.cell))
    held = empty + arm.cell.object.mass_kg * arm.v_WT
    return motion.worse_of(arm.t, *(np.sqrt((p * p).sum(axis=0)) for p in (held, empty)))


def power_sizes(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns the sizes of the mechanical power (k,) [W] of all joints together, tau . qd, that drives or brakes.

    The larger one where the object may be held or gone.
    """
    empty, per_kilogram = ((tau * arm.links.qd.T).sum(axis=0) for tau in arm.torques.whole)
    held = empty + arm.cell.object.mass_kg * per_kilogram
    if motion.problem.body is not None:
        held = (arm.loaded_torques.whole * arm.links.qd.T).sum(axis=0)
    return motion.worse_of(arm.t, np.abs(held), np.abs(empty))


def _elbow_rates(motion: MotionSamples) -> Array:
    return point_bound(watched_levers(motion.problem.cell).elbow, motion.rates, 3)


def _with_rates(
    key: str, sizes: Sizes, rates: Callable[[MotionSamples], Array], bound: LowerBound = curvature_bound
) -> WatchedQuantity:
    """Returns the quantity with bounds on how it bends between the knots, as `bound` takes them."""

    def worst(motion: MotionSamples, limit: float) -> Worst:
        def room(arm: ArmSamples) -> Array:
            return 1.0 - sizes(motion, arm)[None] / limit

        proof = motion.prove(room, rates(motion) / limit, -ROUNDING, bound, motion.share_accuracy)
        return (1.0 - proof.value) * limit, proof.at_s, proof.proven

    return WatchedQuantity(key, sizes, worst)


WATCHED = (
    # No point of the elbow joint's axis inside its housing exceeds the elbow speed.
    _with_rates("elbow_speed_m_s", lambda _, arm: arm.elbow_speed, _elbow_rates),
    _with_rates("momentum_kg_m_s", momentum_sizes, lambda motion: motion.load_bounds.momentum),
    _with_rates("power_w", power_sizes, lambda motion: motion.load_bounds.power[:, None], kinked_bound),
    WatchedQuantity("stopping_time_s", stopping_times, worst_stopping_time),
    WatchedQuantity("stopping_distance_m", stopping_distances, worst_stopping_distance),
)


def curves(shown: ShownMotion) -> list[Curve]:
    """Returns the curves of all of them."""
    motion = shown.motion
    return [
        shown.of_one(each.name, each.unit, each.sizes(motion, shown.arm), upper=each.limit(motion)) for each in WATCHED
    ]

"""Checks of the limits that the arm's own safety system watches: speed of the elbow, momentum, power."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from planner.arrays import Array
from planner.certificate.bounds import (
    LowerBound,
    curvature_bound,
    kinked_bound,
    point_bound,
)
from planner.certificate.certificate import ROUNDING, Check, NotChecked, at_most
from planner.certificate.loads import watched_levers
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.dynamics import empty_bodies, momentum


def elbow_speed(motion: MotionSamples) -> Check | NotChecked:
    """Checks that no point of the elbow joint's axis inside its housing exceeds the elbow speed."""
    limit = motion.problem.cell.safety.elbow_speed_m_s
    cell = motion.problem.cell
    if limit is None:
        return NotChecked("elbow_speed")

    def room(arm: ArmSamples) -> Array:
        return 1.0 - arm.elbow_speed[None] / limit

    rates = point_bound(watched_levers(cell).elbow, motion.rates, 3) / limit
    return _check("elbow_speed", "m/s", motion, limit, room, rates)


def linear_momentum(motion: MotionSamples) -> Check | NotChecked:
    """Checks the linear momentum of arm, tool, and the object while it may be held."""
    limit = motion.problem.cell.safety.momentum_kg_m_s
    if limit is None:
        return NotChecked("momentum")

    def room(arm: ArmSamples) -> Array:
        return 1.0 - momentum_sizes(motion, arm)[None] / limit

    return _check("momentum", "kg m/s", motion, limit, room, motion.load_bounds.momentum / limit)


def power(motion: MotionSamples) -> Check | NotChecked:
    """Checks the mechanical power of all joints together, tau . qd, that drives or brakes arm, tool and object."""
    limit = motion.problem.cell.safety.power_w
    if limit is None:
        return NotChecked("power")

    def room(arm: ArmSamples) -> Array:
        return 1.0 - power_sizes(motion, arm)[None] / limit

    rates = motion.load_bounds.power[:, None] / limit
    return _check("power", "W", motion, limit, room, rates, kinked_bound)


def momentum_sizes(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns the sizes of the momentum (k,) [kg m/s]; the larger one where the object may be held or gone."""
    empty = momentum(arm.links, empty_bodies(arm.cell))
    held = empty + arm.cell.object.mass_kg * arm.v_WT
    return motion.worse_of(arm.t, *(np.sqrt((p * p).sum(axis=0)) for p in (held, empty)))


def power_sizes(motion: MotionSamples, arm: ArmSamples) -> Array:
    """Returns the sizes of the mechanical power (k,) [W]; the larger one where the object may be held or gone."""
    empty, per_kilogram = ((tau * arm.links.qd.T).sum(axis=0) for tau in arm.torques.whole)
    held = empty + arm.cell.object.mass_kg * per_kilogram
    if motion.problem.body is not None:
        held = (arm.loaded_torques.whole * arm.links.qd.T).sum(axis=0)
    return motion.worse_of(arm.t, np.abs(held), np.abs(empty))


def _check(
    name: str,
    unit: str,
    motion: MotionSamples,
    limit: float,
    room: Callable[[ArmSamples], Array],
    rates: Array,
    bound: LowerBound = curvature_bound,
) -> Check:
    """Returns the check that the share of a limit which a motion leaves is not negative."""
    proof = motion.prove(room, rates, -ROUNDING, bound, motion.share_accuracy)
    return at_most(name, (1.0 - proof.value) * limit, limit, unit, proof.at_s).provided(proof.proven)

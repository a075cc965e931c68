"""Checks of the grip: what it must hold, and along which way it lets the object go.

The gripper feels the acceleration f = a - g of the tool centre point against free fall: over a time h it deviates from
its chord by at most sup|a''| h^2/8 + c h/4, where c sums the jumps of its slope from tick to tick (`bounds`). In the
axes of the tool, with w1 and w2 bounding the derivatives of a direction, f'' + 2 w1 f' + w2 f takes the place of a''.
"""

from __future__ import annotations

import numpy as np

from planner.arrays import Array
from planner.certificate.bounds import kinked_bound, point_bound
from planner.certificate.certificate import Check, NotChecked, at_most
from planner.certificate.exits import Exits
from planner.certificate.flight import flights_of
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.certificate.shown import Curve, Series, ShownMotion
from planner.kinematics import dot


def grip_acceleration(motion: MotionSamples) -> Check | NotChecked | None:
    """Checks that the grip withstands the acceleration while the object may be held; None without it."""
    name = "grip_acceleration"
    problem = motion.problem
    if not problem.holds_object:
        return None
    limit = problem.cell.gripper.hold_acceleration_m_s2
    if limit is None:
        return NotChecked(name)
    count = int(np.searchsorted(motion.at_knots.t, motion.held_until_s, side="right"))

    def room(arm: ArmSamples) -> Array:
        return 1.0 - felt_sizes(arm, len(limit) == 3) / limit[:, None]

    rates = np.stack(_acceleration_rates(motion, len(limit) == 3))[:, None, : count - 1]
    rates = np.repeat(rates, len(limit), axis=1) / limit[:, None]
    proof = motion.prove(room, rates, 0.0, kinked_bound, motion.share_accuracy, count)
    bound = float(limit[proof.item])
    axis = "xyz"[proof.item] if len(limit) == 3 else ""
    return at_most(name, (1.0 - proof.value) * bound, bound, "m/s^2", proof.at_s, axis).provided(proof.proven)


def felt_sizes(arm: ArmSamples, in_tool: bool) -> Array:
    """Returns the sizes of the acceleration that the grip feels (k,) [m/s^2], or along the tool's axes (3, k)."""
    felt = arm.felt
    if in_tool:
        axes = arm.R_WT.transpose(1, 2, 0)
        return np.abs([dot(axes[:, c], felt) for c in range(3)])
    return np.sqrt(dot(felt, felt))


def _acceleration_rates(motion: MotionSamples, in_tool: bool) -> tuple[Array, Array]:
    """Returns sup |f''| between the knots, apart from the ends of ticks, and the sums of the jumps of f' (m,) each.

    In the axes of the tool, with w1 and w2 bounding the derivatives of a direction: f'' + 2 w1 f' + w2 f.
    """
    rates = motion.rates
    lever = motion.body.tool_lever
    curvature = point_bound(lever, rates, 4)
    if in_tool:
        w1 = rates.totals[0][-1]
        w2 = rates.totals[1][-1]
        felt = point_bound(lever, rates, 2) + motion.problem.gravity
        curvature = curvature + 2.0 * w1 * point_bound(lever, rates, 3) + w2 * felt
    return curvature, lever @ rates.jumps


def opening_direction(motion: MotionSamples) -> Check | NotChecked | None:
    """Checks that the object leaves within the cone that the gripper opens, whenever that opens within its spread.

    It is out once it has moved by its radius against the tool, or by 1 cm; None for a motion that throws nothing.
    """
    name = "opening_direction"
    gripper = motion.problem.cell.gripper
    if not motion.problem.throws:
        return None
    if gripper.opening_direction is None or gripper.opening_cone_rad is None:
        return NotChecked(name)
    exits = Exits(flights_of(motion), gripper.opening_direction, gripper.opening_cone_rad)
    angle, at_s, proven = exits.widest()
    if proven and motion.is_told:
        angle = exits.bound(angle)
    detail = "between the opening direction and the object's way out"
    return at_most(name, angle, gripper.opening_cone_rad, "rad", at_s, detail).provided(proven)


def curves(shown: ShownMotion) -> list[Curve]:
    """Returns the curve of what the grip feels while the object may be held."""
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

"""The list of curves; each family of checks has its own."""

from __future__ import annotations

from collections.abc import Callable

from planner.certificate import clearance, grip, joints, safety_limits, tool, torque
from planner.certificate.flight import flight_curves
from planner.certificate.shown import Curve, ShownMotion
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

CURVES: tuple[Callable[[ShownMotion], list[Curve]], ...] = (
    joints.curves,
    torque.curves,
    tool.speed_curves,
    safety_limits.curves,
    clearance.curves,
    tool.singularity_curves,
    grip.curves,
    flight_curves,
)


def motion_curves(problem: ThrowProblem, trajectory: Trajectory) -> tuple[Curve, ...]:
    """Returns the curves of a motion: of its joints, torques, speeds, clearances, singularity distances and flight."""
    shown = ShownMotion(problem, trajectory)
    return tuple(curve for curves in CURVES for curve in curves(shown))

"""Flight and landing of what a cell throws, audited: of a ball, or of a body by its turned shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from audit.judge.body_flights import body_flight_faults, body_landing_errors
from audit.judge.fault import AuditFault
from audit.judge.flights import ball_flight_faults, ball_landing_errors
from planner.cell import ThrownBody
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]


def flight_faults(problem: ThrowProblem, motion: Trajectory) -> list[AuditFault]:
    """Returns what is wrong with landing and flight of the releases in the window."""
    if not problem.throws:
        return []
    is_body = isinstance(problem.cell.object, ThrownBody)
    return body_flight_faults(problem, motion) if is_body else ball_flight_faults(problem, motion)


def landing_errors(problem: ThrowProblem, motion: Trajectory, delays: Vector) -> Vector:
    """Returns how far from its target the object lands (m,) [m] for delays of the release (m,) [s]; NaN: it does not.

    A ball lands where its centre comes down through the landing plane, a body where its turned shape first touches.
    """
    is_body = isinstance(problem.cell.object, ThrownBody)
    return (body_landing_errors if is_body else ball_landing_errors)(problem, motion, delays)

"""The judge of ThrowBench: what an answer is worth, by the audit's models, apart from Fling's certificate.

docs/throwbench.md lists the rules and the tolerances.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from audit.judge import AuditFault, clearance_faults, landing_errors, motion_faults, over, release_state, under
from benchmarks.throwbench.answer import BadAnswer, motion_of
from benchmarks.throwbench.problem_document import Problem, problem_from_document
from planner.problem import TargetRelease, ThrowProblem
from planner.trajectory import Trajectory

OFF_S = 0.01  # [s] early and late, for which landing errors are given
WINDOW_INSTANTS = 21  # releases of a window that are looked at
LIMIT_TOLERANCE = 1e-3  # [-] of limits of joints and tool speed: rounding, and other ways of sampling
# Absolute tolerances of the other rules; what is not named here has the audit's, 0.01 mm.
TOLERANCES = {
    "start": 1e-4,  # [rad, rad/s]
    "end_at_rest": 1e-4,  # [rad/s]
    "joint_position": 1e-4,  # [rad]
    "release_elevation": 1e-3,  # [rad]
    "release_distance": 1e-4,  # [m]
    "landing": 1e-4,  # [m] errors of the flight's integration
    "landing_window": 1e-4,  # [m]
}
RELATIVE = ("joint_velocity", "joint_acceleration", "joint_jerk", "joint_torque", "tcp_speed")


@dataclass(frozen=True)
class Verdict:
    """What an answer is worth. Times in seconds, distances in metres; None without a motion.

    Attributes:
        outcome: "solved", "invalid", "refused", "timed out" or "crashed".
        faults: Rules that an invalid answer breaks, with value, limit and words.
        release_time_s: Time of the release.
        duration_s: Duration of the motion.
        landing_error_m: Distance of the landing from the target.
        early_error_m: The same for a release 10 ms early.
        late_error_m: The same for a release 10 ms late.
        reason: Of a refusal, a crash or a time out, in words.
    """

    outcome: str
    faults: tuple[AuditFault, ...] = ()
    release_time_s: float | None = None
    duration_s: float | None = None
    landing_error_m: float | None = None
    early_error_m: float | None = None
    late_error_m: float | None = None
    reason: str = ""

    def as_document(self) -> dict[str, Any]:
        """Returns the verdict in JSON's types."""
        return asdict(self)


def verify(problem: Problem, answer: object) -> Verdict:
    """Returns the verdict on an answer to a problem, both as docs/throwbench.md describes them."""
    if not isinstance(answer, dict):
        return _unreadable("format", f"the answer is of type {type(answer).__name__}, not an object")
    if answer.get("refused") is not None:
        return Verdict("refused", reason=str(answer["refused"]))
    try:
        motion = motion_of(answer, float(problem["sample_rate_hz"]))
    except BadAnswer as error:
        return _unreadable(error.rule, str(error), error.value, error.limit)
    asked = problem_from_document(problem)
    faults = [fault for fault in _faults(asked, motion, problem["target"]["tolerance_m"]) if _counts(fault)]
    errors = [
        float(error) if math.isfinite(error) else None
        for error in landing_errors(asked, motion, np.array([-OFF_S, 0.0, OFF_S]))
    ]
    return Verdict(
        "invalid" if faults else "solved",
        tuple(faults),
        motion.release_time_s,
        motion.duration_s,
        errors[1],
        errors[0],
        errors[2],
    )


def _unreadable(rule: str, text: str, value: float = 0.0, limit: float = 0.0) -> Verdict:
    return Verdict("invalid", (AuditFault(rule, text, value, limit),))


def _faults(problem: ThrowProblem, motion: Trajectory, tolerance: float) -> list[AuditFault]:
    """Returns the broken rules, with the audit's own small tolerances."""
    release = problem.release
    assert isinstance(release, TargetRelease)
    p, v = release_state(problem, motion)
    far = float(np.linalg.norm((p - release.p_W)[:2]))
    elevation = math.atan2(v[2], math.hypot(v[0], v[1]))
    return [
        *motion_faults(problem, motion, smooth=True),
        *under("release_elevation", "release is too flat", elevation, release.min_elevation_rad, 0.0, "rad"),
        *under("release_distance", "release is too near", far, release.min_horizontal_distance_m, 0.0, "m"),
        *_landing_faults(problem, motion, tolerance),
        *clearance_faults(problem, motion),
    ]


def _landing_faults(problem: ThrowProblem, motion: Trajectory, tolerance: float) -> list[AuditFault]:
    """Returns the faults of the landing, and of the worst landing within the release window."""
    nominal = float(landing_errors(problem, motion, np.zeros(1))[0])
    found = over("landing", "lands beside the target", nominal, tolerance, 0.0, "m")
    if problem.is_robust:
        delays = np.linspace(-problem.release_window_s, problem.release_window_s, WINDOW_INSTANTS)
        worst = float(np.max(landing_errors(problem, motion, delays)))
        found += over("landing_window", "lands beside the target within the window", worst, tolerance, 0.0, "m")
    return found


def _counts(fault: AuditFault) -> bool:
    """Returns whether a fault is beyond the tolerance of its rule."""
    allowed = LIMIT_TOLERANCE * abs(fault.limit) if fault.rule in RELATIVE else TOLERANCES.get(fault.rule, 0.0)
    return not abs(fault.value - fault.limit) <= allowed

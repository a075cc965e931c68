"""Certificate: independent verification that a trajectory solves a problem, written without knowing any solver.

Every bound holds at every instant, also between samples: joint bounds by closed forms on the cubic pieces, all others
by bisection with proven bounds on the deviation in between. The executor certifies a plan again before it flies it.
"""

from planner.certificate.bounds import Rates, curvature_bound, point_bound, slope_bound
from planner.certificate.certificate import Certificate, Check
from planner.certificate.checks import Examination, certify
from planner.certificate.clearance import moving_heights, shape_gaps
from planner.certificate.curves import motion_curves
from planner.certificate.grip import felt_sizes
from planner.certificate.joints import START_TOLERANCE
from planner.certificate.release import (
    landing_attitude,
    landing_errors,
    landing_height,
    release_flight,
    window_landing_points,
)
from planner.certificate.safety_limits import momentum_sizes, power_sizes
from planner.certificate.samples import ArmSamples, MotionSamples, ticks_around_release
from planner.certificate.shown import Curve, Series
from planner.certificate.stopping import stopping_distances, stopping_times
from planner.certificate.tool import SINGULARITY_WINDOW_S
from planner.certificate.torque import torque_sizes

__all__ = [
    "SINGULARITY_WINDOW_S",
    "START_TOLERANCE",
    "ArmSamples",
    "Certificate",
    "Check",
    "Curve",
    "Examination",
    "MotionSamples",
    "Rates",
    "Series",
    "certify",
    "curvature_bound",
    "felt_sizes",
    "landing_attitude",
    "landing_errors",
    "landing_height",
    "momentum_sizes",
    "motion_curves",
    "moving_heights",
    "point_bound",
    "power_sizes",
    "release_flight",
    "shape_gaps",
    "slope_bound",
    "stopping_distances",
    "stopping_times",
    "ticks_around_release",
    "torque_sizes",
    "window_landing_points",
]

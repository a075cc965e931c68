"""Certificate: independent verification that a trajectory solves a problem, written without knowing any solver.

Every bound holds at every instant, also between samples: joint bounds by closed forms on the cubic pieces, all others
by bisection with proven bounds on the deviation in between. The executor certifies a plan again before it flies it.
"""

from planner.certificate.bounds import Rates, curvature_bound, point_bound, slope_bound
from planner.certificate.certificate import Certificate, Check, NotChecked
from planner.certificate.checks import Examination, certify
from planner.certificate.curves import Curve, Series, motion_curves
from planner.certificate.joints import START_TOLERANCE
from planner.certificate.release import landing_errors, release_flight, window_landing_points
from planner.certificate.tool import SINGULARITY_WINDOW_S

__all__ = [
    "SINGULARITY_WINDOW_S",
    "START_TOLERANCE",
    "Certificate",
    "Check",
    "Curve",
    "Examination",
    "NotChecked",
    "Rates",
    "Series",
    "certify",
    "curvature_bound",
    "landing_errors",
    "motion_curves",
    "point_bound",
    "release_flight",
    "slope_bound",
    "window_landing_points",
]

"""The foreign judge: certified plans checked by Pinocchio, coal, MuJoCo and SciPy, whatever is asked of them.

It takes the planner's data: cells, problems, motions, the arms' shapes. It shares no check with the certificate.
"""

from audit.judge.checks import find_faults, motion_faults
from audit.judge.distances import (
    Obstacle,
    coal_mesh,
    coal_solid,
    posture_room,
    self_pairs,
    singularity_distance,
)
from audit.judge.fault import AuditFault, over, under, worst_margins
from audit.judge.flights import clearance_faults, release_state
from audit.judge.landings import fall, flight_faults, landing_errors
from audit.judge.pinocchio_arm import arm_model, object_in_flange

__all__ = [
    "AuditFault",
    "Obstacle",
    "arm_model",
    "clearance_faults",
    "coal_mesh",
    "coal_solid",
    "fall",
    "find_faults",
    "flight_faults",
    "landing_errors",
    "motion_faults",
    "object_in_flange",
    "over",
    "posture_room",
    "release_state",
    "self_pairs",
    "singularity_distance",
    "under",
    "worst_margins",
]

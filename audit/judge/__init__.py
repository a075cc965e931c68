"""The foreign judge: certified plans checked by Pinocchio, coal, MuJoCo and SciPy, whatever is asked of them.

Of the planner it knows the data: cells, problems, motions and the arms' shapes. It shares no check with the certificate.
"""

from audit.judge.checks import find_faults, motion_faults
from audit.judge.distances import coal_mesh, coal_solid, self_pairs
from audit.judge.fault import AuditFault, over, under
from audit.judge.flights import clearance_faults, release_state
from audit.judge.landings import flight_faults, landing_errors

__all__ = [
    "AuditFault",
    "clearance_faults",
    "coal_mesh",
    "coal_solid",
    "find_faults",
    "flight_faults",
    "landing_errors",
    "motion_faults",
    "over",
    "release_state",
    "self_pairs",
    "under",
]

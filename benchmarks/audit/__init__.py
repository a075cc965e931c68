"""The independent audit: certified plans checked by Pinocchio, coal and MuJoCo instead of Fling's own kinematics."""

from benchmarks.audit.checks import find_faults, motion_faults
from benchmarks.audit.distances import coal_mesh, coal_solid, self_pairs
from benchmarks.audit.fault import AuditFault, over, under
from benchmarks.audit.flights import clearance_faults, release_state
from benchmarks.audit.landings import flight_faults, landing_errors
from benchmarks.audit.run import AuditResult, drawn_tasks, run_audit

__all__ = [
    "AuditResult",
    "AuditFault",
    "clearance_faults",
    "coal_mesh",
    "coal_solid",
    "drawn_tasks",
    "find_faults",
    "flight_faults",
    "landing_errors",
    "motion_faults",
    "over",
    "release_state",
    "run_audit",
    "self_pairs",
    "under",
]

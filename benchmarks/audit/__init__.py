"""The independent audit: certified plans checked by Pinocchio, coal and MuJoCo instead of Fling's own kinematics."""

from benchmarks.audit.checks import find_faults
from benchmarks.audit.flights import flight_faults
from benchmarks.audit.run import AuditResult, run_audit

__all__ = ["AuditResult", "find_faults", "flight_faults", "run_audit"]

"""The audit of many plans: random cells and requests, planned, and each certified plan judged by foreign code."""

from audit.problems import DrawnProblem, drawn_problem
from audit.record import RecordRefused
from audit.run import AuditOptions, run_audit
from audit.summary import AuditSummary
from audit.trial import AuditTask, Trial, tried

__all__ = [
    "AuditOptions",
    "AuditSummary",
    "AuditTask",
    "DrawnProblem",
    "RecordRefused",
    "Trial",
    "drawn_problem",
    "run_audit",
    "tried",
]

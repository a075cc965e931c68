"""The verifier: proves of a plan what its certificate claims, by arithmetic that rounds outwards.

It reads the cell file by the planner's cell reader and shares nothing else with it: neither code nor tolerances. It
says what it cannot prove, and where. See docs/decisions/0036-a-second-checker.md.
"""

from verifier.finding import Finding, Status
from verifier.request_checks import NotAPlan
from verifier.verify import Verification, findings, verify

__all__ = ["Finding", "NotAPlan", "Status", "Verification", "findings", "verify"]

"""The two ways a run ends early: a fault of the link, and a stop that the link can still carry out."""

from __future__ import annotations


class LinkFault(Exception):
    """The link, the controller or the library cannot be trusted any more: it is never called again in this process.

    Attributes:
        outcome: of the contract.
        reason: for a person.
    """

    def __init__(self, outcome: str, reason: str) -> None:
        super().__init__(f"{outcome}: {reason}")
        self.outcome, self.reason = outcome, reason

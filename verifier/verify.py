"""Verification of a plan: a certificate made anew from its document and its cell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from planner.cell import Cell
from verifier.arm import ArmPieces
from verifier.body_checks import body_findings
from verifier.clearance_checks import clearance_findings
from verifier.exit_checks import exit_findings
from verifier.finding import Finding, Status, not_covered
from verifier.flight_checks import flight_findings
from verifier.joint_checks import joint_findings
from verifier.landing_checks import landing_findings, met_demands
from verifier.load_checks import load_findings
from verifier.passage_checks import passage_findings
from verifier.pieces import all_pieces
from verifier.plan_document import Demands, SampledMotion, read_demands, read_motion
from verifier.profiles import learnt_cell
from verifier.release_checks import release_findings
from verifier.request_checks import NotAPlan


@dataclass(frozen=True)
class Verification:
    """What a verification found.

    Attributes:
        findings: one a check.
    """

    findings: tuple[Finding, ...]

    @property
    def status(self) -> Status:
        """Violated if a check is, not proven if one is not, otherwise proven."""
        every = [finding.status for finding in self.findings]
        if Status.VIOLATED in every:
            return Status.VIOLATED
        return Status.NOT_PROVEN if Status.NOT_PROVEN in every else Status.PROVEN

    @property
    def open(self) -> tuple[Finding, ...]:
        """The findings that are not proven."""
        return tuple(finding for finding in self.findings if finding.status is not Status.PROVEN)


def verify(document: Mapping[str, Any], cell: Cell, profile: Mapping[str, Any] | None = None) -> Verification:
    """Returns what can be proven of a plan, for all times and all rounding; see `findings`."""
    return Verification(tuple(findings(document, cell, profile)))


def findings(document: Mapping[str, Any], cell: Cell, profile: Mapping[str, Any] | None = None) -> Iterator[Finding]:
    """Yields what is found of each check, one after another, as it is made.

    Args:
        document: the plan, as `GET /plans/{id}` answers it.
        cell: its cell, as its file says.
        profile: that the plan was made with, as `GET /profiles/{id}` answers it.

    Raises:
        NotAPlan: the document is none, or that of another cell or profile.
    """
    if document.get("cell_sha256") != cell.sha256:
        raise NotAPlan("cell_sha256: the plan is of another cell file")
    cell = learnt_cell(document, cell, profile)
    motion = read_motion(document)
    demands = read_demands(document, cell, profile is not None)
    if demands.kind and motion.release is None:
        raise NotAPlan("release: the plan has none, though its request asks for one")
    if motion.release is not None and not demands.kind:
        raise NotAPlan("release: the plan has one, though its request asks for none")
    for name, what in demands.not_covered.items():
        yield not_covered(name, what)
    made = _made(cell, motion, met_demands(cell, motion, demands))
    yield from (finding for finding in made if finding.name not in demands.not_covered)


def _made(cell: Cell, motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Yields what is found of each check that can be made."""
    arm = ArmPieces(cell, all_pieces(motion))
    yield from joint_findings(cell, motion, demands, arm)
    yield from passage_findings(cell, motion, demands)
    yield from load_findings(cell, motion, demands, arm)
    yield from clearance_findings(cell, motion, demands, arm)
    for check in (release_findings, landing_findings, flight_findings, body_findings, exit_findings):
        yield from check(cell, motion, demands)

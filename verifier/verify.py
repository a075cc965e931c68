"""Verification of a plan: a certificate made anew from its document and its cell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from planner.cell import Cell
from verifier.apart_checks import apart_findings
from verifier.arm import ArmPieces
from verifier.body_checks import body_findings
from verifier.clearance_checks import clearance_findings
from verifier.exit_checks import exit_findings
from verifier.finding import Finding, Status, not_covered
from verifier.flight_checks import flight_findings
from verifier.held_objects import held_objects
from verifier.joint_checks import joint_findings
from verifier.landing_checks import landing_findings, met_demands
from verifier.load_checks import load_findings
from verifier.motion_parts import MotionPart, motion_parts
from verifier.passage_checks import passage_findings
from verifier.pieces import all_pieces
from verifier.plan_document import SampledMotion, read_demands, read_motion
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
    def reasons(self) -> list[str]:
        """What is not proven and why, in words: checks that are not covered for one reason in one line."""
        names: dict[str, dict[str, None]] = {}
        for finding in self.open:
            if finding.is_not_covered:
                names.setdefault(finding.detail, {})[finding.name] = None
        missing = [f"{Status.NOT_PROVEN}: {', '.join(of)}: {detail}" for detail, of in names.items()]
        return [*missing, *(str(each) for each in self.open if not each.is_not_covered)]

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
    if not isinstance(document, Mapping):
        raise NotAPlan(f"document: a {type(document).__name__}, no mapping")
    if document.get("cell_sha256") != cell.sha256:
        raise NotAPlan("cell_sha256: the plan is of another cell file")
    cell = learnt_cell(document, cell, profile)
    motion = read_motion(document)
    demands = read_demands(document, cell, profile is not None)
    if demands[0].kind and motion.release is None:
        raise NotAPlan("release: the plan has none, though its request asks for one")
    if motion.release is not None and not demands[0].kind:
        raise NotAPlan("release: the plan has one, though its request asks for none")
    left_out = {name: what for each in demands for name, what in each.not_covered.items()}
    for name, what in left_out.items():
        yield not_covered(name, what)
    parts = [_met(part) for part in motion_parts(cell, motion, demands)]
    yield from (finding for finding in _made(cell, motion, parts) if finding.name not in left_out)


def _met(part: MotionPart) -> MotionPart:
    """Returns a part whose target, if it moves, is where it is about the time at which the object lands."""
    return replace(part, demands=met_demands(part.cell, part.motion, part.demands))


def _made(cell: Cell, motion: SampledMotion, parts: Sequence[MotionPart]) -> Iterator[Finding]:
    """Yields what is found of each check that can be made."""
    arm = ArmPieces(cell, all_pieces(motion))
    held = held_objects(cell, parts)
    yield from joint_findings(cell, motion, parts[0].demands, arm)
    yield from passage_findings(cell, motion, parts)
    yield from load_findings(cell, motion, parts, held, arm)
    yield from clearance_findings(cell, parts, held, arm)
    for part in parts:
        for check in (release_findings, landing_findings, flight_findings, body_findings, exit_findings):
            found = check(part.cell, part.motion, part.demands)
            yield from found if len(parts) == 1 else (_of_part(finding, part) for finding in found)
    yield from apart_findings(parts)


def _of_part(finding: Finding, part: MotionPart) -> Finding:
    """Returns a finding about one of several objects, which names the passage at which that leaves."""
    detail = f"{part.demands.passage}: {finding.detail}" if finding.detail else part.demands.passage
    return replace(finding, detail=detail)

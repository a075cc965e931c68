"""Sections of the report: Markdown made from the rows."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.audit import AuditResult
from benchmarks.markdown import markdown_table, percent
from benchmarks.statistics import SetSummary

SHOWN_SETS = ("pose", "point", "target")  # in which every back end is shown


def by_backend(lines: Sequence[SetSummary]) -> list[str]:
    """Returns certified share and median release time over Ruckig's of every back end on a few sets."""
    found = {(s.backend, s.group): f"{percent(s.share)}, {s.to_ruckig[1]:.3f}" for s in lines}
    backends = dict.fromkeys(s.backend for s in lines if s.group in SHOWN_SETS)
    body = [[backend, *(found.get((backend, group), "–") for group in SHOWN_SETS)] for backend in backends]
    return markdown_table(["back end", *SHOWN_SETS], body)


def audit(found: AuditResult) -> list[str]:
    """Returns the result of the independent audit."""
    text = (
        f"{found.audited:,} certified plans of other random problems, in varied cells too, were audited by Pinocchio, "
        f"coal and MuJoCo; {found.refused:,} more were refused: **{len(found.faulty)} faulty**."
    )
    return [text, *(f"- `{name}`: {fault}" for name, fault in found.faulty)]

"""What a record says: counts by outcome and kind, what was wrong, and what a million costs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

MILLION = 1_000_000
REFUSED = ("infeasible", "proven infeasible", "failed", "invalid")


@dataclass(frozen=True)
class AuditSummary:
    """The result of an audit.

    Attributes:
        problems: tried.
        outcomes: number of problems by outcome.
        kinds: number of plans by kind of problem.
        arms: number of plans by arm.
        audited: plans that were judged.
        wrong: index and faults of every plan that is wrong although certified.
        errors: index and reason of every problem over which the planner broke down.
        proofs: number of plans by the verifier's status, of those that it was asked for.
        cut_short: problems whose search the clock ended: another machine may answer otherwise.
        processor_s: time that all of it took [s].
        plans_a_core_second: plans audited in a second of one core.
        size_bytes: of the record.
        million_core_hours: what a million problems would take at this rate, on one core [h].
        results_sha256: over the sorted results.
    """

    problems: int
    outcomes: Mapping[str, int]
    kinds: Mapping[str, int]
    arms: Mapping[str, int]
    audited: int
    wrong: Mapping[int, str]
    errors: Mapping[int, str]
    proofs: Mapping[str, int]
    cut_short: int
    processor_s: float
    plans_a_core_second: float
    size_bytes: int
    million_core_hours: float
    results_sha256: str

    @property
    def is_right(self) -> bool:
        """Whether no plan was wrong, and the planner never broke down."""
        return not self.wrong and not self.errors

    def as_document(self) -> dict[str, Any]:
        """Returns it as JSON."""
        return asdict(self)

    def __str__(self) -> str:
        """Returns it in lines."""
        refused = ", ".join(f"{self.outcomes[name]} {name}" for name in REFUSED if name in self.outcomes) or "none"
        proofs = ", ".join(f"{count} {name}" for name, count in sorted(self.proofs.items())) or "none asked for"
        each_bytes = self.size_bytes / max(self.problems, 1)
        lines = [
            f"{self.problems} problems: {self.audited} planned and audited, {len(self.wrong)} wrong",
            f"refused: {refused}; not drawn: {self.outcomes.get('not drawn', 0)}; the clock ended {self.cut_short}",
            f"proofs: {proofs}",
            "by kind: " + ", ".join(f"{count} {name}" for name, count in sorted(self.kinds.items())),
            f"{self.plans_a_core_second:.2f} plans a second of one core; {each_bytes:.0f} bytes a problem",
            f"a million problems: {self.million_core_hours:.0f} core hours, {each_bytes * MILLION / 1e9:.2f} GB",
            f"sha256 over the sorted results: {self.results_sha256}",
        ]
        lines += [f"wrong: {index}: {text}" for index, text in self.wrong.items()]
        return "\n".join([*lines, *(f"error: {index}: {text}" for index, text in self.errors.items())])


def summary_of(rows: Mapping[int, Mapping[str, Any]], results_sha256: str, size_bytes: int) -> AuditSummary:
    """Returns what rows by index say."""
    every = [rows[index] for index in sorted(rows)]
    planned = [row for row in every if row["outcome"] == "planned"]
    seconds = sum(sum(row.get("seconds", {}).values()) for row in every)
    return AuditSummary(
        problems=len(every),
        outcomes=dict(Counter(row["outcome"] for row in every)),
        kinds=dict(Counter(row["kind"] for row in planned)),
        arms=dict(Counter(row["arm"] for row in planned)),
        audited=len(planned),
        wrong={row["index"]: _wrongs(row) for row in planned if row.get("faults") or row.get("proof") == "violated"},
        errors={row["index"]: row.get("why", "") for row in every if row["outcome"] == "error"},
        proofs=dict(Counter(row["proof"] for row in planned if row.get("proof"))),
        cut_short=sum(bool(row.get("is_cut_short")) for row in every),
        processor_s=seconds,
        plans_a_core_second=len(planned) / seconds if seconds else 0.0,
        size_bytes=size_bytes,
        million_core_hours=MILLION * seconds / max(len(every), 1) / 3600.0,
        results_sha256=results_sha256,
    )


def _wrongs(row: Mapping[str, Any]) -> str:
    proven = [f"verifier: {text}" for text in row.get("open", ())] if row.get("proof") == "violated" else []
    return "; ".join([*row.get("faults", ()), *proven])

"""One problem tried: drawn, planned, and judged; now and then proven, too."""

from __future__ import annotations

import hashlib
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from audit.judge import AuditFault, find_faults, worst_margins
from audit.problems import DrawnProblem, drawn_problem
from planner.errors import Infeasible, InvalidProblem, PlannerError, SolverFailed
from planner.passages import passed_documents
from planner.planning import SearchHints, plan
from planner.problem import TIME_LIMIT_MAX_S, ThrowProblem
from planner.request import problem_from_request
from planner.trajectory import Trajectory
from verifier import Status, findings

STEP_S = 0.004  # [s] of the judge's distances: at 2 m/s a link moves by 8 mm
QUICK = SearchHints(offers_nearest=False)  # the nearest request is most of a refusal's time, and nobody asks for it
MARGIN_DIGITS = 6


@dataclass(frozen=True)
class AuditTask:
    """One problem to try, as a worker of the pool takes it.

    Attributes:
        seed, index: of the problem.
        proofs: share of the plans that are proven, too [-].
    """

    seed: int
    index: int
    proofs: float = 0.0
    tells_progress: bool = False

    @property
    def time_limit_s(self) -> float:
        """Time limit of the search [s]; the pool's grace is for the judge."""
        return TIME_LIMIT_MAX_S

    @property
    def is_proven(self) -> bool:
        """Whether a plan of this problem is proven, too: by lot, the same for the same seed and index."""
        return float(np.random.default_rng([self.seed, self.index, 2]).random()) < self.proofs


@dataclass(frozen=True)
class Trial:
    """What became of one problem: a line of the record.

    Attributes:
        index: of the problem.
        kind: of the problem.
        arm: its name.
        outcome: planned; infeasible, or proven infeasible; failed, invalid, not drawn, or error.
        plan_sha256: of the samples; empty without a plan.
        faults: that the judge finds.
        proof: proven, not proven or violated; empty where nobody tried.
        open: checks that are not proven.
        why: of a refusal.
        is_cut_short: whether the clock ended the search: another machine may answer otherwise.
        seconds: of processor time by step: draw, plan, judge, prove [s].
        worst: value and limit of each rule where least is left, as the judge measures them.
    """

    index: int
    kind: str
    arm: str
    outcome: str
    plan_sha256: str = ""
    faults: tuple[str, ...] = ()
    proof: str = ""
    open: tuple[str, ...] = ()
    why: str = ""
    is_cut_short: bool = False
    seconds: Mapping[str, float] = field(default_factory=dict)
    worst: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def is_wrong(self) -> bool:
        """Whether a certified plan breaks a limit."""
        return bool(self.faults) or self.proof == Status.VIOLATED.value

    def as_row(self) -> dict[str, Any]:
        """Returns it as JSON: what is empty is left out, but never the index."""
        return {name: value for name, value in asdict(self).items() if value or name == "index"}


class Stopwatch:
    """Processor time of one step after another."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last_s = time.process_time()

    def lap(self, step: str) -> None:
        """Ends a step."""
        now_s = time.process_time()
        self.seconds[step] = round(now_s - self._last_s, 4)
        self._last_s = now_s


def tried(task: AuditTask, observer: object = None) -> Trial:
    """Returns what becomes of a problem."""
    watch = Stopwatch()
    drawn = drawn_problem(task.seed, task.index)
    watch.lap("draw")
    about: dict[str, Any] = {"index": task.index, "kind": drawn.kind, "arm": drawn.cell.robot.name}
    about["seconds"] = watch.seconds
    if drawn.request is None:
        return Trial(**about, outcome="not drawn")
    try:
        made = plan(problem_from_request(drawn.request, drawn.cell), QUICK)
    except PlannerError as error:
        watch.lap("plan")
        return Trial(**about, outcome=_refused(error), why=str(error)[:300], is_cut_short=_is_cut_short(error))
    watch.lap("plan")
    with worst_margins() as worst:
        faults = find_faults(made.problem, made.trajectory, STEP_S, drawn.beyond)
    watch.lap("judge")
    unproven = _unproven(drawn, made.problem, made.trajectory) if task.is_proven else None
    watch.lap("prove")
    return Trial(
        **about,
        outcome="planned",
        plan_sha256=samples_sha256(made.trajectory),
        faults=_told(faults),
        proof=_proof(unproven),
        open=tuple(f"{each.name}: {each.detail}" for each in unproven or ()),
        is_cut_short=made.was_cut_short,
        worst={rule: _rounded(pair) for rule, pair in worst.items()},
    )


def samples_sha256(motion: Trajectory) -> str:
    """Returns the hash of a motion: rate, samples, release and passages."""
    where = np.array([motion.sample_rate_hz, motion.release_index, *motion.passed], np.float64)
    arrays = (where, motion.q, motion.qd, motion.qdd)
    return hashlib.sha256(b"".join(np.ascontiguousarray(each, "<f8").tobytes() for each in arrays)).hexdigest()


def plan_document(drawn: DrawnProblem, problem: ThrowProblem, motion: Trajectory) -> dict[str, Any]:
    """Returns what the document of a plan says of its motion."""
    request = drawn.request or {}
    throws = "release" in request or any(each.get("releases") for each in request.get("passages", ()))
    return {
        "cell": drawn.cell.name,
        "cell_sha256": drawn.cell.sha256,
        "request": request,
        "sample_rate_hz": motion.sample_rate_hz,
        "release": {"index": motion.release_index} if throws else None,
        "passages": passed_documents(drawn.cell, problem.passages, motion) if problem.passages else [],
        **({} if problem.starts_at_s is None else {"starts_at_s": problem.starts_at_s}),
        "trajectory": {
            "positions": motion.q.tolist(),
            "velocities": motion.qd.tolist(),
            "accelerations": motion.qdd.tolist(),
        },
    }


def _told(faults: Sequence[AuditFault]) -> tuple[str, ...]:
    """Returns the first fault of each rule: on a line every millisecond has its own."""
    first: dict[str, AuditFault] = {}
    for fault in faults:
        first.setdefault(fault.rule, fault)
    count = Counter(fault.rule for fault in faults)
    return tuple(
        f"{rule}: {fault}" + (f", and {count[rule] - 1} more" * (count[rule] > 1)) for rule, fault in first.items()
    )


def _unproven(drawn: DrawnProblem, problem: ThrowProblem, motion: Trajectory) -> list[Any]:
    """Returns the verifier's findings that are not proven."""
    return [f for f in findings(plan_document(drawn, problem, motion), drawn.cell) if f.status is not Status.PROVEN]


def _proof(unproven: list[Any] | None) -> str:
    if unproven is None:
        return ""
    if any(each.status is Status.VIOLATED for each in unproven):
        return Status.VIOLATED.value
    return Status.NOT_PROVEN.value if unproven else Status.PROVEN.value


def _refused(error: PlannerError) -> str:
    if isinstance(error, InvalidProblem):
        return "invalid"
    if isinstance(error, Infeasible):
        return "proven infeasible" if any(each.proven for each in error.violations) else "infeasible"
    return "failed"


def _is_cut_short(error: PlannerError) -> bool:
    return isinstance(error, SolverFailed)


def _rounded(pair: tuple[float, float]) -> tuple[float, float]:
    value, limit = (float(f"{each:.{MARGIN_DIGITS}g}") for each in pair)
    return value, limit

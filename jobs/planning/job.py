"""One planning job: a request and its cell in, a plan's document out, made once and carried as it is to the store."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import orjson

from planner.answer import iso_time
from planner.cell import Cell, CellSource, cell_of
from planner.errors import CUT_SHORT
from planner.problem import TIME_LIMIT_S
from planner.progress import Observer
from planner.trajectory import Trajectory
from store import PlanRow, pack_trajectory, plan_sha256


@dataclass(frozen=True)
class PlanningJob:
    """One planning request.

    Attributes:
        plan_id: Id of the plan to be; None: it will not be stored, and its document has none.
        created_at: Time of the request [s since the epoch].
        cell: Content of the cell's files.
        request: The request as JSON, in the shape of `POST /plan`.
        profile: Id and document of the profile that the cell uses; None: the cell file's numbers.
        request_id: Id of the HTTP request.
        cell_version: Version of the cell's files; None: not known to a store.
        releases: Joint positions and velocities at the release of plans for other targets: a short search starts from
            these alone. Empty: an ordinary search.
        offers_nearest: Whether a refusal carries a feasible request near it.
        tells_progress: Whether its worker reports the progress of the search; one of a Ray cluster never does.
        nearby: A throw from the request's start at another target, such as what is left of the one that the plan is to
            replace: see `SearchHints`.
    """

    plan_id: str | None
    created_at: float
    cell: CellSource
    request: Mapping[str, Any]
    profile: tuple[str, bytes] | None = None
    request_id: str | None = None
    cell_version: int | None = None
    releases: tuple[tuple[Sequence[float], Sequence[float]], ...] = ()
    offers_nearest: bool = True
    tells_progress: bool = False
    nearby: Trajectory | None = None

    @property
    def time_limit_s(self) -> float:
        """Time limit of the search [s]."""
        return float(self.request.get("time_limit_s") or TIME_LIMIT_S)


@dataclass(frozen=True)
class PlanRecord:
    """A certified plan on its way from a planner process to the store.

    Attributes:
        row: What the store keeps: the document as bytes, and its columns. A plan that is not stored has an empty id.
        release_time_s: Release time [s]; None for passages that let nothing go.
        duration_s: Duration of the motion [s].
        release_speed_m_s: Speed of the object at the release [m/s]; None for a move that ends at rest.
        shift_early_m, shift_late_m: How far the landing point moves for a release 10 ms early, or late [m].
        hit_probability: Of a target [-].
        margin, margin_check: Least margin of the certificate as a share of its limit [-], and which check has it.
        was_cut_short: Whether the time limit ended the search: a longer one might have found a better plan.
    """

    row: PlanRow
    release_time_s: float | None
    duration_s: float
    release_speed_m_s: float | None = None
    shift_early_m: float | None = None
    shift_late_m: float | None = None
    hit_probability: float | None = None
    margin: float | None = None
    margin_check: str | None = None
    was_cut_short: bool = False

    @property
    def samples_sha256(self) -> str:
        """Hash of the trajectory as it is stored."""
        return hashlib.sha256(self.row.samples or b"").hexdigest()


def solve(job: PlanningJob, observer: Observer | None = None) -> PlanRecord:
    """Plans one request.

    Args:
        job: the request.
        observer: told of the progress; what it raises ends the search.

    Raises:
        PlannerError: The planner refused the request, found no plan, or gave up.
    """
    # Imported here: who gives jobs to other processes loads no solver.
    from jobs.planning.aiming import learnt_fields, plan_aimed
    from jobs.planning.duration import check_duration, check_limits
    from jobs.planning.odds import plan_for_odds
    from learning import cell_with_profile, knowledge_of, prior_knowledge
    from planner.answer import plan_document
    from planner.planning import SearchHints
    from planner.progress import ProgressMeter
    from planner.request import problem_from_request

    cell = _cell(job.cell)
    learnt = None if job.profile is None else orjson.loads(job.profile[1])
    problem = problem_from_request(job.request, cell_with_profile(cell, learnt))
    check_limits(problem)
    known = prior_knowledge(cell) if learnt is None else knowledge_of(learnt)
    is_learnt = learnt is not None
    least = float(job.request.get("min_hit_probability") or 0.0)
    meter = ProgressMeter(observer)
    if least > 0.0:
        found = plan_for_odds(problem, least, known, is_learnt, meter)
    else:
        hints = SearchHints(job.releases, job.offers_nearest, meter, job.nearby)
        found = plan_aimed(problem, known if is_learnt else None, hints)
    check_duration(problem, found.trajectory)
    document = plan_document(found, job.request, job.plan_id or "", iso_time(job.created_at))
    document |= learnt_fields(problem, found, known, None if job.profile is None else job.profile[0])
    return record_of(job, document)


def record_of(job: PlanningJob, document: dict[str, Any]) -> PlanRecord:
    """Returns the record of a plan, given its document with trajectory."""
    document |= {"request_id": job.request_id, "cell_version": job.cell_version}
    if job.plan_id is None:
        del document["id"]
    samples = pack_trajectory(document.pop("trajectory"))
    summary = orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)
    flight = document["flight"] or {}
    shift = flight.get("landing_shift_10ms_m") or {}
    margin, check = _least_margin(document["certificate"]["checks"])
    return PlanRecord(
        row=PlanRow(
            id=job.plan_id or "",
            created_at=job.created_at,
            cell=job.cell.name,
            cell_sha256=job.cell.sha256,
            backend=document["backend"],
            summary=summary,
            request_id=job.request_id,
            samples=samples,
            sha256=plan_sha256(job.plan_id or "", summary, samples),
        ),
        release_time_s=document["release_time_s"],
        duration_s=document["duration_s"],
        release_speed_m_s=flight.get("speed_m_s"),
        shift_early_m=shift.get("early"),
        shift_late_m=shift.get("late"),
        hit_probability=(document["hit_probability"] or {}).get("value"),
        margin=margin,
        margin_check=check,
        was_cut_short=document["solver"]["status"].endswith(CUT_SHORT),
    )


def _least_margin(checks: Sequence[Mapping[str, Any]]) -> tuple[float, str]:
    """Returns the least margin of a certificate as a share of its limit [-], and its check.

    Of a limit of 0, such as that of a clearance, the margin itself [in the check's unit].
    """
    return min((check["margin"] / (abs(check["limit"]) or 1.0), check["name"]) for check in checks)


@lru_cache(maxsize=32)
def _cell(source: CellSource) -> Cell:
    return cell_of(source)

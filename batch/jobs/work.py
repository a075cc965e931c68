"""The work of one planner process: a planning job in, the JSON of a plan or an error of the planner out."""

from __future__ import annotations

import gc
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import orjson

from batch.jobs.lifetime import end_with_parent
from planner.cell import Cell, CellSource, cell_of
from planner.errors import PlannerError
from store import join_plan, pack_trajectory

NICENESS = 5  # planning can wait for the stream to the arm, but not until its time limit (docs/decisions/0021)


@dataclass(frozen=True)
class PlanningJob:
    """One planning request.

    Attributes:
        plan_id: Id of the plan to be; None: it will not be stored, and its document has none.
        created_at: Time of the request (UTC, ISO 8601).
        cell: Content of the cell's files.
        request: The request as JSON, in the shape of `POST /plan`.
        profile: Id and document of the profile that the cell uses; None: the cell file's numbers.
        request_id: Id of the HTTP request.
        cell_version: Version of the cell's files; None: not known to a store.
        releases: Joint positions and velocities at the release of plans for other targets: a short search starts from
            these alone. Empty: an ordinary search.
        offers_nearest: Whether a refusal carries the nearest feasible request.
    """

    plan_id: str | None
    created_at: str
    cell: CellSource
    request: Mapping[str, Any]
    profile: tuple[str, bytes] | None = None
    request_id: str | None = None
    cell_version: int | None = None
    releases: tuple[tuple[Sequence[float], Sequence[float]], ...] = ()
    offers_nearest: bool = True


@dataclass(frozen=True)
class Planned:
    """A certified plan: its JSON without the trajectory (`summary`), and the trajectory's samples."""

    backend: str
    summary: bytes
    samples: bytes

    @property
    def document(self) -> bytes:
        """The JSON of the whole plan."""
        return join_plan(self.summary, self.samples)


def initialise(warm_up: PlanningJob | None) -> None:
    """Prepares a child process for planning: it ends with its parent, and does all that `load` does."""
    end_with_parent()
    load(warm_up)


def load(warm_up: PlanningJob | None) -> None:
    """Prepares this process for planning, whoever started it: low priority, solvers built, everything loaded."""
    from planner.backends.casadi_nlp import build_solvers

    os.nice(NICENESS)
    build_solvers()
    if warm_up is not None:
        with suppress(PlannerError):  # a refused warm-up has loaded everything up to there
            solve(warm_up)
    gc.collect()
    gc.freeze()  # collections during a plan skip everything loaded so far: saves milliseconds


def warm_up_job(source: CellSource) -> PlanningJob:
    """Returns a job that loads and builds everything, as any throw does; its plan is not stored."""
    return PlanningJob(None, "", source, {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}})


def solve(job: PlanningJob) -> Planned:
    """Plans one request.

    Raises:
        PlannerError: The planner refused the request, found no plan, or gave up.
    """
    from batch.jobs.aiming import learnt_fields, plan_aimed
    from batch.jobs.duration import check_duration, check_limits
    from batch.jobs.odds import plan_for_odds
    from learning import cell_with_profile, knowledge_of, prior_knowledge
    from planner.plan_document import plan_document
    from planner.planning import SearchHints
    from planner.request import problem_from_request

    cell = _cell(job.cell)
    learnt = None if job.profile is None else orjson.loads(job.profile[1])
    problem = problem_from_request(job.request, cell_with_profile(cell, learnt))
    check_limits(problem)
    known = prior_knowledge(cell) if learnt is None else knowledge_of(learnt)
    is_learnt = learnt is not None
    least = float(job.request.get("min_hit_probability") or 0.0)
    if least > 0.0:
        found = plan_for_odds(problem, least, known, is_learnt)
    else:
        hints = SearchHints(job.releases, job.offers_nearest)
        found = plan_aimed(problem, known if is_learnt else None, hints)
    check_duration(problem, found.trajectory)
    answer = plan_document(found, job.request, job.plan_id or "", job.created_at)
    if job.plan_id is None:
        del answer["id"]
    answer |= learnt_fields(problem, found, known, None if job.profile is None else job.profile[0])
    answer |= {"request_id": job.request_id, "cell_version": job.cell_version}
    samples = pack_trajectory(answer.pop("trajectory"))
    return Planned(answer["backend"], orjson.dumps(answer, option=orjson.OPT_SERIALIZE_NUMPY), samples)


@lru_cache(maxsize=32)
def _cell(source: CellSource) -> Cell:
    return cell_of(source)

"""Making a map: plans its landing cells with a pool, and stores each answer as it comes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import orjson

from jobs.maps.definition import MapDefinition, definition_from
from jobs.maps.landing_cells import plan_id_of, planned_row, refused_row
from jobs.maps.rounds import Step, planned_neighbours, steps
from jobs.planning import Planned, PlanningJob
from jobs.pool import JobResult
from planner.cell import CellSource
from store import LandingCellRow, MapRow, PlanRow, Store

STORE_EVERY_S = 0.5  # [s] between two transactions: what a kill loses at most

ProgressReport = Callable[[Step, int, int], None]  # the step, its answers so far, their number to be


PlanAll = Callable[[Iterable[PlanningJob]], Iterator[JobResult]]


@dataclass(frozen=True)
class MapInputs:
    """What the plans of a map are made for.

    Attributes:
        source: content of the cell's files.
        profile: id and document of the profile that the cell uses; None: the cell file's numbers.
    """

    source: CellSource
    profile: tuple[str, bytes] | None = None


def make_map(
    store: Store,
    row: MapRow,
    inputs: MapInputs,
    plan_all: PlanAll,
    report: ProgressReport = lambda step, done, total: None,
) -> str:
    """Plans the landing cells of a map that have no answer yet. Returns its state in the end.

    `cancelled`: somebody asked for it, or the search of some landing cells did not come to its end, because of its time
    limit or of a planner process that died. To call it again goes on with what is missing.

    Args:
        store: has the map, and takes its answers.
        row: the map, begun.
        inputs: as its definition names them.
        plan_all: plans jobs in any order, such as `PlanningPool.plan_all`.
        report: called after each answer; after the last one of a step when all are stored.
    """
    work = _MapWork(store, row, inputs)
    for step in steps(work.definition, work.known):
        if step.round and work.unanswered:
            break  # what neighbours know would depend on what was interrupted
        work.do(step, plan_all, report)
        if work.is_cancelled:
            break
    state = "cancelled" if work.is_cancelled or work.unanswered else "finished"
    store.end_map(row.id, state)
    return state


class _MapWork:
    """One process's work on a map: what is known, and what is not stored yet."""

    def __init__(self, store: Store, row: MapRow, inputs: MapInputs) -> None:
        self.store = store
        self.row = row
        self.inputs = inputs
        self.definition: MapDefinition = definition_from(row.definition)
        self.known = {each.number: each for each in store.landing_cells(row.id)}
        self.unanswered: set[int] = set()
        self.is_cancelled = False
        self._rows: list[LandingCellRow] = []
        self._plans: list[PlanRow] = []
        self._stored_at = time.monotonic()

    def do(self, step: Step, plan_all: PlanAll, report: ProgressReport) -> None:
        """Plans the landing cells of a step; ends early where somebody cancels."""
        numbers = step.numbers
        answers = []
        with closing(plan_all(self._job(number, step.round) for number in numbers)) as results:  # type: ignore[type-var]
            for result in results:
                answers.append(self._answer(numbers[result.number], step.round, result))
                if time.monotonic() - self._stored_at > STORE_EVERY_S:
                    self._store()
                if len(answers) < len(numbers):
                    report(step, len(answers), len(numbers))
                if self.is_cancelled:
                    break
        self._store()
        self.known |= {row.number: row for row in answers if row is not None}  # only now: see `jobs.maps.rounds`
        report(step, len(answers), len(numbers))

    def _job(self, number: int, round: int) -> PlanningJob:
        """Returns the job that plans a landing cell."""
        return PlanningJob(
            plan_id=plan_id_of(self.row.id, number, round),
            created_at=datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            cell=self.inputs.source,
            request=self.definition.request(number),
            profile=self.inputs.profile,
            cell_version=self.row.cell_version,
            releases=tuple(self._releases(number, round)) if round else (),
            offers_nearest=False,
        )

    def _releases(self, number: int, round: int) -> Iterator[tuple[list[float], list[float]]]:
        for neighbour in planned_neighbours(self.definition, self.known, number, round):
            plan = self.store.plan_summary(neighbour.plan_id or "")
            if plan is not None:
                release = orjson.loads(plan.summary)["release"]
                yield release["positions"], release["velocities"]

    def _answer(self, number: int, round: int, result: JobResult) -> LandingCellRow | None:
        """Notes the answer of a landing cell; None where there is none."""
        if result.planned is not None:
            row = self._planned(number, round, result.planned)
        else:
            assert result.refusal is not None
            row = refused_row(self.row.id, number, round, result.refusal)
        if row is None:
            self.unanswered.add(number)
            return None
        if round and row.plan_id is None:
            row = replace(self.known[number], round=round)  # its own search says better why
        self._rows.append(row)
        return row

    def _planned(self, number: int, round: int, planned: Planned) -> LandingCellRow | None:
        id = plan_id_of(self.row.id, number, round)
        source = self.inputs.source
        row = planned_row(self.row.id, number, round, id, planned)
        if row is not None:
            made = planned.backend, planned.summary, None, planned.samples
            self._plans.append(PlanRow(id, time.time(), source.name, source.sha256, *made))
        return row

    def _store(self) -> None:
        """Stores what is new, and says that the map is worked on."""
        self.is_cancelled = self.store.add_landing_cells(self.row.id, self._rows, self._plans)
        self._rows, self._plans, self._stored_at = [], [], time.monotonic()

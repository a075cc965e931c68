"""A map that is driven: a batch with a grid of landing cells, step by step."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import orjson

from jobs.maps.definition import definition_from
from jobs.maps.landing_cells import plan_id_of, planned_row, refused_row
from jobs.maps.rounds import Step, planned_neighbours, steps
from jobs.planning import PlanningJob
from jobs.pool import JobResult
from jobs.writer import Put
from planner.cell import CellSource
from store import LandingCellRow, MapRow, PlanRow, Store

ProgressReport = Callable[[Step, int, int], None]  # the step, its answers so far, their number to be


@dataclass(frozen=True)
class MapInputs:
    """What the plans of a map are made for.

    Attributes:
        source: content of the cell's files.
        profile: id and document of the profile that the cell uses; None: the cell file's numbers.
    """

    source: CellSource
    profile: tuple[str, bytes] | None = None


class DrivenMap:
    """A map to be driven; see `jobs.driver.Drivable`.

    It ends `cancelled` on request, or if some landing cells have no answer because a time limit or a dead planner
    process ended their search: the next driver resumes with those.

    Args:
        store: has the map, and takes its answers.
        row: the map, begun.
        inputs: as its definition names them.
        report: called after each answer; after the last one of a step when all are stored.
    """

    def __init__(
        self, store: Store, row: MapRow, inputs: MapInputs, report: ProgressReport = lambda step, done, total: None
    ) -> None:
        self._store = store
        self._row = row
        self._inputs = inputs
        self._report = report
        self._definition = definition_from(row.definition)
        self._known = {each.number: each for each in store.landing_cells(row.id)}
        self._unanswered: set[int] = set()
        self._step = Step(0, 0.0, ())
        self._answers: list[LandingCellRow | None] = []
        self.left = self._definition.count  # a round may try again what has an answer
        self.source = inputs.source
        self.is_cancelled = row.cancel_requested_at is not None

    def steps(self, put: Put) -> Iterator[Iterator[PlanningJob]]:
        """Yields the jobs of each step; see `jobs.maps.rounds`."""
        for step in steps(self._definition, self._known):
            if step.round and self._unanswered:
                return  # what neighbours know would depend on what was interrupted
            self._step = step
            self._answers = []
            yield (self._job(number, step.round) for number in step.numbers)
            self._known |= {row.number: row for row in self._answers if row is not None}  # only now: see `rounds`
            self._report(step, len(self._answers), len(step.numbers))

    def answer(self, result: JobResult, put: Put) -> None:
        """Puts the answer of a landing cell in line; there is none where its search did not come to its end."""
        number = self._step.numbers[result.number]
        row = self._answer(number, self._step.round, result)
        self._answers.append(row)
        if row is None:
            self._unanswered.add(number)
        else:
            put(row, result.planned and result.planned.row)
        if len(self._answers) < len(self._step.numbers):
            self._report(self._step, len(self._answers), len(self._step.numbers))

    def save(self, rows: Sequence[LandingCellRow], plans: Sequence[PlanRow]) -> bool:
        """Stores answers, and says that the map is worked on; returns whether it was cancelled."""
        return self._store.add_landing_cells(self._row.id, rows, plans)

    def end(self, is_cancelled: bool, is_complete: bool) -> None:
        """Records that the map is finished or cancelled; a stopped one stays `running`, to be resumed."""
        if is_complete and not self._unanswered:
            self._store.end_map(self._row.id, "finished")
        elif is_complete or is_cancelled:
            self._store.end_map(self._row.id, "cancelled")

    def _job(self, number: int, round: int) -> PlanningJob:
        """Returns the job that plans a landing cell."""
        return PlanningJob(
            plan_id=plan_id_of(self._row.id, number, round),
            created_at=time.time(),
            cell=self._inputs.source,
            request=self._definition.request(number),
            profile=self._inputs.profile,
            cell_version=self._row.cell_version,
            releases=tuple(self._releases(number, round)) if round else (),
            offers_nearest=False,
        )

    def _releases(self, number: int, round: int) -> Iterator[tuple[list[float], list[float]]]:
        for neighbour in planned_neighbours(self._definition, self._known, number, round):
            plan = self._store.plan_summary(neighbour.plan_id or "")
            if plan is not None:
                release = orjson.loads(plan.summary)["release"]
                yield release["positions"], release["velocities"]

    def _answer(self, number: int, round: int, result: JobResult) -> LandingCellRow | None:
        """Returns the answer of a landing cell; None where there is none."""
        if result.planned is not None:
            return planned_row(self._row.id, number, round, result.planned)
        row = refused_row(self._row.id, number, round, result.refusal or {})
        if row is not None and round:
            return replace(self._known[number], round=round)  # its own search says better why
        return row

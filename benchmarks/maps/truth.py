"""Is a map true? Its plans are certified again, its landing cells planned again, one by one."""

from __future__ import annotations

import hashlib
import random
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import orjson

from benchmarks.maps.runs import MapMeasurement
from jobs.maps import LandingState
from jobs.planning import PlanningJob
from jobs.pool import open_pool
from planner.answer import plan_from_document
from planner.cell import CellSource, cell_of
from planner.certificate import certify
from store import Store

ASIDE_M = 0.01  # [m] that a target is moved, to see whether a landing cell without a plan has one next to its centre


@dataclass(frozen=True)
class Certified:
    """Plans of a map that were certified again from the store.

    Attributes:
        valid, invalid: number of plans.
        misplaced: plans for another target than their landing cell, or for another release time than the map says.
    """

    valid: int
    invalid: int
    misplaced: int


@dataclass(frozen=True)
class PlannedAgain:
    """Landing cells that were planned again, each by an ordinary request of its own.

    Attributes:
        asked: number of landing cells.
        same: planned both times, with the same trajectory to the bit.
        other: planned both times, otherwise: the map has its plan from a neighbour's release.
        only_map: planned by the map alone.
        only_alone: planned by itself alone: the map's false no.
        neither: refused both times.
        aside: of those that the map refuses without proof, how many have a plan to a target `ASIDE_M` beside.
        refused: those in all, without proof.
    """

    asked: int
    same: int
    other: int
    only_map: int
    only_alone: int
    neither: int
    aside: int
    refused: int


def certify_again(made: MapMeasurement, source: CellSource) -> Certified:
    """Returns how many of a map's plans are certified again, as they are stored."""
    store = Store.open(made.url)
    table = made.table
    counts = Counter[str]()
    cell = cell_of(source)
    ids = table.plan_ids.ravel().tolist()
    times = table.measures["release_time_s"].ravel()
    for number, id in enumerate(ids):
        row = store.plan(id) if id else None
        if not id:
            continue
        document = {} if row is None else orjson.loads(row.document)
        counts["valid" if document and certify(*plan_from_document(document, cell)).valid else "invalid"] += 1
        target = document.get("request", {}).get("release", {}).get("position")
        counts["misplaced"] += target != table.definition.target(number) or document["release_time_s"] != times[number]
    store.close()
    return Certified(counts["valid"], counts["invalid"], counts["misplaced"])


def plan_again(made: MapMeasurement, source: CellSource, sample: int, workers: int, seed: int = 1) -> PlannedAgain:
    """Returns what becomes of landing cells that are planned by themselves.

    Args:
        made: the map.
        source: content of the cell's files.
        sample: number of landing cells, drawn by `seed`; all, where there are fewer.
        workers: number of planner processes.
        seed: of the draw.
    """
    definition = made.table.definition
    state = made.table.state.ravel()
    numbers = random.Random(seed).sample(range(definition.count), min(sample, definition.count))
    refused = [n for n in range(definition.count) if state[n] == LandingState.NOT_FOUND]
    counts = Counter[str]()
    store = Store.open(made.url)
    with open_pool(workers) as pool:
        for result in pool.plan_all(PlanningJob(None, 0.0, source, definition.request(n)) for n in numbers):
            number = numbers[result.number]
            samples = None if result.planned is None else result.planned.row.samples
            counts[_compared(store, str(made.table.plan_ids.ravel()[number]), samples)] += 1
        jobs = [PlanningJob(None, 0.0, source, request) for n in refused for request in _aside(definition.request(n))]
        found = {refused[result.number // 4] for result in pool.plan_all(jobs) if result.planned is not None}
    store.close()
    kinds = [counts[kind] for kind in ("same", "other", "only_map", "only_alone", "neither")]
    return PlannedAgain(len(numbers), *kinds, aside=len(found), refused=len(refused))


def trajectories_sha256(made: MapMeasurement) -> str:
    """Returns the hash of all trajectories of a map, in the order of its landing cells, as they are stored."""
    store = Store.open(made.url)
    digest = hashlib.sha256()
    for id in made.table.plan_ids.ravel().tolist():
        row = store.plan(id) if id else None
        digest.update(b"" if row is None else row.samples or b"")
    store.close()
    return digest.hexdigest()


def _compared(store: Store, plan_id: str, samples: bytes | None) -> str:
    if not plan_id:
        return "neither" if samples is None else "only_alone"
    if samples is None:
        return "only_map"
    row = store.plan(plan_id)
    return "same" if row is not None and row.samples == samples else "other"


def _aside(request: dict) -> Iterator[dict]:
    """Yields four requests for targets beside that of a request."""
    x, y, z = request["release"]["position"]
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        place = [x + dx * ASIDE_M, y + dy * ASIDE_M, z]
        yield {**request, "release": {**request["release"], "position": place}}

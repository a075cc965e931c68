"""Which landing cells are planned next: level by level, then those without a plan from their neighbours' releases.

The answer of a landing cell depends on the map's definition alone, in whatever order answers come and whenever the
work is interrupted: a level depends on nothing, and a round takes its releases from answers of completed rounds only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count

from jobs.maps.definition import MapDefinition
from jobs.maps.landing_cells import LandingState
from store import LandingCellRow

NEIGHBOURS_MAX = 4  # [-] plans whose releases are candidates: the nearest; each costs a tenth of a second


@dataclass(frozen=True)
class Step:
    """Landing cells that are planned in any order; the next step begins when all of them are answered.

    Attributes:
        round: 0 by their own search, then from the releases of plans of the rounds before.
        level_m: distance of the points that are answered when this step and those before it are completed [m].
        numbers: of the landing cells that have no answer of this step yet.
    """

    round: int
    level_m: float
    numbers: Sequence[int]


def steps(definition: MapDefinition, known: Mapping[int, LandingCellRow]) -> Iterator[Step]:
    """Yields the steps that are left.

    Args:
        definition: of the map.
        known: answers so far, by number; the caller adds those of each step before the next one is asked for.
    """
    for index, stride in enumerate(definition.strides):
        numbers = [number for number in definition.level(index) if number not in known]
        yield Step(0, stride * definition.resolution_m, numbers)
    for round in count(1):
        if not any(row.state == LandingState.YES and row.round == round - 1 for row in known.values()):
            return
        yield Step(round, definition.resolution_m, _without_plan(definition, known, round))


def completed_level_m(definition: MapDefinition, known: Mapping[int, LandingCellRow]) -> float | None:
    """Returns the distance of the points of the finest completed level [m]; None while there is none."""
    finest = None
    for index, stride in enumerate(definition.strides):
        if not all(number in known for number in definition.level(index)):
            break
        finest = stride * definition.resolution_m
    return finest


def planned_neighbours(
    definition: MapDefinition, known: Mapping[int, LandingCellRow], number: int, round: int
) -> list[LandingCellRow]:
    """Returns the nearest landing cells whose plans of earlier rounds are candidates for one without a plan."""
    around = [known[n] for n in definition.neighbours(number) if n in known]
    return [row for row in around if row.state == LandingState.YES and row.round < round][:NEIGHBOURS_MAX]


def _without_plan(definition: MapDefinition, known: Mapping[int, LandingCellRow], round: int) -> list[int]:
    """Returns the landing cells to be tried in a round: not found so far, with a neighbour planned one round before."""
    waiting = [row for row in known.values() if row.state == LandingState.NOT_FOUND and row.round < round]
    return sorted(
        row.number
        for row in waiting
        if any(each.round == round - 1 for each in planned_neighbours(definition, known, row.number, round))
    )

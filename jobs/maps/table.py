"""A map as arrays: what is known of each landing cell, why the others are refused, and whether the map still holds."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import orjson

from jobs.maps.definition import MapDefinition, definition_from
from jobs.maps.landing_cells import LandingState
from jobs.maps.rounds import completed_level_m
from planner.arrays import Array, Index
from store import LandingCellRow, MapRow

MEASURES = ("release_time_s", "shift_early_m", "shift_late_m", "hit_probability", "margin")


@dataclass(frozen=True, eq=False)
class MapTable:
    """A map so far. Arrays are (planes, along y, along x).

    Attributes:
        row: the map.
        definition: what it is of.
        level_m: distance of the points of the finest completed level [m]; None while there is none.
        state: of each landing cell, see `LandingState`.
        measures: `MEASURES` of the plans by name; NaN where there is none.
        plan_ids: of the plans; empty where there is none.
        checks: names of the certificate's checks with a least margin.
        check: index into `checks`; -1 where there is no plan.
        reasons: constraint and words of each reason why landing cells are refused.
        reason: index into `reasons`; -1 where there is none.
        sha256: hash of all answers, plans' trajectories included; ids and times apart. Equal for equal maps.
    """

    row: MapRow
    definition: MapDefinition
    level_m: float | None
    state: Index
    measures: dict[str, Array]
    plan_ids: np.ndarray
    checks: tuple[str, ...]
    check: Index
    reasons: tuple[tuple[str, str], ...]
    reason: Index
    sha256: str

    @property
    def answered(self) -> int:
        """Number of landing cells with an answer."""
        return int((self.state != LandingState.UNKNOWN).sum())

    @property
    def landing_shift_m(self) -> Array:
        """How far the landing point moves for a release 10 ms early or late, whichever is farther [m]."""
        return np.fmax(self.measures["shift_early_m"], self.measures["shift_late_m"])

    @property
    def centres_m(self) -> tuple[Array, Array]:
        """Centres of the landing cells along x, and along y [m]."""
        first = self.definition.target(0)
        last = self.definition.target(self.definition.count - 1)
        rows, columns = self.definition.shape
        return np.linspace(first[0], last[0], columns), np.linspace(first[1], last[1], rows)

    def count_of(self, state: LandingState) -> int:
        """Returns how many landing cells are in a state."""
        return int((self.state == state).sum())


def map_table(row: MapRow, answers: Sequence[LandingCellRow]) -> MapTable:
    """Returns a map as arrays.

    Args:
        row: the map.
        answers: of its landing cells so far.
    """
    definition = definition_from(row.definition)
    shape = (len(definition.planes_z_m), *definition.shape)
    numbers = np.array([each.number for each in answers], dtype=np.intp)

    def spread(values: Sequence[object], fill: object, kind: type) -> np.ndarray:
        filled = np.full(definition.count, fill, dtype=kind)
        filled[numbers] = [fill if value is None else value for value in values]
        return filled.reshape(shape)

    checks = tuple(sorted({each.margin_check for each in answers if each.margin_check}))
    why = [(each.constraint_name or "", each.reason or "") if each.reason is not None else None for each in answers]
    reasons = tuple(sorted({each for each in why if each is not None}))
    index = {each: k for k, each in enumerate(reasons)}
    return MapTable(
        row=row,
        definition=definition,
        level_m=completed_level_m(definition, {each.number: each for each in answers}),
        state=spread([each.state for each in answers], 0, np.uint8),
        measures={name: spread([getattr(each, name) for each in answers], np.nan, float) for name in MEASURES},
        plan_ids=spread([each.plan_id for each in answers], "", np.dtype("U36")),  # type: ignore[arg-type]
        checks=checks,
        check=spread([checks.index(each.margin_check) if each.margin_check else -1 for each in answers], -1, np.int16),
        reasons=reasons,
        reason=spread([-1 if each is None else index[each] for each in why], -1, np.int32),
        sha256=_hash(definition, answers),
    )


def void_because(definition: MapDefinition, cell_sha256: str | None, profile: str | None) -> str | None:
    """Returns why a map does not hold any more, in words; None where it does.

    Args:
        definition: of the map.
        cell_sha256: hash of the cell's files now; None: they are gone.
        profile: id of the profile that the cell uses now; None: the cell file's numbers.
    """
    if cell_sha256 is None:
        return f"the cell file of {definition.cell!r} is gone"
    if cell_sha256 != definition.cell_sha256:
        return f"the cell file of {definition.cell!r} has changed since the map was made"
    if profile != definition.profile:
        then, now = (_profile_words(each) for each in (definition.profile, profile))
        return f"the map was made with {then}; the cell uses {now} now"
    return None


def _profile_words(profile: str | None) -> str:
    return "the cell file's own numbers" if profile is None else f"profile {profile}"


def _hash(definition: MapDefinition, answers: Sequence[LandingCellRow]) -> str:
    """Returns the hash of a definition and of all answers to it; ids of maps and plans, which are drawn, apart."""
    digest = hashlib.sha256(definition.sha256.encode())
    for each in sorted(answers, key=lambda each: each.number):
        fields = {name: value for name, value in vars(each).items() if name not in ("map_id", "plan_id")}
        digest.update(orjson.dumps(fields, option=orjson.OPT_SORT_KEYS))
    return digest.hexdigest()

"""What a batch asks for: its requests, and the version and profile of each cell that they name.

A batch is about the cells as they were when it was made: their files are read from the store, whatever becomes of them
meanwhile.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import orjson

from jobs.batches.grids import axes_of, is_numeric, request_at, values_at
from planner.errors import FieldError, InvalidProblem
from store import Store, derived_id

BATCH_MAX = 1_000_000  # requests of one batch: a day of some hundred cores
LEVEL = 6  # of compression: requests of a batch are much alike


class BatchRequests:
    """The requests of a batch, as a list or as a template with a grid; one of a grid is made when it is asked for.

    Args:
        requests: as for `POST /plan`.
        template: such a request, in which the fields of `grid` may be absent.
        grid: axes by path; see `jobs.batches.grids`.

    Raises:
        InvalidProblem: A wrong axis, no request, or too many.
    """

    def __init__(
        self,
        requests: Sequence[Mapping[str, Any]] | None = None,
        template: Mapping[str, Any] | None = None,
        grid: Mapping[str, Any] | None = None,
    ) -> None:
        self.requests = requests
        self.template = template
        self.grid = grid
        self._axes = axes_of(grid or {}, template or {})
        self._numeric = {axis.path for axis in self._axes if is_numeric(axis)}
        self._count = prod(len(axis.values) for axis in self._axes) if requests is None else len(requests)
        if not 1 <= self._count <= BATCH_MAX:
            field = "grid" if requests is None else "requests"
            raise InvalidProblem([FieldError(field, f"{self._count} requests; a batch has 1 to {BATCH_MAX}")])

    def __len__(self) -> int:
        """Returns the number of requests."""
        return self._count

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        """Yields the requests in their order."""
        return (self[number] for number in range(self._count))

    def __getitem__(self, number: int) -> Mapping[str, Any]:
        """Returns one request, without fields that are null; what is no mapping as it is, for its reader to refuse."""
        if not 0 <= number < self._count:
            raise IndexError(number)
        if self.requests is not None:
            request: Any = self.requests[number]
            return _without_null(request) if isinstance(request, Mapping) else request
        return _without_null(request_at(self.template or {}, self._axes, number))

    def parameters(self, number: int) -> dict[str, float | str]:
        """Returns what a table says of one request: the values of the grid's axes, by path; nothing of a list.

        An axis that has other values than numbers has texts: a string as it is, anything else as JSON.
        """
        if self.requests is not None:
            return {}
        values = values_at(self._axes, number)
        return {path: value if path in self._numeric else _text(value) for path, value in values.items()}

    def document(self) -> dict[str, Any]:
        """Returns the JSON document from which they are made."""
        if self.requests is not None:
            return {"requests": list(self.requests)}
        return {"template": self.template, "grid": self.grid}

    def cells(self, default_cell: str) -> set[str]:
        """Returns the cells that the requests name; only a list, or an axis, can name more than one."""
        if self.requests is not None:
            return {request.get("cell") or default_cell for request in self.requests}
        axis = next((axis for axis in self._axes if axis.path == "cell"), None)
        named = axis.values if axis else [(self.template or {}).get("cell")]
        return {name or default_cell for name in named}


@dataclass(frozen=True)
class CellUse:
    """The version of a cell's files and the profile (None: none) that the plans of a batch use."""

    version: int
    profile: str | None


@dataclass(frozen=True)
class BatchSpecification:
    """What a batch asks for.

    Attributes:
        requests: The requests.
        default_cell: Cell of those that name none.
        cells: What is used of each cell.
    """

    requests: BatchRequests
    default_cell: str
    cells: Mapping[str, CellUse]

    def pack(self) -> bytes:
        """Returns it as bytes, for the store."""
        cells = {name: vars(use) for name, use in self.cells.items()}
        document = {**self.requests.document(), "default_cell": self.default_cell, "cells": cells}
        return zlib.compress(orjson.dumps(document), LEVEL)

    @classmethod
    def stored(cls, store: Store, id: str) -> BatchSpecification:
        """Returns what a batch in the store asks for.

        Raises:
            LookupError: there is no such batch.
        """
        row = store.batch(id, whole=True)
        if row is None:
            raise LookupError(f"there is no batch {id}")
        return cls.unpack(row.specification)

    @classmethod
    def unpack(cls, data: bytes) -> BatchSpecification:
        """Returns what `pack` made bytes of."""
        document = orjson.loads(zlib.decompress(data))
        cells = {name: CellUse(**use) for name, use in document["cells"].items()}
        requests = BatchRequests(document.get("requests"), document.get("template"), document.get("grid"))
        return cls(requests, document["default_cell"], cells)

    def numbered(self) -> Iterator[tuple[int, Mapping[str, Any]]]:
        """Yields each request with its number; every one names its cell."""
        for number, request in enumerate(self.requests):
            yield number, {**request, "cell": request.get("cell") or self.default_cell}


def problem_sha256(request: Mapping[str, Any], cell_sha256: str, profile: str | None) -> str:
    """Returns the hash of what a plan depends on: the request, the cell's files, the profile.

    The order of fields does not matter, nor whether a number is written as 1 or 1.0.
    """
    whole = [_with_floats(request), cell_sha256, profile]
    return hashlib.sha256(orjson.dumps(whole, option=orjson.OPT_SORT_KEYS)).hexdigest()


def plan_id(batch_id: str, sha256: str) -> str:
    """Returns the id of the plan of a problem in a batch: always the same one."""
    return derived_id(batch_id, sha256)


def _without_null(request: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: _without_null(value) if isinstance(value, Mapping) else value
        for key, value in request.items()
        if value is not None
    }


def _text(value: Any) -> str:
    return value if isinstance(value, str) else orjson.dumps(value).decode()


def _with_floats(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _with_floats(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_with_floats(entry) for entry in value]
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value

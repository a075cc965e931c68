"""One problem of the audit: its cell, its request, and what the judge sees beside them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from audit.judge import Obstacle
from audit.problems.cell_file import CellFiles
from audit.problems.cells import random_cell
from audit.problems.chains import chain_document
from audit.problems.meshes import meshes_of
from audit.problems.requests import Frame, limits_document, release_document, start_document
from planner.cell import Cell, ThrownBody

Vector = NDArray[np.float64]

GENERATOR = 2  # counts up whenever an index becomes another problem
PER_CELL = 8  # problems in a row that share a cell, which takes as long to draw as they do
KINDS = {  # share of each kind of problem [-]
    "target": 4,
    "robust target": 3,
    "bin": 3,
    "landing axis": 2,
    "moving target": 2,
    "joint": 3,
    "pose": 3,
    "point": 3,
    "rest": 2,
    "states": 3,
    "lines": 2,
    "throw in a chain": 3,
    "start in motion": 3,
}
AMID = "moving target in a chain"
AMID_SHARE = 0.5  # of moving targets
RELEASE = {"robust target": "target", "landing axis": "axis", "moving target": "moving"}
CHAINS = {"states": "states", "lines": "lines", "throw in a chain": "throw", AMID: "meeting"}
MOVES = ("moving target", AMID)
DRAWS = 4  # of a kind, before the problem is given up


@dataclass(frozen=True, eq=False)
class DrawnProblem:
    """A problem of the audit.

    Attributes:
        kind: one of `KINDS`, or `AMID`.
        files: of the cell.
        cell: that the planner reads from them.
        request: as of `POST /plan`; None where none was drawn: the arm has no room.
        beyond: meshes as they are, which the planner knows as the boxes that cover them.
    """

    kind: str
    files: CellFiles
    cell: Cell
    request: dict[str, Any] | None
    beyond: tuple[Obstacle, ...]


def drawn_problem(seed: int, index: int) -> DrawnProblem:
    """Returns the problem of an index: the same for the same seed and index, whatever was drawn before."""
    files, cell = random_cell(seed, index // PER_CELL)
    rng = np.random.default_rng([seed, index, 1])
    shares = np.array(list(KINDS.values()), np.float64)
    kind = str(rng.choice(list(KINDS), p=shares / shares.sum()))
    kind = _possible(kind, cell)
    if kind == "moving target" and rng.random() < AMID_SHARE:
        kind = AMID
    request = None
    for _ in range(DRAWS):
        request = _request(cell, kind, rng)
        if request is not None:
            break
    return DrawnProblem(kind, files, cell, request, meshes_of(files))


def _possible(kind: str, cell: Cell) -> str:
    """Returns a kind that there is in a cell: balls land along no axis, bodies on what stands still."""
    is_body = isinstance(cell.object, ThrownBody)
    if kind == "landing axis" and not is_body:
        return "target"
    return "target" if kind == "moving target" and is_body else kind


def _request(cell: Cell, kind: str, rng: np.random.Generator) -> dict[str, Any] | None:
    frame = Frame(cell, str(rng.choice(["world", "base"], p=[0.8, 0.2])))
    if kind in CHAINS:
        request = chain_document(cell, CHAINS[kind], frame, rng)
        near = cell.home
    else:
        stated = str(rng.choice(["joint", "target", "point"])) if kind == "start in motion" else RELEASE.get(kind, kind)
        made = release_document(cell, stated, frame, rng)
        request = None if made is None else {"release": made[0]}
        near = cell.home if made is None else made[1].q
    if request is None:
        return None
    is_moving = kind == "start in motion"
    if is_moving or (rng.random() < 0.5 and kind not in CHAINS):
        start = start_document(cell, near, is_moving, rng)
        if start is None:
            return None
        request["start"] = start
    return {**request, "frame": frame.name, **_further(cell, kind, rng)}


def _further(cell: Cell, kind: str, rng: np.random.Generator) -> dict[str, Any]:
    """Returns window, limits, back end and earliest start of a request."""
    found: dict[str, Any] = {}
    if kind in ("target", "landing axis", *MOVES, "throw in a chain", "start in motion"):
        found["release_window_s"] = 0.0
    if kind in ("joint", "pose", "point", "states") and rng.random() < 0.3:
        found["backend"] = "ruckig"  # which reaches its limits in another way
    if kind in MOVES:
        found["starts_not_before_s"] = 1000.5
    if rng.random() < 0.2:
        found["limits"] = limits_document(cell, rng)
    return found

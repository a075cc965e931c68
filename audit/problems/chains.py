"""Random motions of several passages: states, lines and a throw among them, with outputs, times and ends."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from audit.problems.postures import DrawnState, free_posture, free_state, state_of
from audit.problems.requests import Frame, release_document, state_document
from planner.cell import Cell

Vector = NDArray[np.float64]

PASSAGES = (2, 5)
STEP_RAD = 0.8  # of a joint from one passage to the next, at most
SPEED_SHARE = 0.3  # [-] of the joints' limits, at most
LINE_RAD = 0.25  # of a joint from one end of a line to the other, at most
LINE_M_S = (0.05, 0.4)
THROWN = ("joint", "point", "target", "bin")  # kinds of the throw in a chain
MET = ("moving", "moving bin")  # and of one at a target that moves
PASSAGE_S = 0.7  # from one passage to the next, about


def chain_document(cell: Cell, kind: str, frame: Frame, rng: np.random.Generator) -> dict[str, Any] | None:
    """Returns the passages of a request, and how it ends; None where the arm has no room for one.

    Args:
        cell: the cell.
        kind: states, lines, or throw or meeting: states, and lines, of which one state lets the object go; in a
            meeting at a target that moves.
        frame: of the request.
        rng: of the draws.
    """
    count = int(rng.integers(PASSAGES[0], PASSAGES[1] + 1))
    passages: list[dict[str, Any]] = []
    q = cell.home
    for number in range(count):
        state = free_state(cell, q, rng, STEP_RAD, SPEED_SHARE)
        if state is None:
            return None
        is_line = kind == "lines" or (kind in ("throw", "meeting") and rng.random() < 0.3)
        passage = _passage(cell, state, is_line, frame, rng)
        if passage is None:
            return None
        passages.append({"name": f"p{number}", **passage})
        q = state.q
    if kind in ("throw", "meeting"):
        thrown = release_document(cell, str(rng.choice(MET if kind == "meeting" else THROWN)), frame, rng)
        if thrown is None:
            return None
        at = int(rng.integers(0, count + 1))
        passages.insert(at, {"name": "throw", "state": thrown[0], "releases": True})
    _time(passages, rng)
    if kind == "meeting":
        _come_later(passages)
    request: dict[str, Any] = {"passages": passages}
    if rng.random() < 0.3:
        request["end"] = {"kind": str(rng.choice(["home", "rest"]))}
    return request


def _passage(
    cell: Cell, state: DrawnState, is_line: bool, frame: Frame, rng: np.random.Generator
) -> dict[str, Any] | None:
    """Returns a state as one of its kinds, or a line that begins there; now and then an output switches about it.

    None where the arm has no room at the end of the line.
    """
    if is_line:
        there = free_posture(cell, state.q, LINE_RAD, rng)
        if there is None:
            return None
        begin, end = (state_of(cell, q, np.zeros(6)).X_WT for q in (state.q, there))
        speed = float(rng.uniform(*LINE_M_S))
        found: dict[str, Any] = {"line": {"from": frame.pose(begin), "to": frame.pose(end), "speed_m_s": speed}}
    else:
        found = {"state": state_document(str(rng.choice(["joint", "pose", "point"])), state, frame)}
    if rng.random() < 0.2:
        output = {"output": "standard_digital", "index": 1, "level": True, "offset_s": float(rng.uniform(0.0, 0.1))}
        found["outputs"] = [output]
    return found


def _time(passages: list[dict[str, Any]], rng: np.random.Generator) -> None:
    """Gives one passage an earliest or a fixed time now and then: later than it would be."""
    if rng.random() < 0.25:
        at = int(rng.integers(len(passages)))
        name = str(rng.choice(["not_before_s", "at_s"]))
        passages[at][name] = float(rng.uniform(1.0, 2.0)) * (at + 1)


def _come_later(passages: list[dict[str, Any]]) -> None:
    """Moves a target that moves back, by its way while the passages before its throw are passed."""
    at = next(number for number, each in enumerate(passages) if "releases" in each)
    times = [each.get("at_s", each.get("not_before_s", 0.0)) for each in passages[: at + 1]]
    later_s = max(PASSAGE_S * at, *times)
    state = passages[at]["state"]
    state["position"] = (np.array(state["position"]) - later_s * np.array(state["velocity"])).tolist()

"""What a calibration moves: small motions that show the arm's lag or switch outputs, and throws for the gripper."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.cell import Cell, DigitalOutput

AMPLITUDE_RAD = 0.25  # [rad] of a small motion: long enough for 1 rad/s, short enough to stay clear of most things
AMPLITUDE_MIN_RAD = 0.02  # [rad] a shorter motion ends before a lag of 20 ms shows
# Signs of the joints in turn: each joint moves in every motion, and no two always move alike, or always opposed.
SIGNS = ((1, 1, -1, 1, -1, 1), (-1, 1, -1, -1, 1, 1), (1, -1, 1, 1, 1, 1), (-1, -1, -1, 1, -1, -1))
REACHES = (1.25, 1.9)  # [-] targets of calibration throws, in lengths of upper and lower arm together
TURN_RAD = 2.399963  # [rad] golden angle, by which their directions differ: no two throws are alike
EDGES = 8  # of each output in a motion: as many as a passage has
PULSE_S = 0.25  # [s] between two edges of an output: longer than `SEPARATE_S`, so that none is taken for another
TRIES = 5  # candidates for each throw; the surroundings forbid some


def calibration_moves(cell: Cell, throws: int) -> dict[str, Any]:
    """Returns the requests of a calibration, ready to be planned.

    Args:
        cell: what is calibrated.
        throws: how many throws are wanted.

    Returns:
        `motions`: requests of each small motion about home, the longest first: the first that is certified is the one.
        `throws`: candidates in turn, several for each throw: those that are refused are left out.
        `outputs`: requests of a motion about home that switches every output with an input wired to it, the longest
            first; none without such an output.
        `amplitude_rad` and `reach_m`: how far a joint moves at most, and how far from the base targets are.
    """
    reach = float(np.abs(cell.robot.a[1:3]).sum())
    return {
        "cell": cell.name,
        "amplitude_rad": AMPLITUDE_RAD,
        "motions": [_motions(cell, signs) for signs in SIGNS],
        "outputs": _switching(cell),
        "reach_m": [share * reach for share in REACHES],
        "throws": [_throw(cell, reach, i) for i in range(TRIES * throws)],
    }


def _motions(cell: Cell, signs: tuple[int, ...]) -> list[dict[str, Any]]:
    return [{"cell": cell.name, "release": _standing(goal)} for goal in _goals(cell, signs)]


def _goals(cell: Cell, signs: tuple[int, ...]) -> list[Array]:
    """Returns joint positions (6,) about home, the farthest first."""
    halvings = math.floor(math.log2(AMPLITUDE_RAD / AMPLITUDE_MIN_RAD))
    return [cell.home + AMPLITUDE_RAD / 2.0**i * np.array(signs) for i in range(halvings + 1)]


def _standing(q: Array) -> dict[str, Any]:
    """Returns a state at rest in a joint position (6,)."""
    return {"kind": "joint", "positions": q.tolist(), "velocities": [0.0] * 6}


def _switching(cell: Cell) -> list[dict[str, Any]]:
    """Returns motions to and fro with a passage for each output that an input sees, about which it switches."""
    wired = [(name, each) for name, each in cell.outputs.items() if each.sense_input is not None]
    if not wired:
        return []
    goals = zip(_goals(cell, SIGNS[0]), _goals(cell, tuple(-sign for sign in SIGNS[0])), strict=True)
    return [
        {
            "cell": cell.name,
            "passages": [
                {"name": name, "state": _standing(pair[i % 2]), "outputs": _pulses(each)}
                for i, (name, each) in enumerate(wired)
            ],
        }
        for pair in goals
    ]


def _pulses(output: DigitalOutput) -> list[dict[str, Any]]:
    line = {"output": output.output, "index": output.index}
    return [{**line, "level": i % 2 == 0, "offset_s": i * PULSE_S} for i in range(EDGES)]


def _throw(cell: Cell, reach: float, i: int) -> dict[str, Any]:
    """Returns candidate `i`, a soonest throw to the floor: a robust one is blind to the delay it protects against."""
    share = (i * 0.618034) % 1.0  # golden ratio: distances as evenly spread as directions
    distance = reach * (REACHES[0] + share * (REACHES[1] - REACHES[0]))
    x, y = cell.X_WB[:2, 3] + distance * np.array([math.cos(i * TURN_RAD), math.sin(i * TURN_RAD)])
    target = [float(x), float(y), cell.surroundings.floor_z_m]
    return {"cell": cell.name, "release": {"kind": "target", "position": target}, "release_window_s": 0.0}

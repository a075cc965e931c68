"""Requests of a benchmark batch: cheap releases in joints and points, some targets, a few of them out of reach."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Any

TARGETS = 0.05  # [-] share of targets: one costs as much as ten joint releases
JOINTS = 0.6  # [-] share of releases in joints; the rest passes a point
AT_REST = (0.4, -1.4, 1.2, -1.2, -1.57, 0.0)  # [rad] about which releases are drawn


def batch_requests(count: int, seed: int = 0) -> Sequence[dict[str, Any]]:
    """Returns requests of the default cell, the same ones for the same seed."""
    draw = random.Random(seed)
    return [_request(draw) for _ in range(count)]


def _request(draw: random.Random) -> dict[str, Any]:
    kind = draw.random()
    if kind < TARGETS:
        place = [draw.uniform(0.8, 1.6), draw.uniform(-0.8, 0.8), 0.0]
        return {"release": {"kind": "target", "position": place}, "release_window_s": 0.0}
    if kind < TARGETS + JOINTS:
        positions = [q + draw.uniform(-0.4, 0.4) for q in AT_REST]
        velocities = [draw.uniform(-1.0, 1.0) for _ in AT_REST]
        return {"release": {"kind": "joint", "positions": positions, "velocities": velocities}, "backend": "ruckig"}
    position = [draw.uniform(0.3, 0.7), draw.uniform(-0.4, 0.4), draw.uniform(0.3, 0.9)]
    velocity = [draw.uniform(-1.5, 1.5) for _ in range(3)]
    return {"release": {"kind": "point", "position": position, "velocity": velocity}, "backend": "ruckig"}

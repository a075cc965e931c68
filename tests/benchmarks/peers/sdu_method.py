"""The project's own method, rebuilt from its description, on the project's own problem.

Release point and target given; the least speed that hits at 22.5 degrees or more; joint velocities by a weighted
pseudo-inverse; a lead-up in which every joint accelerates uniformly from rest on a straight line in joint space, and a
follow-through that decelerates likewise. It has one posture a release point, where we are kinder: the best of ours.
A pair counts where joint limits (positions, 5 rad/s^2) and the table's box hold for lead-up and follow-through.
Jerk, torques, self-collision and the way to the lead-up's start are not looked at, as they are not there.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.cell import Cell
from planner.errors import Infeasible
from planner.kinematics import forward
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds.candidates import Candidate, candidates
from tests.benchmarks.sdu import table

Vector = NDArray[np.float64]

SAMPLES = 40  # of lead-up and follow-through, at which the box is looked at


@dataclass(frozen=True)
class Tally:
    """Targets with at least one pair, of how many; pairs, of how many looked at; median time a pair [s]."""

    targets: int
    of_targets: int
    pairs: int
    of_pairs: int
    pair_s: float


def tally(part_name: str, cell: Cell, stride: int) -> Tally:
    """Counts over every `stride`-th release point of `near` or `far`."""
    part = table()[part_name]
    places = part["release_points"][::stride]
    hit, clean, times = 0, 0, []
    for target in part["targets"]:
        good = 0
        for place in places:
            begun = time.perf_counter()
            good += _clean(cell, np.array(target), np.array(place), part["min_horizontal_distance_m"])
            times.append(time.perf_counter() - begun)
        hit, clean = hit + (good > 0), clean + good
    return Tally(hit, len(part["targets"]), clean, len(places) * len(part["targets"]), float(np.median(times)))


def _clean(cell: Cell, target: Vector, place: Vector, least_distance: float) -> bool:
    if np.linalg.norm((target - place)[:2]) < least_distance:
        return False
    least = math.radians(table()["planner_of_the_source"]["release_elevation_min_deg"])
    release = TargetRelease(target, min_elevation_rad=least, release_position=place)
    try:
        states = candidates(ThrowProblem(cell, cell.home, release, cell.limits))
    except Infeasible:
        return False
    return any(_lead_up_fits(cell, state) for state in states)


def _lead_up_fits(cell: Cell, state: Candidate) -> bool:
    """Whether the straight line with uniform acceleration before and after the release obeys limits and box."""
    duration = float(np.max(np.abs(state.qd) / cell.limits.qdd_max))
    share = np.linspace(-1.0, 1.0, 2 * SAMPLES + 1)[:, None]
    # before: q - qd T/2 (1 - (1+s)^2), after: the mirror image
    travel = np.where(share < 0.0, -0.5 * (1.0 - (1.0 + share) ** 2), 0.5 * (1.0 - (1.0 - share) ** 2))
    q = state.q + travel * duration * state.qd
    if np.any(q < cell.limits.q_lower) or np.any(q > cell.limits.q_upper):
        return False
    p = (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[:, :3, 3]
    return all(bool(np.all((p >= box.lower) & (p <= box.upper))) for box in cell.surroundings.keep_in)

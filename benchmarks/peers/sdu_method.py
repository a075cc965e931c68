"""The SDU project's own method, rebuilt from its description, on the project's own problem.

Release point and target are given. The method takes the lowest speed that hits the target at 22.5 degrees or more,
joint velocities by a weighted pseudo-inverse, a lead-up in which every joint accelerates uniformly from rest on a
straight line in joint space, and a follow-through that decelerates in the same way. The project has one posture per
release point; here the best of Fling's postures counts. A pair is good if joint limits (positions, 5 rad/s^2) and the
table's box hold for lead-up and follow-through. As in the project, jerk, torques, self-collision and the approach are
not checked.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.problem_sets import sdu_facts
from planner.cell import Cell
from planner.errors import Infeasible
from planner.kinematics import forward
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds import Candidate, candidates

Vector = NDArray[np.float64]

SAMPLES = 40  # of lead-up and of follow-through, where the box is checked


@dataclass(frozen=True)
class SduTally:
    """Result of the method: targets with a good pair, good pairs, and the median time per pair [s]."""

    targets: int
    of_targets: int
    pairs: int
    of_pairs: int
    pair_s: float


def tally_sdu_method(part_name: str, cell: Cell, stride: int) -> SduTally:
    """Runs the method on every `stride`-th release point of the part `near` or `far`."""
    part = sdu_facts()[part_name]
    places = part["release_points"][::stride]
    hits, good_pairs, times = 0, 0, []
    for target in part["targets"]:
        good = 0
        for place in places:
            started_at = time.perf_counter()
            good += _is_good(cell, np.array(target), np.array(place), part["min_horizontal_distance_m"])
            times.append(time.perf_counter() - started_at)
        hits, good_pairs = hits + (good > 0), good_pairs + good
    return SduTally(hits, len(part["targets"]), good_pairs, len(places) * len(part["targets"]), float(np.median(times)))


def _is_good(cell: Cell, target: Vector, place: Vector, least_distance: float) -> bool:
    if np.linalg.norm((target - place)[:2]) < least_distance:
        return False
    least = math.radians(sdu_facts()["planner_of_the_source"]["release_elevation_min_deg"])
    release = TargetRelease(target, min_elevation_rad=least, release_position=place)
    try:
        states = candidates(ThrowProblem(cell, cell.home, release, cell.limits))
    except Infeasible:
        return False
    return any(_lead_up_fits(cell, state) for state in states)


def _lead_up_fits(cell: Cell, state: Candidate) -> bool:
    """Returns whether lead-up and follow-through obey joint limits and box."""
    duration = float(np.max(np.abs(state.qd) / cell.limits.qdd_max))
    share = np.linspace(-1.0, 1.0, 2 * SAMPLES + 1)[:, None]
    # before: q - qd T/2 (1 - (1+s)^2), after: the mirror image
    travel = np.where(share < 0.0, -0.5 * (1.0 - (1.0 + share) ** 2), 0.5 * (1.0 - (1.0 - share) ** 2))
    q = state.q + travel * duration * state.qd
    if np.any(q < cell.limits.q_lower) or np.any(q > cell.limits.q_upper):
        return False
    p = (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[:, :3, 3]
    return all(bool(np.all((p >= box.lower) & (p <= box.upper))) for box in cell.surroundings.keep_in)

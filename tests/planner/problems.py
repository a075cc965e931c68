"""Named problems with known answers, and random ones with fixed seeds, shared by the tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from planner.backends import ruckig_otg
from planner.cell import Box, Cell, Solid, load_cell
from planner.certificate import certify
from planner.errors import Infeasible, SolverFailed
from planner.geometry import tool_state
from planner.problem import JointRelease, PointRelease, PoseRelease, ThrowProblem
from planner.seeds import candidates

CELLS = Path(__file__).parents[2] / "cells"


def cell(name: str = "ur5e-sim") -> Cell:
    return load_cell(CELLS / f"{name}.toml")


def with_clearance(here: Cell, clearance_m: float) -> Cell:
    """The cell with another clearance of the object in flight."""
    return replace(here, surroundings=replace(here.surroundings, flight_clearance_m=clearance_m))


def contact_cell(name: str = "ur5e-sim") -> Cell:
    """A shipped cell in which the object in flight may come as near to everything as it likes, but touch nothing."""
    return with_clearance(cell(name), 0.0)


def steady_cell(name: str = "ur5e-sim") -> Cell:
    """The cell with a gripper that opens in time: without a window, one flight is all that counts."""
    return with_jitter(cell(name), 0.0)


def with_jitter(here: Cell, jitter_s: float) -> Cell:
    """The cell with a gripper of another jitter [s]."""
    return replace(here, gripper=replace(here.gripper, jitter_s=jitter_s))


def ideal_cell(name: str = "ur5e-sim") -> Cell:
    """The cell in which one flight is all that counts, and it may touch nothing."""
    return with_jitter(contact_cell(name), 0.0)


def with_boxes(here: Cell, *boxes: tuple[Sequence[float] | np.ndarray, Sequence[float] | np.ndarray]) -> Cell:
    """The cell with these keep-out boxes alone, each by its lower and its upper corner."""
    return with_shapes(here, *(Box(np.array(lower), np.array(upper)) for lower, upper in boxes))


def with_shapes(here: Cell, *shapes: Solid) -> Cell:
    """The cell with these keep-out shapes alone."""
    return replace(here, surroundings=replace(here.surroundings, keep_out=shapes))


def joint_problem(name: str = "ur5e-sim", **changes) -> ThrowProblem:
    """A launch that every back end can do: towards the front, at moderate speed."""
    here = cell(name)
    q = here.home + np.array([0.6, 0.3, -0.4, 0.3, 0.2, 0.3])
    qd = np.array([0.8, 0.5, -0.6, 0.7, 0.2, 0.3])
    return ThrowProblem(
        **{"cell": here, "start": here.home, "release": JointRelease(q, qd), "limits": here.limits, **changes}
    )


def random_state(problem_cell: Cell, rng: np.random.Generator, spread: float = 1.2) -> tuple[np.ndarray, np.ndarray]:
    """A joint state near home, inside the limits on position and speed."""
    limits = problem_cell.limits
    q = np.clip(problem_cell.home + rng.uniform(-spread, spread, 6), limits.q_lower + 0.05, limits.q_upper - 0.05)
    return q, rng.uniform(-0.6, 0.6, 6) * limits.qd_max


def pose_problem(problem_cell: Cell, q: np.ndarray, qd: np.ndarray) -> ThrowProblem:
    """The pose and twist of a joint state, asked for as a pose release."""
    X_WT, V_WT = tool_state(problem_cell, q, qd)
    return ThrowProblem(problem_cell, problem_cell.home, PoseRelease(X_WT, V_WT), problem_cell.limits)


def point_problem(problem_cell: Cell, q: np.ndarray, qd: np.ndarray) -> ThrowProblem:
    """Place and velocity of a joint state, asked for as a point release."""
    X_WT, V_WT = tool_state(problem_cell, q, qd)
    return ThrowProblem(problem_cell, problem_cell.home, PointRelease(X_WT[:3, 3], V_WT[:3]), problem_cell.limits)


def feasible_states(problem_cell: Cell, count: int, seed: int, spread: float = 0.8):
    """Random joint states that Ruckig alone is known to reach from home by a certified motion, with its release time.

    Yields the state's joint problem as well, so that the same state can be asked for in other ways.
    """
    rng = np.random.default_rng(seed)
    found = 0
    while found < count:
        q, qd = random_state(problem_cell, rng, spread)
        known = ThrowProblem(problem_cell, problem_cell.home, JointRelease(q, qd), problem_cell.limits)
        try:
            answer = ruckig_otg.solve(known, candidates(known)[0]).trajectory
        except (Infeasible, SolverFailed):
            continue
        if certify(known, answer).valid:
            found += 1
            yield known, answer

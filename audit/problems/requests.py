"""Random throws and moves as JSON requests: what is asked for is what a random state of the arm does by itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from audit.judge import fall
from audit.problems.postures import DrawnState, free_posture, free_state, state_of
from planner.cell import Cell, ThrownBody

Vector = NDArray[np.float64]

SPEED_MIN_M_S = 0.4  # of a throw
RANGE_MIN_M = 0.2
STATES = 12  # drawn for one throw, before it is given up
SEEN_S = 1000.0  # [s] on the controller's clock, at which a target that moves was seen
MOVING_S = 1.5  # [s] from then to its landing, about
MOVING_M_S = 0.6  # at most
START_SPREAD_RAD = 1.0  # of starts about the state that is asked for


class Frame:
    """The frame of a request: positions and velocities of the world in it.

    Args:
        cell: gives the base.
        name: world or base.
    """

    def __init__(self, cell: Cell, name: str) -> None:
        self.name = name
        self._X_RW = pin.SE3(cell.X_WB).inverse() if name == "base" else pin.SE3.Identity()

    def point(self, p: Vector) -> list[float]:
        """Returns a place (3,) in this frame."""
        return (self._X_RW * p).tolist()

    def vector(self, v: Vector) -> list[float]:
        """Returns a direction (3,) in this frame."""
        return (self._X_RW.rotation @ v).tolist()

    def pose(self, X: pin.SE3) -> dict[str, Any]:
        """Returns a pose in this frame."""
        here = self._X_RW * X
        return {"position": here.translation.tolist(), "rotation_vector": pin.log3(here.rotation).tolist()}


def state_document(kind: str, state: DrawnState, frame: Frame) -> dict[str, Any]:
    """Returns a state as a release of kind joint, pose or point."""
    if kind == "joint":
        return {"kind": "joint", "positions": state.q.tolist(), "velocities": state.qd.tolist()}
    if kind == "pose":
        twist = {"linear": frame.vector(state.v), "angular": frame.vector(state.w)}
        return {"kind": "pose", "pose": frame.pose(state.X_WT), "twist": twist}
    return {"kind": "point", "position": frame.point(state.X_WT.translation), "velocity": frame.vector(state.v)}


def release_document(
    cell: Cell, kind: str, frame: Frame, rng: np.random.Generator
) -> tuple[dict[str, Any], DrawnState] | None:
    """Returns a release of a kind, and the state that it is made of; None where none was drawn.

    Args:
        cell: the cell.
        kind: joint, pose, point, rest, target, bin, axis (a body lands along one), moving (a target) or moving bin.
        frame: of the request.
        rng: of the draws.
    """
    for _ in range(STATES):
        state = free_state(cell, cell.home, rng)
        if state is None:
            return None
        if kind == "rest":
            still = state_of(cell, state.q, np.zeros(6))
            return state_document(str(rng.choice(["joint", "pose"])), still, frame), still
        if np.linalg.norm(state.v) < SPEED_MIN_M_S:
            continue
        if kind in ("joint", "pose", "point"):
            return state_document(kind, state, frame), state
        if (found := _target(cell, kind, state, frame, rng)) is not None:
            return found, state
    return None


def _target(cell: Cell, kind: str, state: DrawnState, frame: Frame, rng: np.random.Generator) -> dict[str, Any] | None:
    """Returns the target that a state's throw hits; None where it is too near."""
    floor = cell.surroundings.floor_z_m
    height = floor + float(rng.choice([0.0, rng.uniform(0.0, 0.4)]))
    p = state.X_WT.translation
    landed = fall(cell, p, state.v, height)
    if landed is None or np.linalg.norm((landed[0] - p)[:2]) < RANGE_MIN_M:
        return None
    place = np.array([*landed[0][:2], height])
    found: dict[str, Any] = {"kind": "target", "position": frame.point(place)}
    if kind in ("bin", "moving bin"):
        wide = _widest(cell)
        found["opening"] = {
            "radius_m": wide + float(rng.uniform(0.03, 0.15)),
            "rim_height_m": float(rng.uniform(0.03, 0.2)),
        }
    if kind == "axis":
        found["orientation"] = {
            "axis": frame.vector(rng.normal(size=3)),
            "tolerance_rad": float(rng.uniform(0.3, 1.2)),
        }
    if kind in ("moving", "moving bin"):
        way = rng.uniform(-1.0, 1.0, 2)
        v = np.array([*(way * rng.uniform(0.05, MOVING_M_S) / max(float(np.linalg.norm(way)), 1e-3)), 0.0])
        found |= {"velocity": frame.vector(v), "position": frame.point(place - MOVING_S * v), "observed_at_s": SEEN_S}
    return found | _narrowed(state, place, rng)


def _widest(cell: Cell) -> float:
    """Returns the distance of the object's farthest point from its centre [m]."""
    thing = cell.object
    return 0.5 * float(np.linalg.norm(thing.size_m)) if isinstance(thing, ThrownBody) else thing.radius_m


def _narrowed(state: DrawnState, place: Vector, rng: np.random.Generator) -> dict[str, float]:
    """Returns bounds on the throw, now and then, which the state keeps."""
    speed = float(np.linalg.norm(state.v))
    elevation = float(np.arcsin(state.v[2] / speed))
    away = float(np.linalg.norm((place - state.X_WT.translation)[:2]))
    bounds = {
        "max_release_speed_m_s": 1.1 * speed,
        "min_elevation_rad": max(elevation - 0.3, -1.57),
        "max_elevation_rad": min(elevation + 0.3, 1.57),
        "min_horizontal_distance_m": 0.8 * away,
    }
    return {name: value for name, value in bounds.items() if rng.random() < 0.1}


def start_document(cell: Cell, near: Vector, is_moving: bool, rng: np.random.Generator) -> dict[str, Any] | None:
    """Returns a start near joint positions, at rest or in motion; None where the arm has no room there."""
    q = free_posture(cell, near, START_SPREAD_RAD, rng)
    if q is None:
        return None
    start: dict[str, Any] = {"positions": q.tolist()}
    if is_moving:
        start["velocities"] = (rng.uniform(-0.3, 0.3, 6) * cell.limits.qd_max).tolist()
        start["accelerations"] = (rng.uniform(-0.2, 0.2, 6) * cell.limits.qdd_max).tolist()
    return start


def limits_document(cell: Cell, rng: np.random.Generator) -> dict[str, Any]:
    """Returns limits of a request that are tighter than the cell's, as one number or one per joint."""
    own = {"velocity": cell.limits.qd_max, "acceleration": cell.limits.qdd_max, "jerk": cell.limits.jerk_max}
    shares = rng.uniform(0.7, 1.0, 3)
    found: dict[str, Any] = {}
    for (name, most), share in zip(own.items(), shares, strict=True):
        found[name] = float(share * most.min()) if rng.random() < 0.5 else (share * most).tolist()
    return found

"""The flight of an object that is no ball by the audit's own means: its turned shape, by SciPy and coal.

Its rotation is integrated by an eighth-order method, its drag acts on a quarter of the surface that trimesh tells, coal
tells distances. Where it lands: docs/conventions.md.
"""

from __future__ import annotations

from functools import cache

import coal
import numpy as np
import pinocchio as pin
import trimesh
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from planner.cell import ThrownBody

Vector = NDArray[np.float64]

SECTIONS = 256  # [-] of a round side in points and surface: off by 0.02 %
REQUEST = coal.DistanceRequest()


def body_solid(thing: ThrownBody) -> coal.ShapeBase:
    """Returns coal's solid of a body, about its centre."""
    x, y, z = thing.size_m.tolist()
    if thing.kind == "box":
        return coal.Box(x, y, z)
    return coal.Cylinder(0.5 * x, z) if thing.kind == "cylinder" else coal.Capsule(0.5 * x, z - x)


def body_points(thing: ThrownBody) -> tuple[Vector, float]:
    """Returns points (n, 3) and a radius [m]: the balls of that radius about them have the body as their hull."""
    x, y, z = (0.5 * thing.size_m).tolist()
    if thing.kind == "box":
        return np.array(np.meshgrid([-x, x], [-y, y], [-z, z])).reshape(3, -1).T, 0.0
    if thing.kind == "capsule":
        return np.array([[0.0, 0.0, x - z], [0.0, 0.0, z - x]]), x
    angle = np.linspace(0.0, 2.0 * np.pi, SECTIONS, endpoint=False)
    rim = [x * np.cos(angle), x * np.sin(angle)]
    return np.concatenate([np.column_stack([*rim, np.full(SECTIONS, end)]) for end in (-z, z)]), 0.0


@cache
def shadow_m2(thing: ThrownBody) -> float:
    """Returns the mean area of its shadow [m^2]: a quarter of its surface."""
    x, _, z = thing.size_m.tolist()
    if thing.kind == "box":
        mesh = trimesh.creation.box(thing.size_m)
    elif thing.kind == "cylinder":
        mesh = trimesh.creation.cylinder(0.5 * x, z, sections=SECTIONS)
    else:
        return 0.25 * np.pi * x * z  # a ball's surface and a cylinder's side: trimesh's capsule has 0.8 % less
    return 0.25 * float(mesh.area)


def axes_along(thing: ThrownBody, R_WO: Vector, w_W: Vector, t: Vector) -> Vector:
    """Returns the body's axes (n, 3, 3) in the world at increasing times (n,) [s] after the release, from 0 on.

    Args:
        thing: the body.
        R_WO: its axes at the release (3, 3).
        w_W: its angular velocity there (3,) [rad/s].
        t: times [s].
    """
    moments = thing.inertia_kg_m2

    def rates(_: float, state: Vector) -> Vector:
        R = state[:9].reshape(3, 3)
        w = state[9:]
        return np.concatenate([(R @ pin.skew(w)).ravel(), np.cross(moments * w, w) / moments])

    begin = np.concatenate([R_WO.ravel(), R_WO.T @ w_W])
    found = solve_ivp(rates, (0.0, float(t[-1])), begin, method="DOP853", t_eval=t, rtol=1e-10, atol=1e-10)
    return found.y[:9].T.reshape(-1, 3, 3)


def heights(thing: ThrownBody, x: Vector, R_WO: Vector) -> Vector:
    """Returns the heights (n,) [m] of the lowest points of a body at centres (n, 3) with axes (n, 3, 3)."""
    points, radius = body_points(thing)
    return x[:, 2] + (R_WO[:, 2] @ points.T).min(axis=1) - radius


def gaps(thing: ThrownBody, x: Vector, R_WO: Vector, solid: coal.ShapeBase, places: list[coal.Transform3s]) -> Vector:
    """Returns the distances (n,) [m] of a body from a solid, at one place or at n places."""
    own = body_solid(thing)
    at = places * len(x) if len(places) == 1 else places
    found = [
        coal.distance(own, coal.Transform3s(R, p), solid, place, REQUEST, coal.DistanceResult())
        for p, R, place in zip(x, R_WO, at, strict=True)
    ]
    return np.array(found)

"""Distances of spheres and capsules, which an arm is made of, from shapes of every kind, against coal.

    python -m benchmarks.shape_distances --count 1000000 --seed 0

Pairs are drawn at random; where both say that they meet, they agree. Of a mesh in a cell file, the boxes that cover it
are compared with coal's tree of their triangles; and the mesh itself must be as near as its cover, or farther by no
more than its inflation.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import coal
import numpy as np
import trimesh
from numpy.typing import NDArray

from audit.judge import coal_mesh, coal_solid
from planner.cell import Solid, cover_in, load_cell, read_source, shape_of
from planner.geometry import shape_distances
from planner.rotations import pose, rotation_vector_to_matrix

Vector = NDArray[np.float64]

BODIES = ("sphere", "capsule")
KINDS = ("box", "cylinder", "sphere", "capsule")
POOL = 10_000  # bodies and shapes of a kind, that pairs are drawn from
SIZES_M = (0.01, 0.8)  # edges, radii and lengths
RADII_M = (0.01, 0.1)  # of bodies
REACH_M = 1.0  # of the middles of bodies and shapes along each axis
MESHES = {
    "pipe": lambda: trimesh.creation.annulus(0.1, 0.15, 0.4),
    "cone": lambda: trimesh.creation.cone(0.1, 0.3),
    "ball": lambda: trimesh.creation.icosphere(3, 0.15),
    "tray": lambda: trimesh.creation.revolve(
        [[0.0, 0.0], [0.2, 0.0], [0.25, 0.1], [0.24, 0.1], [0.19, 0.01], [0.0, 0.01]]
    ),
}
MESH_PLACES = 5  # of each
MESH_AT_M = np.array([5.0, 0.0, 1.0])  # away from the arm of the cell that names it
MESH_CELL = "ur5e-sim"
TOLERANCE_M = 1e-9
MESH_TOLERANCE_M = 1e-6


class RoundBody(NamedTuple):
    """A sphere or capsule: the ends of its axis (3,) and its radius [m]; the same for coal."""

    p0: Vector
    p1: Vector
    radius_m: float
    solid: coal.ShapeBase
    place: coal.Transform3s


class CoalObstacle(NamedTuple):
    """A shape, or the boxes that cover a mesh; coal's geometry of these and of the mesh, and its inflation [m]."""

    shapes: tuple[Solid, ...]
    solid: coal.CollisionGeometry
    place: coal.Transform3s
    mesh: coal.CollisionGeometry | None = None
    inflation_m: float = 0.0


class ComparedDistances(NamedTuple):
    """What random pairs came to.

    Attributes:
        apart: how many of them are.
        worst_m: largest difference of two distances among these [m].
        outside: how many are nearer to a mesh than to its cover, or farther by more than its inflation.
    """

    apart: int
    worst_m: float
    outside: int


def main() -> None:
    """Prints one line for each two kinds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1_000_000, help="pairs of each two kinds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="+", default=[*KINDS, "mesh"], choices=[*KINDS, "mesh"])
    given = parser.parse_args()
    for kind in given.kinds:
        for body in BODIES:
            found = compared(body, kind, given.count, given.seed)
            print(f"{body}, {kind}: {found} of {given.count}", flush=True)


def compared(body: str, kind: str, count: int, seed: int) -> ComparedDistances:
    """Compares distances of `count` random pairs of a body and a shape with coal's."""
    rng = np.random.default_rng([seed, len(body), len(kind)])
    bodies = list(_bodies(body, rng))
    obstacles = list(_meshes(rng) if kind == "mesh" else _shapes(kind, rng))
    first = rng.integers(len(bodies), size=count)
    second = np.sort(rng.integers(len(obstacles), size=count))
    found = np.concatenate([_found(bodies, first[second == k], each) for k, each in enumerate(obstacles)])
    paired = [(bodies[i], obstacles[k]) for i, k in zip(first, second, strict=True)]
    expected = np.array([_by_coal(body, each.solid, each.place) for body, each in paired])
    apart = (found > 0.0) | (expected > 0.0) & (kind != "mesh")  # a tree of triangles is hollow
    outside = sum(_is_outside(body, each, gap) for (body, each), gap in zip(paired, found, strict=True) if gap > 0.0)
    return ComparedDistances(int(apart.sum()), float(np.abs(found - expected)[apart].max()), outside)


def _found(bodies: list[RoundBody], chosen: NDArray[np.intp], obstacle: CoalObstacle) -> Vector:
    """Returns the distances (n,) [m] of the bodies of `chosen` numbers (n,) by Fling."""
    p0, p1, radii = (np.array([bodies[i][k] for i in chosen]) for k in range(3))
    first = np.zeros(len(chosen), np.intp)
    p0 = p0.reshape(-1, 3)
    p1 = p1.reshape(-1, 3)
    return np.min([shape_distances(p0, p1, first, shape.row[None]) for shape in obstacle.shapes], axis=0) - radii


def _by_coal(body: RoundBody, solid: coal.CollisionGeometry, place: coal.Transform3s) -> float:
    return float(coal.distance(solid, place, body.solid, body.place, _REQUEST, coal.DistanceResult()))


def _is_outside(body: RoundBody, obstacle: CoalObstacle, gap: float) -> bool:
    """Returns whether a mesh is nearer than `gap` from its cover [m], or farther by more than its inflation."""
    if obstacle.mesh is None:
        return False
    beyond = _by_coal(body, obstacle.mesh, obstacle.place) - gap
    return not -MESH_TOLERANCE_M <= beyond <= obstacle.inflation_m + MESH_TOLERANCE_M


def _bodies(kind: str, rng: np.random.Generator) -> Iterator[RoundBody]:
    for _ in range(POOL):
        X = _placed(rng)
        radius = float(rng.uniform(*RADII_M))
        length = float(rng.uniform(*SIZES_M)) if kind == "capsule" else 0.0
        solid = coal.Capsule(radius, length) if length else coal.Sphere(radius)
        along = 0.5 * length * X[:3, 2]
        yield RoundBody(X[:3, 3] - along, X[:3, 3] + along, radius, solid, _transform(X))


def _shapes(kind: str, rng: np.random.Generator) -> Iterator[CoalObstacle]:
    for _ in range(POOL):
        sizes = rng.uniform(*SIZES_M, 3 if kind == "box" else 2)
        sizes = np.array([sizes[0], 0.0]) if kind == "sphere" else sizes
        shape = shape_of(kind, _placed(rng), sizes)
        yield CoalObstacle((shape,), coal_solid(shape), _transform(shape.X_WC))


def _meshes(rng: np.random.Generator) -> Iterator[CoalObstacle]:
    """Yields meshes as a cell file that names them gets them, moved to random places."""
    for make in MESHES.values():
        mesh = make()
        shapes, inflation_m = _read(mesh)
        boxes = [trimesh.creation.box(shape.extent, shape.X_WC) for shape in shapes]
        for _ in range(MESH_PLACES):
            X = _placed(rng)
            moved = tuple(shape_of("box", X @ shape.X_WC, shape.extent) for shape in shapes)
            covered = trimesh.util.concatenate(boxes)
            assert isinstance(covered, trimesh.Trimesh)
            yield CoalObstacle(moved, coal_mesh(covered), _transform(X), coal_mesh(mesh), inflation_m)


def _read(mesh: trimesh.Trimesh) -> tuple[list[Solid], float]:
    """Returns the boxes that stand for a mesh in a cell, in the frame of its file, and its inflation [m]."""
    plain = (Path(__file__).parents[1] / "cells" / f"{MESH_CELL}.toml").read_text(encoding="utf-8")
    entry = f'{{ shape = "mesh", file = "a.stl", pose = {{ position_m = {MESH_AT_M.tolist()} }} }}'
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.toml"
        path.write_text(plain.replace("keep_out = []", f"keep_out = [{entry}]"), encoding="utf-8")
        mesh.export(path.with_suffix(".stl"))
        known = cover_in(read_source(path).meshes, "a.stl")
        shapes = load_cell(path).surroundings.keep_out
    assert not isinstance(known, str), known
    back = pose(-MESH_AT_M, np.eye(3))
    return [shape_of("box", back @ shape.X_WC, shape.extent) for shape in shapes], known[0].beyond


def _placed(rng: np.random.Generator) -> Vector:
    return pose(rng.uniform(-REACH_M, REACH_M, 3), rotation_vector_to_matrix(rng.uniform(-2.0, 2.0, 3)))


def _transform(X: Vector) -> coal.Transform3s:
    return coal.Transform3s(X[:3, :3], X[:3, 3])


def _request() -> coal.DistanceRequest:
    asked = coal.DistanceRequest()
    asked.gjk_tolerance = 0.1 * TOLERANCE_M
    asked.gjk_max_iterations = 1000
    return asked


_REQUEST = _request()

if __name__ == "__main__":
    main()

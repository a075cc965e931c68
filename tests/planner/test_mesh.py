"""Meshes in cells: covered by boxes wholly, no farther than is told, and read from the formats that CAD writes."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pytest
import trimesh

from audit.judge import coal_mesh
from planner.arrays import Array
from planner.cell import load_cell, mended_cell, read_source
from planner.cell.meshes.boxes import BOXES_MAX, cover
from planner.certificate import certify
from planner.errors import CellError
from planner.flight import path as path_of
from planner.geometry import body_model, tool_state
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix

CELLS = Path(__file__).parents[2] / "cells"


def at(mesh: trimesh.Trimesh, position: list[float], turn: list[float] | None = None) -> trimesh.Trimesh:
    return mesh.copy().apply_transform(pose(np.array(position), rotation_vector_to_matrix(np.array(turn or [0, 0, 0]))))


def bracket() -> trimesh.Trimesh:
    """A corner of two plates with a slanted rib, as three bodies that meet."""
    plates = [
        at(trimesh.creation.box((0.3, 0.2, 0.02)), [0, 0, 0.01]),
        at(trimesh.creation.box((0.02, 0.2, 0.3)), [-0.14, 0, 0.15]),
    ]
    return trimesh.util.concatenate([*plates, at(trimesh.creation.box((0.3, 0.01, 0.05)), [0, 0, 0.12], [0, 0.8, 0])])


MESHES = {
    "box": trimesh.creation.box((0.3, 0.2, 0.1)),
    "turned box": at(trimesh.creation.box((0.3, 0.2, 0.1)), [1.0, 2.0, 3.0], [0.2, 0.7, -0.4]),
    "ball": trimesh.creation.icosphere(3, 0.15),
    "pipe": trimesh.creation.annulus(0.1, 0.15, 0.4),
    "cone": at(trimesh.creation.cone(0.1, 0.3), [0, 0, 0], [0.4, 0.0, 0.1]),
    "bracket": bracket(),
    "sheet": trimesh.Trimesh([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0.0]], [[0, 1, 2]]),
    "soup": trimesh.Trimesh(np.random.default_rng(2).normal(size=(60, 3)), np.arange(60).reshape(20, 3), process=False),
}


POSE = "pose = { position_m = [0.7, 0.4, 0.3], rotation_vector_rad = [0.0, 0.0, 0.5] }"


def distance_from(model: coal.BVHModelOBBRSS, X_WM: Array, p0: Array, p1: Array) -> float:
    """Distance of a segment from the faces of a mesh, by coal."""
    along = p1 - p0
    length = float(np.linalg.norm(along))
    turn = np.eye(3) if length < 1e-9 else trimesh.geometry.align_vectors([0, 0, 1], along / length)[:3, :3]
    thin = coal.Capsule(1e-6, length) if length >= 1e-9 else coal.Sphere(1e-6)
    placed = coal.Transform3s(turn, 0.5 * (p0 + p1))
    here = coal.Transform3s(X_WM[:3, :3], X_WM[:3, 3])
    return float(coal.distance(model, here, thin, placed, coal.DistanceRequest(), coal.DistanceResult())) + 1e-6


def boxes_of(mesh: trimesh.Trimesh) -> tuple[Array, Array, Array, float]:
    made = cover(np.array(mesh.triangles))
    return made.axes, made.lower, made.upper, made.beyond


@pytest.mark.slow
@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_lies_in_the_boxes_that_cover_it(name: str) -> None:
    mesh = MESHES[name]
    axes, lower, upper, _ = boxes_of(mesh)
    assert len(lower) <= BOXES_MAX
    points = [trimesh.sample.sample_surface(mesh, 20_000, seed=1)[0], mesh.vertices, mesh.triangles.mean(axis=1)]
    along = np.concatenate(points) @ axes
    inside = ((along[:, None] >= lower - 1e-9) & (along[:, None] <= upper + 1e-9)).all(axis=2)
    assert inside.any(axis=1).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in MESHES if name != "soup"])
def test_no_box_reaches_farther_beyond_a_mesh_than_is_told(name: str) -> None:
    """By coal's distances of small balls in the boxes from the mesh; what is in a closed one is not beyond it."""
    mesh = MESHES[name]
    axes, lower, upper, beyond = boxes_of(mesh)
    model = coal_mesh(mesh)
    rng = np.random.default_rng(3)
    shares = np.concatenate([rng.uniform(size=(30, 3)), rng.integers(0, 2, (30, 3))])
    points = (lower[:, None] + shares * (upper - lower)[:, None]).reshape(-1, 3) @ axes.T
    away = [distance_from(model, np.eye(4), p, p) for p in points[~_within(name, mesh, points)]]
    assert max(away) < beyond
    assert beyond < (0.08 if name != "ball" else 0.15) * mesh.extents.max()


def _within(name: str, mesh: trimesh.Trimesh, points: Array) -> Array:
    """Which points are in a closed mesh: a pipe, or a convex one; of no other."""
    if name == "pipe":
        away = np.hypot(points[:, 0], points[:, 1])
        return (away > 0.1) & (away < 0.15) & (np.abs(points[:, 2]) < 0.2)
    if name in ("bracket", "sheet"):
        return np.zeros(len(points), np.bool_)
    heights = points @ mesh.face_normals.T - (mesh.triangles[:, 0] * mesh.face_normals).sum(axis=1)
    return np.asarray((heights < 0.0).all(axis=1))


def test_what_a_closed_mesh_encloses_is_kept_out() -> None:
    ball = trimesh.creation.icosphere(3, 0.15)
    _, lower, upper, _ = boxes_of(ball)
    rng = np.random.default_rng(4)
    x = rng.uniform(-0.15, 0.15, (4000, 3))
    x = x[np.linalg.norm(x, axis=1) < 0.14]
    assert ((x[:, None] >= lower) & (x[:, None] <= upper)).all(axis=2).any(axis=1).all()


def written(folder: Path, entry: str, **files: bytes) -> Path:
    path = folder / "lab.toml"
    text = (CELLS / "ur5e-sim.toml").read_text().replace("keep_out = []\n", "")
    path.write_text(f'{text}\n[[surroundings.keep_out]]\nshape = "mesh"\n{entry}\n')
    for name, data in files.items():
        (folder / name.replace("_", ".")).write_bytes(data)
    return path


def exported(mesh: trimesh.Trimesh, kind: str) -> bytes:
    data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


@pytest.fixture(autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path_factory.mktemp("cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "suffix"), [("stl", "stl"), ("stl_ascii", "STL"), ("obj", "obj"), ("ply", "ply")])
def test_a_mesh_of_any_format_is_kept_out_where_pose_and_scale_put_it(tmp_path: Path, kind: str, suffix: str) -> None:
    data = exported(trimesh.creation.box((300.0, 200.0, 100.0)), kind)
    entry = f'name = "block"\nfile = "part.{suffix}"\nscale = 0.001\nclearance_m = 0.03\n{POSE}'
    (block,) = load_cell(written(tmp_path, entry, **{f"part_{suffix}": data})).surroundings.keep_out
    assert (block.name, block.clearance_m) == ("block", 0.03)
    placed = pose(np.array([0.7, 0.4, 0.3]), rotation_vector_to_matrix(np.array([0.0, 0.0, 0.5])))
    assert np.abs(block.X_WC - placed).max() < 1e-12
    assert block.extent == pytest.approx([0.3, 0.2, 0.1])


def with_ball(folder: Path, radius_m: float = 0.15, before: str = "") -> Path:
    data = exported(trimesh.creation.icosphere(2, radius_m), "stl")
    return written(folder, f'{before}file = "ball.stl"\n{POSE}', ball_stl=data)


def test_the_parts_of_a_mesh_are_called_like_it_and_others_by_their_place_in_the_file(tmp_path: Path) -> None:
    path = with_ball(tmp_path)
    path.write_text(
        path.read_text() + "[[surroundings.keep_out]]\nlower_m = [1.5, 1.5, 0.0]\nupper_m = [2.0, 2.0, 1.0]\n"
    )
    *parts, box = load_cell(path).surroundings.keep_out_names
    assert parts == [f"mesh 0 {k}" for k in range(len(parts))]
    assert len(parts) > 10
    assert box == "box 1"


@pytest.mark.slow
def test_a_cell_of_another_mesh_is_another_cell(tmp_path: Path) -> None:
    path = with_ball(tmp_path)
    source = read_source(path)
    cell = load_cell(path)
    assert source.sha256 == cell.sha256
    (tmp_path / "ball.stl").write_bytes(exported(trimesh.creation.icosphere(2, 0.14), "stl"))
    assert read_source(path).sha256 != source.sha256
    slower = cell.with_limits(tcp_speed_m_s=2.0)
    assert slower.surroundings.keep_out_names == cell.surroundings.keep_out_names


@pytest.mark.slow
def test_a_mesh_is_covered_once(tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = read_source(with_ball(tmp_path))
    monkeypatch.setattr("planner.cell.meshes.files.cover", None)
    assert read_source(tmp_path / "lab.toml") == source
    for kept in (cache / "fling" / "meshes").iterdir():
        kept.write_bytes(b"half of")
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/no such folder")
    assert read_source(tmp_path / "lab.toml") == source


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("gone.stl", None, "cannot be read"),
        ("../x.stl", b"", "must name a file beside the cell file"),
        ("part.step", b"", "must name a file beside the cell file"),
        ("part.stl", b"", "has no faces"),
        ("part.ply", b"garbage", "is no mesh in PLY format"),
        ("part.obj", b"v 0 0 0\nf 1 2 3\n", "is no mesh in OBJ format"),
        ("part.obj", b"v 0 0 0\nv 1 0 0\nv nan 1 0\nf 1 2 3\n", "has corners that are no numbers"),
        ("part.obj", b"v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "has no faces"),
        ("part.obj", b"v 0 0 0\nv 9000 0 0\nv 0 9000 0\nf 1 2 3\n", "makes the mesh 9000 m large"),
    ],
)
def test_what_is_no_mesh_is_refused(tmp_path: Path, name: str, data: bytes | None, words: str) -> None:
    path = written(tmp_path, f'file = "{name}"\n{POSE}')
    if data is not None:
        (tmp_path / Path(name).name).write_bytes(data)
    with pytest.raises(CellError, match=words):
        load_cell(path)
    (fault,), _ = mended_cell(read_source(path))
    assert fault.field.startswith("surroundings.keep_out[0].")


@pytest.mark.slow
def test_throws_keep_clear_of_a_mesh(tmp_path: Path) -> None:
    """Arm and object, by coal's distances from the mesh itself, each millisecond."""
    mesh = bracket()
    placed = "pose = { position_m = [0.75, 0.35, 0.0], rotation_vector_rad = [0.0, 0.0, 0.6] }"
    entry = f'name = "fixture"\nfile = "fixture.ply"\n{placed}'
    cell = load_cell(written(tmp_path, entry, fixture_ply=exported(mesh, "ply")))
    problem = ThrowProblem(cell, cell.home, TargetRelease(np.array([1.2, 0.5, 0.0])), cell.limits)
    found = plan(problem)
    assert certify(problem, found.trajectory).valid
    q = found.trajectory.at(np.arange(0.0, found.trajectory.duration_s, 1e-3))[0]
    body = body_model(cell)
    ends = np.moveaxis(body.end_points(body.link_poses(q))[body.moving], -1, 0)
    X_WM = pose(np.array([0.75, 0.35, 0.0]), rotation_vector_to_matrix(np.array([0.0, 0.0, 0.6])))
    model = coal_mesh(mesh)
    least = min(
        distance_from(model, X_WM, p0, p1) - radius
        for postures in ends[::4]
        for (p0, p1), radius in zip(postures, body.radii[body.moving], strict=True)
    )
    assert least > cell.surroundings.clearance_m
    state = tool_state(
        cell, *(rows[found.trajectory.release_index] for rows in (found.trajectory.q, found.trajectory.qd))
    )
    x = path_of(state.p_WT, state.v_WT, np.arange(0.0, 1.0, 2e-3), problem.gravity, 0.0)
    flown = x[x[:, 2] > cell.object.radius_m]
    assert min(distance_from(model, X_WM, p, p) for p in flown) - cell.object.radius_m > cell.surroundings.clearance_m

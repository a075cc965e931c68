"""Points in cells: every one is in a box, boxes are full cells and do not overlap; files of all formats read alike."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from planner.cell import load_cell
from planner.cell.meshes.points import points_cover
from planner.errors import CellError, FileRefused
from planner.geometry import body_model
from planner.scenes import points_ply, read_points, scanned
from tests.planner.problems import cell

CELLS = Path(__file__).parents[2] / "cells"


def drawn(seed: int, count: int = 500) -> np.ndarray:
    """A table, a post and some dirt."""
    rng = np.random.default_rng(seed)
    table = rng.uniform([0.5, -0.4, 0.39], [1.1, 0.4, 0.4], (count, 3))
    post = rng.uniform([-0.7, 0.5, 0.0], [-0.6, 0.6, 1.0], (count, 3))
    return np.concatenate([table, post, rng.uniform(-1.0, 1.0, (20, 3))])


@pytest.mark.parametrize("seed", range(3))
def test_boxes_are_the_full_cells_each_once(seed: int) -> None:
    points = drawn(seed)
    edge = 0.03
    made = points_cover(points, edge)
    inside = ((points[:, None] >= made.lower - 1e-9) & (points[:, None] <= made.upper + 1e-9)).all(axis=2)
    assert inside.any(axis=1).all()
    volumes = np.round((made.upper - made.lower) / edge).prod(axis=1)
    assert volumes.sum() == len(np.unique(np.floor(points / edge), axis=0))
    middle = 0.5 * (made.lower + made.upper)
    apart = np.abs(middle[:, None] - middle) - 0.5 * ((made.upper - made.lower)[:, None] + (made.upper - made.lower))
    assert (apart.max(axis=2)[~np.eye(len(middle), dtype=bool)] > -1e-9).all()
    assert made.beyond == pytest.approx(np.sqrt(3.0) * edge)


def test_a_full_block_is_one_box() -> None:
    grid = np.stack(np.meshgrid(*[np.arange(n) for n in (4, 5, 6)]), axis=-1).reshape(-1, 3)
    made = points_cover((grid + 0.5) * 0.1, 0.1)
    np.testing.assert_allclose([made.lower, made.upper], [[[0.0, 0.0, 0.0]], [[0.4, 0.5, 0.6]]], atol=1e-12)


def pcd(points: np.ndarray, encoding: str) -> bytes:
    head = f"VERSION 0.7\nFIELDS rgb x y z\nSIZE 4 4 4 8\nTYPE U F F F\nCOUNT 1 1 1 1\nPOINTS {len(points)}\n"
    rows = np.zeros(len(points), [("rgb", "<u4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f8")])
    for i, axis in enumerate("xyz"):
        rows[axis] = points[:, i]
    body = (
        rows.tobytes() if encoding == "binary" else "\n".join(" ".join(map(str, row)) for row in rows.tolist()).encode()
    )
    return f"# .PCD\n{head}DATA {encoding}\n".encode() + body


@pytest.mark.parametrize("kind", ["a.ply", "a.xyz", "ascii.pcd", "binary.pcd"])
def test_every_format_reads_the_same_points(kind: str, tmp_path: Path) -> None:
    points = drawn(1, 20)
    path = tmp_path / kind
    xyz = "\n".join(" ".join(map(str, row)) for row in points.tolist()).encode()
    content = {"a.ply": points_ply(points), "a.xyz": xyz}.get(kind) or pcd(points, kind.split(".")[0])
    path.write_bytes(content)
    np.testing.assert_allclose(read_points(path), points, atol=1e-6)


def test_a_depth_picture_is_seen_from_its_camera(tmp_path: Path) -> None:
    depth = np.zeros((48, 64), np.uint16)
    depth[10, 20] = 1500
    depth[47, 63] = 800
    path = tmp_path / "seen.png"
    Image.fromarray(depth).save(path)
    points = 0.001 * read_points(path, (60.0, 62.0, 31.5, 23.5))
    u, v, z = np.array([20, 63]), np.array([10, 47]), np.array([1.5, 0.8])
    np.testing.assert_allclose(points[:, 0] / points[:, 2] * 60.0 + 31.5, u)
    np.testing.assert_allclose(points[:, 1] / points[:, 2] * 62.0 + 23.5, v)
    np.testing.assert_allclose(points[:, 2], z)
    with pytest.raises(FileRefused, match="intrinsics"):
        read_points(path)


def colours() -> bytes:
    held = io.BytesIO()
    Image.fromarray(np.zeros((4, 4, 3), np.uint8)).save(held, "PNG")
    return held.getvalue()


MESH_PLY = b"""ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.ply", b"ply\nnothing", "is no point cloud in PLY format"),
        ("a.ply", MESH_PLY, "has faces"),
        ("a.ply", points_ply(np.full((2, 3), np.nan)), "has no points"),
        ("a.xyz", b"one two three", "is no point cloud in XYZ format"),
        ("a.pcd", pcd(drawn(0), "binary")[:-2], "is no point cloud in PCD format"),
        ("a.pcd", b"VERSION 0.7\nDATA binary_compressed\n", "DATA ascii or binary"),
        ("a.png", b"\x89PNG", "is no picture in PNG format"),
        ("a.png", colours(), "is no depth picture"),
        ("a.las", b"", "must be .ply"),
    ],
)
def test_what_is_no_scan_is_refused(name: str, content: bytes, reason: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileRefused, match=reason):
        read_points(tmp_path / name, (1.0, 1.0, 0.0, 0.0))


def test_floor_arm_and_what_is_far_are_left_out() -> None:
    here = cell()
    body = body_model(here)
    ends = body.end_points(body.link_poses(here.home[None]))[..., 0]
    on_arm = ends.reshape(-1, 3)
    points = np.concatenate([on_arm, [[1.0, 0.0, 0.005], [1.0, 0.0, 0.5], [9.0, 0.0, 0.5], [1.0, 0.0, -0.5]]])
    made = scanned(here, points, 0.02, 3.0)
    np.testing.assert_allclose(made.middles, [[1.01, 0.01, 0.51]], atol=1e-12)
    assert [line.split()[0] for line in made.left_out[:2]] == ["1", "3"]  # the foot of the base, too


def with_points(tmp_path: Path, entry: str, points: np.ndarray) -> Path:
    path = tmp_path / "lab.toml"
    text = (CELLS / "ur5e-sim.toml").read_text()
    path.write_text(text.replace("keep_out = []", f"keep_out = [{entry}]"))
    (tmp_path / "seen.ply").write_bytes(points_ply(points))
    return path


def test_a_cell_keeps_out_of_points(tmp_path: Path) -> None:
    points = np.array([[1000.0, 0.0, 500.0], [1049.0, 0.0, 500.0], [1000.0, 300.0, 900.0]])
    pose = "pose = { position_m = [0.1, 0.0, 0.0] }"
    path = with_points(
        tmp_path,
        f'{{ name = "seen", shape = "points", file = "seen.ply", scale = 0.001, cell_m = 0.05, {pose} }}',
        points,
    )
    shapes = load_cell(path).surroundings.keep_out
    assert [shape.name for shape in shapes] == ["seen 0", "seen 1"]
    np.testing.assert_allclose([shapes[0].lower, shapes[0].upper], [[1.1, 0.0, 0.5], [1.15, 0.05, 0.55]], atol=1e-9)
    before = load_cell(path).sha256
    (tmp_path / "seen.ply").write_bytes(points_ply(points[:1]))
    assert len(load_cell(path).surroundings.keep_out) == 1
    assert load_cell(path).sha256 != before


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ('file = "seen.stl"', r"must name a file beside the cell file: .ply"),
        ('file = "seen.ply", cell_m = 0.0', "cell_m"),
        ('file = "seen.ply", cell_m = "x"', "."),
        ('file = "seen.ply", scale = 0', "."),
        ('file = "other.ply"', "cannot be read"),
        ('file = "seen.ply", cell_m = 0.001, scale = 1000.0', "too many cells|large"),
        ('file = "seen.ply", size_m = [1, 1, 1]', "size_m"),
    ],
)
def test_points_that_cannot_be_are_refused(keys: str, reason: str, tmp_path: Path) -> None:
    path = with_points(tmp_path, f'{{ shape = "points", {keys} }}', drawn(0))
    with pytest.raises(CellError, match=reason):
        load_cell(path)

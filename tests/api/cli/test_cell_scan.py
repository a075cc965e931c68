"""`fling cell scan`: what a camera has seen becomes boxes of a cell, where it was; a second scan takes its place."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from api.cli import main
from planner.cell import load_cell
from planner.geometry import segment_shape_distance
from planner.rotations import rotation_vector_to_matrix
from planner.scenes import points_ply

CAMERA = (1.0, 0.0, 1.5, 2.6, 0.0, 0.0)  # looks down, and aside
INTRINSICS = (80.0, 80.0, 39.5, 29.5)


def scan(cell: Path, name: str, *options: object) -> Result:
    return CliRunner().invoke(main, ["cell", "scan", str(cell.parent / name), "--into", str(cell), *map(str, options)])


def test_a_depth_picture_becomes_boxes_where_its_points_are(cell: Path) -> None:
    """A plane before the camera, 0.8 m away from it."""
    Image.fromarray(np.full((60, 80), 800, np.uint16)).save(cell.parent / "view.png")
    done = scan(cell, "view.png", "--camera", *CAMERA, "--intrinsics", *INTRINSICS, "--cell-size", 0.03, "--json")
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    shapes = load_cell(cell).surroundings.keep_out
    assert told["boxes"] == len(shapes) < told["cells"]
    v, u = np.mgrid[0:60, 0:80].reshape(2, -1)
    rays = np.stack([(u - INTRINSICS[2]) / INTRINSICS[0], (v - INTRINSICS[3]) / INTRINSICS[1], np.ones(len(u))], axis=1)
    x = 0.8 * rays @ rotation_vector_to_matrix(np.array(CAMERA[3:])).T + CAMERA[:3]
    least = np.min([segment_shape_distance(x, x, shape) for shape in shapes], axis=0)
    assert least.max() < 1e-9
    assert told["beyond_m"] == pytest.approx(0.03 * np.sqrt(3.0))
    corners = np.concatenate([[shape.lower, shape.upper] for shape in shapes])
    assert all(np.linalg.norm(x - corner, axis=1).min() < told["beyond_m"] for corner in corners)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--camera", 0, 0, 0, 0, 0, 180), "degrees?"),
        (("--camera", 0, 0, "nan", 0, 0, 0), "--camera"),
        (("--scale", -1), "--scale"),
        (("--scale", "nan"), "--scale"),
        (("--intrinsics", 0, 80, 40, 30), "focal lengths"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(cell: Path, options: tuple[object, ...], named: str) -> None:
    (cell.parent / "cloud.ply").write_bytes(points_ply(np.array([[0.9, 0.4, 0.3]])))
    before = cell.read_text()
    done = scan(cell, "cloud.ply", *options)
    assert done.exit_code == 64
    assert named in done.output
    assert cell.read_text() == before


def test_a_second_scan_takes_the_place_of_the_first(cell: Path) -> None:
    (cell.parent / "table top.ply").write_bytes(points_ply(np.array([[0.9, 0.4, 0.3], [0.9, 0.4, 0.31]])))
    first = scan(cell, "table top.ply")
    assert first.exit_code == 0, first.output
    assert "34.6 mm" in first.output
    text = cell.read_text()
    (cell.parent / "table top.ply").write_bytes(points_ply(np.array([[-0.9, 0.4, 0.5]])))
    assert scan(cell, "table top.ply").exit_code == 0
    assert cell.read_text() == text
    (shape,) = load_cell(cell).surroundings.keep_out
    assert shape.upper[0] < -0.8
    again = scan(cell, "table top.ply", "--cell-size", 0.05)
    assert again.exit_code == 1
    assert "cell_m = 0.02" in again.output
    checked = CliRunner().invoke(main, ["cell", "check", str(cell)])
    assert "lab-scan-table-top.ply, 0.02 × 0.02 × 0.02 m, as a box, at most 34.6 mm beyond its points" in checked.output


def test_a_scan_of_the_arm_alone_adds_nothing(cell: Path) -> None:
    text = cell.read_text()
    (cell.parent / "arm.ply").write_bytes(points_ply(np.array([[0.0, 0.0, 0.1], [0.5, 0.5, 0.01]])))
    done = scan(cell, "arm.ply")
    assert done.exit_code == 1
    assert "nothing is left of it: 1 cells on the floor" in done.output
    assert cell.read_text() == text
    assert not list(cell.parent.glob("lab-scan*"))

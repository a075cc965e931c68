"""`fling calibrate camera`: from touched points to a file that `fling.Camera` reads, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import fling
from api.cli import main
from tests.learning.test_hand_eye import drawn

HEADER = "seen_x_m,seen_y_m,seen_z_m,touched_x_m,touched_y_m,touched_z_m"


def written(folder: Path, rows: list[str], header: str = HEADER) -> str:
    file = folder / "points.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return str(file)


def lines(seen: np.ndarray, touched: np.ndarray) -> list[str]:
    return [",".join(map(repr, [*s.tolist(), *t.tolist()])) for s, t in zip(seen, touched, strict=True)]


def test_the_camera_is_written_and_read(tmp_path: Path) -> None:
    X_WC, seen, touched = drawn(5, 10)
    out = tmp_path / "camera.json"
    file = written(tmp_path, lines(seen, touched))
    done = CliRunner().invoke(main, ["calibrate", "camera", file, "--out", str(out), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.output)
    camera = fling.Camera.load(out)
    for name, value in camera.document().items():
        assert value == pytest.approx(told[name], abs=1e-12)
    assert pytest.approx(X_WC, abs=5e-3) == camera.X_WC
    assert 0.0005 < camera.std_m < 0.002
    assert np.linalg.norm(camera.in_world(seen) - touched, axis=1) == pytest.approx(told["residuals_m"], abs=1e-9)
    assert camera.in_world(seen[0]) == pytest.approx(camera.in_world(seen)[0])


def test_residuals_and_a_slip_are_told(tmp_path: Path) -> None:
    _, seen, touched = drawn(3, 10)
    touched[6] += [0.03, 0.0, 0.0]
    done = CliRunner().invoke(main, ["calibrate", "camera", written(tmp_path, lines(seen, touched))])
    assert done.exit_code == 0, done.output
    assert "point 7 is far off while the others agree" in done.output


def test_a_line_that_is_no_point_is_named(tmp_path: Path) -> None:
    file = written(tmp_path, ["0.1,0.2,0.3,0.4,0.5,left"])
    done = CliRunner().invoke(main, ["calibrate", "camera", file])
    assert done.exit_code != 0
    assert "line 2: touched_z_m = 'left' is not a number" in done.output
    done = CliRunner().invoke(main, ["calibrate", "camera", written(tmp_path, [], "x,y,z")])
    assert "the first line lacks seen_x_m" in done.output


def test_a_file_that_is_no_camera_is_refused(tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text('{"position_m": [1, 2]}')
    with pytest.raises(fling.FileRefused, match=r"other\.json: is no camera"):
        fling.Camera.load(tmp_path / "other.json")
    (tmp_path / "other.json").write_text('{"position_m": [1, 2, 3], "std_m": 0.0}')
    with pytest.raises(fling.FileRefused, match="it lacks 'rotation_vector_rad'"):
        fling.Camera.load(tmp_path / "other.json")


def test_a_camera_that_sees_nothing_says_so() -> None:
    camera = fling.Camera(np.eye(4))
    assert camera.in_world([]).shape == (0, 3)
    with pytest.raises(ValueError, match="three coordinates"):
        camera.in_world([[0.1, 0.2]])
    with pytest.raises(ValueError, match="three coordinates"):
        camera.in_world([0.1, 0.2, float("nan")])

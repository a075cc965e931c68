"""What the executor makes of a cell file that changes under it."""

from __future__ import annotations

from pathlib import Path

import pytest
import trimesh

from audit.judge.published_arms import published_file
from executor.cell_watch import CellWatch
from planner.cell import load_cell
from tests.executor.conftest import CELLS


@pytest.fixture
def path(tmp_path: Path) -> Path:
    file = tmp_path / "cell.toml"
    file.write_bytes((CELLS / "ur5e-sim.toml").read_bytes())
    return file


def watch_of(path: Path) -> CellWatch:
    return CellWatch(load_cell(path), path)


def test_an_unchanged_file_is_nothing_new(path: Path) -> None:
    watch = watch_of(path)
    assert [watch.look(), watch.look(), watch.fault] == [None, None, None]
    path.write_bytes(path.read_bytes())  # written again with the same content
    assert watch.look() is None


def test_a_change_is_noticed_once_also_one_before_the_first_look(path: Path) -> None:
    watch = watch_of(path)
    text = path.read_text()
    path.write_text(text.replace("delay_s = 0.040", "delay_s = 0.055", 1))
    changed = watch.look()
    assert changed is not None
    assert changed.gripper.delay_s == 0.055
    assert watch.look() is None
    path.write_text(text)
    again = watch.look()
    assert again is not None
    assert again.gripper.delay_s == 0.040


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("delay_s = 0.040", "delay_s = -1", "gripper.delay_s = -1: must lie in"),
        ("[gripper]", "[gripper", "is not TOML"),
        ("floor_z_m = 0.0", "floor_z_m = 0.9", "home_rad"),
    ],
)
def test_a_broken_file_is_a_fault_until_it_is_repaired(path: Path, old: str, new: str, words: str) -> None:
    watch = watch_of(path)
    text = path.read_text()
    path.write_text(text.replace(old, new, 1))
    assert watch.look() is None
    assert watch.fault is not None
    assert watch.fault["outcome"] == "cell_file"
    assert words in watch.fault["reason"]
    path.write_text(text)
    assert watch.look() is None  # what the executor still has
    assert watch.fault is None


def test_a_file_that_is_gone_is_a_fault(path: Path) -> None:
    watch = watch_of(path)
    text = path.read_text()
    path.unlink()
    assert watch.look() is None
    assert watch.fault is not None
    assert "No such file" in watch.fault["reason"]
    path.write_text(text + "\n# back\n")
    assert watch.look() is not None
    assert watch.fault is None


def test_a_change_of_the_calibration_file_is_noticed(path: Path) -> None:
    published = published_file("ur5e", "default_kinematics").read_text()
    calibration = path.with_name("arm.yaml")
    calibration.write_text(published)
    path.write_text(path.read_text() + '\n[kinematics]\ncalibration = "arm.yaml"\n')
    watch = watch_of(path)
    assert watch.look() is None
    calibration.write_text(published.replace("z: 0.1625", "z: 0.1627"))
    changed = watch.look()
    assert changed is not None
    assert changed.robot.d[0] == pytest.approx(0.1627)
    calibration.unlink()
    assert watch.look() is None
    assert watch.fault is not None
    assert "arm.yaml" in watch.fault["reason"]
    calibration.write_text(published)
    assert watch.look() is not None
    assert watch.fault is None


@pytest.mark.slow
def test_another_mesh_is_a_change(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    entry = '{ shape = "mesh", file = "part.stl", pose = { position_m = [1.5, 1.5, 0.5] } }'
    path.write_text(path.read_text().replace("keep_out = []", f"keep_out = [{entry}]"))
    mesh = tmp_path / "part.stl"
    mesh.write_bytes(trimesh.creation.box((0.2, 0.2, 0.2)).export(file_type="stl"))
    watch = watch_of(path)
    assert watch.look() is None
    mesh.write_bytes(trimesh.creation.box((0.3, 0.2, 0.2)).export(file_type="stl"))
    changed = watch.look()
    assert changed is not None
    assert changed.surroundings.keep_out[0].extent == pytest.approx([0.3, 0.2, 0.2])
    mesh.unlink()
    assert watch.look() is None
    assert watch.fault is not None
    assert "part.stl" in watch.fault["reason"]

"""Versions of a cell: kept, named by plans, compared and restored."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
import trimesh
from click.testing import CliRunner

from api.cli import main
from planner.cell import CellSource, cell_of
from store import Store
from tests.api.conftest import ROOT, RunningService
from tests.api.test_bad_input import problem_of
from tests.planner.calibration.arms import UR5E_FILE

DRIVER_FILE = UR5E_FILE.decode()


@pytest.fixture
def changed(service: RunningService):
    """Changes the cell that tests may change, and takes the change back."""
    path = service.settings.cells / "changing.toml"
    before = path.read_text()
    yield lambda old, new: path.write_text(before.replace(old, new))
    path.write_text(before)


def test_plans_name_the_version_and_the_history_says_what_changed(service: RunningService, changed):
    first = service.plan(cell="changing")["cell_version"]
    changed("lag_s = 0.02 ", "lag_s = 0.021 ")
    answer = service.client.get("/cells/changing/history").json()
    newest, before = answer["versions"][:2]
    assert (newest["version"], before["version"]) == (first + 1, first)
    assert newest["seen_by"] == "service"
    assert {c["key"]: (c["before"], c["after"]) for c in newest["changes"]}["timing.lag_s"] == (0.020, 0.021)
    assert service.plan(cell="changing")["cell_version"] == first + 1
    profile = service.client.post("/cells/changing/profiles").json()
    assert profile["cell_version"] == first + 1
    changed("robot =", "nonsense =")
    assert service.client.get("/cells/changing/history").json()["versions"][0]["version"] == first + 1
    problem_of(service.client.get("/cells/nowhere/history"), 404, "not-found")


@pytest.fixture
def fling(tmp_path: Path):
    """Runs a command on a cell and a store of its own."""
    shutil.copy(ROOT / "cells" / "ur5e-sim.toml", tmp_path / "mine.toml")
    environment = {
        "FLING_CELLS": str(tmp_path),
        "FLING_DEFAULT_CELL": "mine",
        "FLING_DATABASE_URL": f"sqlite:///{tmp_path / 'fling.db'}",
    }
    return lambda *arguments: CliRunner().invoke(main, ["cell", *arguments], env=environment)


def test_history_diff_and_restore_on_the_command_line(fling, tmp_path: Path):
    path = tmp_path / "mine.toml"
    original = path.read_bytes()
    assert json.loads(fling("history", "--json").output)["versions"][0]["version"] == 1
    path.write_bytes(original.replace(b"mass_kg = 1.0", b"mass_kg = 1.25"))
    assert "tool.mass_kg: 1.0 -> 1.25" in fling("history").output
    shown = fling("diff", "1").output
    assert "-mass_kg = 1.0" in shown
    assert "+mass_kg = 1.25" in shown
    assert fling("diff", "2", "2").output == ""
    assert "version 1" in fling("restore", "1").output
    assert path.read_bytes() == original
    versions = json.loads(fling("history", "--json").output)["versions"]
    assert [row["version"] for row in versions] == [3, 2, 1]
    assert versions[0]["sha256"] == versions[2]["sha256"]


def test_a_file_that_is_refused_is_kept_beside_the_restored_one(fling, tmp_path: Path):
    path = tmp_path / "mine.toml"
    assert fling("history").exit_code == 0
    path.write_text("nonsense = 1\n")
    done = fling("restore", "1")
    assert done.exit_code == 0
    assert (tmp_path / "mine.toml.refused").read_text() == "nonsense = 1\n"
    assert "mass_kg" in path.read_text()


def test_a_calibration_file_is_restored_with_its_cell(fling, tmp_path: Path):
    path = tmp_path / "mine.toml"
    beside = tmp_path / "arm.yaml"
    plain = path.read_text()
    path.write_text(plain + '\n[kinematics]\ncalibration = "arm.yaml"\n')
    beside.write_text(DRIVER_FILE)
    assert fling("history").exit_code == 0
    beside.write_text(DRIVER_FILE.replace("calib_", "other_"))
    assert "calibration file" in fling("diff", "1").output
    assert "with arm.yaml" in fling("restore", "1").output
    assert beside.read_text() == DRIVER_FILE


def test_a_version_that_is_not_there_is_named(fling):
    done = fling("restore", "7")
    assert done.exit_code == 1
    assert "there is no version 7; there are 1 to 1" in done.output


def test_the_store_has_the_text_of_each_version(fling, tmp_path: Path):
    fling("history")
    store = Store.open(f"sqlite:///{tmp_path / 'fling.db'}")
    assert store.cell_versions("mine")[0].text == (tmp_path / "mine.toml").read_bytes()
    store.close()


@pytest.mark.slow
def test_a_version_knows_its_meshes_and_says_where_a_file_is_another_now(fling, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "mine.toml"
    entry = '{ shape = "mesh", file = "part.stl", pose = { position_m = [1.5, 1.5, 0.5] } }'
    path.write_text(re.sub(r"keep_out = \[\]", f"keep_out = [{entry}]", path.read_text()))
    for edge_m in (0.2, 0.3):
        (tmp_path / "part.stl").write_bytes(trimesh.creation.box((edge_m, 0.2, 0.2)).export(file_type="stl"))
        assert fling("history").exit_code == 0
    assert '"mesh files"' in fling("history", "--json").output
    store = Store.open(f"sqlite:///{tmp_path / 'fling.db'}")
    newest, _ = store.cell_versions("mine")
    store.close()
    (block,) = cell_of(CellSource("mine", newest.text, None, newest.meshes)).surroundings.keep_out
    assert block.extent == pytest.approx([0.3, 0.2, 0.2])
    assert "put back that of version 1" in fling("restore", "1").output
    assert "put back" not in fling("restore", "2").output

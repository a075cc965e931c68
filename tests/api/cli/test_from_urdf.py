"""`fling cell from-urdf`: the files it writes pass `cell check`, and what is there stays."""

import json
import os

import numpy as np
import pytest
from click.testing import CliRunner

from api.cli import main
from planner.cell import load_cell
from tests.planner.urdf_files import urdf_text

OFFSETS = np.zeros((6, 6))
OFFSETS[2] = [4e-4, 0.0, 2e-4, 1e-3, 0.0, 0.0]


def fling(*arguments):
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


@pytest.fixture
def urdf(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "my lab.urdf"
    path.write_text(urdf_text("ur10e", offsets=OFFSETS))
    return path


def test_its_files_are_a_cell(urdf, tmp_path):
    found = fling("cell", "from-urdf", urdf)
    assert found.exit_code == 0, found.output
    assert "a ur10e, simulated" in found.output
    assert "ur10e and ur12e" in found.output
    assert "home" not in found.output
    checked = fling("cell", "check", tmp_path / "my-lab.toml")
    assert checked.exit_code == 0, checked.output
    cell = load_cell(tmp_path / "my-lab.toml")
    assert cell.calibration is not None
    assert cell.calibration.name == "my-lab-kinematics.yaml"


def test_it_writes_nothing_over(urdf, tmp_path):
    (tmp_path / "my-lab-kinematics.yaml").write_text("mine")
    found = fling("cell", "from-urdf", urdf)
    assert found.exit_code == 1
    assert "is there already" in found.output
    assert (tmp_path / "my-lab-kinematics.yaml").read_text() == "mine"
    assert not (tmp_path / "my-lab.toml").exists()


def test_a_file_that_cannot_be_written_leaves_none(urdf, tmp_path, monkeypatch):
    opened = os.open
    monkeypatch.setattr(
        os, "open", lambda path, *rest: opened("/dev/full/x" if path.suffix == ".toml" else path, *rest)
    )
    found = fling("cell", "from-urdf", urdf)
    assert found.exit_code == 1
    assert "cannot be written" in found.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["my lab.urdf"]


def test_a_folder_that_is_missing_is_named(urdf, tmp_path):
    found = fling("cell", "from-urdf", urdf, "--out", "cells/plant.toml")
    assert found.exit_code == 1
    assert "cells/plant.toml cannot be written: there is no folder cells" in found.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["my lab.urdf"]


def test_a_table_is_in_the_file_and_on_the_terminal(urdf, tmp_path):
    table = (
        '<link name="table"><collision><origin xyz="0 0 -0.4"/><geometry><box size="1 1 0.8"/></geometry></collision>'
        '<collision><geometry><mesh filename="rail.stl"/></geometry></collision></link><joint name="to_table"'
        ' type="fixed"><parent link="base_link"/><child link="table"/><origin rpy="0 0 -0.5"/></joint></robot>'
    )
    urdf.write_text(urdf_text("ur10e").replace("</robot>", table))
    found = fling("cell", "from-urdf", urdf)
    assert found.exit_code == 0, found.output
    assert "surroundings.keep_out has the shapes of table" in found.output
    assert "the shape of table (a mesh) is not taken over" in found.output
    assert "home" not in found.output
    (box,) = load_cell(tmp_path / "my-lab.toml").surroundings.keep_out
    np.testing.assert_allclose([box.lower, box.upper], [[-0.2, -0.7, 0.0], [0.8, 0.3, 0.8]], atol=1e-9)


def test_a_file_name_may_hold_bytes_that_are_no_text(tmp_path):
    path = tmp_path / os.fsdecode(b"lab\xff.urdf")
    path.write_text(urdf_text("ur5e"))
    found = fling("cell", "from-urdf", path, "--out", tmp_path / "lab.toml")
    assert found.exit_code == 0, found.output
    assert load_cell(tmp_path / "lab.toml").robot.name == "ur5e"


def test_it_answers_in_json(urdf, tmp_path):
    found = fling("cell", "from-urdf", urdf, "--robot", "ur12e", "--out", tmp_path / "b.toml", "--json")
    answer = json.loads(found.output)
    assert (answer["cell"], answer["robot"]) == ("b", "ur12e")
    assert [path.rsplit("/", 1)[1] for path in answer["files"]] == ["b.toml", "b-kinematics.yaml"]
    refused = fling("cell", "from-urdf", urdf, "--robot", "ur3e", "--out", tmp_path / "c.toml", "--json")
    assert refused.exit_code == 1
    assert "is no ur3e" in json.loads(refused.output)["detail"]
    missing = fling("cell", "from-urdf", tmp_path / "missing.urdf")
    assert (missing.exit_code, missing.output.count("\n")) == (1, 1)

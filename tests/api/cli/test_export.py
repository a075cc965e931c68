"""`fling export`: a plan as a program for the pendant, which the simulated controller runs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

import fling
from api.cli import main
from planner.cell import load_cell
from store import plan_sha256, split_plan
from tests.executor.conftest import CELLS, prepare
from tests.simulator.conftest import Driven


@pytest.fixture(scope="module")
def plan() -> dict[str, Any]:
    return json.loads(prepare("ur5e-sim").document)


def exported(folder: Path, plan: dict[str, Any]) -> Result:
    file = folder / "plan.json"
    file.write_text(json.dumps(plan))
    return CliRunner().invoke(main, ["export", "--urscript", str(file), "--cells", str(CELLS)])


def test_the_program_says_what_it_is_and_makes_the_motion(tmp_path: Path, plan: dict[str, Any]) -> None:
    result = exported(tmp_path, plan)
    assert result.exit_code == 0, result.output
    text = (tmp_path / "plan.script").read_text()
    cell = load_cell(CELLS / "ur5e-sim.toml")
    head = text.split("def ")[0]
    assert plan["id"] in head
    assert plan_sha256(plan["id"], *split_plan(json.dumps(plan, separators=(",", ":")).encode())) in head
    assert f"cell ur5e-sim (ur5e), sha256 {cell.sha256}" in head
    assert "there is no dead-man" in head
    assert "sets tool_digital 0 to True" in head
    driven = Driven(cell, script=text)
    fastest = 0.0
    while driven.controller.runner.playing:
        driven.cycle()
        fastest = max(fastest, *map(abs, driven.arm.qd))
    assert fastest == pytest.approx(np.abs(plan["trajectory"]["velocities"]).max(), abs=0.01)
    assert driven.arm.q == pytest.approx(plan["trajectory"]["positions"][-1], abs=1e-3)


def test_a_plan_of_another_version_of_the_cell_is_refused(tmp_path: Path, plan: dict[str, Any]) -> None:
    result = exported(tmp_path, {**plan, "cell_sha256": "0" * 64})
    assert result.exit_code == 1
    assert "another version of cell 'ur5e-sim'" in result.output


def test_a_plan_that_fails_its_certificate_is_refused(tmp_path: Path, plan: dict[str, Any]) -> None:
    positions = plan["trajectory"]["positions"]
    spoilt = {**plan["trajectory"], "positions": [*positions[:100], positions[0], *positions[101:]]}
    result = exported(tmp_path, {**plan, "trajectory": spoilt})
    assert result.exit_code == 1
    assert "fails its certificate: " in result.output
    assert not (tmp_path / "plan.script").exists()


def test_what_is_no_plan_is_refused(tmp_path: Path, plan: dict[str, Any]) -> None:
    result = exported(tmp_path, {"title": "Infeasible"})
    assert result.exit_code == 1
    assert "the answer to a request that was refused" in result.output


def test_a_plan_that_waits_for_a_target_that_moves_is_refused(tmp_path: Path) -> None:
    """The pendant would start it at any time."""
    release = {"kind": "target", "position": [1.1, -0.5, 0.0], "velocity": [0.0, 0.4, 0.0], "observed_at_s": 1000.0}
    made = fling.plan({"release": release, "starts_not_before_s": 1000.5}, load_cell(CELLS / "ur5e-sim.toml"))
    result = exported(tmp_path, dict(made.document))
    assert result.exit_code == 1
    assert "for a target that moves" in result.output
    assert not (tmp_path / "plan.script").exists()

"""The simulator's command-line options, as the settings that they become."""

from __future__ import annotations

from pathlib import Path

import pytest

from planner.errors import CellError
from simulator.__main__ import cell_of, parse, settings_of
from simulator.controller import identity_of
from simulator.settings import SimulatorSettings
from tests.simulator.conftest import Driven, cell_text, make_cell


@pytest.mark.parametrize(("options", "noisy"), [([], True), (["--no-noise"], False)])
def test_noise_can_be_switched_off(options: list[str], noisy: bool):
    cell = make_cell()
    driven = Driven(cell, settings_of(parse(["--cell", "x.toml", *options]), cell))
    driven.cycle(10)
    assert (driven.arm.measured_q != driven.arm.true_q) is noisy
    assert (driven.arm.measured_qd != driven.arm.true_qd) is noisy


@pytest.mark.parametrize(
    ("options", "version"),
    [([], (5, 11, 1)), (["--polyscope", "x"], (10, 14, 0)), (["--polyscope", "10.12.1"], (10, 12, 1))],
)
def test_the_version_is_that_of_the_cell_or_the_one_asked_for(
    tmp_path: Path, options: list[str], version: tuple[int, int, int]
) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(cell_text())
    cell = cell_of(parse(["--cell", str(path), *options]))
    assert identity_of(cell, SimulatorSettings()).version == version


@pytest.mark.parametrize("asked", ["x", "ten"])
def test_a_version_that_the_arm_cannot_have_is_refused(tmp_path: Path, asked: str) -> None:
    path = tmp_path / "cell.toml"
    path.write_text(cell_text("ur5"))
    with pytest.raises(CellError, match=r"sim\.polyscope"):
        cell_of(parse(["--cell", str(path), "--polyscope", asked]))

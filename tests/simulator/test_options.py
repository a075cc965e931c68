"""The simulator's command-line options, as the settings that they become."""

from __future__ import annotations

import pytest

from simulator.__main__ import parse, settings_of
from tests.simulator.conftest import Driven, make_cell


@pytest.mark.parametrize(("options", "noisy"), [([], True), (["--no-noise"], False)])
def test_noise_can_be_switched_off(options: list[str], noisy: bool):
    cell = make_cell()
    driven = Driven(cell, settings_of(parse(["--cell", "x.toml", *options]), cell))
    driven.cycle(10)
    assert (driven.arm.measured_q != driven.arm.true_q) is noisy
    assert (driven.arm.measured_qd != driven.arm.true_qd) is noisy

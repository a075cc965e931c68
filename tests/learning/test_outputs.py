"""Delay and jitter of outputs from edges that are told once a tick."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from learning import cell_with_profile
from learning.outputs import delay_between, learnt_outputs
from planner.cell import Cell, cell_of_keys

TICK_S = 0.002
LAG_S = 0.02
OUTPUTS = {
    "valve": {"output": "standard_digital", "index": 2, "delay_s": 0.004, "sense_input": 5},
    "lamp": {"output": "standard_digital", "index": 3, "delay_s": 0.001, "jitter_s": 0.0005},
}


def cell() -> Cell:
    return cell_of_keys({"robot": "ur5e", "link": {"kind": "sim"}, "timing": {"lag_s": LAG_S}, "outputs": OUTPUTS})


def spans(delays: np.ndarray, tick_s: float = TICK_S) -> np.ndarray:
    """Returns between which states delays end (n, 2) [s]."""
    seen = np.ceil(delays / tick_s) * tick_s
    return np.stack([seen - tick_s, seen], axis=1)


@pytest.mark.parametrize("jitter_s", [0.0, 0.0005, 0.002])
@pytest.mark.parametrize("tick_s", [0.002, 0.008])
def test_the_standard_errors_are_those_of_the_errors(tick_s: float, jitter_s: float) -> None:
    rng = np.random.default_rng(61)
    off = []
    for _ in range(40):
        mean_s = rng.uniform(0.02, 0.05)
        found, std_s, *_ = delay_between(spans(mean_s + jitter_s * rng.normal(size=64), tick_s))
        assert std_s <= 1.1 * tick_s / 12**0.5 + jitter_s / 8.0  # never worse than one tick, evenly distributed
        off.append((found - mean_s) / std_s)
    assert 0.6 < np.std(off) < 1.4
    assert abs(np.mean(off)) < 0.5


def test_a_scatter_of_more_than_half_a_tick_shows_the_delay_within_a_tenth_of_a_millisecond() -> None:
    delays = 0.0313 + 0.0015 * np.random.default_rng(3).normal(size=600)
    mean_s, mean_std_s, jitter_s, jitter_std_s = delay_between(spans(delays))
    assert mean_s == pytest.approx(0.0313, abs=0.0002)
    assert mean_std_s < 0.0001
    assert jitter_s == pytest.approx(0.0015, abs=3.0 * jitter_std_s)
    assert jitter_std_s < 0.0001


def run(delays: np.ndarray, pulse_s: float = 0.25, index: int = 2, sense_input: int | None = 5) -> list[dict[str, Any]]:
    """Returns the outputs of a run in which one was told by turns to switch on and off."""
    found = []
    for i, (after_s, seen_s) in enumerate(spans(delays)):
        at_s = i * pulse_s - 0.1
        edge = {
            "passage": "valve",
            "output": "standard_digital",
            "index": index,
            "level": i % 2 == 0,
            "sense_input": sense_input,
        }
        times = {"command_time_s": at_s, "edge_after_s": at_s + after_s, "edge_time_s": at_s + seen_s}
        found.append(edge | times)
    return found


def test_an_output_is_learnt_from_the_edges_of_its_input() -> None:
    rng = np.random.default_rng(5)
    runs = [run(0.0313 + 0.001 * rng.normal(size=8)) for _ in range(10)]
    other = run(np.full(8, 0.09))
    unseen = [each | {"edge_time_s": None, "edge_after_s": None} for each in other]
    unsent = [each | {"command_time_s": None} for each in unseen]
    hasty = run(np.full(8, 0.06), pulse_s=0.04)
    stopped = [each | {"passage": None} for each in run(np.full(8, 0.5), pulse_s=1.0)]
    elsewhere = run(np.full(8, 0.06), index=3) + run(np.full(8, 0.06), sense_input=6)
    found = learnt_outputs(cell(), [*runs, unseen, unsent, hasty, stopped, elsewhere, []], lag_s=0.022)
    assert set(found) == {"valve"}
    assert found["valve"]["edges"] == 80
    assert found["valve"]["delay_s"] == pytest.approx(0.0313 - 0.022, abs=0.0004)
    assert found["valve"]["jitter_s"] == pytest.approx(0.001, rel=0.3)


def test_a_reported_edge_of_the_controller_teaches_nothing() -> None:
    assert learnt_outputs(cell(), [run(np.full(8, 0.02), sense_input=None)], LAG_S) == {}


def test_a_cell_with_a_profile_has_the_learnt_delays() -> None:
    here = cell()
    numbers = {"lag_s": 0.021, "delay_s": 0.04, "jitter_s": 0.001, "drag_coefficient": 0.0}
    learnt = {"valve": {"delay_s": 0.0093, "delay_std_s": 1e-4, "jitter_s": 0.0012, "jitter_std_s": 1e-4, "edges": 80}}
    used = cell_with_profile(here, {**numbers, "outputs": {**learnt, "gone": learnt["valve"]}})
    assert (used.outputs["valve"].delay_s, used.outputs["valve"].jitter_s) == (0.0093, 0.0012)
    assert used.outputs["valve"].sense_input == 5
    assert used.outputs["lamp"] == here.outputs["lamp"]
    assert used.sha256 == here.sha256
    assert cell_with_profile(here, numbers).outputs == here.outputs

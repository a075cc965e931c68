"""The truth file: every key, every refusal, and nothing that a client could learn of it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from simulator.control_operations import control_operations
from simulator.settings import SimulatorSettings
from simulator.simulation import Simulation
from simulator.truth import GripperOpening, Truth, TruthError, load_truth, truth_of
from tests.simulator.conftest import make_cell, unique_address

VALVE = '[outputs.valve]\noutput = "standard_digital"\nindex = 2\ndelay_s = 0.006\njitter_s = 0.001\n'
EVERY_KEY = """
seed = 7
[timing]
lag_s = 0.026
first_order_s = 0.002
gain = [1.02, 1.02, 1.01, 1.0, 1.0, 1.0]
output_delay_s = 0.004
[gripper]
delay_s = 0.052
jitter_s = 0.003
jitter_shape = "skewed"
drift_s_per_throw = 0.00005
[release]
speed_factor = 0.98
cling_share = 0.08
cling_speed_factor = 0.95
[object]
drag_coefficient = 0.4
[arm]
disturbance = "ur5-measured"
overshoot = [0.01, 0.02, 0.03, 0.0, 0.0, 0.0]
base_offset_m = [0.004, -0.003, 0.002]
base_rotation_vector_rad = [0.0, 0.0, 0.006]
dh_deviation = { a_m = [0, 0.001, 0, 0, 0, 0], d_m = [0.002, 0, 0, 0, 0, 0], alpha_rad = [0, 0.003, 0, 0, 0, 0], theta_rad = [0, 0, 0.004, 0, 0, 0] }
[camera]
std_m = 0.003
outlier_share = 0.05
outlier_std_m = 0.2
[outputs.valve]
delay_s = 0.0123
jitter_s = 0.0004
"""  # noqa: E501


def read(folder: Path, text: str, **cell: Any) -> Truth:
    (folder / "truth.toml").write_text(text)
    return load_truth(folder / "truth.toml", make_cell(**cell))


def test_every_key_is_read(tmp_path: Path) -> None:
    truth = read(tmp_path, EVERY_KEY, tables=VALVE)
    assert truth.seed == 7
    assert truth.timing.lag_s == 0.026
    assert truth.timing.first_order_s == (0.002,) * 6
    assert truth.timing.gain == (1.02, 1.02, 1.01, 1.0, 1.0, 1.0)
    assert truth.timing.output_delay_s == 0.004
    assert vars(truth.gripper) == {
        "delay_s": 0.052,
        "jitter_s": 0.003,
        "jitter_shape": "skewed",
        "drift_s_per_throw": 0.00005,
    }
    assert vars(truth.release) == {"speed_factor": 0.98, "cling_share": 0.08, "cling_speed_factor": 0.95}
    assert truth.drag_coefficient == 0.4
    assert truth.arm.disturbance == "ur5-measured"
    assert truth.arm.overshoot == (0.01, 0.02, 0.03, 0.0, 0.0, 0.0)
    assert truth.arm.base_offset_m == (0.004, -0.003, 0.002)
    assert truth.arm.base_rotation_vector_rad == (0.0, 0.0, 0.006)
    deviation = truth.arm.dh_deviation
    assert deviation is not None
    nonzero = [max(values) for values in (deviation.a_m, deviation.d_m, deviation.alpha_rad, deviation.theta_rad)]
    assert nonzero == [0.001, 0.002, 0.003, 0.004]
    assert {name: vars(each) for name, each in truth.outputs.items()} == {
        "valve": {"delay_s": 0.0123, "jitter_s": 0.0004}
    }
    assert vars(truth.camera) == {"std_m": 0.003, "outlier_share": 0.05, "outlier_std_m": 0.2}
    assert truth.hidden


def test_what_is_absent_is_as_in_the_cell(tmp_path: Path) -> None:
    sim = {"lag_s": 0.017, "gripper_delay_s": 0.031, "gripper_jitter_s": 0.001, "seed": 5}
    truth = read(tmp_path, "", **sim)
    assert vars(truth) == {**vars(truth_of(make_cell(**sim))), "hidden": True}
    assert (truth.timing.lag_s, truth.timing.output_delay_s) == (0.017, 0.017)
    assert (truth.gripper.delay_s, truth.gripper.jitter_s, truth.seed) == (0.031, 0.001, 5)


@pytest.mark.parametrize(("output_delay_s", "own_s"), [(0.02, 0.006), (0.022, 0.004), (0.03, 0.0)])
def test_what_an_output_switches_is_as_late_as_the_cell_says(tmp_path: Path, output_delay_s: float, own_s: float):
    truth = read(tmp_path, f"[timing]\nlag_s = 0.02\noutput_delay_s = {output_delay_s}", tables=VALVE)
    assert truth.outputs["valve"].delay_s == pytest.approx(own_s)
    assert truth.outputs["valve"].jitter_s == 0.001


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sneed = 1", "sneed: unknown key; did you mean 'seed'?"),
        ("seed = 1.5", "seed = 1.5: must be a whole number"),
        ("[timing]\nlag = 0.02", "timing.lag: unknown key"),
        ("[timing]\nlag_s = 0.001", "timing.lag_s = 0.001: must lie in [0.002, 0.5]"),
        ("[timing]\nlag_s = 0.006\nfirst_order_s = 0.005", "timing.first_order_s = 0.005: must lie in [0, 0.004]"),
        ("[timing]\ngain = [1, 1, 1, 1, 1, 3]", "timing.gain[5] = 3: must lie in [0.5, 1.5]"),
        ("[timing]\ngain = [1, 1]", "timing.gain = [1, 1]: must be a list of 6 numbers"),
        ("[gripper]\ndelay_s = -0.01", "gripper.delay_s = -0.01: must lie in [0, 5]"),
        ('[gripper]\njitter_shape = "flat"', "must be one of gaussian, skewed, quantised"),
        ("[gripper]\njitter_s = nan", "gripper.jitter_s = nan: must be finite"),
        ("[release]\ncling_share = 1.1", "release.cling_share = 1.1: must lie in [0, 1]"),
        ("[object]\ndrag_coefficient = 'high'", "object.drag_coefficient = 'high': must be a number"),
        ('[arm]\ndisturbance = "ur10"', "must be one of none, ur5-measured"),
        ("[arm]\ndh_deviation = { b_m = [0, 0, 0, 0, 0, 0] }", "arm.dh_deviation.b_m: unknown key"),
        ("[arm]\ndh_deviation = 3", "arm.dh_deviation = 3: must be a table"),
        ("[arm]\ndh_deviation = { d_m = [0, 0, 0, 0, 0, 2] }", "arm.dh_deviation.d_m[5] = 2: must lie in [-1, 1]"),
        ("[camera]\nstd_m = true", "camera.std_m = True: must be a number"),
        ("[outputs.lamp]\ndelay_s = 0.001", "outputs.lamp: unknown key"),
        ("[feeder]\nreach_m = 0.01", "feeder.places: must be a list of 1 to 1000 positions [x, y, z]"),
        ("[feeder]\nplaces = []", "feeder.places = []: must be a list of 1 to 1000"),
        ("[feeder]\nplaces = [[0, 0, 0], [0, 0]]", "feeder.places[1] = [0, 0]: must be a list of 3 numbers"),
        ("[feeder]\nplaces = [[0, 0, 1e3]]", "feeder.places[0][2] = 1000.0: must lie in [-100, 100]"),
        ("[feeder]\nplaces = [[0, 0, 0]]\nmissed = 3", "feeder.missed = 3: must lie in [0, 1]"),
        ("[feeder]\nplaces = [[0, 0, 0]]\nreach_m = 0", "feeder.reach_m = 0: must lie in [0.0001, 1]"),
        ("[feeder]\nplaces = [[0, 0, 0]]\nscatter_m = -1", "feeder.scatter_m = -1: must lie in [0, 1]"),
        ("[feeder]\nplaces = [[0, 0, 0]]\nrefill_s = -1", "feeder.refill_s = -1: must lie in [0, 86400]"),
        ("camera = 3", "camera = 3: must be a table"),
        ("[timing", "truth.toml"),
        ("a = " + "[" * 5000, "nests deeper than 32 levels"),
        ("[timing]\nlag_s" + ".a" * 40_000 + " = 1", "nests deeper than 32 levels"),
        ("# comment\n" * 20_000, "is larger than 100000 bytes"),
    ],
)
def test_what_cannot_be_is_refused_by_field_value_and_limit(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(TruthError) as refusal:
        read(tmp_path, text)
    assert words in str(refusal.value)
    assert str(tmp_path / "truth.toml") in str(refusal.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TruthError, match="No such file"):
        load_truth(tmp_path / "nothing.toml", make_cell())


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(TruthError, match="not a file"):
            load_truth(path, make_cell())


def answers(truth: Truth | None) -> dict[str, Any]:
    """Returns all answers of the control port after one throw from rest."""
    simulation = Simulation(make_cell(), SimulatorSettings(), unique_address(), truth)
    try:
        operations = control_operations(simulation, lambda: None)
        operations["expect_throw"]({})
        simulation.controller.take_inputs(_opening())
        for _ in range(500):
            simulation.tick()
        return {name: operations[name]({}) for name in ("state", "world", "stats", "events")}
    finally:
        simulation.network.close()


def _opening() -> Any:
    from simulator.interfaces import InputValues

    return InputValues(others={"tool_digital_output_mask": 1, "tool_digital_output": 1})


def test_a_feed_is_read_with_what_it_leaves_out(tmp_path: Path) -> None:
    (tmp_path / "truth.toml").write_text("[feeder]\nplaces = [[0.5, 0, 0.02], [0.6, 0, 0.02]]\nrefill_s = 3\n")
    cell = make_cell()
    found = load_truth(tmp_path / "truth.toml", cell).feed
    assert found is not None
    assert found.places == ((0.5, 0.0, 0.02), (0.6, 0.0, 0.02))
    assert (found.reach_m, found.scatter_m, found.refill_s, found.missed) == (cell.object.radius_m, 0.0, 3.0, 0.0)


def test_a_hidden_truth_shows_what_a_controller_and_a_camera_tell(tmp_path: Path) -> None:
    found = answers(read(tmp_path, "[camera]\nstd_m = 0.003\n"))
    assert set(found["world"]) == {"t", "hidden", "observations"}
    (observation,) = found["world"]["observations"]
    assert set(observation) == {"throw", "object", "surface", "position_m", "std_m"}
    assert found["state"]["hidden"] is True
    secret = {"q", "qd", "output_changes", "device_changes", "gripper_holds", "gripper_open", "moved_at"}
    assert secret.isdisjoint(found["state"])
    shown = answers(None)
    assert secret <= set(shown["state"])
    (release,) = shown["world"]["releases"]
    (landing,) = shown["world"]["landings"]
    assert release["throw"] == landing["throw"] == observation["throw"]
    assert shown["world"]["observations"][0]["position_m"] == landing["position_m"]
    error = [a - b for a, b in zip(observation["position_m"], landing["position_m"], strict=True)]
    assert 0.0 < max(map(abs, error)) < 0.02
    assert error[2] == 0.0


def test_a_jitter_that_reaches_below_no_delay_is_said():
    assert GripperOpening(0.02, 0.006).cut_short == ""
    assert "gripper.delay_s of 2 ms is less than 3 jitter_s of 5 ms" in GripperOpening(0.002, 0.005).cut_short

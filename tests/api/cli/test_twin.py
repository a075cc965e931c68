"""The timing twin: what a profile says is how the simulated controller behaves."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from api.cli import main
from api.cli.simulator import CONTROL_PORT
from api.cli.support.twin import truth_of_profile, truth_text
from benchmarks.learning.plans import benchmark_cell, planned_throws
from learning.throws import Circumstances, Throws, throw_table
from planner.cell import cell_of_keys
from simulator.truth import load_truth

PROFILE = {
    "lag_s": 0.0264,
    "gain": [1.02, 0.99, 1.01, None, 1.0, 1.0],
    "timing": {"first_order_s": [0.003, 0.002, None, 0.0, 0.5, -0.001]},
    "delay_s": 0.0521,
    "jitter_s": 0.0031,
    "speed_factor": 0.98,
    "cling_share": 0.02,
    "drag_coefficient": 0.3,
    "landing_offset_m": [0.004, -0.003],
    "base_turn_rad": 0.0021,
}

OUTPUTS = {"valve 1": {"delay_s": 0.006, "jitter_s": 0.001}, "lamp": {"delay_s": -0.012, "jitter_s": 0.0}}
WIRED = {
    "robot": "ur5e",
    "link": {"kind": "sim"},
    "outputs": {name: {"output": "standard_digital", "index": i} for i, name in enumerate(OUTPUTS)},
}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    file = tmp_path / "profile.json"
    file.write_text(json.dumps(PROFILE))
    return file


def test_a_twin_has_the_profiles_numbers(tmp_path: Path):
    path = tmp_path / "twin.toml"
    path.write_text(truth_text(truth_of_profile(PROFILE)))
    truth = load_truth(path, benchmark_cell())
    assert (truth.timing.lag_s, truth.timing.output_delay_s) == (0.0264, 0.0264)
    assert truth.timing.gain == (1.02, 0.99, 1.01, 1.0, 1.0, 1.0)
    assert truth.timing.first_order_s == (0.003, 0.002, 0.0, 0.0, 0.0132, 0.0)
    assert (truth.gripper.delay_s, truth.gripper.jitter_s) == (0.0521, 0.0031)
    assert (truth.release.speed_factor, truth.release.cling_share) == (0.98, 0.02)
    assert truth.drag_coefficient == 0.3
    assert truth.hidden


def test_a_negative_delay_makes_the_outputs_sooner_and_a_negative_lead_is_refused(tmp_path: Path):
    path = tmp_path / "twin.toml"
    path.write_text(truth_text(truth_of_profile({**PROFILE, "delay_s": -0.004})))
    truth = load_truth(path, benchmark_cell())
    assert truth.timing.output_delay_s + truth.gripper.delay_s == pytest.approx(0.0264 - 0.004)
    path.write_text(truth_text(truth_of_profile({**PROFILE, "delay_s": -0.004, "outputs": OUTPUTS})))
    truth = load_truth(path, cell_of_keys(WIRED))
    assert truth.timing.output_delay_s + truth.gripper.delay_s == pytest.approx(0.0264 - 0.004)
    for name, learnt in OUTPUTS.items():
        assert truth.timing.output_delay_s + truth.outputs[name].delay_s == pytest.approx(0.0264 + learnt["delay_s"])
        assert truth.outputs[name].jitter_s == learnt["jitter_s"]
    path.write_text(json.dumps({**PROFILE, "delay_s": -0.030}))
    result = CliRunner().invoke(main, ["sim", "--cell", "ur5e-sim", "--profile", str(path)])
    assert result.exit_code == 1
    assert "lag_s and delay_s sum to -3.6 ms" in result.output


def test_a_turned_and_shifted_base_means_the_same_to_estimator_and_simulator(tmp_path: Path):
    """The estimator turns and shifts landings; the simulator has a base that stands elsewhere."""
    arm = truth_of_profile(PROFILE)["arm"]
    (planned,) = planned_throws(1, (0.0,), "ruckig")
    throws = Throws([throw_table(planned.problem, planned.trajectory)])
    x, y, turn = *arm["base_offset_m"][:2], arm["base_rotation_vector_rad"][2]
    zero = np.zeros(1)
    one = np.ones(1)
    learnt = throws.landings(Circumstances(zero, one, np.array([[x, y]]), zero, np.array([turn])))[0]
    straight = throws.landings(Circumstances(zero, one, np.zeros((1, 2)), zero, zero))[0]
    base = planned.problem.cell.X_WB[:2, 3]
    c = np.cos(turn)
    s = np.sin(turn)
    moved = base + [x, y] + np.array([[c, -s], [s, c]]) @ (straight - base)  # about the base, then with it
    assert learnt == pytest.approx(moved, abs=1e-12)


@pytest.mark.slow
def test_the_simulated_controller_takes_a_profile(file: Path, root: Path):
    command = [sys.executable, "-c", "from api.cli import main; main()", "sim", "--cell", "ur5e-sim"]
    options = ["--profile", str(file), "--host", "127.0.40.7", "--no-remote-control", "--no-noise", "--strict-clock"]
    with subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True, cwd=root) as process:
        assert process.stdout is not None
        ready = process.stdout.readline()
        with socket.create_connection(("127.0.40.7", 29900), 5.0) as connection, connection.makefile("rw") as text:
            text.write('{"op": "world"}\n')
            text.flush()
            answer = json.loads(text.readline())
        process.terminate()
    assert re.match("ready: ur5e .* on 127.0.40.7", ready)
    assert answer["hidden"] is True


@pytest.mark.parametrize(
    ("content", "word"), [("{}", "lag_s"), ("no json", "is not a profile"), ("[1]", "is not a profile")]
)
def test_a_file_that_is_no_profile_is_refused(tmp_path: Path, content: str, word: str):
    file = tmp_path / "other.json"
    file.write_text(content)
    with socket.create_server(("127.0.40.8", CONTROL_PORT)):  # another simulator runs: the file is refused all the same
        arguments = ["--cell", "ur5e-sim", "--host", "127.0.40.8", "--profile", str(file)]
        result = CliRunner().invoke(main, ["sim", *arguments])
    assert result.exit_code == 1
    assert word in result.output


def test_a_twin_has_no_second_truth(file: Path, tmp_path: Path):
    truth = tmp_path / "truth.toml"
    truth.write_text("seed = 1\n")
    result = CliRunner().invoke(main, ["sim", "--profile", str(file), "--truth", str(truth)])
    assert result.exit_code != 0
    assert "--profile is a truth of its own" in result.output

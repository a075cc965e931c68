"""A controller whose robot is not the cell's: refused before anything moves, with both names."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from executor.robot import simulator_client
from tests.system.rig import NUDGE, ROOT, Rig

SERIAL = "20245500815"


def other_robot(rig: Rig, name: str) -> Path:
    """Returns a cell file of another robot at the rig's address."""
    text = (ROOT / "cells" / f"{name}.toml").read_text()
    path = rig.folder / "other" / f"{name}.toml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(re.sub(r'host = "[^"]*"', f'host = "{rig.host}"', text))
    return path


def refused(rig: Rig, *words: str) -> None:
    before = simulator_client.request(rig.host, "state")["q"]
    row = rig.throw(NUDGE)
    assert row.outcome == "refused", row.reason
    for word in words:
        assert word in row.reason
    assert simulator_client.request(rig.host, "state")["q"] == pytest.approx(before, abs=1e-9)
    assert not rig.is_latched()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ur", "sim"])
def test_a_ur3e_is_not_thrown_with_as_a_ur5e(tmp_path: Path, kind: str) -> None:
    """Nor where it took the place of the right robot a moment ago."""
    rig = Rig(tmp_path, replace={'kind = "sim"': f'kind = "{kind}"'})
    try:
        rig.start()
        assert rig.throw_when_ready().outcome == "completed"
        assert rig.simulator is not None
        rig.simulator.terminate()
        rig.simulator.wait(10.0)
        rig.start_simulator("--cell", str(other_robot(rig, "ur3e-sim")))
        rig.until(lambda: "ur3e" in " ".join(rig.robot().get("refusals", [])))
        refused(rig, "wrong robot", "ur3e", "ur5e")
    finally:
        rig.stop()


@pytest.mark.slow
def test_a_robot_of_another_serial_number_is_refused(tmp_path: Path) -> None:
    rig = Rig(tmp_path, replace={"[link]\n": f'[link]\nserial = "{SERIAL}"\n'})
    try:
        rig.start_simulator("--serial-number", "20245500816")
        rig.start_executor()
        refused(rig, "wrong robot", "20245500816", SERIAL)
        rig.until(lambda: rig.robot().get("refusals"))
        assert rig.robot()["serial_number"] == "20245500816"
        assert rig.simulator is not None
        rig.simulator.send_signal(signal.SIGTERM)
        rig.simulator.wait(10.0)
        rig.start_simulator()  # the simulated controller of a cell that states one has that one
        row = rig.throw_when_ready()
        assert row.outcome == "completed", row.reason
        rig.until(lambda: rig.robot().get("serial_number") == SERIAL)
    finally:
        rig.stop()


@pytest.mark.slow
def test_a_controller_that_does_not_tell_its_arm_is_refused(rig: Rig) -> None:
    rig.fault("mute", port="primary")
    try:
        refused(rig, "does not report its arm", "ur5e")
    finally:
        rig.fault("mute", port="primary", on=False)
    assert rig.throw_when_ready().outcome == "completed"


@pytest.mark.slow
def test_the_doctor_shows_the_serial_number_and_a_wrong_robot(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    try:
        rig.start_simulator("--cell", str(other_robot(rig, "ur3e-sim")), "--serial-number", SERIAL)
        code = (
            "import sys; from executor.doctor import _robot; from executor.robot import find_robot\n"
            "from planner.cell import load_cell\n"
            "cell = load_cell(sys.argv[1])\n"
            "print(*_robot(cell, find_robot(cell.link.host)), sep='\\n')"
        )
        command = [sys.executable, "-c", code, str(rig.path)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT, env=dict(os.environ))
    finally:
        rig.stop()
    assert SERIAL in done.stdout
    assert "grade='bad'" in done.stdout
    assert "a ur3e" in done.stdout

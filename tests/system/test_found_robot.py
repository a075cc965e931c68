"""What a controller tells whoever asks: the doctor, and `fling cell new`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from executor.doctor import found_words
from executor.robot import FoundRobot, find_robot
from tests.system.rig import Rig

SERIAL = "20245500815"


@pytest.mark.slow
def test_a_controller_tells_its_arm_software_serial_number_and_tool(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    assert find_robot(rig.host) == FoundRobot()
    ask = [sys.executable, "-P", "-m", "executor", "--find", rig.host]
    assert "no controller answers" in subprocess.run(ask, capture_output=True, text=True).stderr
    try:
        rig.start_simulator("--serial-number", SERIAL)
        told = json.loads(subprocess.run(ask, capture_output=True, text=True, check=True).stdout)
        words = found_words(rig.cell, find_robot(rig.host))
    finally:
        rig.stop()
    assert told["models"] == ["ur5e", "ur7e"]
    assert (told["serial"], told["polyscope"]) == (SERIAL, "5.11.1")
    assert told["payload_kg"] == pytest.approx(rig.cell.tool.mass_kg)
    assert told["tcp_offset"][:3] == pytest.approx(rig.cell.tool.X_FT[:3, 3].tolist())
    gripper = "gripper on tool_digital 0, closed"
    assert words == f"a ur5e or ur7e, serial number {SERIAL}, PolyScope 5.11.1; {gripper}"

"""Cells at whose home the arm cannot stand, and tools that leave it no posture."""

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import ToolCapsule
from planner.cell_folder import check_home, file_faults, home_faults
from planner.errors import CellError
from tests.planner.problems import cell


def test_a_tool_too_thick_for_its_wrist_is_refused_by_name():
    here = cell()
    thick = ToolCapsule(np.zeros(3), np.array([0.0, 0.0, 0.15]), 0.13)
    with pytest.raises(CellError, match="tool_0 is too close to wrist_1 in every posture") as refusal:
        check_home(replace(here, tool=replace(here.tool, capsules=(thick,))))
    assert (refusal.value.field, refusal.value.value) == ("tool.capsules[0].radius_m", 0.13)
    beyond = ToolCapsule(np.array([0.0, 0.0, 0.13]), np.array([0.0, 0.0, 0.15]), 0.13)
    assert home_faults(replace(here, tool=replace(here.tool, capsules=(beyond,)))) == []


def test_a_missing_calibration_file_hides_no_other_fault(tmp_path):
    """The tool is too heavy for the arm, and home is within a box."""
    path = tmp_path / "lab.toml"
    box = "[surroundings]\nkeep_out = [{ lower_m = [-2, -2, 0.3], upper_m = [2, 2, 2] }]\n"
    text = f'robot = "ur5e"\n[link]\nkind = "sim"\n[tool]\nmass_kg = 20\n{box}'
    path.write_text(text)
    violated = [str(fault) for fault in file_faults(path)]
    assert [fault.partition(" ")[0] for fault in violated] == ["tool.mass_kg", "home_rad"]
    path.write_text(text + '[kinematics]\ncalibration = "missing.yaml"\n')
    first, *others = file_faults(path)
    assert first.field == "kinematics.calibration"
    assert [str(fault) for fault in others] == violated

"""Cells at whose home the arm cannot stand, and tools that leave it no posture."""

from dataclasses import replace

import numpy as np
import pytest

from planner.cell import ToolCapsule
from planner.cell_folder import check_home, home_faults
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

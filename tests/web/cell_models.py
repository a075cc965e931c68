"""A cell with each published arm, for the tests of the page; `python -m tests.web.cell_models` writes them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from api.scene import cell_model
from planner.cell import parse_cell
from planner.robots import ROBOT_NAMES, robot

ROOT = Path(__file__).parents[2]
FILE = ROOT / "web" / "tests" / "cell-models.json"
DRAWN = (
    *("cell", "robot", "sample_rate_hz", "base_in_world", "chain", "tool_in_flange", "home", "capsules"),
    *("surroundings", "object"),
)


def cell_models() -> list[dict[str, Any]]:
    """Returns what the scene takes of the model of the default cell, with each arm in turn."""
    text = (ROOT / "cells" / "ur5e-sim.toml").read_text()
    text = re.sub(r"\[safety\].*?\n\n", "", text, flags=re.DOTALL).replace("rad_s = 3.0", "rad_s = 1.5")
    models = []
    for name in ROBOT_NAMES:
        polyscope = "3.15.4" if robot(name).generation == "CB3" else "5.11.1"
        own = text.replace('robot = "ur5e"', f'robot = "{name}"').replace("5.11.1", polyscope)
        model = cell_model(parse_cell(own, name))
        models.append({key: model[key] for key in DRAWN})
    return models


if __name__ == "__main__":
    FILE.write_text(json.dumps(cell_models()) + "\n")

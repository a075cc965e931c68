"""The page's kinematics is tested against numbers from the planner: they must be the planner's of today."""

from __future__ import annotations

import json

from tests.web import cell_models
from tests.web.model_numbers import FILE, model_numbers, same


def test_the_numbers_for_the_page_are_the_planners():
    current = model_numbers()
    stored = json.loads(FILE.read_text())
    assert same(current, stored), "write them anew: python -m tests.web.model_numbers"


def test_a_number_that_has_changed_is_noticed():
    stored = json.loads(FILE.read_text())
    changed = json.loads(FILE.read_text())
    changed["arms"][3]["links"][1][2][0][3] += 1e-9
    assert not same(changed, stored)


def test_the_models_for_the_page_are_the_services():
    stored = json.loads(cell_models.FILE.read_text())
    assert same(cell_models.cell_models(), stored), "write them anew: python -m tests.web.cell_models"

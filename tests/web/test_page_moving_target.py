"""A target that moves on the page: asked for in the form, and carried along in the scene."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.system.browser import CHROMIUM, MISSING, Visit
from tests.web.conftest import Desk, posted

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

PLANNED_MS = 60_000
BELT: dict[str, Any] = {
    "kind": "target",
    "position": [1.1, -0.5, 0.0],
    "velocity": [0.0, 0.2, 0.0],
    "observed_at_s": 100.0,
    "opening": {"radius_m": 0.12, "rim_height_m": 0.2},
}


def test_the_form_asks_for_a_target_that_moves(guest: Visit, desk: Desk) -> None:
    guest.page.goto(desk.url)
    guest.field("x [m]").fill("1.1")
    guest.field("y [m]").fill("-0.5")
    guest.page.get_by_label("It moves").check()
    guest.field("Its velocity y [m/s]").fill("0.2")
    guest.field("Seen there at [s]").fill("100")
    guest.field("Starts after it is seen [s]").fill("1.5")
    guest.button("Plan").click()
    expect(guest.page).to_have_url(re.compile("#/plan/"), timeout=PLANNED_MS)
    plan = desk.store.plan(guest.page.url.rsplit("/", 1)[1])
    assert plan is not None
    assert b'"observed_at_s":100' in plan.summary
    assert b'"starts_not_before_s":101.5' in plan.summary
    assert guest.complaints == []


@pytest.mark.slow
def test_a_plan_by_its_address_fills_the_form(guest: Visit, desk: Desk) -> None:
    id = posted(desk, {"release": BELT, "starts_not_before_s": 101.5})
    guest.page.goto(f"{desk.url}/#/plan/{id}")
    expect(guest.page.get_by_label("It moves")).to_be_checked(timeout=PLANNED_MS)
    expect(guest.field("Seen there at [s]")).to_have_value("100")
    expect(guest.field("Starts after it is seen [s]")).to_have_value("1.5")
    assert guest.complaints == []

"""A motion of passages in the form of the page: its list is moved about, and planned."""

from __future__ import annotations

import json
import re

import pytest
from playwright.sync_api import expect

from tests.system.browser import CHROMIUM, MISSING, Visit
from tests.web.conftest import Desk, posted

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

PLANNED_MS = 60_000


def names(guest: Visit) -> list[str]:
    """Names of the passages, in the order of the list."""
    heads = guest.page.get_by_role("list", name="Passages").locator(".passage-head .link")
    return heads.all_inner_texts()


def test_passages_are_added_moved_and_planned(guest: Visit, desk: Desk) -> None:
    page = guest.page
    page.get_by_role("radio", name="Motion").check(force=True)
    page.get_by_label("Name").fill("camera")
    page.get_by_role("button", name="Add an output").click()
    page.get_by_label("Number").fill("2")
    page.get_by_role("button", name="Add a passage").click()
    page.get_by_label("Name").fill("first")
    guest.field("Tool at the release y [m]").fill("-0.2")
    assert names(guest) == ["camera", "first"]
    page.get_by_role("button", name="first earlier").click()
    assert names(guest) == ["first", "camera"]
    grips = page.locator(".passage-head .grip")
    grips.nth(0).drag_to(page.get_by_role("list", name="Passages").locator("li").nth(1))
    assert names(guest) == ["camera", "first"]
    page.get_by_role("button", name="first earlier").click()
    guest.button("Plan").click()
    expect(page).to_have_url(re.compile("#/plan/"), timeout=PLANNED_MS)
    plan = desk.store.plan(page.url.rsplit("/", 1)[1])
    assert plan is not None
    asked = json.loads(plan.summary)["request"]
    assert [each["name"] for each in asked["passages"]] == ["first", "camera"]
    assert asked["passages"][0]["state"]["position"][1] == -0.2
    assert asked["passages"][1]["outputs"][0]["index"] == 2
    expect(page.get_by_role("list", name="Passages and outputs").get_by_role("button")).to_have_count(3)
    assert guest.complaints == []


def test_a_field_that_the_service_refuses_is_marked_in_its_passage(guest: Visit, desk: Desk) -> None:
    page = guest.page
    page.get_by_role("radio", name="Motion").check(force=True)
    page.get_by_role("button", name="Add an output").click()
    page.get_by_label("Number").fill("9")
    guest.button("Plan").click()
    expect(page.get_by_label("Number")).to_have_attribute("aria-invalid", "true", timeout=PLANNED_MS)


@pytest.mark.slow
def test_a_plan_of_passages_fills_the_form_and_is_answered_by_it(guest: Visit, desk: Desk) -> None:
    state = {
        "kind": "joint",
        "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0],
        "velocities": [0.4, 0.3, -0.2, 0.1, 0.0, 0.0],
    }
    id = posted(desk, {"passages": [{"name": "swing", "state": state}], "end": {"kind": "home"}})
    guest.page.goto(f"{desk.url}/#/plan/{id}")
    expect(guest.page.get_by_role("radio", name="Motion")).to_be_checked(timeout=PLANNED_MS)
    assert names(guest) == ["swing"]
    expect(guest.page.get_by_label("Comes to rest")).to_have_value("home")
    expect(guest.button("Throw on ur5e-sim: a motion through swing")).to_be_enabled()
    assert guest.complaints == []

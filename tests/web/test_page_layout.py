"""Where things lie on the page at the sizes that people have: nothing covers, cuts or hides what is needed."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, FloatRect, Locator, ViewportSize, expect

from tests.system.browser import CHROMIUM, MISSING, visit
from tests.web.conftest import Desk, planned

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason=MISSING)]

LAPTOP: ViewportSize = {"width": 1280, "height": 800}
PHONE: ViewportSize = {"width": 390, "height": 844}
DOUBLED: ViewportSize = {"width": 640, "height": 400}  # a laptop's page at 200 %
SOON_MS = 15_000
CUT = """(views, texts) => [...views.querySelectorAll("svg")].flatMap((svg) => {
  const frame = svg.getBoundingClientRect();
  const isAsked = ({ textContent }) => texts.some((text) => textContent.startsWith(text));
  const labels = [...svg.querySelectorAll("text")].filter(isAsked);
  return labels.filter((label) => {
    const box = label.getBoundingClientRect();
    return box.left < frame.left - 1 || box.right > frame.right + 1;
  }).map((label) => label.textContent);
})"""


LINES = """(button) => [...button.querySelectorAll(".whole")].map((part) => {
  return Math.round(part.clientHeight / parseFloat(getComputedStyle(part).lineHeight));
})"""


def box_of(element: Locator) -> FloatRect:
    box = element.bounding_box()
    assert box is not None
    return box


def meet(a: FloatRect, b: FloatRect) -> bool:
    """Returns whether two boxes overlap."""
    across = a["x"] < b["x"] + b["width"] and b["x"] < a["x"] + a["width"]
    return across and a["y"] < b["y"] + b["height"] and b["y"] < a["y"] + a["height"]


@pytest.mark.parametrize("has_scene", [True, False], ids=["scene", "drawn"])
def test_the_key_of_the_scene_is_seen_beside_an_execution(
    desk: Desk, browser: Browser, drawing_browser: Browser, thrown_id: str, has_scene: bool
) -> None:
    id = desk.execution(thrown_id)
    drawn_by = drawing_browser if has_scene else browser
    with visit(drawn_by, f"{desk.url}/#/execution/{id}", viewport=LAPTOP) as guest:
        guest.button("Take its request").wait_for()
        key = box_of(guest.page.locator(".scene-key"))
        others = [".side > .card", ".panel.request", ".cameras" if has_scene else ".drawn-reason"]
        for selector in others:
            for other in guest.page.locator(selector).all():
                assert not meet(key, box_of(other)), selector


@pytest.mark.parametrize("size", [PHONE, DOUBLED], ids=["phone", "200 %"])
def test_no_page_is_wider_than_a_small_screen(desk: Desk, browser: Browser, size: ViewportSize) -> None:
    for path in ("/", "/docs", "/problems"):
        with visit(browser, desk.url + path, viewport=size) as guest:
            filled = (
                guest.page.get_by_role("link", name="infeasible") if path == "/problems" else guest.page.locator("h2")
            )
            filled.first.wait_for()
            assert guest.page.evaluate("document.documentElement.scrollWidth") <= size["width"], path


def test_at_200_percent_nothing_is_taken_away(desk: Desk, browser: Browser, thrown_id: str) -> None:
    desk.execution(thrown_id)
    with visit(browser, desk.url, viewport=DOUBLED) as guest:
        expect(guest.region("History").get_by_role("checkbox").first).to_be_visible(timeout=SOON_MS)
        note = guest.page.get_by_text("Not a safety function")
        expect(note).to_be_in_viewport()
        assert not meet(box_of(note), box_of(guest.button("Stop")))


def test_a_place_is_not_broken_over_two_lines(desk: Desk, browser: Browser) -> None:
    with visit(browser, desk.url, viewport=PHONE) as guest:
        guest.region("Robots").get_by_text("Ready").wait_for()
        planned(guest)
        button = guest.button("Throw on")
        expect(button).to_have_text("Throw on ur5e-sim to (1.20, 0.30)")
        assert button.evaluate(LINES) == [1, 1]


def test_labels_of_drawn_views_are_not_cut(desk: Desk, browser: Browser) -> None:
    with visit(browser, desk.url, viewport=PHONE) as guest:
        guest.region("Robots").get_by_text("Ready").wait_for()
        planned(guest)
        views = guest.region("Scene").locator(".drawn-views")
        expect(views.get_by_text("landing after")).to_have_count(2, timeout=SOON_MS)
        assert views.evaluate(CUT, ["landing after", "release, "]) == []  # at once: they are drawn again and again

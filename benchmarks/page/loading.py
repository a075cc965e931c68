"""How soon the page is painted, and that three.js is loaded after that."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

from playwright.sync_api import Browser

LOADS = 7
WIDTH = 1440
HEIGHT = 900  # [px] of the window
PAINT = """() => ({
  painted: performance.getEntriesByName("first-contentful-paint")[0].startTime,
  scene: performance.getEntriesByType("resource").find(({ name }) => /assets\\/scene-/.test(name)).startTime,
})"""


@dataclass(frozen=True)
class FirstPaint:
    """Medians of several loads with an empty cache.

    Attributes:
        painted_ms: first paint with content [ms].
        scene_asked_ms: request for three.js and the scene [ms].
    """

    painted_ms: float
    scene_asked_ms: float


def first_paint(browser: Browser, url: str) -> FirstPaint:
    """Returns when the page is painted, and when it asks for the scene."""
    found = [_load(browser, url) for _ in range(LOADS)]
    return FirstPaint(median(one["painted"] for one in found), median(one["scene"] for one in found))


def _load(browser: Browser, url: str) -> dict[str, float]:
    context = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT})
    try:
        page = context.new_page()
        with page.expect_response(lambda response: "/assets/scene-" in response.url):
            page.goto(url)
        page.get_by_role("region", name="Robots").get_by_role("listitem").first.wait_for()
        return page.evaluate(PAINT)
    finally:
        context.close()

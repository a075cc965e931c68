"""A report of one throw, open in a headless Chromium that draws in software."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Browser, Page, sync_playwright

from api.report import ReportContent, report_html
from api.scene import cell_model, plan_curves
from planner.answer import plan_document
from planner.cell import load_cell
from planner.planning import plan
from planner.request import problem_from_request

ROOT = Path(__file__).parents[2]
REQUEST = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}}
SOFTWARE = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
PATIENCE_MS = 180_000  # [ms] on a busy machine without a graphics processor
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
WHOLE_WINDOW = (
    "body { overflow: hidden } main { max-width: none; padding: 0; display: block }"
    "main > :not(#stage) { display: none }"
    "#stage { border: 0; border-radius: 0 } #stage canvas { height: 100vh } .cameras, .player { display: none }"
)


def report_of_a_throw() -> str:
    """Returns the report of a throw of the default cell as HTML."""
    cell = load_cell(ROOT / "cells" / "ur5e-sim.toml")
    answer = plan(problem_from_request(REQUEST, cell))
    document = plan_document(answer, REQUEST, "throw", "2026-01-01T00:00:00Z")
    return report_html(ReportContent(document, None, cell_model(cell), plan_curves(document, cell)))


@contextmanager
def software_browser() -> Iterator[Browser]:
    """A headless Chromium of this machine that draws without a graphics processor.

    Raises:
        FileNotFoundError: There is no Chromium.
    """
    program = next((found for name in CHROMIUM if (found := shutil.which(name))), None)
    if program is None:
        raise FileNotFoundError(f"none of {', '.join(CHROMIUM)} is installed")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(SOFTWARE))
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def scene_page(browser: Browser, report: str, width: int, height: int, dark: bool = False) -> Iterator[Page]:
    """The report's scene alone, filling a window of this size [px]."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "report.html"
        file.write_text(report, encoding="utf-8")
        page = browser.new_page(
            viewport={"width": width, "height": height},
            color_scheme="dark" if dark else "light",
        )
        page.set_default_timeout(PATIENCE_MS)
        page.goto(file.as_uri())
        page.add_style_tag(content=WHOLE_WINDOW)
        page.wait_for_function("window.report && report.scene && report.scene.statistics.draw_calls > 0")
        page.wait_for_function("document.querySelector('canvas').clientWidth === innerWidth")
        page.evaluate("report.scene.resize()")
        page.evaluate("new Promise(done => setTimeout(done, 1500))")  # the camera settles after the change of size
        yield page
        page.close()

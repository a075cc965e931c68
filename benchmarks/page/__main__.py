"""`python -m benchmarks.page`: how fast the page is without a graphics processor; writes build/benchmarks/page.md.

Everything runs on this machine: service, planner, browser, and its drawing in software. Nothing else should.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import click
from playwright.sync_api import Browser

from benchmarks.page.dragging import COUNT, round_trips
from benchmarks.page.frames import HEIGHT, WIDTH, FrameRate, measured, measured_on_page
from benchmarks.page.loading import HEIGHT as PAGE_HEIGHT
from benchmarks.page.loading import LOADS, first_paint
from benchmarks.page.loading import WIDTH as PAGE_WIDTH
from benchmarks.page.report_browser import ROOT, report_of_a_throw, scene_page, software_browser
from benchmarks.page.service import service
from benchmarks.results import machine, write_report

PLAN_MS = 60_000  # [ms] on a busy machine
Row = tuple[str, str, str]  # quantity, goal, what was measured


@click.command()
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=ROOT / "build" / "benchmarks")
def main(out: Path) -> None:
    """Measure the page, and write what was measured."""
    about = machine()
    rows = []
    with software_browser() as browser:
        for row in _measured(browser):
            load = f"{os.getloadavg()[0]:.1f}"
            click.echo(" | ".join((*row, f"load {load}")), err=True)
            rows.append(f"| {' | '.join((*row, load))} |")
    text = _text(about, rows)
    write_report(text, out, "page.md")
    click.echo(text)


def _measured(browser: Browser) -> Iterator[Row]:
    """Yields one figure after another."""
    with scene_page(browser, report_of_a_throw(), WIDTH, HEIGHT) as page:
        yield "scrubbing a throw, the scene as the machine allows", "30 a second", _frames(measured(page, None))
        yield "scrubbing a throw, the scene in full detail", "12 a second", _frames(measured(page, 0))
    with service() as url:
        paint = first_paint(browser, url)
        later = f"three.js is asked for after {paint.scene_asked_ms:.0f} ms"
        yield f"first paint, median of {LOADS} loads", "1000 ms", f"{paint.painted_ms:.0f} ms; {later}"
        page = browser.new_page(viewport={"width": PAGE_WIDTH, "height": PAGE_HEIGHT})
        page.goto(url)
        trips = round_trips(page)
        parts = f"{trips.planner_p50_ms:.0f} ms are the planner's, {trips.rest_p50_ms:.0f} ms all the rest"
        yield (
            f"preview while dragging, p50 of {COUNT}",
            "60 ms",
            f"{trips.p50_ms:.0f} ms (p90 {trips.p90_ms:.0f} ms); {parts}",
        )
        page.get_by_role("button", name="Plan", exact=True).click()
        curves = page.get_by_role("region", name="Timeline").get_by_role("button", name="Tool speed")
        curves.wait_for(timeout=PLAN_MS)
        yield "scrubbing a throw on the page with its curves", "30 a second", _frames(measured_on_page(page))


def _frames(rate: FrameRate) -> str:
    level = "" if rate.detail is None else f" at level {rate.detail}"
    return f"{rate.frames_per_s:.1f} a second{level}, {rate.processor_ms:.0f} ms of processor time each"


def _priority() -> str:
    """Returns how this run was scheduled, where not as any other."""
    if os.sched_getscheduler(0) == os.SCHED_OTHER:
        return ""
    return " at real-time priority (`chrt -r`), so that whatever else ran on the machine waited"


def _text(about: dict[str, str], rows: list[str]) -> str:
    """Returns the page of the documentation."""
    table = "\n".join(["| quantity | goal | measured | load |", "| --- | --- | --- | --- |", *rows])
    return f"""# The page, without a graphics processor

{about["date"]}, {about["processor"]}. One run of `python -m benchmarks.page`{_priority()}; service, planner and browser
share the machine, and its load is that of the last minute when each figure was taken.

{table}

The scene alone is {WIDTH} by {HEIGHT} pixels, the page {PAGE_WIDTH} by {PAGE_HEIGHT}. Level 0 is full detail; at higher
ones shadows, then resolution fall. Processor time is that of all the browser's processes.
"""


if __name__ == "__main__":
    main()

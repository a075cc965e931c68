"""`python -m benchmarks.page`: how fast the page is without a graphics processor; writes docs/benchmarks/page.md.

Everything runs on this machine: service, planner, browser, and its drawing in software. Nothing else should.
"""

from __future__ import annotations

from pathlib import Path

import click

from benchmarks.page.dragging import COUNT, RoundTrips, round_trips
from benchmarks.page.frames import HEIGHT, WIDTH, FrameRate, measured
from benchmarks.page.loading import LOADS, FirstPaint, first_paint
from benchmarks.page.report_browser import ROOT, report_of_a_throw, scene_page, software_browser
from benchmarks.page.service import service
from benchmarks.results import machine

LEVELS = (("as the machine allows", None), ("full detail", 0))
GOALS = (30, 12)  # [1/s]


@click.command()
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=ROOT / "docs" / "benchmarks")
def main(out: Path) -> None:
    """Measure the page, and write what was measured."""
    about = machine()
    with software_browser() as browser:
        with scene_page(browser, report_of_a_throw(), WIDTH, HEIGHT) as page:
            rates = {label: measured(page, level) for label, level in LEVELS}
        with service() as url:
            paint = first_paint(browser, url)
            page = browser.new_page()
            page.goto(url)
            trips = round_trips(page)
    text = _text(about, rates, paint, trips)
    (out / "page.md").write_text(text, encoding="utf-8")
    click.echo(text)


def _text(about: dict[str, str], rates: dict[str, FrameRate], paint: FirstPaint, trips: RoundTrips) -> str:
    """Returns the page of the documentation."""
    rows = [
        f"| first paint, median of {LOADS} loads | 1000 ms | {paint.painted_ms:.0f} ms; three.js is asked for after "
        f"{paint.scene_asked_ms:.0f} ms |",
        *(_frames_row(label, rate, goal) for (label, rate), goal in zip(rates.items(), GOALS, strict=True)),
        f"| preview while dragging, p50 of {COUNT} | 60 ms | {trips.p50_ms:.0f} ms (p90 {trips.p90_ms:.0f} ms); "
        f"{trips.planner_p50_ms:.0f} ms are the planner's, {trips.rest_p50_ms:.0f} ms all the rest |",
    ]
    table = "\n".join(["| quantity | goal | measured |", "| --- | --- | --- |", *rows])
    return f"""# The page, without a graphics processor

{about["date"]}, {about["processor"]}, load {about["load"]}. One run of
`python -m benchmarks.page`; service, planner and browser share the machine.

{table}

The scene is {WIDTH} by {HEIGHT} pixels. Processor time is that of all the browser's processes.
"""


def _frames_row(label: str, rate: FrameRate, goal: int) -> str:
    what = f"{rate.frames_per_s:.1f} a second at level {rate.detail}, {rate.processor_ms:.0f} ms of processor time each"
    return f"| scrubbing a throw, {label} | {goal} frames a second | {what} |"


if __name__ == "__main__":
    main()

"""The README's pictures: the page with a planned throw, its scene, and the throw as an animation (`make pictures`)."""

from __future__ import annotations

import io
from base64 import b64decode
from pathlib import Path

import click
from PIL import Image
from playwright.sync_api import Browser, Page

from benchmarks.page.report_browser import PATIENCE_MS, ROOT, report_of_a_throw, scene_page, software_browser
from benchmarks.page.service import service

WIDTH = 1200
HEIGHT = 720  # [px] of the pictures
MOVING_WIDTH = 760
MOVING_HEIGHT = 456  # [px] of the animation
FRAMES_PER_S = 20
SLOWER = 2.0  # the animation shows the throw at half its speed
HOLD_S = 0.9  # [s] at the start and at the landing
QUALITY = 62  # of WebP: the largest file that stays near 1 MB
PAGE_WIDTH = 1440
PAGE_HEIGHT = 900  # [px]
INSTANT_S = "0.6"  # [s] of the page's picture
REST_MS = 4000  # [ms] after which the scene at rest is drawn in full
AFTER_RELEASE_S = 0.3  # [s] instant of the still pictures


PNG = """report.scene.png().then((blob) => new Promise((done) => {
  const reader = new FileReader();
  reader.onload = () => done(reader.result);
  reader.readAsDataURL(blob);
}))"""


def still(page: Page, time_s: str) -> bytes:
    """Returns the scene at an instant as PNG; `time_s` is an expression of the page."""
    page.evaluate(f"report.player.go({time_s})")
    return b64decode(page.evaluate(PNG).partition(",")[2])


def animation(page: Page) -> bytes:
    """Returns the throw from start to landing as an animated WebP."""
    end = page.evaluate("report.player.end")
    count = round(end * SLOWER * FRAMES_PER_S) + 1
    frames = [_image(still(page, str(end * i / (count - 1))), MOVING_WIDTH) for i in range(count)]
    durations = [round(1000 / FRAMES_PER_S)] * count
    durations[0] = durations[-1] = round(1000 * HOLD_S)
    out = io.BytesIO()
    frames[0].save(
        out, "WEBP", save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=QUALITY, method=6
    )
    return out.getvalue()


def _image(png: bytes, width: int) -> Image.Image:
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    return picture.resize((width, round(width * picture.height / picture.width)), Image.Resampling.LANCZOS)


def _webp(png: bytes, width: int) -> bytes:
    out = io.BytesIO()
    _image(png, width).save(out, "WEBP", quality=88, method=6)
    return out.getvalue()


def page_of_a_throw(browser: Browser) -> bytes:
    """Returns the page with a planned throw as PNG, on a simulated arm that is ready."""
    with service(robot=True) as url:
        page = browser.new_page(viewport={"width": PAGE_WIDTH, "height": PAGE_HEIGHT}, reduced_motion="reduce")
        page.set_default_timeout(PATIENCE_MS)
        page.goto(url)
        page.get_by_role("region", name="Robots").get_by_text("Ready").wait_for()
        page.get_by_role("button", name="Plan", exact=True).click()
        page.get_by_role("button", name="Throw on").and_(page.locator(":enabled:not([aria-disabled=true])")).wait_for()
        timeline = page.get_by_role("region", name="Timeline")
        timeline.get_by_role("button", name="Tool speed").wait_for()  # all its curves are there
        timeline.get_by_role("slider").fill(INSTANT_S)
        page.wait_for_timeout(REST_MS)
        picture = page.screenshot()
        page.close()
        return picture


@click.command()
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=ROOT / "docs" / "img")
def main(out: Path) -> None:
    """Write the pictures and the animation of a throw."""
    report = report_of_a_throw()
    with software_browser() as browser:
        _write(out / "web-page.webp", _webp(page_of_a_throw(browser), PAGE_WIDTH))
        with scene_page(browser, report, WIDTH, HEIGHT, dark=True) as page:
            moment = f"report.player.release + {AFTER_RELEASE_S}"
            _write(out / "throw-dark.webp", _webp(still(page, moment), WIDTH))
        with scene_page(browser, report, MOVING_WIDTH, MOVING_HEIGHT, dark=True) as page:
            _write(out / "throw.webp", animation(page))


def _write(file: Path, content: bytes) -> None:
    file.write_bytes(content)
    click.echo(f"{file}: {len(content) / 1000:.0f} kB")


if __name__ == "__main__":
    main()

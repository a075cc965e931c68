"""The README's pictures: the scene of a throw, light and dark, and the throw as an animation (`make pictures`)."""

from __future__ import annotations

import io
from base64 import b64decode
from pathlib import Path

import click
from PIL import Image
from playwright.sync_api import Page

from benchmarks.page.report_browser import ROOT, report_of_a_throw, scene_page, software_browser

WIDTH, HEIGHT = 1200, 720  # [px] of the pictures
MOVING_WIDTH, MOVING_HEIGHT = 760, 456  # [px] of the animation
FRAMES_PER_S = 20
SLOWER = 2.0  # the animation shows the throw at half its speed
HOLD_S = 0.9  # [s] at the start and at the landing
QUALITY = 62  # of WebP: the largest file that stays near 1 MB
FINER = 1.5  # pixels drawn for each of a picture, along both sides: smooth edges
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
    frames = [_image(still(page, str(end * i / (count - 1)))) for i in range(count)]
    durations = [round(1000 / FRAMES_PER_S)] * count
    durations[0] = durations[-1] = round(1000 * HOLD_S)
    out = io.BytesIO()
    frames[0].save(
        out, "WEBP", save_all=True, append_images=frames[1:], duration=durations, loop=0, quality=QUALITY, method=6
    )
    return out.getvalue()


def _image(png: bytes) -> Image.Image:
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    return picture.resize((round(picture.width / FINER), round(picture.height / FINER)), Image.Resampling.LANCZOS)


def _webp(png: bytes) -> bytes:
    out = io.BytesIO()
    _image(png).save(out, "WEBP", quality=88, method=6)
    return out.getvalue()


@click.command()
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default=ROOT / "docs" / "img")
def main(out: Path) -> None:
    """Write the pictures and the animation of a throw."""
    report = report_of_a_throw()
    with software_browser() as browser:
        for name, dark in (("throw-light", False), ("throw-dark", True)):
            with scene_page(browser, report, WIDTH, HEIGHT, dark, FINER) as page:
                moment = f"report.player.release + {AFTER_RELEASE_S}"
                _write(out / f"{name}.webp", _webp(still(page, moment)))
        with scene_page(browser, report, MOVING_WIDTH, MOVING_HEIGHT, dark=True, scale=FINER) as page:
            _write(out / "throw.webp", animation(page))


def _write(file: Path, content: bytes) -> None:
    file.write_bytes(content)
    click.echo(f"{file}: {len(content) / 1000:.0f} kB")


if __name__ == "__main__":
    main()

"""How many frames a second the scene draws while a throw is scrubbed.

Frames are counted between two of the browser's own. The processor time of all its processes for a frame depends little
on what else the machine does, and stands beside them. The scene is measured alone, and on the page with all its curves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import psutil
from playwright.sync_api import Page

WIDTH = 1440
HEIGHT = 582  # [px] the scene of the page in a window of 1440 by 900
SECONDS = 6.0  # [s] of scrubbing for one figure
# Frames are counted while something swings to and fro from end to end, as a hand would move it.
SWING = """const swing = (length, show) => new Promise((done) => {
  const stamps = [];
  const step = (now) => {
    stamps.push(now);
    show(0.5 * (1 + Math.sin((3 * (now - stamps[0])) / 1000)));
    if (now - stamps[0] < 1000 * length) requestAnimationFrame(step);
    else done({ frames: stamps.length - 1, seconds: (stamps.at(-1) - stamps[0]) / 1000 });
  };
  requestAnimationFrame(step);
});"""

SCRUB = f"""async ([seconds, level]) => {{ {SWING}
  const {{ scene, player }} = report;
  const show = (share) => scene.setTime(player.end * share);
  scene.pinDetail(level);
  await swing(level === null ? seconds : 0.5, show); // detail finds its level, pictures are taken
  const found = await swing(seconds, show);
  return {{ ...found, detail: scene.statistics.detail }};
}}"""

# The page's slider.
SLIDE = f"""async (seconds) => {{ {SWING}
  const slider = document.querySelector(".transport input[type=range]");
  const value = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
  const show = (share) => {{
    value.set.call(slider, slider.max * share);
    slider.dispatchEvent(new Event("input", {{ bubbles: true }}));
  }};
  await swing(seconds, show);
  return {{ ...(await swing(seconds, show)), detail: null }};
}}"""


@dataclass(frozen=True)
class FrameRate:
    """Frames of one run.

    Attributes:
        detail: level of detail at the end; 0 is all of it; None: not known.
        frames_per_s: [1/s].
        processor_ms: processor time of the browser for one frame [ms].
    """

    detail: int | None
    frames_per_s: float
    processor_ms: float


def measured(page: Page, level: int | None) -> FrameRate:
    """Returns the frame rate at a level of detail; at the one that the scene chooses where it is None."""
    before = _processor_s()
    found = page.evaluate(SCRUB, [SECONDS, level])
    return _rate(found, SECONDS if level is None else 0.5, _processor_s() - before)


def measured_on_page(page: Page) -> FrameRate:
    """Returns the frame rate of the whole page with a plan: scene, curves, slider and panels."""
    before = _processor_s()
    found = page.evaluate(SLIDE, SECONDS)
    return _rate(found, SECONDS, _processor_s() - before)


def _rate(found: dict[str, Any], warming_s: float, processor_s: float) -> FrameRate:
    share = found["seconds"] / (found["seconds"] + warming_s)
    per_frame = processor_s * share / max(1, found["frames"])
    return FrameRate(found["detail"], found["frames"] / found["seconds"], 1000.0 * per_frame)


def _processor_s() -> float:
    """Returns the processor time of all processes of the browser [s]."""
    total = 0.0
    for process in psutil.Process().children(recursive=True):
        try:
            times = process.cpu_times()
            name = process.name()
        except psutil.NoSuchProcess:
            continue
        if "chrom" not in name:
            continue
        total += times.user + times.system
    return total

"""How many frames a second the scene draws while a throw is scrubbed.

Frames are counted between two of the browser's own. The processor time of all its processes for a frame depends little
on what else the machine does, and stands beside them. The scene is measured alone, and on the page with all its curves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import psutil
from playwright.sync_api import Page

WIDTH, HEIGHT = 1440, 582  # [px] the scene of the page in a window of 1440 by 900
SECONDS = 6.0  # [s] of scrubbing for one figure
SCRUB = """async ([seconds, level]) => {
  const { scene, player } = report;
  scene.pinDetail(level);
  const run = (length) => new Promise((done) => {
    const stamps = [];
    const step = (now) => {
      stamps.push(now);
      scene.setTime(player.end * 0.5 * (1 + Math.sin((3 * (now - stamps[0])) / 1000)));
      if (now - stamps[0] < 1000 * length) requestAnimationFrame(step);
      else done(stamps);
    };
    requestAnimationFrame(step);
  });
  await run(level === null ? seconds : 0.5); // detail finds its level, pictures are taken
  const stamps = await run(seconds);
  const { detail } = scene.statistics;
  return { frames: stamps.length - 1, seconds: (stamps.at(-1) - stamps[0]) / 1000, detail };
}"""

# The page's slider, moved as a hand moves it.
SLIDE = """async (seconds) => {
  const slider = document.querySelector(".transport input[type=range]");
  const value = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value");
  const run = (length) => new Promise((done) => {
    const stamps = [];
    const step = (now) => {
      stamps.push(now);
      value.set.call(slider, slider.max * 0.5 * (1 + Math.sin((3 * (now - stamps[0])) / 1000)));
      slider.dispatchEvent(new Event("input", { bubbles: true }));
      if (now - stamps[0] < 1000 * length) requestAnimationFrame(step);
      else done(stamps);
    };
    requestAnimationFrame(step);
  });
  await run(seconds);
  const stamps = await run(seconds);
  return { frames: stamps.length - 1, seconds: (stamps.at(-1) - stamps[0]) / 1000, detail: null };
}"""


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
            times, name = process.cpu_times(), process.name()
        except psutil.NoSuchProcess:
            continue
        if "chrom" not in name:
            continue
        total += times.user + times.system
    return total

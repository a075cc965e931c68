"""How many frames a second the scene draws while a throw is scrubbed.

Frames are counted between two of the browser's own. The processor time of all its processes for a frame does not depend
on what else the machine does, and stands beside them.
"""

from __future__ import annotations

from dataclasses import dataclass

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
  const { detail, draw_calls } = scene.statistics;
  return { frames: stamps.length - 1, seconds: (stamps.at(-1) - stamps[0]) / 1000, detail, draw_calls };
}"""


@dataclass(frozen=True)
class FrameRate:
    """Frames of one run.

    Attributes:
        detail: level of detail at the end; 0 is all of it.
        frames_per_s: [1/s].
        draw_calls: of one frame.
        processor_ms: processor time of the browser for one frame [ms].
    """

    detail: int
    frames_per_s: float
    draw_calls: int
    processor_ms: float


def measured(page: Page, level: int | None) -> FrameRate:
    """Returns the frame rate at a level of detail; at the one that the scene chooses where it is None."""
    before = _processor_s()
    found = page.evaluate(SCRUB, [SECONDS, level])
    warming = SECONDS if level is None else 0.5
    share = found["seconds"] / (found["seconds"] + warming)
    per_frame = (_processor_s() - before) * share / max(1, found["frames"])
    return FrameRate(found["detail"], found["frames"] / found["seconds"], found["draw_calls"], 1000.0 * per_frame)


def _processor_s() -> float:
    """Returns the processor time of all our children [s]."""
    total = 0.0
    for process in psutil.Process().children(recursive=True):
        try:
            times = process.cpu_times()
        except psutil.NoSuchProcess:
            continue
        total += times.user + times.system
    return total

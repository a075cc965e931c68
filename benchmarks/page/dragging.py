"""How long a preview takes while a target is dragged, and what of it the planner takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from playwright.sync_api import Page

COUNT = 60
# A circle about the first target, one request after another as the page sends them (state/draft.ts, previewOf).
DRAG = """async (count) => {
  const found = [];
  for (let i = 0; i < count; i++) {
    const turn = (2 * Math.PI * i) / count;
    const position = [1.2 + 0.2 * Math.cos(turn), 0.3 + 0.4 * Math.sin(turn), 0];
    const release = { kind: "target", position };
    const soonest = { backend: "ruckig", release_window_s: 0, landing_tolerance_m: 0 };
    const body = JSON.stringify({ cell: "ur5e-sim", release, frame: "world", ...soonest });
    const init = { method: "POST", headers: { "Content-Type": "application/json" }, body, cache: "no-store" };
    const began = performance.now();
    const answer = await fetch("/plan?store=false", init);
    const plan = await answer.json();
    found.push([performance.now() - began, answer.ok ? 1000 * plan.solver.solve_time_s : NaN]);
  }
  return found;
}"""


@dataclass(frozen=True)
class RoundTrips:
    """Previews of one drag.

    Attributes:
        p50_ms: from the request to the parsed answer [ms].
        p90_ms: the same [ms].
        planner_p50_ms: of the planner alone [ms].
        rest_p50_ms: HTTP, queue, document and JSON: what is left of each [ms].
    """

    p50_ms: float
    p90_ms: float
    planner_p50_ms: float
    rest_p50_ms: float


def round_trips(page: Page) -> RoundTrips:
    """Returns the round trips of the previews of a drag, from an open page of the service."""
    found = np.array(page.evaluate(DRAG, COUNT))
    whole = found[:, 0]
    planner = found[:, 1]
    return RoundTrips(
        float(np.median(whole)),
        float(np.percentile(whole, 90)),
        float(np.nanmedian(planner)),
        float(np.nanmedian(whole - planner)),
    )

"""Where the object really went: asked of a simulated controller after the release."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor import truth
from planner.flight import fly
from planner.problem import ThrowProblem

Vector = NDArray[np.float64]
Record = dict[str, Any]

POLL_S = 0.02  # [s] between two questions
SLACK_S = 1.0  # [s] of the controller's time waited beyond the planned flight
SAME_PLANE_M = 1e-6  # [m] planes closer than this are one


@dataclass(frozen=True, eq=False)
class Landing:
    """When the object left, by the controller's time [s], and where it came down (3,) [m]; None: it has not yet."""

    released_at: float
    point: Vector | None


def last_release(host: str) -> float:
    """Returns the controller's time of the newest release so far [s], minus infinity where there was none.

    Raises:
        OSError, ValueError: the simulator does not answer.
    """
    return max((r["t"] for r in truth.ask(host, "world")["releases"]), default=-np.inf)


def watch_landing(host: str, problem: ThrowProblem, after: float, flight_s: float) -> Landing | None:
    """Waits for the object released later than `after` to land; None where none was released.

    Where the plan's plane is not the surface it fell on, the true release is flown on to the plan's plane.

    Raises:
        OSError, ValueError: the simulator does not answer.
    """
    end: float | None = None
    while True:
        world = truth.ask(host, "world")
        end = world["t"] + flight_s + SLACK_S if end is None else end
        releases = [r for r in world["releases"] if r["t"] > after]
        if not releases:
            return None
        release = releases[0]
        landings = [x for x in world["landings"] if x["object"] == release["object"] and x["bounce"] == 0]
        if landings or world["t"] > end:
            return Landing(release["t"], _on_plane(problem, release, landings))
        time.sleep(POLL_S)


def _on_plane(problem: ThrowProblem, release: Record, landings: list[Record]) -> Vector | None:
    if landings and abs(landings[0]["position_m"][2] - problem.plane_z) < SAME_PLANE_M:
        return np.array(landings[0]["position_m"])
    flight = fly(release["position_m"], release["velocity_m_s"], problem.plane_z, problem.gravity, problem.drag)
    return None if flight is None else flight.landing_point

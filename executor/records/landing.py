"""The observed landing, as a simulated controller reports it after the release."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.robot import simulator_client
from planner.flight import fly
from planner.problem import ThrowProblem

Vector = NDArray[np.float64]
Record = dict[str, Any]

POLL_S = 0.02  # [s] between two requests
SLACK_S = 1.0  # [s] of the controller's time, beyond the planned flight
SAME_PLANE_M = 1e-6  # [m] distance below which two planes are one


@dataclass(frozen=True, eq=False)
class Landing:
    """Observed release and landing of the object.

    Attributes:
        released_at: the controller's time of the release [s].
        point: landing point (3,) [m]; None where it has not landed.
    """

    released_at: float
    point: Vector | None


def last_release_s(host: str) -> float:
    """Returns the controller's time of the newest release [s]; minus infinity without one.

    Raises:
        OSError, ValueError: the simulator does not answer.
    """
    return max((r["t"] for r in simulator_client.request(host, "world")["releases"]), default=-np.inf)


def wait_for_landing(host: str, problem: ThrowProblem, after: float, flight_s: float) -> Landing | None:
    """Waits for the landing of the object released after `after`; returns None without such a release.

    Where the object fell on another surface than the plan's plane, the observed release is flown on to that plane.

    Args:
        host: address of the simulated controller.
        problem: the plan's problem.
        after: the controller's time before the throw [s].
        flight_s: planned flight time [s].

    Raises:
        OSError, ValueError: the simulator does not answer.
    """
    end: float | None = None
    while True:
        world = simulator_client.request(host, "world")
        end = world["t"] + flight_s + SLACK_S if end is None else end
        releases = [r for r in world["releases"] if r["t"] > after]
        if not releases:
            return None
        release = releases[0]
        landings = [x for x in world["landings"] if x["object"] == release["object"] and x["bounce"] == 0]
        if landings or world["t"] > end:
            return Landing(release["t"], _point_on_plane(problem, release, landings))
        time.sleep(POLL_S)


def _point_on_plane(problem: ThrowProblem, release: Record, landings: list[Record]) -> Vector | None:
    """Returns the landing point (3,) on the plan's plane [m]."""
    if landings and abs(landings[0]["position_m"][2] - problem.plane_z) < SAME_PLANE_M:
        return np.array(landings[0]["position_m"])
    flight = fly(release["position_m"], release["velocity_m_s"], problem.plane_z, problem.gravity, problem.drag)
    return None if flight is None else flight.landing_point

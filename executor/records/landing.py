"""The bin given to a simulated controller before a throw, and the landing that it reports afterwards."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.robot import simulator_client
from planner.flight import fly
from planner.problem import TargetRelease, ThrowProblem

Vector = NDArray[np.float64]
Record = dict[str, Any]

POLL_S = 0.02  # [s] between two requests
SLACK_S = 1.0  # [s] of the controller's time, beyond the planned flight
SAME_PLANE_M = 1e-6  # [m] distance below which two planes are one
SAME_TIME_S = 1e-6  # [s] difference below which two instants are one
ENDLESS = ("floor", "landing plane")  # surfaces that the plan's plane may replace; anything else is in the way


@dataclass(frozen=True, eq=False)
class Landing:
    """Observed release and landing of the object.

    Attributes:
        released_at: the controller's time of the release [s].
        point: landing point (3,) [m]; None where it has not landed.
        surface: what it landed on or was stopped by, in the simulator's words; None where it has not landed.
    """

    released_at: float
    point: Vector | None
    surface: str | None = None


def place_bin(host: str, problem: ThrowProblem) -> None:
    """Puts the target's bin into the simulated world, or takes the bin of an earlier throw away.

    Raises:
        OSError, ValueError: the simulator does not answer, or refuses.
    """
    release = problem.release
    if isinstance(release, TargetRelease) and release.opening is not None:
        bin = {"bottom_m": release.p_W.tolist(), **asdict(release.opening)}
        simulator_client.request(host, "place_bin", **bin)
    else:
        simulator_client.request(host, "remove_bin")


def last_release_s(host: str) -> float:
    """Returns the controller's time of the newest release [s]; minus infinity without one.

    Raises:
        OSError, ValueError: the simulator does not answer.
    """
    return max((r["t"] for r in simulator_client.request(host, "world")["releases"]), default=-np.inf)


def wait_for_landing(host: str, problem: ThrowProblem, after: float, flight_s: float) -> Landing | None:
    """Waits for the landing of the object released after `after`; returns None without such a release.

    Where the object fell on the floor or the landing plane and the plan's plane is another one, the observed release is
    flown to that one. A box or bin in the way stopped it: then the landing point is where it did.

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
            surface = landings[0]["surface"] if landings else None
            return Landing(release["t"], _point(problem, release, landings), surface)
        time.sleep(POLL_S)


def _point(problem: ThrowProblem, release: Record, landings: list[Record]) -> Vector | None:
    """Returns the landing point (3,) [m]: on the plan's plane, or where something stopped the object before it."""
    flight = fly(release["position_m"], release["velocity_m_s"], problem.plane_z, problem.gravity, problem.drag)
    landed = landings[0] if landings else None
    if landed is not None:
        point = np.array(landed["position_m"])
        stopped = landed["surface"] not in ENDLESS
        came_through = flight is not None and landed["t"] - release["t"] > flight.time_of_flight_s + SAME_TIME_S
        if abs(point[2] - problem.plane_z) < SAME_PLANE_M or (stopped and not came_through):
            return point
    return None if flight is None else flight.landing_point

"""A throw as a simulated controller sees it: announced with its bin before, its landing reported afterwards."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.robot import simulator_client
from planner.problem import ThrowProblem

Vector = NDArray[np.float64]
Record = dict[str, Any]

POLL_S = 0.02  # [s] between two requests
KINDS = ("releases", "landings", "observations")  # lists of records in the answer to `world`
SLACK_S = 1.0  # [s] of the controller's time, beyond the planned flight


@dataclass(frozen=True, eq=False)
class ObservedLanding:
    """Where the simulated camera saw an object land.

    Attributes:
        position: landing point (3,) [m].
        std_m: standard deviation of the camera along x and y [m]; 0 without noise.
    """

    position: Vector
    std_m: float


@dataclass(frozen=True, eq=False)
class Landing:
    """Release and landing of the object; what the simulated controller hides is None.

    Attributes:
        released_at: the controller's time of the release [s].
        point: true landing point (3,) [m]; None also where it has not landed.
        surface: what it landed on or was stopped by, in the simulator's words; None where it has not landed.
        observed: what the camera observed; None where it has not landed.
        landed_at: the controller's time of the landing [s].
    """

    released_at: float | None
    point: Vector | None
    surface: str | None = None
    observed: ObservedLanding | None = None
    landed_at: float | None = None


def expect_throw(host: str, problem: ThrowProblem) -> int:
    """Announces a throw: the object lands on the plan's plane, or in the target's bin, which is put into the world.

    Returns:
        Its number.

    Raises:
        OSError, ValueError: the simulator does not answer, or refuses.
    """
    target = problem.target
    if target is not None and target.opening is not None:
        bin = {"bottom_m": target.p_W.tolist(), **asdict(target.opening)}
        bin |= {"velocity_m_s": target.v_W.tolist(), "at_s": target.at_s} if target.moves else {}
        simulator_client.request(host, "place_bin", **bin)
    else:
        simulator_client.request(host, "remove_bin")
    own = {part.problem.cell.mounted: float(part.problem.plane_z) for part in problem.parts if part.problem.throws}
    of_each = {"landing_z_m_of": own} if own else {}
    return int(simulator_client.request(host, "expect_throw", landing_z_m=float(problem.plane_z), **of_each)["throw"])


def wait_for_landing(host: str, throw: int, flight_s: float, gripper: str = "") -> Landing | None:
    """Waits for the landing of a throw's object; returns None where none left.

    Args:
        host: address of the simulated controller.
        throw: number of the throw.
        flight_s: planned flight time [s].
        gripper: that lets go of the object, by its name.

    Raises:
        OSError, ValueError: the simulator does not answer.
    """
    end: float | None = None
    while True:
        world = simulator_client.request(host, "world")
        end = world["t"] + flight_s + SLACK_S if end is None else end
        release, landing, observation = (_first(world.get(name), throw, gripper) for name in KINDS)
        if release is None and not world["hidden"]:
            return None
        if observation is not None or world["t"] > end:
            return _landing(release, landing, observation)
        time.sleep(POLL_S)


def _first(records: list[Record] | None, throw: int, gripper: str) -> Record | None:
    own = (record for record in records or () if record["throw"] == throw and record.get("gripper", "") == gripper)
    return next(own, None)


def _landing(release: Record | None, landing: Record | None, observation: Record | None) -> Landing:
    released_at = None if release is None else release["t"]
    point = None if landing is None else np.array(landing["position_m"])
    landed_at = None if landing is None else float(landing["t"])
    if observation is None:
        return Landing(released_at, point, landed_at=landed_at)
    observed = ObservedLanding(np.array(observation["position_m"]), float(observation["std_m"]))
    return Landing(released_at, point, observation["surface"], observed, landed_at)

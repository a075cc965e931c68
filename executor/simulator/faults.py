"""Faults on request: what can go wrong with a robot and its network, made to happen while the simulator runs.

One function a fault; its keyword arguments are the parameters of the request. The table is at the end of the file
and, for users, in docs/simulator.md.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from typing import Any, Protocol

from executor.simulator.connections import Connection, Network
from executor.simulator.controller import Controller
from executor.simulator.rtde_server import RtdeServer

CONTROL_PORT_NAME = "control"
FREEZE_MAX_S = 60.0


class BadRequest(Exception):
    """A request of the control port that cannot be obeyed; the text says why."""


class Simulation(Protocol):
    """What faults act on."""

    controller: Controller
    network: Network
    rtde: RtdeServer
    freeze_s: float


def protective_stop(s: Simulation, runtime: str = "paused") -> None:
    """A protective stop; the program is `paused`, `stopped`, or goes on `playing`."""
    if runtime not in ("paused", "stopped", "playing"):
        raise BadRequest(f"runtime {runtime!r} is none of paused, stopped, playing")
    s.controller.stops.protective("fault on request", runtime)


def emergency_stop(s: Simulation) -> None:
    """Somebody hits the button."""
    s.controller.stops.emergency()


def safeguard_stop(s: Simulation) -> None:
    """Somebody opens the fence."""
    s.controller.stops.safeguard()


def power_loss(s: Simulation) -> None:
    """The arm loses power; the controller stays on."""
    s.controller.stops.power_loss()


def clear(s: Simulation) -> None:
    """The cause of every stop is gone: button pulled out, fence closed, protective stop unlocked on the pendant."""
    s.controller.safety.clear()


def stop_program(s: Simulation) -> None:
    """Somebody presses stop on the pendant."""
    s.controller.execution.stop("pendant: stop")


def pause_program(s: Simulation) -> None:
    """Somebody presses pause on the pendant."""
    s.controller.execution.pause()


def resume_program(s: Simulation) -> None:
    """Somebody presses play on the pendant."""
    s.controller.execution.resume()


def local_mode(s: Simulation, on: bool = True) -> None:
    """The pendant is switched to local control, or back."""
    s.controller.execution.remote_control = not on


def speed_slider(s: Simulation, fraction: float = 0.5) -> None:
    """Somebody moves the speed slider."""
    if not 0.0 <= fraction <= 1.0:
        raise BadRequest(f"fraction {fraction} is not within 0 and 1")
    s.controller.slider = float(fraction)


def close_connection(s: Simulation, role: str = "control", reset: bool = False) -> None:
    """Connections of a role are closed, with a reset if asked for; the port goes on listening."""
    for connection in _of_role(s, role):
        s.network.drop(connection, reset)


def stall_connection(s: Simulation, role: str = "control", on: bool = True) -> None:
    """Connections of a role are neither read nor written any more, but stay open."""
    for connection in _of_role(s, role):
        connection.disturbance.stalled = on
    s.network.changed()


def disturb_connection(s: Simulation, role: str = "control", delay_s: float = 0.0, drop: float = 0.0) -> None:
    """Connections of a role delay everything by `delay_s` and lose a share `drop` of their data packages."""
    if not 0.0 <= drop <= 1.0 or not 0.0 <= delay_s <= 10.0:
        raise BadRequest("drop must be within 0 and 1, delay_s within 0 and 10")
    for connection in _of_role(s, role):
        connection.disturbance.delay_s, connection.disturbance.drop = float(delay_s), float(drop)


def offline(s: Simulation, on: bool = True, reset: bool = True) -> None:
    """The controller is gone from the network: every connection ends, every port refuses; or it is back."""
    if not on:
        s.network.listen()
        return
    s.network.unlisten(keep=CONTROL_PORT_NAME)
    for role in ("any", "dashboard", "script"):
        close_connection(s, role, reset)


def mute(s: Simulation, port: str = "dashboard", on: bool = True) -> None:
    """A port accepts connections but never answers."""
    for entry in s.network.ports:
        if entry.name == port and port != CONTROL_PORT_NAME:
            entry.mute = on
            return
    raise BadRequest(f"no port {port!r} to mute")


def freeze(s: Simulation, duration_s: float = 1.0) -> None:
    """The controller stands still, and the world with it; the sockets stay open."""
    if not 0.0 <= duration_s <= FREEZE_MAX_S:
        raise BadRequest(f"duration_s must be within 0 and {FREEZE_MAX_S}")
    s.freeze_s = float(duration_s)


def kill(s: Simulation) -> None:
    """The controller process dies at once."""
    os.kill(os.getpid(), signal.SIGKILL)


def gripper_stuck(s: Simulation, on: bool = True) -> None:
    """The gripper does not open, whatever its output says."""
    s.controller.gripper.stuck = on


def _of_role(s: Simulation, role: str) -> list[Connection]:
    """Returns the connections of control, receive, io, any (all three), dashboard or script."""
    if role in ("dashboard", "script"):
        return [c for c, port in list(s.network.connections.values()) if port.name == role]
    if role not in ("control", "receive", "io", "any"):
        raise BadRequest(f"role {role!r} is none of control, receive, io, any, dashboard, script")
    return [c for c, session in list(s.rtde.sessions.items()) if role in ("any", session.role)]


FAULTS: dict[str, Callable[..., None]] = {
    fault.__name__: fault
    for fault in (
        protective_stop, emergency_stop, safeguard_stop, power_loss, clear, stop_program, pause_program, resume_program,
        local_mode, speed_slider, close_connection, stall_connection, disturb_connection, offline, mute, freeze, kill,
        gripper_stuck,
    )
}  # fmt: skip


def cause(s: Simulation, name: object, parameters: dict[str, Any]) -> None:
    """Makes the fault `name` happen.

    Raises:
        BadRequest: no such fault, or not such parameters.
    """
    fault = FAULTS.get(str(name))
    if fault is None:
        raise BadRequest(f"unknown fault {name!r}; known are {', '.join(FAULTS)}")
    try:
        fault(s, **parameters)
    except TypeError as error:
        raise BadRequest(f"{name}: {error}") from error

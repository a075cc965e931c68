"""Faults of a robot and its network, caused on request while the simulator runs.

One function per fault; its keyword arguments are the parameters of the request. The table of all faults is at the end
of the file and, for users, in docs/simulator.md.
"""

from __future__ import annotations

import inspect
import os
import signal
from collections.abc import Callable

from planner.grippers import INPUT_LINES
from simulator.grippers import PORT_NAME
from simulator.interfaces import BadRequest, Connection, Document
from simulator.program import PROGRAM_FATES
from simulator.simulation import Simulation

CONTROL_PORT_NAME = "control"
EVERY = "every"
RTDE_ROLES = {"control": ("control",), "io": ("io",), "receive": ("receive",), "inputs": ("control", "io")}
OTHER_PORTS = ("dashboard", "robot_api", "script", "primary", "secondary", "camera", PORT_NAME)
ROLES = (*RTDE_ROLES, "any", *OTHER_PORTS, EVERY)
FREEZE_MAX_S = 60.0  # [s]
DELAY_MAX_S = 10.0  # [s]
TYPES: dict[str, tuple[type | tuple[type, ...], str]] = {  # of parameters, by their annotation
    "bool": (bool, "true or false"),
    "float": ((int, float), "a number"),
    "int": (int, "a whole number"),
    "str": (str, "a word"),
}


def protective_stop(s: Simulation, runtime: str = "paused") -> None:
    """Triggers a protective stop; the program is `paused`, `stopped`, or left `playing`."""
    if runtime not in PROGRAM_FATES:
        raise BadRequest(f"runtime {runtime!r} is none of {', '.join(PROGRAM_FATES)}")
    s.controller.stops.protective("fault on request", runtime)


def emergency_stop(s: Simulation) -> None:
    """Presses the emergency stop button."""
    s.controller.stops.emergency()


def safeguard_stop(s: Simulation) -> None:
    """Opens the safeguard fence."""
    s.controller.stops.safeguard()


def power_loss(s: Simulation) -> None:
    """Cuts the power of the arm; the controller stays on."""
    s.controller.stops.power_loss()


def clear(s: Simulation) -> None:
    """Removes the cause of every stop: button released, fence closed, protective stop unlocked on the pendant."""
    s.controller.safety.clear()


def stop_program(s: Simulation) -> None:
    """Presses stop on the pendant."""
    s.controller.runner.stop("pendant: stop")


def pause_program(s: Simulation) -> None:
    """Presses pause on the pendant."""
    s.controller.runner.pause()


def resume_program(s: Simulation) -> None:
    """Presses play on the pendant."""
    s.controller.runner.resume()


def local_mode(s: Simulation, on: bool = True) -> None:
    """Switches the pendant to local control, or back."""
    s.controller.runner.remote_control = not on


def speed_slider(s: Simulation, fraction: float = 0.5) -> None:
    """Moves the speed slider."""
    if not 0.0 <= fraction <= 1.0:
        raise BadRequest(f"fraction {fraction} is not within 0 and 1")
    s.controller.slider = float(fraction)


def close_connection(s: Simulation, role: str = "control", reset: bool = False) -> None:
    """Closes the connections of a role, with RST instead of FIN if `reset`; the port keeps listening."""
    for connection in _of_role(s, role):
        s.network.drop(connection, reset)


def stall_connection(s: Simulation, role: str = "control", on: bool = True) -> None:
    """Stops reading and writing the connections of a role; they stay open."""
    for connection in _of_role(s, role):
        connection.disturbance.stalled = on
    s.network.changed()


def disturb_connection(
    s: Simulation, role: str = "control", delay_s: float = 0.0, jitter_s: float = 0.0, drop: float = 0.0
) -> None:
    """Delays everything on the connections of a role by `delay_s` [s] and loses a share `drop` of data packages.

    `jitter_s` is the largest further delay, drawn anew for everything that is sent [s]. The role `every` has all
    connections, also those to come.
    """
    if not 0.0 <= drop <= 1.0 or not 0.0 <= delay_s <= DELAY_MAX_S or not 0.0 <= jitter_s <= DELAY_MAX_S:
        raise BadRequest("drop must be within 0 and 1, delay_s and jitter_s within 0 and 10")
    disturbances = [connection.disturbance for connection in _of_role(s, role)]
    if role == EVERY:
        s.network.undisturbed = CONTROL_PORT_NAME
        disturbances.append(s.network.disturbance)
    for disturbance in disturbances:
        disturbance.delay_s = float(delay_s)
        disturbance.jitter_s = float(jitter_s)
        disturbance.drop = float(drop)


def offline(s: Simulation, on: bool = True, reset: bool = True) -> None:
    """Takes the controller off the network: connections end, ports refuse; or brings it back."""
    if not on:
        s.network.listen()
        return
    s.network.unlisten(keep=CONTROL_PORT_NAME)
    for connection, port in list(s.network.connections.values()):
        if port.name != CONTROL_PORT_NAME:
            s.network.drop(connection, reset)


def mute(s: Simulation, port: str = "dashboard", on: bool = True) -> None:
    """Makes a port accept connections without ever answering."""
    for entry in s.network.ports:
        if entry.name == port and port != CONTROL_PORT_NAME:
            entry.mute = on
            return
    ports = ", ".join(entry.name for entry in s.network.ports if entry.name != CONTROL_PORT_NAME)
    raise BadRequest(f"no port {port!r} to mute; there are {ports}")


def freeze(s: Simulation, duration_s: float = 1.0) -> None:
    """Makes controller and world stand still for `duration_s` [s]; the sockets stay open."""
    if not 0.0 <= duration_s <= FREEZE_MAX_S:
        raise BadRequest(f"duration_s must be within 0 and {FREEZE_MAX_S}")
    s.freeze_s = float(duration_s)


def kill(s: Simulation) -> None:
    """Kills the controller process at once."""
    os.kill(os.getpid(), signal.SIGKILL)


def gripper_stuck(s: Simulation, on: bool = True) -> None:
    """Keeps the gripper closed, regardless of its output."""
    s.controller.workcell.gripper.stuck = on


def object_lost(s: Simulation) -> None:
    """Lets the object slip out of the closed gripper."""
    s.controller.workcell.lose_object(s.controller.timeline.t)


def outputs_stuck(s: Simulation, on: bool = True) -> None:
    """Keeps the digital outputs as they are, whatever they are told."""
    s.controller.workcell.outputs.stuck = on


def digital_input(s: Simulation, index: int = 0, on: bool = True) -> None:
    """Switches a digital input of the controller: something outside, such as a loader, signals."""
    if not 0 <= index < INPUT_LINES:
        raise BadRequest(f"index {index} is not within 0 and {INPUT_LINES - 1}")
    workcell = s.controller.workcell
    workcell.input_bits = workcell.input_bits | 1 << index if on else workcell.input_bits & ~(1 << index)


def _of_role(s: Simulation, role: str) -> list[Connection]:
    """Returns the connections of a role.

    `inputs` are control and io, `any` these and receive, `every` all but those of this port.
    """
    if role == EVERY:
        return [c for c, port in list(s.network.connections.values()) if port.name != CONTROL_PORT_NAME]
    if role in OTHER_PORTS:
        return [c for c, port in list(s.network.connections.values()) if port.name == role]
    if role != "any" and role not in RTDE_ROLES:
        raise BadRequest(f"role {role!r} is none of {', '.join(ROLES)}")
    return [c for c, session in list(s.rtde.sessions.items()) if role == "any" or session.role in RTDE_ROLES[role]]


_STOPS = (protective_stop, emergency_stop, safeguard_stop, power_loss, clear)
_PENDANT = (stop_program, pause_program, resume_program, local_mode, speed_slider)
_NETWORK = (close_connection, stall_connection, disturb_connection, offline, mute)
_PROCESS = (freeze, kill, gripper_stuck, object_lost, outputs_stuck, digital_input)
FAULTS: dict[str, Callable[..., None]] = {f.__name__: f for f in (*_STOPS, *_PENDANT, *_NETWORK, *_PROCESS)}


def cause_fault(s: Simulation, request: Document) -> None:
    """Causes the fault of a request {"op": "fault", "name": name, ...} with the parameters in it.

    Raises:
        BadRequest: the fault or one of its parameters is unknown.
    """
    name = request.get("name")
    fault = FAULTS.get(str(name))
    if fault is None:
        raise BadRequest(f"unknown fault {name!r}; known are {', '.join(FAULTS)}")
    fault(s, **_parameters(fault, {key: value for key, value in request.items() if key not in ("op", "name")}))


def _parameters(fault: Callable[..., None], given: Document) -> Document:
    """Returns the parameters of a fault, all of which it has and can take.

    Raises:
        BadRequest: one of them is unknown, or of another type.
    """
    known = {key: each.annotation for key, each in inspect.signature(fault).parameters.items() if key != "s"}
    for key, value in given.items():
        if key not in known:
            raise BadRequest(f"{fault.__name__} has no parameter {key!r}; it has {', '.join(known) or 'none'}")
        types, words = TYPES[known[key]]
        if not isinstance(value, types) or (isinstance(value, bool) and known[key] != "bool"):
            raise BadRequest(f"{fault.__name__}: {key} must be {words}; it is {value!r}")
    return given

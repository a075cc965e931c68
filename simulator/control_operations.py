"""Operations of the control port: true state, the bin, releases and landings, counts, events, faults.

Where the truth is hidden they tell what a real controller tells, and what the camera observed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from simulator.faults import cause_fault
from simulator.interfaces import BadRequest, Document
from simulator.physics import RoundBin, Workcell
from simulator.simulation import Simulation

OUTPUT_CHANGES_MAX = 20  # latest changes in an answer


def control_operations(
    simulation: Simulation, quit_loop: Callable[[], None]
) -> dict[str, Callable[[Document], Document | None]]:
    """Returns the operations by name; each turns a request into its answer, None for an empty one."""
    return {
        "state": lambda request: true_state(simulation),
        "world": lambda request: objects_after(simulation, int(request.get("after", 0))),
        "expect_throw": lambda request: expect_throw(simulation, request),
        "place_bin": lambda request: place_bin(simulation, request),
        "remove_bin": lambda request: place_bin(simulation, None),
        "stats": lambda request: simulation.stats(),
        "reset_stats": lambda request: simulation.reset_stats(),
        "events": lambda request: {"events": list(simulation.controller.timeline.events)},
        "fault": lambda request: cause_fault(simulation, request),
        "quit": lambda request: quit_loop(),
    }


def true_state(simulation: Simulation) -> Document:
    """Returns the true state of the controller and its workcell; what is hidden is left out."""
    return controller_state(simulation) | ({} if _is_hidden(simulation) else hidden_state(simulation))


def controller_state(simulation: Simulation) -> Document:
    """Returns the state of the controller as it tells it."""
    c = simulation.controller
    arm = c.arm
    outputs = c.workcell.outputs
    program = c.runner.program
    return {
        "t": c.timeline.t,
        "cell": c.cell.name,
        "cell_sha256": c.cell.sha256,
        "polyscope": c.cell.sim.polyscope,
        "hidden": _is_hidden(simulation),
        "target_q": arm.q,
        "target_qd": arm.qd,
        "measured_q": arm.measured_q,
        "measured_qd": arm.measured_qd,
        "runtime_state": c.runner.runtime,
        "program": program.name if program else None,
        "threads": list(program.threads) if program else [],
        "safety_mode": c.safety.mode,
        "safety_bits": c.safety.bits,
        "safety_reason": c.safety.reason,
        "robot_mode": c.safety.robot_mode,
        "remote_control": c.runner.remote_control,
        "speed_slider": c.slider,
        "speed_scaling": c.speed_scaling,
        "digital_outputs": outputs.bits,
        "connections": [
            {"role": s.role, "packages_in": s.packages_in, "packages_out": s.packages_out, "skipped": s.skipped}
            for s in simulation.rtde.sessions.values()
        ],
    }


def hidden_state(simulation: Simulation) -> Document:
    """Returns what only the simulator can tell."""
    workcell = simulation.controller.workcell
    arm = workcell.arm
    gripper = workcell.gripper
    return {
        "moved_at": workcell.moved_at,
        "q": arm.true_q,
        "qd": arm.true_qd,
        "output_changes": list(workcell.outputs.changes)[-OUTPUT_CHANGES_MAX:],
        "device_changes": {
            name: list(device.changes)[-OUTPUT_CHANGES_MAX:] for name, device in workcell.devices.items()
        },
        "gripper_open": gripper.open,
        "gripper_holds": gripper.holds,
        "gripper_stuck": gripper.stuck,
        "grippers_hold": {name: each.holds for name, each in workcell.grippers.items() if name},
    }


def objects_after(simulation: Simulation, after: int) -> Document:
    """Returns what the camera observed of objects numbered above `after`; unless hidden, all that happened to them."""
    workcell = simulation.controller.workcell
    world = workcell.world
    hidden = _is_hidden(simulation)
    observed = {"observations": [o for o in world.observations if o["object"] > after]}
    answer = {"t": simulation.controller.timeline.t, "hidden": hidden, **observed}
    if hidden:
        return answer
    return answer | {
        "releases": [r for r in world.releases if r["object"] > after],
        "landings": [r for r in world.landings if r["object"] > after],
        "in_flight": [
            {"object": f.number, "position_m": f.state[:3], "velocity_m_s": f.state[3:]} for f in world.flights
        ],
        "gripper_holds": workcell.gripper.holds,
        **({} if workcell.feeder is None else {"objects": fed_objects(workcell, after)}),
    }


def fed_objects(workcell: Workcell, after: int) -> list[Document]:
    """Returns where every object of a feeder is that is numbered above `after`: each is in one state.

    `lost` is one that fell past everything.
    """
    assert workcell.feeder is not None
    world = workcell.world
    found: dict[int, Document] = {}
    for release in world.releases:
        found[release["object"]] = {"state": "lost", "throw": release["throw"]}
    for landing in world.landings:
        place = {"position_m": landing["position_m"], "surface": landing["surface"]}
        found[landing["object"]] = {"state": "landed", "throw": landing["throw"], **place}
    for flight in world.flights:
        found[flight.number] = {"state": "flying", "throw": flight.throw, "position_m": list(flight.state[:3])}
    for place, each in workcell.feeder.on_places.items():
        found[each.number] = {"state": "on its place", "place": place, "position_m": list(each.position_m)}
    if workcell.gripper.holds is not None:
        found[workcell.gripper.holds] = {"state": "held"}
    return [{"object": number, **found[number]} for number in sorted(found) if number > after]


def _is_hidden(simulation: Simulation) -> bool:
    return simulation.controller.workcell.truth.hidden


def expect_throw(simulation: Simulation, request: Document) -> Document:
    """Returns the number of the throw that comes next; its object lands at `landing_z_m`, or where the cell has it.

    Raises:
        BadRequest: the height is not a finite number.
    """
    world = simulation.controller.workcell.world
    try:
        height_m = float(request.get("landing_z_m", world.usual_landing_z_m))
        of_each = {str(name): float(z_m) for name, z_m in dict(request.get("landing_z_m_of", {})).items()}
    except (TypeError, ValueError, OverflowError) as error:
        raise BadRequest("landing_z_m must be a number [m]") from error
    if not all(map(math.isfinite, (height_m, *of_each.values()))):
        raise BadRequest("landing_z_m must be finite")
    return {"throw": world.expect_throw(height_m, of_each)}


def place_bin(simulation: Simulation, request: Document | None) -> None:
    """Puts a bin into the world, in place of the one that stands there; None only takes that one away.

    Raises:
        BadRequest: a number is missing, not finite or negative.
    """
    world = simulation.controller.workcell.world
    if request is None:
        world.place_bin(None)
        return
    try:
        x, y, z = map(float, request["bottom_m"])
        vx, vy, vz = map(float, request.get("velocity_m_s", (0.0, 0.0, 0.0)))
        sizes = float(request["radius_m"]), float(request["rim_height_m"])
        placed = RoundBin((x, y, z), *sizes, (vx, vy, vz), float(request.get("at_s", 0.0)))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BadRequest("a bin needs bottom_m [x, y, z], radius_m and rim_height_m [m]") from error
    if not all(map(math.isfinite, (x, y, z, vx, vy, vz, *sizes, placed.at_s))):
        raise BadRequest("the numbers of a bin must be finite")
    if placed.radius_m <= 0.0 or placed.rim_height_m < 0.0:
        raise BadRequest("a bin's radius_m must be above 0, its rim_height_m not below 0")
    world.place_bin(placed)

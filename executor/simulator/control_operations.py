"""Operations of the control port: true state, the bin, releases and landings, counts, events, faults."""

from __future__ import annotations

import math
from collections.abc import Callable

from executor.simulator.faults import cause_fault
from executor.simulator.interfaces import BadRequest, Document
from executor.simulator.physics import RoundBin
from executor.simulator.simulation import Simulation

OUTPUT_CHANGES_MAX = 20  # latest changes in an answer


def control_operations(
    simulation: Simulation, quit_loop: Callable[[], None]
) -> dict[str, Callable[[Document], Document | None]]:
    """Returns the operations by name; each turns a request into its answer, None for an empty one."""
    return {
        "state": lambda request: true_state(simulation),
        "world": lambda request: objects_after(simulation, int(request.get("after", 0))),
        "place_bin": lambda request: place_bin(simulation, request),
        "remove_bin": lambda request: place_bin(simulation, None),
        "stats": lambda request: simulation.stats(),
        "reset_stats": lambda request: simulation.reset_stats(),
        "events": lambda request: {"events": list(simulation.controller.timeline.events)},
        "fault": lambda request: cause_fault(simulation, request),
        "quit": lambda request: quit_loop(),
    }


def true_state(simulation: Simulation) -> Document:
    """Returns the true state of the controller and its workcell."""
    c = simulation.controller
    arm, outputs, gripper, program = c.arm, c.workcell.outputs, c.workcell.gripper, c.runner.program
    return {
        "t": c.timeline.t,
        "moved_at": c.workcell.moved_at,
        "cell": c.cell.name,
        "cell_sha256": c.cell.sha256,
        "polyscope": c.cell.sim.polyscope,
        "target_q": arm.q,
        "target_qd": arm.qd,
        "q": arm.true_q,
        "qd": arm.true_qd,
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
        "output_changes": list(outputs.changes)[-OUTPUT_CHANGES_MAX:],
        "gripper_open": gripper.open,
        "gripper_holds": gripper.holds,
        "gripper_stuck": gripper.stuck,
        "connections": [
            {"role": s.role, "packages_in": s.packages_in, "packages_out": s.packages_out, "skipped": s.skipped}
            for s in simulation.rtde.sessions.values()
        ],
    }


def objects_after(simulation: Simulation, after: int) -> Document:
    """Returns releases and landings of objects numbered above `after`, and all objects in flight."""
    workcell = simulation.controller.workcell
    world = workcell.world
    return {
        "t": simulation.controller.timeline.t,
        "releases": [r for r in world.releases if r["object"] > after],
        "landings": [r for r in world.landings if r["object"] > after],
        "in_flight": [
            {"object": f.number, "position_m": f.state[:3], "velocity_m_s": f.state[3:]} for f in world.flights
        ],
        "gripper_holds": workcell.gripper.holds,
    }


def place_bin(simulation: Simulation, request: Document | None) -> None:
    """Puts a bin into the world, in place of the one that stands there; None only takes that one away.

    Raises:
        BadRequest: a number is missing, not finite or negative.
    """
    world = simulation.controller.workcell.world
    if request is None:
        world.bin = None
        return
    try:
        x, y, z = map(float, request["bottom_m"])
        placed = RoundBin((x, y, z), float(request["radius_m"]), float(request["rim_height_m"]))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise BadRequest("a bin needs bottom_m [x, y, z], radius_m and rim_height_m [m]") from error
    if not all(map(math.isfinite, (x, y, z, placed.radius_m, placed.rim_height_m))):
        raise BadRequest("the numbers of a bin must be finite")
    if placed.radius_m <= 0.0 or placed.rim_height_m < 0.0:
        raise BadRequest("a bin's radius_m must be above 0, its rim_height_m not below 0")
    world.bin = placed

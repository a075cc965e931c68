"""What a cell file that is accepted most likely gets wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner.cell import Cell

LAG_S = 0.002  # [s] by which a simulated arm may be later than its cell says: a tick of the e-Series


def _called_gripper(cell: Cell) -> list[str]:
    """Returns a warning of a gripper whose timing depends on somebody's code."""
    from planner.grippers import KINDS

    call = KINDS[cell.gripper.kind].call
    return [f"gripper.kind is {cell.gripper.kind!r}: {call}"] if call else []


def warnings_of(cell: Cell) -> list[str]:
    """Returns warnings of a cell, in words."""
    found = [*_elsewhere(cell), *_gripper_elsewhere(cell), *_far_shapes(cell), *_far_floor(cell), *_wrong_lag(cell)]
    return [*found, *_unpublished(cell), *_assumed_shape(cell), *_no_clearance(cell), *_called_gripper(cell)]


def _elsewhere(cell: Cell) -> list[str]:
    """Returns a warning of a simulation that is not on this machine: it may be an arm."""
    from fling import this_machine

    if cell.link.kind != "sim" or this_machine.is_loopback_host(cell.link.host):
        return []
    says = f"link.kind is 'sim', and {cell.link.host} (link.host) is not this machine"
    return [f"{says}: if an arm stands there, it moves without the questions of a real one; kind = 'ur' is for those"]


def _gripper_elsewhere(cell: Cell) -> list[str]:
    """Returns a warning of a simulated arm whose gripper is not the simulated controller's."""
    from fling import this_machine

    link = cell.gripper.link
    if cell.link.kind != "sim" or link is None or not link.host or this_machine.is_loopback_host(link.host):
        return []
    mend = f"name {cell.link.host} in both URLs" if link.kind == "http" else "leave gripper.host out"
    return [f"the arm is simulated, and the gripper at {link.host} is not: {mend} for the simulated one"]


def _far_shapes(cell: Cell) -> list[str]:
    """Returns warnings of shapes that nothing can meet, mostly as their places are in millimetres."""
    from planner.cell import FARTHEST_M
    from planner.geometry import segment_shape_distance

    base = cell.X_WB[:3, 3]
    found = []
    for name, shape in zip(cell.surroundings.keep_out_names, cell.surroundings.keep_out, strict=True):
        away_m = float(segment_shape_distance(base, base, shape))
        if away_m >= FARTHEST_M:
            found.append(f"{name} is {away_m:.0f} m from the arm, beyond every throw: places are in metres")
    return found


def _far_floor(cell: Cell) -> list[str]:
    """Returns a warning of a floor that no arm stands over, mostly as its height is in millimetres."""
    from planner.cell import FARTHEST_M

    below_m = float(cell.X_WB[2, 3]) - cell.surroundings.floor_z_m
    return [f"surroundings.floor_z_m is {below_m:.0f} m below the arm: metres?"] if below_m >= FARTHEST_M else []


def _wrong_lag(cell: Cell) -> list[str]:
    """Returns a warning of an arm that is not as late as the cell says."""
    lag_s = cell.timing.lag_s
    if cell.link.kind == "sim" and round(abs(cell.sim.lag_s - lag_s), 6) > LAG_S:
        found = f"timing.lag_s is {lag_s:g} s and the simulated arm is {cell.sim.lag_s:g} s late (sim.lag_s)"
        return [f"{found}: its throws miss, or are stopped as the arm is not where the plan is"]
    if cell.link.kind == "ur" and lag_s == 0.0:
        measures = f"`fling calibrate lag --cell {cell.name}` measures it"
        return [f"timing.lag_s is 0 s: a real arm is late, by about 0.02 s, and its throws miss; {measures}"]
    return []


def _unpublished(cell: Cell) -> list[str]:
    """Returns warnings of what is not known of the cell's arm."""
    name = cell.robot.name
    found = []
    if cell.robot.payload_kg is None:
        known = "payload_kg in [arm_data] takes it"
        found.append(f"no rated payload of a {name} is known, so tool and object may be too heavy for it; {known}")
    if cell.robot.shape.is_estimate:
        like = f"estimated by those of a {cell.robot.shape.of}"
        keep = "keep well clear: of floor and shapes by surroundings.clearance_m, of the arm itself by its postures"
        found.append(f"the capsules of a {name} are {like}: {keep}")
    return found


def _assumed_shape(cell: Cell) -> list[str]:
    """Returns a warning of a tool whose shape nobody gave."""
    if not cell.tool.is_assumed:
        return []
    thick_mm = 2e3 * cell.tool.capsules[0].radius_m
    return [f"tool.capsules gives no shape: {thick_mm:.0f} mm about the line from flange to object are assumed"]


def _no_clearance(cell: Cell) -> list[str]:
    """Returns a warning of a cell in which arm and tool may touch what stands around them."""
    around = cell.surroundings
    if around.clearance_m <= 0.0:
        return ["surroundings.clearance_m is 0 m: arm, tool and object may touch the floor and every shape"]
    stands = zip(around.keep_out_names, around.keep_out, strict=True)
    touched = [name for name, shape in stands if shape.clearance_m == 0.0]
    return [f"clearance_m of {name} is 0 m: arm, tool and object may touch it" for name in touched]

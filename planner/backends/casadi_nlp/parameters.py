"""Parameter vectors for the generated functions; those of a cell alone are computed once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.layout import ARM, TOOL_CAPSULES, Vector
from planner.backends.casadi_nlp.margins import Margins
from planner.cell import Box, Cell, Limits, ThrownBody
from planner.geometry import SELF_CLEARANCE_M, arm_capsules, body_model, held_object, self_collision_pairs

CELLS_KEPT = 32  # cells whose parameters are cached
UNBOUNDED = 1.0e3  # [m] coordinate of a missing keep-in face
ABSENT_ROW = Box(np.full(3, layout.ABSENT_SHAPE), np.full(3, layout.ABSENT_SHAPE)).row
ABSENT_ROOM = layout.SHAPE.pack(
    {
        **dict.fromkeys(layout.SHAPE.sizes, 0.0),
        "rotation": np.eye(3),
        **dict.fromkeys(("upper", "upper_faces", "reach", "radius"), layout.FAR),
        **dict.fromkeys(("lower", "lower_faces"), -layout.FAR),
    }
)
TIME_SHARE = 0.4  # [-] of the slowest joint's time to full speed: about 0.1 s, the length of two or three stages


def scale_parameters(limits: Limits, longest_initial_step_s: float) -> Vector:
    """Returns the `SCALES` vector: mostly the limits themselves, so that the bounds of every problem are about one.

    A jerk cannot last longer than the acceleration takes from one limit to the other. In a step longer than that, a
    jerk of one, if scaled by its limit, would turn the arm several times: over a few such steps rounding spoils the
    solver's factorisation, and fatrop 1.1.8 raises its regularisation without end. So it is scaled by what the longest
    step of the initial guess leaves of it, and may be more than one.

    Args:
        limits: of the joints.
        longest_initial_step_s: the longest step of the initial guess [s].
    """
    jerk = np.minimum(limits.jerk_max, 2.0 * limits.qdd_max / longest_initial_step_s)
    to_full_speed_s = limits.qd_max / limits.qdd_max + limits.qdd_max / limits.jerk_max
    return layout.SCALES.pack(
        {
            "qd": limits.qd_max,
            "qdd": limits.qdd_max,
            "jerk": jerk,
            "time": TIME_SHARE * to_full_speed_s.max(),
        }
    )


def variable_scales(scales: Vector) -> Vector:
    """Returns the scales of one stage's variables (NZ,) from a `SCALES` vector: z times these is in SI units."""
    c = layout.SCALES.split(scales)
    return np.concatenate([np.ones(6), c["qd"], c["qdd"], c["time"], c["jerk"], c["time"]])


@lru_cache(maxsize=CELLS_KEPT)
def cell_parameters(cell: Cell) -> Vector:
    """Returns the `ARM` vector without margins, not to be changed; the torque and speed limits are 0.

    Of a calibrated arm it is that of the published one: `release_state` corrects the release by the difference.
    """
    robot = cell.robot.published
    R_WB = cell.X_WB[:3, :3]
    lower, upper = cell.surroundings.box_within or (np.full(3, -UNBOUNDED), np.full(3, UNBOUNDED))
    return _read_only(
        layout.ARM.pack(
            {
                "dh": np.array([robot.d[0], robot.a[1], robot.a[2], robot.d[3], robot.d[4], robot.d[5]]),
                "tcp": cell.tool.X_FT[:3, 3],
                "links": link_parameters(cell),
                "gravity": R_WB.T @ [0.0, 0.0, cell.surroundings.gravity_m_s2],
                "base": np.concatenate([R_WB.T.ravel(), cell.X_WB[:3, 3]]),
                "capsules": capsule_parameters(cell),
                "pairs": pair_parameters(cell),
                "keep_in": np.concatenate([lower, upper]),
                "floor": cell.surroundings.floor_z_m + cell.surroundings.clearance_m,
                "self_clearance": SELF_CLEARANCE_M,
                "grip": grip_parameters(cell),
                "tool_rotation": cell.tool.X_FT[:3, :3].T,
                "torque": 0.0,
                "speed": 0.0,
            }
        )
    )


def nearest_shapes(cell: Cell, q: Vector) -> tuple[int, ...]:
    """Returns the numbers of the `KEEP_OUT_SHAPES` shapes that arm, tool and object come nearest to; of fewer, all.

    The optimiser keeps clear of these. Of more than four it heeds none at first, then those that come nearest to the
    motion in which the certificate found one met: there the next solve starts.

    Args:
        cell: the cell.
        q: postures of the motion that the optimiser starts from (n, 6) [rad].
    """
    around = cell.surroundings
    count = len(around.keep_out)
    if count <= layout.KEEP_OUT_SHAPES:
        return tuple(range(count))
    body = body_model(cell)
    left = body.shape_distances(body.end_points(body.link_poses(q))).min(axis=(1, 2)) - around.further_clearances
    order = np.argsort(np.round(left, layout.DECIMALS), kind="stable")
    return tuple(sorted(order[: layout.KEEP_OUT_SHAPES].tolist()))


@lru_cache(maxsize=CELLS_KEPT)
def shape_parameters(cell: Cell, chosen: tuple[int, ...], margin_m: float = 0.0) -> Vector:
    """Returns the `SHAPES` vector of the shapes of these numbers, not to be changed."""
    around = cell.surroundings
    free = layout.FAR * touching_slots(cell)
    slots = [_shape_slot(around.keep_out_rows[i], float(around.further_clearances[i]), free[i]) for i in chosen]
    slots += [_shape_slot(ABSENT_ROW, 0.0, 0.0)] * (layout.KEEP_OUT_SHAPES - len(slots))
    return _read_only(layout.SHAPES.pack({"shapes": np.array(slots), "clearance": around.clearance_m + margin_m}))


def room_parameters(cell: Cell, q: Vector, margin_m: float) -> Vector:
    """Returns the `ROOMS` vector: the keep-in shapes that are no plain boxes; of many those whose walls come nearest.

    Args:
        cell: the cell.
        q: postures of the motion that the optimiser starts from (n, 6) [rad].
        margin_m: added to the clearance from their walls [m].
    """
    around = cell.surroundings
    chosen = around.rooms
    if len(chosen) > layout.KEEP_IN_ROOMS:
        body = body_model(cell)
        left = body.wall_distances(body.end_points(body.link_poses(q))).min(axis=1) - around.keep_in_clearances
        order = np.argsort(np.round(left[chosen], layout.DECIMALS), kind="stable")
        chosen = np.sort(chosen[order[: layout.KEEP_IN_ROOMS]])
    slots = [_shape_slot(around.keep_in[i].row, float(around.keep_in_clearances[i]), 0.0) for i in chosen]
    slots += [ABSENT_ROOM] * (layout.KEEP_IN_ROOMS - len(slots))
    return layout.ROOMS.pack({"rooms": np.array(slots), "margin": margin_m})


def touching_slots(cell: Cell) -> NDArray[np.bool_]:
    """Returns which capsule slots (k,) may touch which keep-out shapes (b, k): of several in one slot all of them."""
    body = body_model(cell)
    first = body.names.index("base")
    own = body.may_touch[:, first : first + layout.FIRST_TOOL]
    tool = body.may_touch[:, first + layout.FIRST_TOOL : body.object]
    last = tool[:, TOOL_CAPSULES - 1 :].all(axis=1, keepdims=True)
    of_tool = [tool[:, : TOOL_CAPSULES - 1], *[last] * (tool.shape[1] >= TOOL_CAPSULES)]
    found = np.zeros((len(tool), len(layout.CAPSULE_FRAMES)), np.bool_)
    slots = np.hstack([own, *of_tool])
    found[:, : slots.shape[1]] = slots
    found[:, layout.OBJECT] = body.may_touch[:, body.object]
    return found


def _shape_slot(row: Vector, further_m: float, added_m: Vector | float) -> Vector:
    """Returns the `SHAPE` vector of a `Solid.row`.

    Args:
        row: of the shape.
        further_m: the clearance that it has beyond the cell's [m].
        added_m: to the distance of each capsule slot (k,) [m].
    """
    rotation, origin, lower, upper = np.split(row[:18], (9, 12, 15))
    is_round = row[18] > 0.0
    lower_faces, upper_faces = (np.full(3, sign * layout.FAR) for sign in (-1.0, 1.0))
    faces = slice(2, 3) if is_round else slice(3 if row[19] > 0.0 else 0, 3)  # of a sphere or capsule none
    lower_faces[faces] = lower[faces]
    upper_faces[faces] = upper[faces]
    return layout.SHAPE.pack(
        {
            "rotation": rotation,  # that of the shape in the world by rows
            "origin": origin,
            "lower": lower,
            "upper": upper,
            "is_round": float(is_round),
            "lower_faces": lower_faces,
            "upper_faces": upper_faces,
            "reach": layout.FAR if is_round else upper[2],
            "radius": upper[0] if is_round else row[19] or layout.FAR,
            "further": further_m,
            "added": added_m,
        }
    )


def _read_only(vector: Vector) -> Vector:
    vector.flags.writeable = False
    return vector


def grip_parameters(cell: Cell) -> Vector:
    """Returns what the grip withstands along the tool's axes, and in any direction (4,) [m/s^2]."""
    held = cell.gripper.hold_acceleration_m_s2
    limits = np.full(4, layout.UNLIMITED_GRIP)
    if held is not None:
        limits[slice(3) if len(held) == 3 else slice(3, 4)] = held
    return limits


def link_parameters(cell: Cell) -> Vector:
    """Returns mass, first moment and inertia about the frame's origin of each link (60,), payload in the last."""
    rows = [_about_origin(link.mass, link.com, link.inertia) for link in cell.robot.links]
    X_FT = cell.tool.X_FT
    thing = cell.object
    inertia = np.zeros((3, 3))
    if isinstance(thing, ThrownBody):
        R_FO = X_FT[:3, :3] @ thing.R_TO
        inertia = R_FO * thing.inertia_kg_m2 @ R_FO.T
    rows[-1] = rows[-1] + _about_origin(cell.tool.mass_kg, cell.tool.end_F / 2.0, np.zeros((3, 3)))
    for each in cell.carried:
        rows[-1] = rows[-1] + _about_origin(each.mass_kg, each.p_F, np.zeros((3, 3)))
    rows[-1] = rows[-1] + _about_origin(thing.mass_kg, X_FT[:3, 3], inertia)
    return np.concatenate(rows)


def _about_origin(mass: float, com: Vector, inertia: Vector) -> Vector:
    about = inertia + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.concatenate([[mass], mass * com, about[np.triu_indices(3)]])


def capsule_parameters(cell: Cell) -> Vector:
    """Returns end points and radius of every slot of `CAPSULE_FRAMES` (98,)."""
    table = np.zeros((len(layout.CAPSULE_FRAMES), 7))
    table[:, 6] = layout.ABSENT_RADIUS
    for slot, c in enumerate(arm_capsules(cell.robot)[1:]):
        table[slot] = [*c.p0, *c.p1, c.radius_m]
    for slot, (p0, p1, radius) in enumerate(wrapped_tool_capsules(cell), start=layout.FIRST_TOOL):
        table[slot] = [*p0, *p1, radius]
    held = held_object(cell)
    table[layout.OBJECT] = [*held.p0, *held.p1, held.radius_m]
    return table.ravel()


def wrapped_tool_capsules(cell: Cell) -> list[tuple[Vector, Vector, float]]:
    """Returns the tool's capsules, at most `TOOL_CAPSULES`: where it has more, the last one encloses the rest."""
    own = [(c.from_m, c.to_m, c.radius_m) for c in cell.tool.capsules]
    if len(own) <= TOOL_CAPSULES:
        return own
    return [*own[: TOOL_CAPSULES - 1], _enclosing_capsule(own[TOOL_CAPSULES - 1 :])]


def _enclosing_capsule(capsules: list[tuple[Vector, Vector, float]]) -> tuple[Vector, Vector, float]:
    """Returns a capsule that contains the others, along their principal direction."""
    points = np.array([end for p0, p1, _ in capsules for end in (p0, p1)])
    radii = np.repeat([radius for *_, radius in capsules], 2)
    centre = points.mean(axis=0)
    axis = np.linalg.svd(points - centre)[2][0]
    along = (points - centre) @ axis
    off = np.linalg.norm(points - centre - along[:, None] * axis, axis=1)
    return centre + along.min() * axis, centre + along.max() * axis, float((off + radii).max())


def pair_parameters(cell: Cell) -> Vector:
    """Returns 0 for the slots of `PAIRS` that can meet on this arm with this tool, `FAR` for the others."""
    body = body_model(cell)
    own = self_collision_pairs(cell.robot, cell.tool.capsules)
    free = cell.surroundings.is_free_to_touch
    can = {(i - 1, j - 1) for i, j in own if not free(body.names[i], body.names[j])}
    last = layout.FIRST_TOOL + TOOL_CAPSULES - 1
    if len(cell.tool.capsules) > TOOL_CAPSULES:
        can |= {(i, last) for i, j in can if j > last}
    return np.array([0.0 if pair in can else layout.FAR for pair in layout.PAIRS])


def arm_parameters(cell: Cell, limits: Limits, margins: Margins) -> Vector:
    """Returns the `ARM` vector, with the margins added to every required clearance."""
    vector = cell_parameters(cell).copy()
    at = ARM.slices
    vector[at["torque"]] = limits.tau_max
    vector[at["speed"]] = limits.tcp_speed_max
    vector[at["floor"]] += margins.floor_m
    vector[at["self_clearance"]] += margins.self_m
    lower, upper = np.split(vector[at["keep_in"]], 2)
    lower += margins.keep_in_m
    upper -= margins.keep_in_m
    return vector

"""The model of a cell as the planner sees it: chain, capsules, limits, surroundings; enough to draw and to move it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from planner.arrays import Array
from planner.calibration import fixed_transforms
from planner.cell import Cell, Solid, ThrownBody
from planner.flight import drag_constant
from planner.geometry import SELF_CLEARANCE_M, body_model


def cell_model(cell: Cell) -> dict[str, Any]:
    """Returns the document of `GET /cells/{name}/model`.

    Link poses follow from it as X_WL[0] = base_in_world, X_WL[i] = X_WL[i-1] Rz(q_i) chain[i-1], of a calibrated arm
    too; the tool centre point is X_WL[6] tool_in_flange.
    """
    robot = cell.robot
    return {
        "cell": cell.name,
        "sha256": cell.sha256,
        "robot": robot.name,
        "link_kind": cell.link.kind,
        "calibrated": robot.fixed is not None,
        "sample_rate_hz": robot.sample_rate_hz,
        "joint_names": list(robot.joint_names),
        "base_in_world": cell.X_WB.tolist(),
        "chain": fixed_transforms(robot).tolist(),
        "a_m": robot.a.tolist(),
        "d_m": robot.d.tolist(),
        "tool_in_flange": cell.tool.X_FT.tolist(),
        "home": cell.home.tolist(),
        **_body(cell),
        "limits": _limits(cell),
        "safety": dict(vars(cell.safety)),
        "surroundings": _surroundings(cell),
        "object": _object(cell),
        "gripper": _gripper(cell),
        "lag_s": cell.timing.lag_s,
    }


def _body(cell: Cell) -> dict[str, Any]:
    """Returns the capsules of arm, tool and held object, and which of them can collide."""
    body = body_model(cell)
    rows = zip(body.names, body.frames.tolist(), body.ends.tolist(), body.radii.tolist(), strict=True)
    capsules = [
        {"name": name, "part": _part(name), "frame": frame, "from_m": start, "to_m": end, "radius_m": radius}
        for name, frame, (start, end), radius in rows
    ]
    return {"capsules": capsules, "colliding_pairs": body.pairs.tolist(), "self_clearance_m": SELF_CLEARANCE_M}


def _part(name: str) -> str:
    return "tool" if name.startswith("tool_") else "object" if name == "object" else "arm"


def _limits(cell: Cell) -> dict[str, Any]:
    limits = cell.limits
    return {
        "position_lower_rad": limits.q_lower.tolist(),
        "position_upper_rad": limits.q_upper.tolist(),
        "velocity_rad_s": limits.qd_max.tolist(),
        "acceleration_rad_s2": limits.qdd_max.tolist(),
        "jerk_rad_s3": limits.jerk_max.tolist(),
        "torque_n_m": limits.tau_max.tolist(),
        "tcp_speed_m_s": limits.tcp_speed_max,
        "singularity_distance_min": limits.singularity_distance_min,
    }


def _surroundings(cell: Cell) -> dict[str, Any]:
    around = cell.surroundings
    heights = {"floor_z_m": around.floor_z_m, "clearance_m": around.clearance_m, "gravity_m_s2": around.gravity_m_s2}
    clearances = around.clearance_m + around.further_clearances
    return {
        **heights,
        "keep_in": _shapes(around.keep_in_names, around.keep_in, around.keep_in_clearances),
        "keep_out": _shapes(around.keep_out_names, around.keep_out, clearances),
    }


def _shapes(names: Sequence[str], shapes: Sequence[Solid], clearances: Array) -> list[dict[str, Any]]:
    rows = zip(names, shapes, clearances.tolist(), strict=True)
    return [
        {
            "lower_m": shape.lower.tolist(),
            "upper_m": shape.upper.tolist(),
            "name": name,
            "shape": shape.kind,
            "pose": shape.X_WC.tolist(),
            "extent_m": shape.extent.tolist(),
            "clearance_m": clearance_m,
        }
        for name, shape, clearance_m in rows
    ]


def _object(cell: Cell) -> dict[str, Any]:
    thing = cell.object
    is_body = isinstance(thing, ThrownBody)
    return {
        "shape": thing.kind if is_body else "sphere",
        "extent_m": thing.size_m.tolist() if is_body else [2.0 * thing.radius_m] * 3,
        "axes_in_tool": (thing.R_TO if is_body else np.eye(3)).tolist(),
        "mass_kg": thing.mass_kg,
        "radius_m": thing.radius_m,
        "drag_coefficient": thing.drag_coefficient,
        "drag_per_m": float(drag_constant(thing.mass_kg, thing.drag_radius_m, thing.drag_coefficient)),
    }


def _gripper(cell: Cell) -> dict[str, Any]:
    gripper = cell.gripper
    direction = gripper.opening_direction
    hold = gripper.hold_acceleration_m_s2
    return {
        "delay_s": gripper.delay_s,
        "jitter_s": gripper.jitter_s,
        "opening_direction": None if direction is None else direction.tolist(),
        "opening_cone_rad": gripper.opening_cone_rad,
        "hold_acceleration_m_s2": None if hold is None else hold.tolist(),
    }

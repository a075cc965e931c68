"""Problems as plain JSON documents that need no Fling, and back; docs/throwbench.md describes them."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from functools import cache
from typing import Any

import numpy as np

from audit.judge import self_pairs
from planner.arrays import Array, read_only
from planner.cell import Box, Cell, Limits, Solid, ToolCapsule, parse_cell
from planner.geometry import SELF_CLEARANCE_M, body_capsules
from planner.problem import Opening, TargetRelease, ThrowProblem
from planner.robots import Link
from planner.rotations import pose

Problem = dict[str, Any]

FORMAT = 1  # of the documents: another one where a reader of this one would misunderstand
POINT_TOLERANCE_M = 0.01  # [m] around a target without bin and window
DIGITS = 12  # decimals of a number


def problem_document(name: str, problem: ThrowProblem) -> Problem:
    """Returns a throw as a document of its own.

    Args:
        name: "set/number".
        problem: A throw at a target; what the documents have no words for (singularities, safety limits, grip) is lost.
    """
    cell = problem.cell
    release = problem.release
    limits = problem.limits
    assert isinstance(release, TargetRelease)
    document = {
        "throwbench": FORMAT,
        "name": name,
        "cell": cell.name,
        "sample_rate_hz": cell.robot.sample_rate_hz,
        "arm": _arm(cell),
        "base": _pose(cell.X_WB),
        "tool": _pose(cell.tool.X_FT) | {"mass_kg": cell.tool.mass_kg},
        "object": asdict(cell.object),
        "limits": {
            "position_lower_rad": limits.q_lower,
            "position_upper_rad": limits.q_upper,
            "velocity_rad_s": limits.qd_max,
            "acceleration_rad_s2": limits.qdd_max,
            "jerk_rad_s3": limits.jerk_max,
            "torque_n_m": limits.tau_max,
            "tool_speed_m_s": limits.tcp_speed_max,
        },
        "surroundings": {
            "floor_z_m": cell.surroundings.floor_z_m,
            "clearance_m": cell.surroundings.clearance_m,
            "gravity_m_s2": cell.surroundings.gravity_m_s2,
            "keep_in": [_box(box) for box in cell.surroundings.keep_in],
            "keep_out": [_box(box) for box in cell.surroundings.keep_out],
        },
        "start": {"positions": problem.start},
        "target": _target(problem, release),
    }
    return _plain(document)


def problem_from_document(document: Problem) -> ThrowProblem:
    """Returns the planning problem of a document, with nothing that the document does not say."""
    target = document["target"]
    limits = document["limits"]
    vessel = target["bin"]
    release = TargetRelease(
        np.array(target["position_m"], float),
        min_elevation_rad=max(target["min_elevation_rad"], -math.pi / 2),  # which is rounded in the document
        min_horizontal_distance_m=target["min_horizontal_distance_m"],
        opening=None if vessel is None else Opening(vessel["radius_m"], vessel["rim_height_m"]),
    )
    window = target["release_window_s"]
    return ThrowProblem(
        _cell(document),
        read_only(document["start"]["positions"]),
        release,
        _limits(limits),
        release_window_s=window,
        landing_tolerance_m=target["tolerance_m"] if window > 0.0 else 0.0,
    )


def _arm(cell: Cell) -> dict[str, Any]:
    arm = cell.robot
    return {
        "model": arm.name,
        "dh": {"a_m": arm.a, "d_m": arm.d, "alpha_rad": arm.alpha},
        "links": [_link(link) for link in arm.links],
        "capsules": [
            {"name": c.name, "frame": c.frame, "from_m": c.p0, "to_m": c.p1, "radius_m": c.radius_m}
            for c in body_capsules(arm, cell.tool.capsules)
        ],
        "collision_pairs": self_pairs(cell),
        "self_clearance_m": SELF_CLEARANCE_M,
    }


def _link(link: Link) -> dict[str, Any]:
    return {
        "name": link.name,
        "mass_kg": link.mass,
        "center_of_mass_m": link.com,
        "inertia_kg_m2": link.inertia,
    }


def _pose(X: Array) -> dict[str, Any]:
    return {"position_m": X[:3, 3], "rotation": X[:3, :3]}


def _box(box: Solid) -> dict[str, Any]:
    if box.core is not None or box.clearance_m is not None:
        raise ValueError("ThrowBench knows boxes along the axes alone, without clearances of their own")
    return {"lower_m": box.lower, "upper_m": box.upper}


def _target(problem: ThrowProblem, release: TargetRelease) -> dict[str, Any]:
    opening = release.opening
    tolerance = POINT_TOLERANCE_M
    if problem.is_robust:
        tolerance = problem.landing_tolerance_m
    elif opening is not None:
        tolerance = opening.radius_m - problem.cell.object.radius_m
    return {
        "position_m": release.p_W,
        "tolerance_m": tolerance,
        "release_window_s": problem.release_window_s if problem.is_robust else 0.0,
        "min_elevation_rad": release.min_elevation_rad,
        "min_horizontal_distance_m": release.min_horizontal_distance_m,
        "bin": None if opening is None else {"radius_m": opening.radius_m, "rim_height_m": opening.rim_height_m},
    }


def _plain(value: Any) -> Any:
    """Returns a value made of JSON's types, numbers rounded to `DIGITS`."""
    match value:
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case np.ndarray():
            return _plain(value.tolist())
        case float():
            return round(value, DIGITS)
    return value


def _cell(document: Problem) -> Cell:
    """Returns the cell: arm constants by the model's name, everything else from the document."""
    bare = _bare_cell(document["arm"]["model"])
    tool = document["tool"]
    around = document["surroundings"]
    boxes = {
        key: tuple(Box(read_only(b["lower_m"]), read_only(b["upper_m"])) for b in around[key])
        for key in ("keep_in", "keep_out")
    }
    numbers = {key: around[key] for key in ("floor_z_m", "clearance_m", "gravity_m_s2")}
    capsules = [c for c in document["arm"]["capsules"] if c["name"].startswith("tool_")]
    return replace(
        bare,
        name=document["cell"],
        home=read_only(document["start"]["positions"]),
        X_WB=_matrix(document["base"]),
        tool=replace(
            bare.tool,
            X_FT=_matrix(tool),
            mass_kg=tool["mass_kg"],
            capsules=tuple(ToolCapsule(read_only(c["from_m"]), read_only(c["to_m"]), c["radius_m"]) for c in capsules),
        ),
        limits=_limits(document["limits"]),
        surroundings=replace(bare.surroundings, flight_clearance_m=0.0, **numbers, **boxes),
        object=replace(bare.object, **document["object"]),
    )


@cache
def _bare_cell(model: str) -> Cell:
    """Returns a cell with this arm and nothing else: no safety limits, no gripper's cone, a tool without shape."""
    return parse_cell(f'robot = "{model}"\n[link]\nkind = "sim"\n', "bare")


def _matrix(document: dict[str, Any]) -> Array:
    return read_only(pose(document["position_m"], document["rotation"]))


def _limits(limits: dict[str, Any]) -> Limits:
    return Limits(
        q_lower=read_only(limits["position_lower_rad"]),
        q_upper=read_only(limits["position_upper_rad"]),
        qd_max=read_only(limits["velocity_rad_s"]),
        qdd_max=read_only(limits["acceleration_rad_s2"]),
        jerk_max=read_only(limits["jerk_rad_s3"]),
        tau_max=read_only(limits["torque_n_m"]),
        tcp_speed_max=limits["tool_speed_m_s"],
        singularity_distance_min=0.0,
    )

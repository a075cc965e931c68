"""Picture of a plan: side view and top view of arm, tool path and flight, as one SVG styled by who shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.answer import plan_from_document
from planner.cell import Cell
from planner.flight import path as flight_path
from planner.geometry import tool_pose
from planner.kinematics import link_poses
from planner.passages import passed_until
from planner.problem import Opening, ThrowProblem

Vector = NDArray[np.float64]

WIDTH = 460
HEIGHT = 340
EDGE = 28  # [px] size of one view, and its margin
FLIGHT_POINTS = 60
BIN_POINTS = 41
ARM_STYLES = ("arm start", "arm release", "arm end")
# For a notebook, light or dark; page and report have their own.
STYLE = """
.fling-plan svg { max-width: 920px; width: 100%; font: 12px sans-serif }
.fling-plan th { text-align: left; padding-right: 1em }
.fling-plan .label { fill: currentColor }
.fling-plan polyline, .fling-plan line { fill: none; stroke-width: 2; stroke-linecap: round; stroke-linejoin: round }
.fling-plan .arm { stroke-width: 5; opacity: 0.75 }
.fling-plan .start, .fling-plan .floor, .fling-plan .ruler { stroke: #9aa5b1 }
.fling-plan .release, .fling-plan .launch { stroke: #0b7285 }
.fling-plan .straight { stroke: #0b7285; stroke-width: 4 }
.fling-plan .end, .fling-plan .brake { stroke: #c05621; stroke-dasharray: 4 3 }
.fling-plan .flight { stroke: #2f9e44; stroke-dasharray: 2 4 }
.fling-plan .bin { stroke: #7048e8 }
.fling-plan .let-go { fill: #0b7285 }
.fling-plan .landing { fill: #2f9e44 }
.fling-plan .target { fill: none; stroke: #e03131; stroke-width: 2 }
"""


@dataclass(frozen=True, eq=False)
class PlanScene:
    """Geometry of the picture, in the world [m].

    Attributes:
        arms: Points (n, 3) along the arm at the start, the release and the end.
        path: Positions (N, 3) of the tool centre point.
        turned_index: Sample of the release in `path`; without one, that at which the last passage ends.
        passed: First and last sample of each passage, the same of a state; without any, that of the release.
        flight: Positions (n, 3) of the object in flight; empty for a move that ends at rest.
        further: Flights (n, 3) of other objects than the first.
        target: Target (3,) of the throw, None for other releases.
        opening: Mouth of the bin around the target, None without one.
        floor_z: Height of the floor.
    """

    arms: tuple[Vector, ...]
    path: Vector
    turned_index: int
    passed: tuple[tuple[int, int], ...]
    flight: Vector
    further: tuple[Vector, ...]
    target: Vector | None
    opening: Opening | None
    floor_z: float


def plan_svg(plan: Mapping[str, Any], cell: Cell) -> str:
    """Returns both views of a plan as one SVG element; each line has a class for its style.

    Args:
        plan: The plan as JSON, as `GET /plans/{id}` answers it.
        cell: Its cell.
    """
    scene = _scene(plan, cell)
    side = _direction(scene, cell)
    bin = _bin_lines(scene, side)
    views = (
        _view("side", 0, scene, lambda p: np.stack([p[..., :2] @ side, p[..., 2]], -1), bin, floor=True),
        _view("top", WIDTH, scene, lambda p: p[..., :2], bin, floor=False),
    )
    size = f'viewBox="0 0 {2 * WIDTH} {HEIGHT}" role="img"'
    title = "<title>Side view and top view of the planned motion and the flight</title>"
    return f'<svg xmlns="http://www.w3.org/2000/svg" class="picture" {size}>{title}{"".join(views)}</svg>'


def _scene(plan: Mapping[str, Any], cell: Cell) -> PlanScene:
    problem, trajectory = plan_from_document(plan, cell)
    until = passed_until(problem.passages, trajectory)
    k = trajectory.release_index if problem.throws else until[-1]
    passed = tuple(zip(trajectory.passed, until, strict=True))
    X_WT = tool_pose(cell, trajectory.q)
    arms = tuple(_arm(cell, trajectory.q[i]) for i in (0, k, -1))
    target = problem.target
    place = None if target is None else target.p_W
    opening = None if target is None else target.opening
    floor = cell.surroundings.floor_z_m
    flights = (each.get("flight") for each in plan.get("passages", ()) if each["index"] != trajectory.release_index)
    further = tuple(np.array(each["object_path"]) for each in flights if each)
    return PlanScene(arms, X_WT[:, :3, 3], k, passed, _flight(plan, problem), further, place, opening, floor)


def _arm(cell: Cell, q: Vector) -> Vector:
    """Returns the points (n, 3) along the arm from base to tool centre point [m]."""
    origins = cell.X_WB @ link_poses(cell.robot, q)
    tool = tool_pose(cell, q)
    return np.vstack([origins[:, :3, 3], tool[None, :3, 3]])


def _flight(plan: Mapping[str, Any], problem: ThrowProblem) -> Vector:
    if plan["flight"] is None:
        return np.zeros((0, 3))
    release = plan["release"]
    p = np.array(release["pose"]["position"])
    v = np.array(release["twist"]["linear"])
    leaves = problem.release_speed_factor * v
    times = np.linspace(0.0, plan["flight"]["time_of_flight_s"], FLIGHT_POINTS)
    return flight_path(p, leaves, times, problem.gravity, problem.drag)


def _direction(scene: PlanScene, cell: Cell) -> Vector:
    """Returns the horizontal direction (2,) of the throw, which is the x axis of the side view."""
    end = scene.flight[-1] if len(scene.flight) else scene.path[-1]
    offset = (end - cell.X_WB[:3, 3])[:2]
    length = float(np.linalg.norm(offset))
    return offset / length if length > 1e-9 else np.array([1.0, 0.0])


def _bin_lines(scene: PlanScene, side: Vector) -> list[Vector]:
    """Returns lines (n, 3) that show the bin from the side and from above [m]: its bottom and two edges of the wall."""
    if scene.target is None or scene.opening is None:
        return []
    angles = np.linspace(0.0, 2.0 * np.pi, BIN_POINTS)
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros(BIN_POINTS)], axis=1)
    across = scene.opening.radius_m * np.append(side, 0.0)
    up = np.array([0.0, 0.0, scene.opening.rim_height_m])
    walls = [scene.target + np.array([edge, edge + up]) for edge in (across, -across)]
    return [scene.target + scene.opening.radius_m * around, *walls]


def _view(name: str, left: float, scene: PlanScene, project: Any, bin: list[Vector], floor: bool) -> str:
    points = [project(p) for p in (*scene.arms, scene.path, scene.flight, *scene.further, *bin) if len(p)]
    everything = np.vstack(points)
    if floor:
        everything = np.vstack([everything, [[everything[:, 0].min(), scene.floor_z]]])
    to_pixels = _scale(everything, left)
    parts = [f'<text class="label" x="{left + EDGE}" y="16">{name} view</text>', _ruler(to_pixels, everything, left)]
    if floor:
        y = to_pixels(np.array([[0.0, scene.floor_z]]))[0, 1]
        parts.append(f'<line class="floor" x1="{left + 8}" x2="{left + WIDTH - 8}" y1="{y:.1f}" y2="{y:.1f}"/>')
    for style, arm in zip(ARM_STYLES, scene.arms, strict=True):
        parts.append(_line(to_pixels(project(arm)), style))
    path = project(scene.path)
    parts.append(_line(to_pixels(path[: scene.turned_index + 1]), "launch"))
    parts.append(_line(to_pixels(path[scene.turned_index :]), "brake"))
    parts += [_line(to_pixels(path[first : last + 1]), "straight") for first, last in scene.passed if last > first]
    for flight in (each for each in (scene.flight, *scene.further) if len(each)):
        parts.append(_line(to_pixels(project(flight)), "flight"))
        parts.append(_dot(to_pixels(project(flight[-1:])), "landing", 4))
    parts += [_dot(to_pixels(path[index][None]), "let-go", 4) for span in scene.passed for index in sorted({*span})]
    parts += [_line(to_pixels(project(line)), "bin") for line in bin]
    if scene.target is not None:
        parts.append(_dot(to_pixels(project(scene.target[None])), "target", 8))
    return "<g>" + "".join(parts) + "</g>"


def _scale(points: Vector, left: float) -> Any:
    """Returns the map from metres to pixels that fits `points` into the view, with equal scales of both axes."""
    low = points.min(0)
    high = points.max(0)
    scale = min((WIDTH - 2 * EDGE) / max(high[0] - low[0], 0.1), (HEIGHT - 2 * EDGE) / max(high[1] - low[1], 0.1))
    middle = (low + high) / 2

    def to_pixels(p: Vector) -> Vector:
        x = left + WIDTH / 2 + scale * (p[:, 0] - middle[0])
        return np.stack([x, HEIGHT / 2 - scale * (p[:, 1] - middle[1])], -1)

    return to_pixels


def _ruler(to_pixels: Any, points: Vector, left: float) -> str:
    low = points.min(0)
    ends = to_pixels(np.array([[low[0], low[1]], [low[0] + 0.5, low[1]]]))
    length = float(ends[1, 0] - ends[0, 0])
    x = left + EDGE
    y = HEIGHT - 10
    return (
        f'<line class="ruler" x1="{x}" x2="{x + length:.1f}" y1="{y}" y2="{y}"/>'
        f'<text class="label" x="{x + length + 6:.1f}" y="{y + 4}">0.5 m</text>'
    )


def _line(points: Sequence[Sequence[float]] | Vector, style: str) -> str:
    listed = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline class="{style}" fill="none" points="{listed}"/>'


def _dot(point: Vector, style: str, radius: float) -> str:
    x, y = point[0]
    return f'<circle class="{style}" cx="{x:.1f}" cy="{y:.1f}" r="{radius}"/>'

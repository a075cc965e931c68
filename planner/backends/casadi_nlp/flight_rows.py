"""Parameters of block "flight": the edges, the bin's mouth and the gripper's opening that the object passes.

A box is passed over its top or by one of its sides, between the times at which the flight crosses two of its vertical
planes. The optimiser cannot change sides: the candidate's own flight decides.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from planner.backends.casadi_nlp.layout import FLIGHT, FLIGHT_EDGES, NO_EDGE, FlightEdge, Vector
from planner.backends.casadi_nlp.margins import FailedCheck, Margins
from planner.cell import Box
from planner.flight import path, time_of_flight
from planner.geometry import Arcs, body_model, tool_state
from planner.problem import TargetRelease, ThrowProblem
from planner.seeds import Candidate
from planner.trajectory import Trajectory

UNBOUNDED_RADIUS_M = 1.0e3  # [m] usable radius where there is no bin
LEAST_SPEED_M_S = 1e-3  # [m/s] a flight slower than this along an axis does not cross the planes across it
LEAST_USABLE = 0.02  # [-] of the mouth's radius: what remains usable however flat the candidate's flight
CUT_STEP_S = 0.004  # [s] between the instants at which a failed flight is compared with the arm
CUT_ROOM_M = 0.012  # [m] by which a cut keeps the object off the arm: the arm moves on in the next solution, too
PASSING_TIME_S = 0.005  # [s] half the roundness of an edge's time, which a fixed time must not be moved by


def constrains_flight(problem: ThrowProblem) -> bool:
    """Returns whether block "flight" says anything about a problem: an edge, a mouth or an opening direction."""
    return not problem.ends_at_rest and (
        starts_with_flight(problem) or problem.cell.gripper.opening_direction is not None
    )


def starts_with_flight(problem: ThrowProblem) -> bool:
    """Returns whether the flight is constrained from the first solve: a solution without would be far from one with."""
    release = problem.release
    if not isinstance(release, TargetRelease):
        return False
    return bool(problem.cell.surroundings.keep_out) or release.opening is not None


def flight_parameters(problem: ThrowProblem, candidate: Candidate, margins: Margins, aim: Vector) -> Vector:
    """Returns the `FLIGHT` vector.

    Args:
        problem: the problem.
        candidate: whose flight decides how boxes are passed.
        margins: room beside edges, within the opening's cone, and cuts.
        aim: landing point of the drag-free flight (3,) [m].
    """
    edges: list[FlightEdge] = []
    mouth = [*aim, UNBOUNDED_RADIUS_M]
    if isinstance(problem.release, TargetRelease):
        arcs = _flight(problem, candidate)
        edges = [*_box_edges(problem, arcs, margins.flight_m), *margins.cuts][:FLIGHT_EDGES]
        if problem.release.opening is not None:
            mouth = _mouth(problem.release, arcs, margins.mouth_m)
    edges += [NO_EDGE] * (FLIGHT_EDGES - len(edges))
    opening = _opening(problem, margins.opening_rad)
    return FLIGHT.pack({"edges": np.array([edge.row for edge in edges]), "mouth": mouth, "opening": opening})


def _flight(problem: ThrowProblem, candidate: Candidate) -> Arcs:
    tool = tool_state(problem.cell, candidate.q, candidate.qd)
    return Arcs.onto(tool.p_WT, tool.v_WT, problem.plane_z, problem.gravity, problem.cell.object.radius_m)


def _opening(problem: ThrowProblem, margin_rad: float) -> list[float]:
    """Returns the opening direction in the flange frame, and the cosine of the largest angle from it (4,)."""
    gripper = problem.cell.gripper
    if gripper.opening_direction is None or gripper.opening_cone_rad is None:
        return [0.0, 0.0, 0.0, -1.0]
    direction = problem.cell.tool.X_FT[:3, :3] @ gripper.opening_direction
    return [*direction, math.cos(max(gripper.opening_cone_rad - margin_rad, 0.0))]


def _mouth(release: TargetRelease, arcs: Arcs, room_m: float) -> list[float]:
    """Returns centre, rim height and usable radius of the bin's mouth (4,) [m].

    At an angle d below the horizontal the sphere clears the rim if its centre falls through the mouth's plane r / sin d
    inside of it. The candidate's angle is taken; a flatter flight needs more and fails the certificate, which adds to
    the room.
    """
    assert release.opening is not None
    radius, rim = release.opening.radius_m, release.p_W[2] + release.opening.rim_height_m
    t = float(np.nan_to_num(time_of_flight(arcs.p[2] - rim, arcs.v[2], arcs.gravity)))
    fall = arcs.v[2] - arcs.gravity * t
    sine = max(-fall / math.hypot(arcs.v[0], arcs.v[1], fall), LEAST_USABLE)
    usable = max(radius - arcs.radius_m / sine - room_m, LEAST_USABLE * radius)
    return [release.p_W[0], release.p_W[1], rim, usable]


def _box_edges(problem: ThrowProblem, arcs: Arcs, room_m: float) -> list[FlightEdge]:
    """Returns two edges a box at most, the boxes that the flight passes most closely first."""
    passed = []
    for box in problem.cell.surroundings.keep_out:
        if box.upper[2] > problem.plane_z:  # the object comes down on the others
            passed += [max(_ways_past(box, arcs, room_m), key=lambda way: way[0], default=(math.inf, []))]
    return [edge for _, edges in sorted(passed, key=lambda way: way[0]) for edge in edges]


def _ways_past(box: Box, arcs: Arcs, room_m: float) -> Iterator[tuple[float, list[FlightEdge]]]:
    """Yields the ways over or beside a box: the flight's room [m] and the edges; none where it never comes close."""
    grown = arcs.radius_m + room_m
    lower, upper = box.lower - grown, box.upper + grown
    for axis in (0, 1):
        speed = float(arcs.v[axis])
        if abs(speed) < LEAST_SPEED_M_S:
            continue
        faces = sorted((lower[axis], upper[axis]), key=lambda face: (face - arcs.p[axis]) / speed)
        times = [float(face - arcs.p[axis]) / speed for face in faces]
        if times[1] < 0.0 or times[0] > arcs.until_s:
            continue
        ends = np.clip(times, 0.0, arcs.until_s)
        crossed = [face for face, t in zip(faces, times, strict=True) if t < arcs.until_s]
        for direction, bound in _sides(axis, lower, upper):
            room = min(float(arcs.at(np.asarray(t)) @ direction) for t in ends) - bound
            yield room, [_edge(axis, face, direction, bound) for face in crossed]


def _sides(axis: int, lower: Vector, upper: Vector) -> Iterator[tuple[Vector, float]]:
    """Yields the half-spaces above and on either side of a grown box that is crossed along `axis`."""
    other = np.eye(3)[1 - axis]
    yield np.array([0.0, 0.0, 1.0]), float(upper[2])
    yield other, float(upper[1 - axis])
    yield -other, -float(lower[1 - axis])


def _edge(axis: int, face: float, direction: Vector, bound: float) -> FlightEdge:
    x, y, z = direction.tolist()
    return FlightEdge((float(axis == 0), float(axis == 1)), float(face), (x, y, z), 0.0, bound)


def flight_cuts(problem: ThrowProblem, failures: Iterable[FailedCheck], made: Trajectory) -> tuple[FlightEdge, ...]:
    """Returns half-spaces that keep the flight of a throw at a target clear of the arm, where it was not.

    They hold at the first, the deepest and the last instant at which the object meets a link. The certificate's own
    instants are not needed: the motion is sampled here.
    """
    if not isinstance(problem.release, TargetRelease) or all(check.name != "flight_clearance" for check in failures):
        return ()
    return _arm_cuts(problem, made)


def _arm_cuts(problem: ThrowProblem, made: Trajectory) -> tuple[FlightEdge, ...]:
    """Returns the cuts of a motion; the tool is left out, which the object starts in."""
    body, k, radius = body_model(problem.cell), made.release_index, problem.cell.object.radius_m
    tool = tool_state(problem.cell, made.q[k], made.qd[k])
    arc = Arcs.onto(tool.p_WT, tool.v_WT, problem.plane_z, problem.gravity, radius)
    t = np.arange(CUT_STEP_S, float(arc.until_s), CUT_STEP_S)
    x = path(tool.p_WT, tool.v_WT, t, problem.gravity, problem.drag)
    arm = np.flatnonzero(body.frames < 6)
    q = made.at(np.minimum(made.release_time_s + t, made.duration_s))[0]
    ends = body.end_points(body.link_poses(q))[arm]
    p0, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    lengths = np.maximum(np.einsum("kin,kin->kn", along, along), 1e-12)
    share = np.clip(np.einsum("kin,kin->kn", x.T - p0, along) / lengths, 0.0, 1.0)
    away = x.T - p0 - share[:, None] * along
    gap = np.linalg.norm(away, axis=1) - body.radii[arm, None] - radius
    hit = np.flatnonzero(gap.min(axis=0) < 0.0)
    if len(hit) == 0:
        return ()
    instants = {int(hit[0]), int(gap.min(axis=0).argmin()), int(hit[-1])}
    return tuple(
        _cut(t[i], x[i], away[c, :, i], body.radii[arm[c]] + radius) for i in instants for c in [gap[:, i].argmin()]
    )


def _cut(t: float, x: Vector, away: Vector, distance_m: float) -> FlightEdge:
    """Returns the half-space at `t` [s] beyond a sphere round a link's nearest point, which is `away` from x (3,)."""
    m = away / max(float(np.linalg.norm(away)), 1e-9)
    bound = float(m @ (x - away)) + distance_m + CUT_ROOM_M
    return FlightEdge((0.0, 0.0), 0.0, (float(m[0]), float(m[1]), float(m[2])), float(t) - PASSING_TIME_S, bound)

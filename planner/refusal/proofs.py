"""What no motion can do: bounds that need no search, so that a refusal can call a violation proven.

Every bound is on the far side of the certificate's tolerances: what is refused here could not have been certified.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.arrays import Array
from planner.cell import FARTHEST_M, AllowedContact, Cell
from planner.certificate import SINGULARITY_WINDOW_S
from planner.errors import Infeasible, Violation
from planner.flight import least_speed
from planner.geometry import body_model, segment_shape_distance, tool_state
from planner.problem import ThrowProblem
from planner.refusal.blocked_postures import blocked_postures
from planner.refusal.released_flight import released_flight_blocked
from planner.refusal.throw_range import SLACK, farthest_reach_from_shoulder, out_of_range, shoulder_position
from planner.refusal.unstoppable import unstoppable
from planner.releases import SteadyLine, Target

RIM_POINTS = 2048  # [-] places on the rim of the arm's reach from which a target is aimed at
RANGE_STEP_M = 0.01  # [m] to which the farthest distance of a target is found
TOOL_LIMIT = "the joints at their speed limits move the tool no faster"
RIM_FIRST = 32  # [-] one of so many is looked at first: a target that can be reached from there is not refused


def refuse_impossible(problem: ThrowProblem) -> None:
    """Raises `Infeasible` where a bound proves that no motion fulfils the release."""
    violations = proven_violations(problem)
    if violations:
        raise Infeasible(violations)


def proven_violations(problem: ThrowProblem) -> list[Violation]:
    """Returns the violations that no motion avoids, as far as bounds alone tell."""
    if problem.is_chain:
        found = [each for number in range(len(problem.passages)) for each in _of_passage(problem, number)]
    else:
        found = [*_of_demands(problem), *filter(None, [released_flight_blocked(problem)])]
    return [replace(each, proven=True) for each in (*found, *blocked_postures(problem), *unstoppable(problem))]


def _of_passage(problem: ThrowProblem, number: int) -> list[Violation]:
    """Returns what rules out a passage by itself, or the end of a line; names it."""
    passage = problem.passages[number]
    name = f"passage {passage.name!r}"
    alone = problem.alone(number)
    found = [*_of_demands(alone), *filter(None, [released_flight_blocked(alone)])]
    if isinstance(passage.state, SteadyLine):
        name += f", {'start' if found else 'end'} of the line"
        found = found or _of_demands(alone.through(passage.state.end_state, False, False))
    return [(each if alone.throws else each.in_passing()).within(name) for each in found]


def _of_demands(problem: ThrowProblem) -> list[Violation]:
    """Returns what rules out the release by itself: the joint state, the tool's place and velocity, or the target."""
    release = problem.release
    if release.joint_state is not None:
        q, qd = release.joint_state
        speeds = [*_joint_speeds(problem, qd), *_speed(problem, tool_state(problem.cell, q, qd).v_WT)]
        return speeds or _singularities(problem, q, qd)
    if release.tool_state is not None:
        X, V = release.tool_state
        return [*_place(problem, X[:3, 3]), *_speed(problem, V[:3], X[:3, 3]), *_turning(problem, V[3:])]
    if release.point_state is not None:
        p, v = release.point_state
        return [*_place(problem, p), *_speed(problem, v, p)]
    assert release.target is not None
    p = release.target.release_position
    return _misfit(problem) or ([] if p is None else _place(problem, p)) or _range(problem, release.target, p)


def farthest_target_m(problem: ThrowProblem) -> float | None:
    """Returns a horizontal distance from the shoulder [m] beyond which no throw reaches a target's height.

    The bounds on a throw's range depend on that distance and on the height alone. None where not even a target right
    below or above the shoulder is within range.

    Args:
        problem: of a target; its height counts.
    """
    target = problem.target
    assert target is not None
    shoulder = shoulder_position(problem.cell)

    def is_out_of_range(distance: float) -> bool:
        place = np.array([shoulder[0] + distance, shoulder[1], target.p_W[2]])
        return bool(_range(problem, replace(target, p_W=place)))

    if is_out_of_range(0.0):
        return None
    within = 0.0
    beyond = 1.0
    while not is_out_of_range(beyond):
        within = beyond
        beyond = 2.0 * beyond
    while beyond - within > RANGE_STEP_M:
        middle = (within + beyond) / 2.0
        within, beyond = (within, middle) if is_out_of_range(middle) else (middle, beyond)
    return beyond


def of_candidates(problem: ThrowProblem, violations: tuple[Violation, ...]) -> tuple[Violation, ...]:
    """Returns the violations of a request without candidates, proven where all its release states were looked at.

    A joint release has one state. A pose has one for each branch of the inverse kinematics, and full turns of it: all
    that keep away from singularities. The states of a point or a target are drawn.
    """
    release = problem.release
    distinct = problem.limits.singularity_distance_min > SLACK and not problem.ends_at_rest
    complete = release.joint_state is not None or (release.tool_state is not None and distinct)
    return tuple(replace(violation, proven=violation.proven or complete) for violation in violations)


def farthest_from_shoulder(problem: ThrowProblem) -> tuple[Array, float]:
    """Returns the shoulder's position (3,) and a bound on the tool centre's distance from it [m]."""
    return shoulder_position(problem.cell), farthest_reach_from_shoulder(problem.cell)


def _place(problem: ThrowProblem, p_WT: Array) -> list[Violation]:
    """Returns what rules out a tool centre at `p_WT` (3,): the arm's reach, or the surroundings of the held object."""
    shoulder, reach = farthest_from_shoulder(problem)
    distance = float(np.linalg.norm(p_WT - shoulder))
    found = []
    if distance > reach + SLACK:
        detail = "distance from the arm's shoulder" + _in_metres(distance)
        found.append(Violation("reach", distance, reach, "m", detail=detail))
    if problem.holds_object:
        found += _object_on_floor(problem.cell, p_WT)
    around = problem.cell.surroundings
    for i, (room, clearance_m) in enumerate(zip(around.keep_in, around.keep_in_clearances.tolist(), strict=True)):
        inside = float(room.depth(p_WT))
        if inside < clearance_m - SLACK:
            of = f", {room.called(i)}," if i in around.rooms else ""
            detail = f"tool centre point{of} at the release"
            found.append(Violation("keep_in", inside, clearance_m, "m", detail=detail))
    return [*found, *(_object_at_shapes(problem.cell, p_WT) if problem.holds_object else [])]


def _object_on_floor(cell: Cell, p_WT: Array) -> list[Violation]:
    """Returns by how much an object at the tool centre (3,) is too close to the floor."""
    around = cell.surroundings
    height = float(p_WT[2]) - cell.object.radius_m - around.floor_z_m
    if height >= around.clearance_m - SLACK:
        return []
    return [Violation("floor", height, around.clearance_m, "m", detail="object at the release")]


def _object_at_shapes(cell: Cell, p_WT: Array) -> list[Violation]:
    """Returns by how much an object at the tool centre (3,) is too close to what is kept out."""
    around = cell.surroundings
    found = []
    clearances = (around.clearance_m + around.further_clearances).tolist()
    for shape, name, clearance_m in zip(around.keep_out, around.keep_out_names, clearances, strict=True):
        if around.is_free_to_touch(AllowedContact.OBJECT, name):
            continue
        gap = float(segment_shape_distance(p_WT, p_WT, shape))
        if gap - cell.object.radius_m < clearance_m - SLACK:
            detail = f"object, {name}, at the release"
            found.append(Violation("keep_out", gap - cell.object.radius_m, clearance_m, "m", detail=detail))
    return found


def _misfit(problem: ThrowProblem) -> list[Violation]:
    """Returns by how much the object does not fit at the target, which no certificate passes."""
    found = problem.misfit
    if found is None:
        return []
    return [Violation("flight_clearance", -found.lacking_m, 0.0, "m", detail=f"{found.name}: {found.how}")]


def _joint_speeds(problem: ThrowProblem, qd: Array) -> list[Violation]:
    """Returns the joints whose velocities `qd` (6,) at the release exceed their limits."""
    limits = problem.limits.qd_max
    names = problem.cell.robot.joint_names
    return [
        Violation("joint_velocity", float(abs(qd[i])), float(limits[i]), "rad/s", detail=f"{names[i]} at the release")
        for i in np.flatnonzero(np.abs(qd) > limits + SLACK)
    ]


def _speed(problem: ThrowProblem, v_WT: Array, p_WT: Array | None = None) -> list[Violation]:
    """Returns what rules out a tool velocity (3,) [m/s], at a place (3,) where one is given."""
    speed = float(np.linalg.norm(v_WT))
    limits = problem.limits
    if speed > limits.tcp_speed_max + SLACK:
        return [Violation("tcp_speed", speed, limits.tcp_speed_max, "m/s", detail="at the release")]
    fastest = fastest_tool(problem, p_WT)
    if p_WT is not None and speed > fastest + SLACK:
        detail = "speed at the release; all joints together move the tool no faster there"
        return [Violation("joint_velocity", speed, fastest, "m/s", detail=detail)]
    return []


def fastest_tool(problem: ThrowProblem, p_WT: Array | None = None) -> float:
    """Returns a bound on the tool centre's speed [m/s]: every joint at its limit times its lever.

    At a given place (3,) the lever of the first joint is the distance from its axis.
    """
    lever = body_model(problem.cell).tool_lever.copy()
    X_WB = problem.cell.X_WB
    if p_WT is not None:
        p_BT = X_WB[:3, :3].T @ (p_WT - X_WB[:3, 3])
        lever[0] = min(lever[0], float(np.hypot(p_BT[0], p_BT[1])) + SLACK)
    return float(lever @ problem.limits.qd_max)


def _singularities(problem: ThrowProblem, q: Array, qd: Array) -> list[Violation]:
    """Returns which singularities of elbow and wrist a release (6,), (6,) [rad, rad/s] cannot keep away from.

    A joint with the speed w that brakes by a at most turns w T - a T^2/2 at least within T, or w^2 / 2a where it comes
    to rest before; as much before the release. All of that is within the time in which singularities are watched.
    """
    required = problem.limits.singularity_distance_min
    if required <= SLACK or problem.ends_at_rest:
        return []
    for joint, name in ((4, "wrist"), (2, "elbow")):
        speed = max(0.0, abs(float(qd[joint])) - SLACK)
        slowing = float(problem.limits.qdd_max[joint])
        lasts_s = min(SINGULARITY_WINDOW_S, speed / slowing)
        turned = max(0.0, speed * lasts_s - 0.5 * slowing * lasts_s**2 - SLACK)
        path = q[joint] + np.array([-turned, turned])
        passed = math.floor(path[1] / math.pi) > math.floor(path[0] / math.pi)
        least = 0.0 if passed else float(np.abs(np.sin(path)).min())
        if least < required - SLACK:
            detail = f"{name}: {problem.cell.robot.joint_names[joint]} cannot stop sooner beside the release"
            return [Violation("singularity_distance", least, required, "1", detail=detail)]
    return []


def _in_metres(distance_m: float) -> str:
    """Returns what to add where a distance [m] is most likely one in millimetres."""
    return f"; {distance_m:.0f} m away: positions are in metres" if distance_m >= FARTHEST_M else ""


def _turning(problem: ThrowProblem, w_WT: Array) -> list[Violation]:
    """Returns what rules out a tool's angular velocity (3,) [rad/s]: the joints' velocities add up at best."""
    speed = float(np.linalg.norm(w_WT))
    fastest = float(problem.limits.qd_max.sum())
    if speed <= fastest + SLACK:
        return []
    detail = "angular velocity at the release; all joints together turn the tool no faster"
    return [Violation("joint_velocity", speed, fastest, "rad/s", detail=detail)]


def _range(problem: ThrowProblem, target: Target, p_WT: Array | None = None) -> list[Violation]:
    """Returns the speed that rules a target out: even the best place takes more than the limits on speed allow."""
    bounds = {
        "tcp_speed": problem.limits.tcp_speed_max,
        "release_velocity": target.max_speed_m_s,
        "joint_velocity": fastest_tool(problem, p_WT),
    }
    name = min(bounds, key=lambda name: bounds[name])
    if p_WT is None and _least_speed(problem, target.p_W, *_rim(problem, target.p_W, RIM_FIRST)) <= bounds[name]:
        return _beyond_stretched_arm(problem, target)
    needed = least_speed_within_reach(problem, target.p_W, p_WT)
    if needed > bounds[name] + SLACK:
        detail = "least speed that hits the target from anywhere within the arm's reach"
        detail += f"; {TOOL_LIMIT}" if name == "joint_velocity" else ""
        detail += _in_metres(float(np.linalg.norm(target.p_W - problem.cell.X_WB[:3, 3])))
        return [Violation(name, needed, bounds[name], "m/s", detail=detail)]
    return _beyond_stretched_arm(problem, target) if p_WT is None else []


def _beyond_stretched_arm(problem: ThrowProblem, target: Target) -> list[Violation]:
    """Returns the joints' speed limits where these rule out every throw to a target: see `throw_range`."""
    # What a body comes down with is higher than the target, by how much depends on how it is turned.
    found = None if problem.body is not None and problem.surfaces else out_of_range(problem, target)
    if found is None:
        return []
    needed, given = found
    detail = f"speed away from the shoulder that a throw from the best place within reach needs; {TOOL_LIMIT} there"
    return [Violation("joint_velocity", needed, given, "m/s", detail=detail)]


def least_speed_within_reach(problem: ThrowProblem, target: Array, p_WT: Array | None = None) -> float:
    """Returns a lower bound on the speed [m/s] of a throw to a target (3,), from a place (3,) or from anywhere.

    The least speed v of a throw over the vector d obeys v^2 / g = |d| + d_z. That is convex in the place of the
    release and falls by at most 2 m per metre, so its least value over the ball of the arm's reach is on the rim, in
    the vertical plane through shoulder and target: it is sampled there, less what lies between two samples. Drag asks
    for more speed: from the same release, the flight with drag stays below the one without.
    """
    return _least_speed(problem, target, *(_rim(problem, target) if p_WT is None else (p_WT, 2.0 * SLACK)))


def _least_speed(problem: ThrowProblem, target: Array, places: Array, between_m: float) -> float:
    """Returns the least speed [m/s] of a throw from `places` (..., 3) to a target (3,), |d| + d_z less `between_m`."""
    least = float(least_speed(places, target, problem.gravity_at_tool_speed).min()) ** 2 / problem.gravity_at_tool_speed
    return float(np.sqrt(problem.gravity_at_tool_speed * max(least - between_m, 0.0)))


def _rim(problem: ThrowProblem, target: Array, every: int = 1) -> tuple[Array, float]:
    """Returns places (n, 3) on the rim towards a target (3,), and how much |d| + d_z varies between two [m].

    Only one place of `every` so many is among them.
    """
    shoulder, reach = farthest_from_shoulder(problem)
    away = target[:2] - shoulder[:2]
    length = float(np.linalg.norm(away))
    along = away / length if length > SLACK else np.array([1.0, 0.0])
    angle = np.linspace(-np.pi, np.pi, RIM_POINTS, endpoint=False)[::every]
    rim = np.stack([np.cos(angle) * along[0], np.cos(angle) * along[1], np.sin(angle)], axis=1)
    return shoulder + reach * rim, 2.0 * reach * np.pi / RIM_POINTS + 2.0 * SLACK

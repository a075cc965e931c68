"""The planner's answer: a plan, as the JSON document that the service stores and returns, and read back from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from planner.approach import Approach
from planner.arrays import Array
from planner.cell import Cell
from planner.certificate import Certificate, landing_attitude, landing_errors, release_flight, window_landing_points
from planner.errors import CUT_SHORT, FieldError, InvalidProblem
from planner.flight import Flight, landing_per_release_delay, path
from planner.geometry import tool_state
from planner.kinematics import tcp_acceleration
from planner.passages import first_release, passed_documents
from planner.problem import ThrowProblem
from planner.request import problem_from_request
from planner.rotations import matrix_to_quaternion, matrix_to_rotation_vector
from planner.trajectory import Trajectory

PATH_STEP_S = 0.02  # [s] between the listed positions of the object in flight
DRIFT_S = 1e-4  # [s] early and late: step of a body's central difference
SHIFT_S = 0.01  # [s] early and late, for which every answer gives the shift of the landing point
WINDOW_DELAYS_S = (-0.02, -0.01, 0.0, 0.01, 0.02)  # [s] release delays listed for a request without a window


@dataclass(frozen=True)
class Attempt:
    """One entry of the attempt log: back end ("candidates", "approach" for a way), result in words, duration [s]."""

    backend: str
    result: str
    duration_s: float


@dataclass(frozen=True, eq=False)
class Plan:
    """A certified motion for a problem, with the record of the search.

    Attributes:
        problem: as requested.
        backend: that made the motion.
        trajectory: the motion.
        certificate: of the motion, valid.
        status: final status of the back end, in words.
        iterations: of the back end for this motion.
        solve_time_s: duration of the searches that found it, loading of libraries and solvers excluded [s].
        attempts: log of these searches.
        way_home: certified motion from the plan's end to the cell's home.
        was_cut_short: whether the time limit passed before the end of the search: more time may give a sooner release.
    """

    problem: ThrowProblem
    backend: str
    trajectory: Trajectory
    certificate: Certificate
    status: str
    iterations: int
    solve_time_s: float
    attempts: tuple[Attempt, ...]
    way_home: Approach
    was_cut_short: bool = False


def plan_document(plan: Plan, request: Mapping[str, Any], plan_id: str, created_at: str) -> dict[str, Any]:
    """Returns the plan as `GET /plans/{id}` returns it.

    Args:
        plan: a certified plan.
        request: the request that it answers, as posted.
        plan_id: its identifier.
        created_at: its time of creation, ISO 8601.
    """
    trajectory = plan.trajectory
    cell = plan.problem.cell
    return {
        "id": plan_id,
        "created_at": created_at,
        "cell": cell.name,
        "cell_sha256": cell.sha256,
        "request": dict(request),
        "backend": plan.backend,
        "sample_rate_hz": trajectory.sample_rate_hz,
        "duration_s": trajectory.duration_s,
        **_passed(plan.problem, trajectory),
        **({} if plan.problem.starts_at_s is None else {"starts_at_s": plan.problem.starts_at_s}),
        "flight": _flight(first_part(plan.problem), trajectory),
        "way_home": {"duration_s": plan.way_home.duration_s},
        "trajectory": _samples(cell, trajectory),
        "certificate": {
            "valid": plan.certificate.valid,
            "checks": [c.__dict__ for c in plan.certificate.checks],
            "not_checked": list(plan.certificate.not_checked),
        },
        "solver": {
            "solve_time_s": plan.solve_time_s,
            "iterations": plan.iterations,
            "status": f"{plan.status}; {CUT_SHORT}" if plan.was_cut_short else plan.status,
            "attempts": [attempt.__dict__ for attempt in plan.attempts],
        },
    }


def passing_text(document: Mapping[str, Any]) -> str:
    """Returns in words when a plan passes what it was asked to pass: the release; without one, its passages."""
    end = f"of {document['duration_s']:.3f} s"
    if document["release_time_s"] is not None:
        return f"release after {document['release_time_s']:.3f} s {end}"
    passages = document["passages"]
    times = ", ".join(f"{each['time_s']:.3f}" for each in passages)
    return f"{'passage' if len(passages) == 1 else 'passages'} after {times} s {end}"


def iso_time(at: float) -> str:
    """Returns seconds since the epoch as UTC in ISO 8601 with milliseconds."""
    return datetime.fromtimestamp(at, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def command_time(cell: Cell, release_time_s: float) -> float:
    """Returns the time [s] of the gripper command, on the plan's clock (docs/conventions.md, Time).

    For information: the executor switches the output at a row of its own (`planner.stream_rows.sample_rows`).
    """
    return release_time_s - cell.gripper.delay_s - cell.timing.lag_s


def _samples(cell: Cell, trajectory: Trajectory) -> dict[str, Any]:
    return {
        "joint_names": list(cell.robot.joint_names),
        "time_from_start": trajectory.t.tolist(),
        "positions": trajectory.q.tolist(),
        "velocities": trajectory.qd.tolist(),
        "accelerations": trajectory.qdd.tolist(),
    }


def first_part(problem: ThrowProblem) -> ThrowProblem:
    """Returns the motion as the gripper sees it that lets go first; itself where all is one gripper's."""
    return problem.parts[0].problem if problem.parts else problem


def _passed(problem: ThrowProblem, trajectory: Trajectory) -> dict[str, Any]:
    """Returns what a plan says of its release, null where passages without one are asked for, and of its passages."""
    release = None
    if problem.throws or not problem.passages:
        release = _state(problem, trajectory, trajectory.release_index, problem.throws)
    document = {"release_time_s": None if release is None else trajectory.release_time_s, "release": release}
    if problem.passages:
        document["passages"] = _passages(problem, trajectory)
    return document


def _passages(problem: ThrowProblem, trajectory: Trajectory) -> list[dict[str, Any]]:
    """Returns the passages with their states and their outputs' times, in their order."""
    passed = passed_documents(problem.cell, problem.passages, trajectory)
    flights = _flights(problem, trajectory)
    return [
        {
            "name": told["name"],
            **_state(problem.seen_at(number), trajectory, told["index"], passage.releases),
            "end_index": told["end_index"],
            "time_s": told["index"] / trajectory.sample_rate_hz,
            "releases": passage.gripper or passage.releases,
            **flights.get(number, {}),
            "outputs": told["outputs"],
        }
        for number, (passage, told) in enumerate(zip(problem.passages, passed, strict=True))
    ]


def _flights(problem: ThrowProblem, trajectory: Trajectory) -> dict[int, dict[str, Any]]:
    """Returns the flights of several objects by the numbers of their passages; none of a cell with one gripper."""
    if not problem.cell.grippers or not problem.throws:
        return {}
    if not problem.parts:
        number = first_release(problem.passages)
        return {} if number is None else {number: {"flight": _flight(problem, trajectory)}}
    lets_go = [part for part in problem.parts if part.problem.throws]
    return {part.release: {"flight": _flight(part.problem, part.of(trajectory))} for part in lets_go}


def _state(problem: ThrowProblem, trajectory: Trajectory, k: int, lets_go: bool) -> dict[str, Any]:
    """Returns the state at a sample, and when the gripper is told to open for it; None where it is not."""
    X_WT, V_WT = tool_state(problem.cell, trajectory.q[k], trajectory.qd[k])
    return {
        "index": k,
        "positions": trajectory.q[k].tolist(),
        "velocities": trajectory.qd[k].tolist(),
        "accelerations": trajectory.qdd[k].tolist(),
        "pose": {
            "position": X_WT[:3, 3].tolist(),
            **_orientation(X_WT[:3, :3]),
        },
        "twist": {"linear": V_WT[:3].tolist(), "angular": V_WT[3:].tolist()},
        "command_time_s": command_time(problem.cell, k / trajectory.sample_rate_hz) if lets_go else None,
    }


def _flight(problem: ThrowProblem, trajectory: Trajectory) -> dict[str, Any] | None:
    flight = release_flight(problem, trajectory)
    if flight is None:
        return None
    w = problem.planned_window_s
    drift = _landing_drift(problem, trajectory)
    delays = np.array((-w, -w / 2, 0.0, w / 2, w) if w > 0.0 else WINDOW_DELAYS_S)
    delays = delays[(delays >= -trajectory.release_time_s)]
    errors = landing_errors(problem, trajectory, delays)
    return {
        "landing_point": flight.landing_point.tolist(),
        **_attitude(problem, trajectory),
        "time_of_flight_s": flight.time_of_flight_s,
        "apex_height_m": flight.apex_height_m,
        "speed_m_s": flight.speed_m_s,
        "release_speed_factor": problem.release_speed_factor,
        "drag_coefficient": problem.cell.object.drag_coefficient,
        "drag_per_m": problem.drag,
        "landing_per_release_delay_m_s": drift.tolist() if np.isfinite(drift).all() else None,
        "landing_shift_10ms_m": _landing_shift(problem, trajectory, flight.landing_point),
        "object_path": _object_path(problem, trajectory, flight),
        "release_window_s": w,
        "landing_tolerance_m": problem.landing_tolerance_m,
        "window": [
            {"delay_s": float(d), "landing_error_m": float(e) if np.isfinite(e) else None}
            for d, e in zip(delays, errors, strict=True)
        ],
    }


def _orientation(R: Array) -> dict[str, Any]:
    """Returns an orientation (3, 3) as plans tell it."""
    return {
        "quaternion": matrix_to_quaternion(R).tolist(),
        "rotation_vector": matrix_to_rotation_vector(R).tolist(),
    }


def _attitude(problem: ThrowProblem, trajectory: Trajectory) -> dict[str, Any]:
    """Returns how an object that is no ball lies as it lands; nothing of a ball."""
    R_WO = landing_attitude(problem, trajectory)
    return {} if R_WO is None else {"landing_orientation": {**_orientation(R_WO), "axis": R_WO[:, 2].tolist()}}


def _landing_shift(problem: ThrowProblem, trajectory: Trajectory, landing_point: Array) -> dict[str, float | None]:
    """Returns how far the landing point moves for a release 10 ms early and late [m]; null where it never lands."""
    delays = np.array([-min(SHIFT_S, trajectory.release_time_s), SHIFT_S])
    shifts = np.linalg.norm(window_landing_points(problem, trajectory, delays) - landing_point, axis=1)
    early, late = (float(shift) if np.isfinite(shift) else None for shift in shifts)
    return {"early": early, "late": late}


def _object_path(problem: ThrowProblem, trajectory: Trajectory, flight: Flight) -> list[list[float]]:
    """Returns the object's positions every 20 ms from the release to the landing [m]."""
    k = trajectory.release_index
    T = flight.time_of_flight_s
    state = tool_state(problem.cell, trajectory.q[k], trajectory.qd[k])
    times = np.append(np.arange(0.0, T, PATH_STEP_S), T)
    leaves = problem.release_speed_factor * state.v_WT
    return path(state.p_WT, leaves, times, problem.gravity, problem.drag).tolist()


def _landing_drift(problem: ThrowProblem, trajectory: Trajectory) -> Array:
    if problem.body is not None:
        before, after = window_landing_points(problem, trajectory, np.array([-DRIFT_S, DRIFT_S]))
        return (after - before) / (2.0 * DRIFT_S)
    k = trajectory.release_index
    cell = problem.cell
    X_WT, V_WT = tool_state(problem.cell, trajectory.q[k], trajectory.qd[k])
    a_BT = tcp_acceleration(cell.robot, trajectory.q[k], trajectory.qd[k], trajectory.qdd[k], cell.tool.X_FT)[:3]
    a_WT = cell.X_WB[:3, :3] @ a_BT
    air = (problem.plane_z, problem.gravity, problem.drag)
    return landing_per_release_delay(X_WT[:3, 3], V_WT[:3], a_WT, *air, problem.release_speed_factor)


def plan_from_document(document: Mapping[str, Any], cell: Cell) -> tuple[ThrowProblem, Trajectory]:
    """Returns problem and trajectory of a stored plan, for the executor to certify again with its own cell.

    Args:
        document: as `GET /plans/{id}` returns it.
        cell: the robot station that will execute the plan.

    Raises:
        InvalidProblem: the request does not fit this cell, or the trajectory is malformed.
    """
    cell = _as_the_flight_says(cell, flight_of_own_gripper(document))
    problem = replace(problem_from_request(document["request"], cell), **_window(document))
    problem = aimed_problem(problem, aim_shift(document))
    try:
        samples = document["trajectory"]
        arrays = [np.array(samples[name], float) for name in ("positions", "velocities", "accelerations")]
        passed = tuple(each["index"] for each in document.get("passages", ()))
        release = document["release"]
        release_index = passed[-1] if release is None else release["index"]
        trajectory = Trajectory(
            float(document["sample_rate_hz"]), *arrays, release_index=release_index, passage_indices=passed
        )
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise InvalidProblem([FieldError("trajectory", str(error))]) from error
    return _met(problem, trajectory, document.get("starts_at_s")), trajectory


def _met(problem: ThrowProblem, trajectory: Trajectory, starts_at_s: float | None) -> ThrowProblem:
    """Returns the problem with a target that moves where it is as the object of a plan lands.

    Raises:
        InvalidProblem: the plan does not say when it starts.
    """
    if problem.moving is None:
        return problem
    flight = release_flight(problem, trajectory)
    if flight is None or starts_at_s is None:
        raise InvalidProblem([FieldError("starts_at_s", "is missing, or the object does not come down")])
    lands_at_s = starts_at_s + trajectory.release_time_s + flight.time_of_flight_s
    return replace(problem.met_at(lands_at_s), starts_at_s=starts_at_s)


def aim_shift(document: Mapping[str, Any]) -> Array:
    """Returns by how much a plan's aim lies off its target (3,) [m], so that a learnt cell hits the target."""
    aim = document.get("aim")
    return np.zeros(3) if aim is None else np.array(aim["shift_m"], float)


def promised_tolerance(document: Mapping[str, Any], problem: ThrowProblem) -> float | None:
    """Returns the landing error that a plan promises not to exceed [m]; None where it promises nothing.

    A window promises its tolerance, a bin its room, and a request what it states; a soonest throw that states none is
    for whoever accepts any landing.

    Args:
        document: the plan.
        problem: read from it.
    """
    target = problem.target
    stated = document["request"].get("landing_tolerance_m")
    if target is None or not (problem.is_robust or stated or problem.opening is not None):
        return None
    return problem.landing_tolerance_m or None


def aimed_problem(problem: ThrowProblem, shift: Array) -> ThrowProblem:
    """Returns the problem with its aim, and the mouth that the flight enters, moved by `shift` (3,) [m].

    The bin that the arm keeps out of stays where it stands.
    """
    target = problem.target
    if target is None or not shift.any():
        return problem
    aim = replace(target, p_W=target.p_W + shift)
    return replace(problem.with_release(problem.release.with_target(aim)), aim_shift=problem.aim_shift + shift)


def flight_of_own_gripper(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Returns the flight of what a plan's cell's own gripper lets go; empty where it is another one, or nothing.

    Another one's object flies as the cell file says.
    """
    found = [each for each in document.get("passages") or () if isinstance(each, Mapping)]
    flights = [each.get("flight") for each in found if each.get("releases") is True]
    is_of_others = any(isinstance(each.get("releases"), str) for each in found)
    flight = next(iter(flights), None) if is_of_others else document.get("flight")
    return flight if isinstance(flight, Mapping) else {}


def _as_the_flight_says(cell: Cell, flight: Mapping[str, Any]) -> Cell:
    """Returns the cell with the release speed factor and the drag that a plan was made with.

    Plans of version 0.1 do not state them: their objects leave with the tool's speed, with the cell's drag.
    """
    factor = float(flight.get("release_speed_factor", 1.0))
    drag = float(flight.get("drag_coefficient", cell.object.drag_coefficient))
    if (factor, drag) == (cell.gripper.release_speed_factor, cell.object.drag_coefficient):
        return cell
    gripper = replace(cell.gripper, release_speed_factor=factor)
    thing = replace(cell.object, drag_coefficient=drag)
    return cell.as_learnt(gripper=gripper, object=thing)


def _window(document: Mapping[str, Any]) -> dict[str, float]:
    """Returns the window that the plan was made for, which the cell's defaults of today do not change.

    Plans of version 0.1 do not state it: those without one in their request had none.
    """
    flight = document.get("flight") or {}
    request = document["request"]
    names = ("release_window_s", "landing_tolerance_m")
    return {name: float(flight.get(name, request.get(name)) or 0.0) for name in names}

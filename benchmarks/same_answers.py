"""Records the answers to a fixed set of requests, and compares two records: for changes that must not change answers.

    python -m benchmarks.same_answers record before.npz             # on the code before
    python -m benchmarks.same_answers record after.npz              # on the code after
    python -m benchmarks.same_answers compare before.npz after.npz  # exit status 1 where an answer differs

`--no-clock` stops the clock that budgets of time are read from, so that a slow or busy machine gives the same record
as a fast one. Where a record made with it differs from one made without, a budget of time decided the answer.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.cell import Box, Cell, load_cell
from planner.errors import Infeasible, InvalidProblem, SolverFailed
from planner.kinematics import forward, jacobian
from planner.planning import plan
from planner.request import problem_from_request

Vector = NDArray[np.float64]
Request = dict[str, Any]

CELLS = Path(__file__).parent.parent / "cells"
SHIPPED = ("ur5e-sim", "ur3e-sim", "ur10e-sim", "ur5-sim", "sdu-table", "example-real")
SEED = 12
SPREAD_RAD = 0.9  # from home, of the joint states that releases are made from
SPEED_SHARE = 0.5  # [-] of the velocity limit
CLOSE = 1e-9  # [-] relative or absolute; larger differences of numbers are another answer
TIME_LIMIT_S = 60.0  # ample: no answer may end at the request's own deadline


def cells() -> dict[str, Cell]:
    """Returns the shipped cells, and variants that make every kind of surroundings count."""
    made = {name: load_cell(CELLS / f"{name}.toml") for name in SHIPPED}
    here = made["ur5e-sim"]
    around = here.surroundings
    up = here.X_WB.copy()
    wall = Box(np.array([0.75, -1.0, 0.0]), np.array([0.8, 1.0, 0.9]))
    room = Box(np.array([-0.9, -0.9, 0.1]), np.array([0.9, 0.9, 1.5]))
    up[2, 3] += 0.4
    made["wall"] = replace(here, surroundings=replace(around, keep_out=(wall,)))
    made["room"] = replace(here, surroundings=replace(around, keep_in=(room,)))
    made["pedestal, drag"] = replace(here, X_WB=up, object=replace(here.object, drag_coefficient=0.5))
    made["heavy"] = replace(here, object=replace(here.object, mass_kg=1.5, radius_m=0.05))
    return made


def requests() -> list[tuple[str, Request]]:
    """Returns (cell, request) pairs of every kind of release, back end and refusal; always the same."""
    rng = np.random.default_rng(SEED)
    known = cells()
    return [(name, request) for name, cell in known.items() for request in _of_cell(name, cell, rng)]


def _of_cell(name: str, cell: Cell, rng: np.random.Generator) -> Iterator[Request]:
    for profiles in (("toppra", "trapezoid"), ("cubic", "ramp")):
        q, qd = _state(cell, rng)
        joint = {"kind": "joint", "positions": q.tolist(), "velocities": qd.tolist()}
        pose, point = _tool_releases(cell, q, qd)
        target = _target(cell, rng)
        yield from _each_kind(joint, pose, point, target, profiles)
        yield {"release": pose, "start": {"positions": _start(cell, rng)}}
        if profiles[1] == "ramp":
            yield from _with_options(cell, joint, target)
            if name in ("ur5e-sim", "ur5-sim", "wall"):
                yield from _refused(joint, pose, rng)


def _each_kind(
    joint: Request, pose: Request, point: Request, target: Request, profiles: tuple[str, str]
) -> Iterator[Request]:
    yield from ({"release": release} for release in (joint, pose, point, target))
    yield {"release": target, "release_window_s": 0.02, "landing_tolerance_m": 0.01}
    yield {"release": point, "backend": "casadi"}
    yield {"release": target, "backend": "ruckig"}
    yield {"release": pose, "backend": profiles[0]}
    yield {"release": joint, "backend": profiles[1]}


def _with_options(cell: Cell, joint: Request, target: Request) -> Iterator[Request]:
    tight = {"velocity": (0.7 * cell.limits.qd_max).tolist(), "jerk": float(0.5 * cell.limits.jerk_max.min())}
    yield {"release": target, "limits": tight, "singularity_distance_min": 0.1}
    yield {"release": {**target, "max_release_speed_m_s": 3.5, "min_elevation_rad": 0.1}}
    yield {"release": {**joint, "velocities": [0.0] * 6}, "frame": "base"}
    yield {"release": target, "release_window_s": 0.01, "landing_tolerance_m": 0.01, "backend": "casadi"}


def _refused(joint: Request, pose: Request, rng: np.random.Generator) -> Iterator[Request]:
    yield {"release": {"kind": "target", "position": [4.0 + rng.random(), 0.3, 0.0]}}
    yield {"release": {"kind": "point", "position": [1.6, 0.2, 0.4], "velocity": [0.5, 0.0, 0.5]}}
    yield {"release": {**pose, "twist": {"linear": [9.0, 0.0, 1.0], "angular": [0.0, 0.0, 0.0]}}}
    yield {"release": {**joint, "positions": [9.0, *joint["positions"][1:]]}}


def _state(cell: Cell, rng: np.random.Generator) -> tuple[Vector, Vector]:
    lower = cell.limits.q_lower
    upper = cell.limits.q_upper
    q = np.clip(cell.home + rng.uniform(-SPREAD_RAD, SPREAD_RAD, 6), lower, upper)
    return q, rng.uniform(-SPEED_SHARE, SPEED_SHARE, 6) * cell.limits.qd_max


def _start(cell: Cell, rng: np.random.Generator) -> list[float]:
    return (cell.home + rng.uniform(-0.3, 0.3, 6)).tolist()


def _tool_releases(cell: Cell, q: Vector, qd: Vector) -> tuple[Request, Request]:
    X_WT = cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT)
    V_BT = jacobian(cell.robot, q, cell.tool.X_FT) @ qd
    R_WB = cell.X_WB[:3, :3]
    p_WT = X_WT[:3, 3].tolist()
    linear = (R_WB @ V_BT[:3]).tolist()
    angular = (R_WB @ V_BT[3:]).tolist()
    pose = {"position": p_WT, "rotation_vector": _rotation_vector(X_WT[:3, :3]).tolist()}
    twist = {"linear": linear, "angular": angular}
    return {"kind": "pose", "pose": pose, "twist": twist}, {"kind": "point", "position": p_WT, "velocity": linear}


def _rotation_vector(R: Vector) -> Vector:
    """Returns the rotation vector (3,) of a matrix that is not turned by nearly 0 or pi."""
    angle = np.arccos(np.clip((np.trace(R) - 1.0) / 2.0, -1.0, 1.0))
    return angle / (2.0 * np.sin(angle)) * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])


def _target(cell: Cell, rng: np.random.Generator) -> Request:
    reach = float(abs(cell.robot.a[1]) + abs(cell.robot.a[2]))
    away = reach * rng.uniform(1.1, 1.7)
    angle = rng.uniform(-np.pi, np.pi)
    base = cell.X_WB[:3, 3]
    position = [base[0] + away * np.cos(angle), base[1] + away * np.sin(angle), cell.surroundings.floor_z_m]
    return {"kind": "target", "position": [float(x) for x in position]}


def answer(cell: Cell, request: Request) -> tuple[dict[str, Any], Vector]:
    """Returns what the planner says to a request, and the samples of its trajectory (N, 3, 6); (0, 3, 6) for none."""
    nothing = np.zeros((0, 3, 6))
    try:
        found = plan(problem_from_request({"time_limit_s": TIME_LIMIT_S, **request}, cell))
    except InvalidProblem as error:
        return {"outcome": "invalid", "says": str(error)}, nothing
    except Infeasible as error:
        names = [violation.constraint for violation in error.violations]
        values = [[violation.value, violation.limit] for violation in error.violations]
        return {"outcome": "infeasible", "violations": names, "values": values, "nearest": _nearest(error)}, nothing
    except SolverFailed:
        return {"outcome": "solver-failed"}, nothing
    motion = found.trajectory
    samples = np.stack([motion.q, motion.qd, motion.qdd], axis=1)
    return {
        "outcome": "planned",
        "backend": found.backend,
        "release_index": motion.release_index,
        "samples": len(samples),
        "sha256": hashlib.sha256(samples.tobytes()).hexdigest(),
        "checks": [check.name for check in found.certificate.checks],
        "values": [[check.value, check.limit] for check in found.certificate.checks],
    }, samples


def _nearest(error: Infeasible) -> Any:
    return None if error.nearest is None else error.nearest["release"]


def record(file: Path, every: int) -> None:
    """Writes the answers to the requests, or to one of `every` so many."""
    known = cells()
    rows = {}
    samples = {}
    for i, (name, request) in list(enumerate(requests()))[::every]:
        row, motion = answer(known[name], request)
        rows[i] = {"cell": name, "request": request, **row}
        samples[f"samples_{i}"] = motion
        print(f"{i:4d} {name:15s} {request['release']['kind']:6s} {row['outcome']}", file=sys.stderr)
    np.savez_compressed(file, rows=json.dumps(rows), **samples)


def compare(before: Path, after: Path) -> int:
    """Prints every answer to a request of both records that differs; returns how many there are."""
    one = np.load(before)
    other = np.load(after)
    rows = json.loads(str(one["rows"]))
    others = json.loads(str(other["rows"]))
    pairs = [(int(i), rows[i], others[i]) for i in rows if i in others]
    found = 0
    to_the_bit = 0
    for i, was, now in pairs:
        reasons = list(_differences(was, now, one[f"samples_{i}"], other[f"samples_{i}"]))
        to_the_bit += not reasons and was.get("sha256") == now.get("sha256")
        found += bool(reasons)
        for reason in reasons[:1]:
            backend = was["request"].get("backend", "auto")
            print(f"{i:4d} {was['cell']}, {was['request']['release']['kind']}, {backend}: {reason}")
    print(f"{len(pairs)} requests: {len(pairs) - found} the same ({to_the_bit} to the bit), {found} differ")
    return found


def _differences(was: Mapping[str, Any], now: Mapping[str, Any], before: Vector, after: Vector) -> Iterator[str]:
    for key in ("cell", "request", "outcome", "says", "backend", "release_index", "samples", "checks", "violations"):
        if was.get(key) != now.get(key):
            yield f"{key} was {was.get(key)}, is {now.get(key)}"
    if not (before.shape == after.shape and np.allclose(before, after, rtol=CLOSE, atol=CLOSE)):
        yield f"samples differ by up to {np.abs(before - after).max() if before.shape == after.shape else 'length'}"
    old, new = (np.array(row.get("values", []), dtype=float) for row in (was, now))
    if old.shape != new.shape or not np.allclose(old, new, rtol=1e3 * CLOSE, atol=1e2 * CLOSE, equal_nan=True):
        yield "values of the certificate or of the violations differ"
    if (was.get("nearest") is None) != (now.get("nearest") is None):
        yield f"nearest was {was.get('nearest')}, is {now.get('nearest')}"
    elif was.get("nearest") is not None and not _alike(was["nearest"], now["nearest"]):
        yield f"nearest was {was['nearest']}, is {now['nearest']}"


def _alike(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(_alike(a[key], b[key]) for key in a)
    return a == b if isinstance(a, str) else bool(np.allclose(a, b, rtol=CLOSE, atol=CLOSE))


def main() -> int:
    """Runs one of the two commands; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("record", "compare"))
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--no-clock", action="store_true", help="no budget of time ends")
    parser.add_argument("--every", type=int, default=1, help="record one request of so many, for a quick look")
    given = parser.parse_args()
    if given.command == "compare":
        before, after = given.files
        return 1 if compare(before, after) else 0
    if given.no_clock:
        time.perf_counter = lambda: 0.0
    record(given.files[0], given.every)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Release states for planners without any of their own: random postures, ballistic velocity, least joint velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.arm import PeerArm, Problem

Vector = NDArray[np.float64]

POSTURES = 3000  # drawn, half of them near the start
NEAR_RAD = 1.2  # [rad] around the start
FLIGHT_TIMES = np.linspace(1.0, 2.0, 6)  # [-] of the slowest throw's
TRIED = 40  # states looked at for each one wanted
SPARE = 0.95  # [-] of the limits of joint velocity and tool speed
ROOM_M = 0.002  # [m] beyond the clearances, at the release
ARC_SAMPLES = 60  # of a flight, at which obstacles are looked at
ARC_M = 0.02  # [m] by which a flight passes boxes and rims
AIR_KG_M3 = 1.204
OUT_M = 0.04  # [m] from the release on, the object may be close to what held it
STEP_S = 0.002  # [s] of a flight


@dataclass(frozen=True, eq=False)
class ThrowState:
    """A release that hits the target: joint positions and velocities (6,), and the object's speed [m/s]."""

    q: Vector
    qd: Vector
    speed: float


def release_states(problem: Problem, arm: PeerArm, count: int, slowest: bool = False) -> list[ThrowState]:
    """Returns up to `count` release states that break no limit by themselves, the soonest reached (by a guess) first.

    Args:
        problem: The problem.
        arm: Its arm.
        count: Number of states.
        slowest: Whether the slowest throw of each posture is the only one tried, and the slowest come first.
    """
    q, qd, inverse, order = _throws(problem, arm, _postures(arm), slowest)
    order = order[: TRIED * count]
    order = order[arm.room(q[order]) >= ROOM_M]
    found: list[ThrowState] = []
    for i in order:
        state = _state(problem, arm, q[i], qd[i], inverse[i])
        if state is not None:
            found.append(state)
        if len(found) == count:
            break
    return found


def _postures(arm: PeerArm) -> Vector:
    """Returns random postures (n, 6), half of them near the start."""
    rng = np.random.default_rng(0)
    half = POSTURES // 2
    near = arm.start + rng.uniform(-NEAR_RAD, NEAR_RAD, (half, 6))
    anywhere = rng.uniform(np.maximum(arm.q_lower, -np.pi), np.minimum(arm.q_upper, np.pi), (half, 6))
    q = np.concatenate([near, anywhere])
    return q[((q > arm.q_lower + 0.05) & (q < arm.q_upper - 0.05)).all(axis=1)]


def _throws(
    problem: Problem, arm: PeerArm, q: Vector, slowest: bool
) -> tuple[Vector, Vector, Vector, NDArray[np.intp]]:
    """Returns the throws from postures (n, 6) that obstacles and limits of speed allow, drag left out.

    They are joint positions and velocities (m, 6), weighted inverses of the Jacobians (m, 6, 3), and their order.
    """
    target = problem["target"]
    g = arm.around["gravity_m_s2"]
    p, J = arm.tool(q)
    away = np.array(target["position_m"]) - p
    t = (FLIGHT_TIMES[:1] if slowest else FLIGHT_TIMES)[:, None] * np.sqrt(2.0 * np.linalg.norm(away, axis=1) / g)
    v = away / t[..., None] + np.array([0.0, 0.0, 0.5 * g]) * t[..., None]
    inverse = np.asarray(np.linalg.pinv(J * arm.qd_max) * arm.qd_max[:, None], dtype=np.float64)
    qd = np.einsum("nij,knj->kni", inverse, v)
    speed = np.linalg.norm(v, axis=-1)
    fits = (np.abs(qd) <= SPARE * arm.qd_max).all(-1) & (speed <= SPARE * arm.speed_max) & (v[..., 2] < g * t)
    fits &= np.arcsin(v[..., 2] / speed) >= target["min_elevation_rad"]
    fits &= np.linalg.norm(away[:, :2], axis=1) >= target["min_horizontal_distance_m"]
    k, n = np.nonzero(fits)
    passes = _pass(problem, arm, _parabolas(p[n], v[k, n], t[k, n], g))
    k = k[passes]
    n = n[passes]
    travel = np.abs(q[n] - arm.start - 0.5 * qd[k, n] ** 2 * np.sign(qd[k, n]) / arm.qdd_max)
    guess = (travel / arm.qd_max + 2.0 * np.abs(qd[k, n]) / arm.qdd_max).max(axis=1)
    return q[n], qd[k, n], inverse[n], np.argsort(speed[k, n] if slowest else guess)


def _state(problem: Problem, arm: PeerArm, q: Vector, qd: Vector, inverse: Vector) -> ThrowState | None:
    """Returns the state if its flight is clear, its velocity corrected for drag."""
    p, J = (x[0] for x in arm.tool(q[None]))
    v = J @ qd
    target = np.array(problem["target"]["position_m"])
    for _ in range(4 if problem["object"]["drag_coefficient"] > 0.0 else 0):
        path = flight(problem, p, v)
        if path is None:
            return None
        v = v + (target - path[-1]) / (STEP_S * (len(path) - 1)) * [1.0, 1.0, 0.0]
    qd = inverse @ v
    path = flight(problem, p, v)
    if path is None or np.any(np.abs(qd) > SPARE * arm.qd_max) or not _is_clear(problem, arm, path, q):
        return None
    return ThrowState(q, qd, float(np.linalg.norm(v)))


def flight(problem: Problem, p: Vector, v: Vector) -> Vector | None:
    """Returns the path (n, 3) of the object's centre down to the target's height; None if it stays below that."""
    if problem["object"]["drag_coefficient"] == 0.0:
        return _parabola(p, v, problem["surroundings"]["gravity_m_s2"], problem["target"]["position_m"][2])
    thing = problem["object"]
    g = problem["surroundings"]["gravity_m_s2"]
    plane = problem["target"]["position_m"][2]
    drag = 0.5 * AIR_KG_M3 * thing["drag_coefficient"] * np.pi * thing["radius_m"] ** 2 / thing["mass_kg"]
    rows = [p]
    down = np.array([0.0, 0.0, -g])
    for _ in range(round(3.0 / STEP_S)):
        a = down - drag * np.linalg.norm(v) * v
        middle = v + 0.5 * STEP_S * a
        p = p + STEP_S * middle
        v = v + STEP_S * (down - drag * np.linalg.norm(middle) * middle)
        rows.append(p)
        if v[2] < 0.0 and p[2] <= plane:
            share = (rows[-2][2] - plane) / (rows[-2][2] - p[2])
            rows[-1] = rows[-2] + share * (p - rows[-2])
            return np.array(rows) if 0.0 <= share <= 1.0 else None
    return None


def _parabolas(p: Vector, v: Vector, t: Vector, g: float) -> Vector:
    """Returns flights (m, n, 3) of m releases that take the times `t` (m,) [s], without drag."""
    s = np.linspace(0.0, 1.0, ARC_SAMPLES) * t[:, None]
    return p[:, None] + v[:, None] * s[..., None] - 0.5 * g * s[..., None] ** 2 * np.array([0.0, 0.0, 1.0])


def _parabola(p: Vector, v: Vector, g: float, plane: float) -> Vector | None:
    root = v[2] ** 2 + 2.0 * g * (p[2] - plane)
    if root < 0.0 or v[2] + np.sqrt(root) <= 0.0:
        return None
    t = np.linspace(0.0, (v[2] + np.sqrt(root)) / g, 200)[:, None]
    return p + v * t - [0.0, 0.0, 0.5 * g] * t**2


def _is_clear(problem: Problem, arm: PeerArm, x: Vector, q: Vector) -> bool:
    """Returns whether a flight (n, 3) passes the arm in its posture, and all else."""
    away = x[np.linalg.norm(x - x[0], axis=1) > OUT_M]
    if arm.gaps(q[None], away).min(initial=np.inf) < arm.radius:
        return False
    return bool(_pass(problem, arm, x[None])[0])


def _pass(problem: Problem, arm: PeerArm, x: Vector) -> NDArray[np.bool_]:
    """Returns which flights (m, n, 3) pass the boxes, and enter the bin through its mouth."""
    thick = arm.radius + ARC_M
    target = np.array(problem["target"]["position_m"])
    good = np.ones(len(x), dtype=bool)
    for lower, upper in arm.boxes:
        good &= np.linalg.norm(x - np.clip(x, lower, upper), axis=-1).min(axis=1, initial=np.inf) >= thick
    vessel: dict[str, Any] | None = problem["target"]["bin"]
    if vessel is not None:
        aside = np.linalg.norm(x[..., :2] - target[:2], axis=-1) - vessel["radius_m"]
        over = x[..., 2] - target[2] - vessel["rim_height_m"]
        inside = aside <= -arm.radius - 0.005
        good &= (over[:, 0] > 0.0) & (inside | (np.hypot(aside, over) >= thick) & (over > 0.0)).all(axis=1)
    return good

"""The textbook formulation in plain CasADi with IPOPT: jerk constant on equal intervals, the release state free.

Launch and brake have a free duration each, and so has the flight. Constraints hold at the nodes: joint limits, tool
speed, floor, the box that the tool stays in, landing and elevation. Boxes, the arm itself and torques are looked at
afterwards, with the next initial guess where they are not kept; drag and the flight's clearance are left out. A second
solve puts the release on a tick.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.arm import PeerArm, Problem
from benchmarks.peers.motions import WITHIN, Answer, answer, is_right, refusal
from benchmarks.peers.releases import release_states

Vector = NDArray[np.float64]

LAUNCH = 20
BRAKE = 12  # intervals
NODES = LAUNCH + BRAKE + 1
DURATION_S = (0.05, 5.0)  # [s] of each phase
TRIES = 3  # initial guesses
TIME_LIMIT_S = 8.0  # [s] of one solve
ROOM_M = 0.003  # [m] and
SPARE = 0.99  # [-] at the nodes, for the motion between them
BRAKE_WEIGHT = 0.05
SPEED_MIN = 0.3  # [m/s]


def plan(problem: Problem) -> Answer:
    """Returns the answer to a problem of ThrowBench."""
    arm = PeerArm(problem)
    rate = float(problem["sample_rate_hz"])
    program = _program(problem, arm)
    for state in release_states(problem, arm, TRIES):
        first = _solve(program, _guess(problem, arm, state.q, state.qd), None)
        if first is None:
            continue
        second = _solve(program, first, np.ceil(first[0] * rate) / rate)
        if second is None:
            continue
        q, qd, release = _sampled(second, rate)
        if is_right(arm, rate, q, qd, release):
            return answer(q, qd, release, rate)
    return refusal("IPOPT found no motion that is clear")


def _solve(program: dict[str, Any], guess: Vector, launch_s: float | None) -> Vector | None:
    """Returns the variables of IPOPT's solution, with the launch's duration fixed or free; None where it fails."""
    lower = program["lbx"].copy()
    upper = program["ubx"].copy()
    if launch_s is not None:
        lower[0] = upper[0] = launch_s
    found = program["solver"](x0=guess, lbx=lower, ubx=upper, lbg=program["lbg"], ubg=program["ubg"])
    return np.array(found["x"]).ravel() if program["solver"].stats()["success"] else None


def _program(problem: Problem, arm: PeerArm) -> dict[str, Any]:
    """Returns the solver and the bounds of its variables: durations of launch, brake, flight; nodes; jerks."""
    T = ca.SX.sym("T", 3)
    X = ca.SX.sym("X", 18, NODES)
    J = ca.SX.sym("J", 6, NODES - 1)
    steps = [T[0] / LAUNCH] * LAUNCH + [T[1] / BRAKE] * BRAKE
    rows = []
    lower = []
    upper = []

    def hold(expression: Any, low: Any, high: Any) -> None:
        rows.append(expression)
        lower.append(np.broadcast_to(low, expression.shape[0]))
        upper.append(np.broadcast_to(high, expression.shape[0]))

    top = SPARE * arm.qd_max
    for i, h in enumerate(steps):
        q = X[:6, i]
        v = X[6:12, i]
        a = X[12:, i]
        j = J[:, i]
        after = ca.vertcat(q + h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j)
        hold(X[:, i + 1] - after, 0.0, 0.0)
        hold(v + h * a / 2, -top, top)
    place = _place(problem, arm)
    for i in range(1, NODES):
        p, velocity, heights = place(X[:6, i], X[6:12, i])
        hold(ca.sumsqr(velocity), 0.0, (SPARE * arm.speed_max) ** 2)
        hold(heights, arm.around["floor_z_m"] + arm.around["clearance_m"] + ROOM_M, np.inf)
        for low, high in arm.keep_in:
            hold(p, low + ROOM_M, high - ROOM_M)
    _add_flight(problem, arm, place(X[:6, LAUNCH], X[6:12, LAUNCH]), T[2], hold)
    still = np.concatenate([arm.start, np.zeros(12)])
    ends = [arm.q_lower, -top, -WITHIN * arm.qdd_max], [arm.q_upper, top, WITHIN * arm.qdd_max]
    low, high = (np.tile(np.concatenate(side)[:, None], NODES) for side in ends)
    low[:, 0] = still
    high[:, 0] = still
    low[6:, -1] = 0.0
    high[6:, -1] = 0.0
    jerk = np.tile(WITHIN * arm.jerk_max, NODES - 1)
    cost = T[0] + BRAKE_WEIGHT * T[1] + 1e-9 * ca.sumsqr(J)
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.max_wall_time": TIME_LIMIT_S}
    x = ca.vertcat(T, ca.vec(X), ca.vec(J))
    g = ca.vertcat(*rows)
    return {
        "solver": ca.nlpsol("throw", "ipopt", {"x": x, "f": cost, "g": g}, options),
        "lbx": np.concatenate([np.full(3, DURATION_S[0]), low.T.ravel(), -jerk]),
        "ubx": np.concatenate([np.full(3, DURATION_S[1]), high.T.ravel(), jerk]),
        "lbg": np.concatenate(lower),
        "ubg": np.concatenate(upper),
    }


def _add_flight(problem: Problem, arm: PeerArm, released: Any, t: Any, hold: Any) -> None:
    target = problem["target"]
    (p, v, _) = released
    landing = p + t * v - ca.DM([0.0, 0.0, 0.5 * arm.around["gravity_m_s2"]]) * t**2
    hold(landing - ca.DM(target["position_m"]), 0.0, 0.0)
    hold(v[2] - np.sin(target["min_elevation_rad"]) * ca.sqrt(ca.sumsqr(v) + 1e-6), 1e-4, np.inf)
    far = np.array(target["position_m"][:2])
    hold(ca.sumsqr(p[:2] - far), (target["min_horizontal_distance_m"] + ROOM_M) ** 2, np.inf)
    hold(ca.sumsqr(v), SPEED_MIN**2, np.inf)


def _place(problem: Problem, arm: PeerArm) -> Any:
    """Returns the function of position and velocity of the tool, and heights of the capsules' lowest points."""
    q = ca.SX.sym("q", 6)
    qd = ca.SX.sym("qd", 6)
    dh = problem["arm"]["dh"]
    X = np.eye(4)
    X[:3, :3] = problem["base"]["rotation"]
    X[:3, 3] = problem["base"]["position_m"]
    frames = [ca.SX(X)]
    for i in range(6):
        c = ca.cos(q[i])
        s = ca.sin(q[i])
        ca_ = np.cos(dh["alpha_rad"][i])
        sa = np.sin(dh["alpha_rad"][i])
        a = dh["a_m"][i]
        d = dh["d_m"][i]
        rows = [[c, -s * ca_, s * sa, a * c], [s, c * ca_, -c * sa, a * s], [0, sa, ca_, d], [0, 0, 0, 1]]
        frames.append(frames[-1] @ ca.vertcat(*[ca.horzcat(*row) for row in rows]))
    p = (frames[6] @ ca.DM([*problem["tool"]["position_m"], 1.0]))[:3]
    heights = [
        (frames[body["frame"]] @ ca.DM([*body[end], 1.0]))[2] - body["radius_m"]
        for body in problem["arm"]["capsules"]
        for end in ("from_m", "to_m")
        if body["frame"] > 0
    ]
    return ca.Function("place", [q, qd], [p, ca.jtimes(p, q, qd), ca.vertcat(*heights, p[2] - arm.radius)])


def _guess(problem: Problem, arm: PeerArm, q: Vector, qd: Vector) -> Vector:
    share = np.minimum(np.linspace(0.0, NODES / LAUNCH, NODES), 1.0)[:, None]
    nodes = np.zeros((NODES, 18))
    nodes[:, :6] = arm.start + share * (q - arm.start)
    nodes[LAUNCH, 6:12] = qd
    flight_s = np.sqrt(2.0 * np.linalg.norm(np.array(problem["target"]["position_m"]) - arm.tool(q[None])[0][0]) / 9.81)
    return np.concatenate([[0.8, 0.4, flight_s], nodes.ravel(), np.zeros(6 * (NODES - 1))])


def _sampled(x: Vector, rate: float) -> tuple[Vector, Vector, int]:
    """Returns positions and velocities (n, 6) on ticks, and the release's index, of a solution."""
    nodes = x[3 : 3 + 18 * NODES].reshape(-1, 18)
    jerk = x[3 + 18 * NODES :].reshape(-1, 6)
    times = np.concatenate([[0.0], np.cumsum([x[0] / LAUNCH] * LAUNCH + [x[1] / BRAKE] * BRAKE)])
    t = np.arange(int(np.ceil(times[-1] * rate)) + 1) / rate
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, NODES - 2)
    s = np.minimum(t, times[-1])[:, None] - times[i][:, None]
    q = nodes[i, :6]
    v = nodes[i, 6:12]
    a = nodes[i, 12:]
    j = jerk[i]
    velocity = v + s * (a + s * j / 2.0)
    velocity[-1] = 0.0
    return q + s * (v + s * (a / 2.0 + s * j / 6.0)), velocity, round(x[0] * rate)

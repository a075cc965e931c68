"""The rows of the optimal control problem, as functions of the state and control of one stage.

z = (q, qd / pi, qdd / 15, t / 0.1 | jerk / 500, h / 0.1): constant jerk over a step of length h, integrated exactly. A
`Block` is a group of rows that belong together; where it applies is the problem's business (`assembly`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from planner.backends.casadi_nlp import arm, clearance, layout
from planner.backends.casadi_nlp.layout import ARM, BOXES

SX = Any


@dataclass(frozen=True)
class Rows:
    """Rows of a block, what is held while differentiating, and how many leading rows the Hessian leaves out."""

    rows: SX
    held: clearance.Held
    uncurved: int = 0


@dataclass(frozen=True)
class State:
    """Joint state in SI units, each (6,)."""

    q: SX
    qd: SX
    qdd: SX


def state(z: SX) -> State:
    """Returns the state at a stage's beginning."""
    return State(z[layout.Q], z[layout.QD] * layout.QD_SCALE, z[layout.QDD] * layout.QDD_SCALE)


def after(z: SX, share: float) -> State:
    """Returns the state after a share of the stage's step, exactly."""
    s, h, j = state(z), share * z[layout.STEP] * layout.TIME_SCALE, z[layout.JERK] * layout.JERK_SCALE
    q = s.q + h * (s.qd + h * (s.qdd / 2 + h * j / 6))
    return State(q, s.qd + h * (s.qdd + h * j / 2), s.qdd + h * j)


def motion(z: SX, p: SX) -> Rows:
    """Next state (NX), velocity's middle control point (6), position's middle (6), all scaled."""
    end, s = after(z, 1.0), state(z)
    step = z[layout.STEP] * layout.TIME_SCALE
    bend = (s.qd + s.qdd * step / 2) / layout.QD_SCALE
    following = ca.vertcat(end.q, end.qd / layout.QD_SCALE, end.qdd / layout.QDD_SCALE, z[layout.TIME] + z[layout.STEP])
    return Rows(ca.vertcat(following, bend, after(z, 0.5).q), clearance.Held())


def cost(z: SX, p: SX) -> Rows:
    """One row: weighted time, squared jerk, and the step's deviation from the first guess's. p: `COST`."""
    c = COST.split(p)
    step = z[layout.STEP]
    row = c["time"] * step + c["jerk"] * ca.sumsqr(z[layout.JERK]) + c["step"] * (step / c["guess"] - 1) ** 2
    return Rows(row, clearance.Held())


COST = layout.Layout({"time": 1, "jerk": 1, "step": 1, "guess": 1})
TORQUE_ROWS = 6
FIRST_THAT_FALLS = 2  # base and shoulder do not come nearer to the floor


def effort(z: SX, p: SX) -> Rows:
    """Joint torque shares (6), whose curvature is left out, and tool speed share squared, at the stage's beginning."""
    return _effort_rows(state(z), ARM.split(p))


def effort_middle(z: SX, p: SX) -> Rows:
    """The same rows in the middle of the step; all their curvature is left out: little is lost, half the time saved."""
    return _effort_rows(after(z, 0.5), ARM.split(p))


def _effort_rows(s: State, a: dict[str, SX]) -> Rows:
    tau = arm.torques(a["dh"], a["links"], a["gravity"], s.q, s.qd, s.qdd) / a["torque"]
    v = arm.tool_motion(a["dh"], a["tcp"], s.q, s.qd, s.qdd).velocity
    return Rows(ca.vertcat(tau, ca.sumsqr(v) / a["speed"] ** 2), clearance.Held())


def space(z: SX, p: SX) -> Rows:
    """Self, floor and keep-in distances less what is asked, at the stage's beginning: rows [m] not to be negative."""
    return _space_rows(state(z), ARM.split(p))


def space_middle(z: SX, p: SX) -> Rows:
    """The same rows in the middle of the step; their curvature is left out."""
    return _space_rows(after(z, 0.5), ARM.split(p))


def _space_rows(s: State, a: dict[str, SX]) -> Rows:
    held, body = clearance.Held(), arm.frames(a["dh"], s.q)
    capsules = clearance.capsules_in_s(body, a["capsules"])
    R_WB, p_WB = ca.reshape(a["base"][:9], 3, 3), a["base"][9:]
    R_WS = R_WB @ arm.turn(s.q[0])
    heights = clearance.lowest_heights(capsules, R_WS[2, :].T, p_WB[2], FIRST_THAT_FALLS)
    p_WT = R_WS @ body.point(6, a["tcp"]) + p_WB
    inside = ca.vertsplit(ca.vertcat(p_WT - a["keep_in"][:3], a["keep_in"][3:] - p_WT))
    rows = ca.vertcat(
        clearance.self_distance(capsules, a["pairs"], held) - a["self_clearance"],
        clearance.soft_minimum(heights, held) - a["floor"],
        clearance.soft_minimum(inside, held),
    )
    return Rows(rows, held)


def _uncurved(made: Rows) -> Rows:
    return Rows(made.rows, made.held, made.rows.size1())


def boxes(z: SX, p: SX) -> Rows:
    """Distance of everything that moves from the keep-out boxes, less what is asked (1) [m]. p: `ARM`, `BOXES`."""
    return _box_rows(state(z), p)


def boxes_middle(z: SX, p: SX) -> Rows:
    """The same row in the middle of the step."""
    return _box_rows(after(z, 0.5), p)


def _box_rows(s: State, p: SX) -> Rows:
    a, b, held = ARM.split(p[: ARM.size]), BOXES.split(p[ARM.size :]), clearance.Held()
    body = clearance.capsules_in_s(arm.frames(a["dh"], s.q), a["capsules"])
    R_WS = ca.reshape(a["base"][:9], 3, 3) @ arm.turn(s.q[0])
    starts, ends = ([R_WS @ point + a["base"][9:] for point in points] for points in (body.starts, body.ends))
    gaps = clearance.box_distances(clearance.Capsules(starts, ends, body.radii), b["boxes"], held)
    return Rows(clearance.soft_minimum(gaps, held) - b["box_clearance"], held, uncurved=1)


def singular(z: SX, p: SX) -> Rows:
    """Signed distances from the elbow, wrist and shoulder singularities (3) [-]."""
    return _singular_rows(z[layout.Q], p)


def singular_middle(z: SX, p: SX) -> Rows:
    """The same rows in the middle of the step; their curvature is left out."""
    return _singular_rows(after(z, 0.5).q, p)


def _singular_rows(q: SX, p: SX) -> Rows:
    a = ARM.split(p)
    rows = ca.vertcat(ca.sin(q[2]), ca.sin(q[4]), arm.shoulder_distance(a["dh"], q))
    return Rows(rows, clearance.Held())

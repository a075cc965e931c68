"""MuJoCo models of the audit: inverse dynamics of the arm, and the flight of the object."""

from __future__ import annotations

from functools import cache, lru_cache

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from audit.judge.pinocchio_arm import CELLS_KEPT, arm_model
from planner.cell import Cell

Vector = NDArray[np.float64]

STEP_S = 0.002  # [s] of the flight: Runge-Kutta is exact for a free fall, the chord at the end is off by 5e-6 m
FLIGHT_MAX_S = 5.0  # [s]
INERTIA_ORDER = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])  # xx yy zz xy xz yz; source: MJCF

BALL = """
<mujoco><option timestep="{step}" gravity="0 0 {gravity}" integrator="RK4"/>
<worldbody>
<body><freejoint/><inertial pos="0 0 0" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/></body>
</worldbody>
</mujoco>
"""


@cache
def _ball(gravity: float) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(BALL.format(step=STEP_S, gravity=-gravity))


def landing_point(p: Vector, v: Vector, plane_z: float, gravity: float) -> Vector | None:
    """Returns the point (3,) where a ball falls through a horizontal plane [m], or None if it does not.

    Args:
        p: Position of the release (3,) [m].
        v: Velocity of the release (3,) [m/s].
        plane_z: Height of the plane [m].
        gravity: Acceleration of gravity [m/s^2].
    """
    model = _ball(gravity)
    data = mujoco.MjData(model)
    data.qpos[:3] = p
    data.qvel[:3] = v
    before = np.array(p)
    for _ in range(round(FLIGHT_MAX_S / STEP_S)):
        mujoco.mj_step(model, data)
        now = data.qpos[:3].copy()
        if now[2] <= plane_z < before[2]:
            share = (before[2] - plane_z) / (before[2] - now[2])
            return before + share * (now - before)
        before = now
    return None


def inverse_dynamics(cell: Cell, with_object: bool, q: Vector, qd: Vector, qdd: Vector) -> Vector:
    """Returns MuJoCo's joint torques (N, 6) [N m].

    Args:
        cell: The cell.
        with_object: Whether the arm holds the object.
        q: Joint positions (N, 6) [rad].
        qd: Joint velocities (N, 6) [rad/s].
        qdd: Joint accelerations (N, 6) [rad/s^2].
    """
    model = _arm(cell, with_object)
    data = mujoco.MjData(model)
    rows = []
    for state in zip(q, qd, qdd, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_inverse(model, data)
        rows.append(data.qfrc_inverse.copy())
    return np.array(rows).reshape(-1, 6)


@lru_cache(maxsize=2 * CELLS_KEPT)
def _arm(cell: Cell, with_object: bool) -> mujoco.MjModel:
    arm = arm_model(cell, with_object)
    return mujoco.MjModel.from_xml_string(_document(arm, cell.surroundings.gravity_m_s2))


def _document(arm: pin.Model, gravity: float) -> str:
    """Returns the kinematic chain as MJCF: one body per joint, which turns about its own z axis."""
    opening = ""
    closing = ""
    for i in range(1, 7):
        X = arm.jointPlacements[i]
        body = arm.inertias[i]
        turn = pin.Quaternion(X.rotation)
        opening += (
            f'<body pos="{_text(X.translation)}" quat="{_text([turn.w, turn.x, turn.y, turn.z])}">'
            f'<joint type="hinge" axis="0 0 1"/>'
            f'<inertial pos="{_text(body.lever)}" mass="{body.mass!r}" '
            f'fullinertia="{_text(body.inertia[INERTIA_ORDER])}"/>'
        )
        closing += "</body>"
    return (
        f'<mujoco><compiler angle="radian" boundmass="0" boundinertia="0"/><option gravity="0 0 {-gravity}"/>'
        f"<worldbody>{opening}{closing}</worldbody></mujoco>"
    )


def _text(values: object) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(values, dtype=float).ravel())

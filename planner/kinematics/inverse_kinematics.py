"""Inverse kinematics in closed form: eight branches, and every turn of every joint within its limits.

The axes of a calibrated arm are not quite parallel and square: there the closed form, with the measured lengths, is
where Newton's iteration begins.

The branches are shoulder left or right, wrist flipped or not, elbow up or down. Source: geometric solution for arms
whose joints 2, 3 and 4 are parallel, e.g. Hawkins, "Analytic Inverse Kinematics for the Universal Robots UR-5/UR-10
Arms" (2013); written with vectors, so that no branch divides by a sine.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array, Index, Mask
from planner.kernel import Kernel, twin_of
from planner.kinematics.forward_kinematics import forward, jacobian
from planner.kinematics.singularities import SINGULARITIES, signed_singularity_distances
from planner.robots import Robot
from planner.robots import robot as robot_named
from planner.rotations import invert_pose, matrix_to_rotation_vector, pose, rotation_vector_to_matrix

# signs of (shoulder, wrist, elbow) of the eight branches
_SIGNS = np.array(list(product((1.0, -1.0), repeat=3)))

REACH_TOLERANCE_M = 1e-10  # [m] beyond a stretched arm that counts as rounding; below the promised 1e-9
WRIST_FREE = 1e-10  # [1] |sin q5| below which q6 does not change the pose by the promised 1e-9
SINGULAR_DISTANCE = 1e-4  # [1] within which a pose is singular; rounding of a pose by 1e-9 changes it less
LIMIT_SLACK_RAD = 1e-9  # [rad] beyond a limit that counts as rounding; such a solution is moved onto the limit
SAME_RAD = 1e-7  # [rad] branches closer than this coincide in a singularity
SEED_EXCESS_M = 0.05  # [m] beyond the reach of the closed form from which Newton still begins: several calibrations
REFINED = 1e-10  # [m, rad] pose error at which Newton's iteration ends; a tenth of the promised 1e-9
NEWTON_ROUNDS = 12  # [-] iterations at most; away from singularities three or four do
STEP_MAX_RAD = 0.2  # [rad] largest joint step of one iteration: a posture does not leap to another branch
BENT_RAD = np.array([0.0, -0.1, 0.2, -0.1, 0.0, 0.0])  # [rad] bend of the elbow there: 2 mm less reach or more
DAMPING = 1e-6  # [m, rad] singular values below it do not count: steps stay finite in a singularity


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """All solutions for a pose.

    Attributes:
        q: solutions (n, 6) [rad], each branch at every turn within the limits; n may be 0.
        branch: number of the branch of each (n,): solutions of one branch differ by full turns.
        singular: names of the singularities on which branches of this pose lie, within the limits or not. With
            "wrist" among them, joints 4 and 6 are one choice of a continuum: that with the elbow closest to a right
            angle.
        reach_excess_m: distance by which the pose is out of reach, in the arm's plane [m]; 0 where it can be
            reached, even if only outside the limits.
    """

    q: Array
    branch: Index
    singular: tuple[str, ...]
    reach_excess_m: float

    @property
    def reachable(self) -> bool:
        """Whether the pose can be reached if joint limits are ignored."""
        return self.reach_excess_m == 0.0


def inverse(
    robot: Robot,
    X_BT: ArrayLike,
    X_FT: ArrayLike | None = None,
    q_lower: ArrayLike | None = None,
    q_upper: ArrayLike | None = None,
) -> InverseKinematics:
    """Returns the solutions for one pose of the tool.

    Args:
        robot: the arm.
        X_BT: pose of the tool in the base (4, 4).
        X_FT: pose of the tool in the flange (4, 4); the flange itself by default.
        q_lower, q_upper: joint limits (6,) [rad]; the arm's own by default.
    """
    branches, excess = inverse_branches(robot, X_BT, X_FT)
    within = np.isfinite(branches[:, 0])
    if not within.any():
        return InverseKinematics(np.empty((0, 6)), np.empty(0, dtype=np.intp), (), float(excess.min()))
    near = np.abs(signed_singularity_distances(robot, branches[within])).min(axis=0) < SINGULAR_DISTANCE
    singular = tuple(name for name, is_near in zip(SINGULARITIES, near, strict=True) if is_near)
    distinct = _distinct(branches[within]) if singular or robot.fixed is not None else branches[within]
    lower = robot.q_lower if q_lower is None else np.asarray(q_lower, dtype=np.float64)
    upper = robot.q_upper if q_upper is None else np.asarray(q_upper, dtype=np.float64)
    return InverseKinematics(*_all_turns(distinct, lower, upper), singular, 0.0)


def inverse_branches(robot: Robot, X_BT: ArrayLike, X_FT: ArrayLike | None = None) -> tuple[Array, Array]:
    """Returns the eight branches (..., 8, 6) in (-pi, pi], and how far each is out of reach (..., 8) [m].

    A branch out of reach is NaN. Works over leading dimensions of `X_BT` (..., 4, 4).
    """
    X_BF = np.asarray(X_BT, dtype=np.float64)
    if X_FT is not None:
        X_BF = X_BF @ invert_pose(X_FT)
    if robot.fixed is not None:
        q, excess = _refined(robot, X_BF, *_closed_form(robot, X_BF))
        q[excess > 0.0] = np.nan
        return q, excess
    found = _branches(X_BF.reshape(-1, 4, 4), robot).reshape(*X_BF.shape[:-2], len(_SIGNS), 7)
    return found[..., :6], found[..., 6]


def _compiled(kernel: Kernel, X_BF: Array, robot: Robot) -> Array:
    lengths = *robot.d[[0, 3, 4, 5]], *robot.a[[1, 2]], REACH_TOLERANCE_M, WRIST_FREE
    return kernel.branches(X_BF, np.array(lengths))


def _example() -> tuple[Array, Robot]:
    """Returns poses within reach, the last with joint 6 free."""
    turn = rotation_vector_to_matrix([[0.1, 0.2, 0.3], [2.0, 1.0, -1.0], [0.5 * np.pi, 0.0, 0.0]])
    return pose([[0.3, -0.4, 0.2], [-0.5, 0.1, 0.4], [0.4, 0.3, 0.1]], turn), robot_named("ur5e")


@twin_of(_compiled, _example)
def _branches(X_BF: Array, robot: Robot) -> Array:
    """Returns the branches (n, 8, 6) of flange poses (n, 4, 4), and how far each is out of reach: (n, 8, 7)."""
    q, excess = _closed_form(robot, X_BF)
    q[excess > 0.0] = np.nan
    return np.concatenate([q, excess[..., None]], axis=-1)


def _refined(robot: Robot, X_BF: Array, q: Array, excess: Array) -> tuple[Array, Array]:
    """Returns branches (..., 8, 6) that have the pose X_BF (..., 4, 4) in the measured chain, and the missing reach.

    Args:
        robot: a calibrated arm.
        X_BF: poses of the flange.
        q: branches of the closed form.
        excess: how far each is out of its reach (..., 8) [m].
    """
    goals = np.broadcast_to(X_BF[..., None, :, :], (*q.shape[:-1], 4, 4))
    rows = np.nonzero(excess <= SEED_EXCESS_M)
    # Stretched to the limit, elbow up and elbow down are one posture: each begins on its own side.
    bent = np.where(excess > 0.0, _SIGNS[:, 2], 0.0)[..., None] * BENT_RAD
    refined = q.copy()
    missing = excess.copy()
    refined[rows], error = _newton(robot, goals[rows], (q + bent)[rows])
    missing[rows] = np.where(error <= REFINED, 0.0, np.maximum(error, excess[rows]))
    return _wrapped(refined), missing


def _newton(robot: Robot, X_BF: Array, q: Array) -> tuple[Array, Array]:
    """Returns joint positions (n, 6) close to `q` (n, 6) with the flange at X_BF (n, 4, 4), and the errors left (n,).

    The largest of the three offsets [m] and the three components of the rotation [rad] that are left.
    """
    q, error = q.copy(), np.full(len(q), np.inf)
    todo = np.arange(len(q))
    for _ in range(NEWTON_ROUNDS):
        twist = _twist_between(forward(robot, q[todo]), X_BF[todo])
        error[todo] = np.abs(twist).max(axis=1, initial=0.0)
        far = error[todo] > REFINED
        todo = todo[far]
        twist = twist[far]
        if len(todo) == 0:
            break
        J = jacobian(robot, q[todo])
        square = J @ np.swapaxes(J, -1, -2) + DAMPING**2 * np.eye(6)
        step = (np.swapaxes(J, -1, -2) @ np.linalg.solve(square, twist[..., None]))[..., 0]
        q[todo] += step * np.minimum(1.0, STEP_MAX_RAD / np.maximum(np.abs(step).max(axis=1), STEP_MAX_RAD))[:, None]
    return q, error


def _twist_between(X: Array, goal: Array) -> Array:
    """Returns the twists (n, 6) that move poses X (n, 4, 4) to `goal` (n, 4, 4) in unit time."""
    turn = matrix_to_rotation_vector(goal[:, :3, :3] @ np.swapaxes(X[:, :3, :3], -1, -2))
    return np.concatenate([goal[:, :3, 3] - X[:, :3, 3], turn], axis=1)


def _closed_form(robot: Robot, X_BF: Array) -> tuple[Array, Array]:
    """Returns the eight branches (..., 8, 6) of the flange's pose, and how far each is out of reach (..., 8) [m].

    A branch out of reach is the closest to it.
    """
    x6, y6, z6 = (X_BF[..., None, :3, k] for k in range(3))
    p5 = X_BF[..., None, :3, 3] - robot.d[5] * z6
    q1, short = _shoulder(p5, robot.d[3])
    across, along = _plane(q1)
    q5, c6, s6, free = _wrist(across, x6, y6, z6)
    p = np.stack([_dot(p5, along), p5[..., 2] - robot.d[0] + 0.0 * q1], axis=-1)  # wrist centre in the arm's plane
    z4 = -(s6[..., None] * x6 + c6[..., None] * y6)
    down = np.stack([_dot(z4, along), z4[..., 2]], axis=-1)  # from wrist 1 to the wrist's centre, in the arm's plane
    down = np.where(free[..., None], _elbow_at_right_angle(p, robot), down)
    q6 = np.where(free, _last_joint(down, along, x6, y6), np.arctan2(s6, c6))
    q2, q3, beyond = _elbow(p - robot.d[4] * down, robot)
    q4 = np.arctan2(down[..., 0], -down[..., 1]) - q2 - q3
    q = _wrapped(np.stack(np.broadcast_arrays(q1, q2, q3, q4, q5, q6), axis=-1))
    return q, np.maximum(short, beyond)


def _shoulder(p5: Array, offset: float) -> tuple[Array, Array]:
    """Returns joint 1 (..., 8) with the wrist's centre `offset` beside the arm's plane, and the missing reach [m]."""
    x = p5[..., 0]
    y = p5[..., 1]
    radius = np.hypot(x, y)
    ahead = np.sqrt(np.maximum((radius - offset) * (radius + offset), 0.0))
    q1 = np.arctan2(y, x) + np.arctan2(offset, _SIGNS[:, 0] * ahead)
    return q1, _beyond_tolerance(offset - radius) + 0.0 * q1


def _plane(q1: Array) -> tuple[Array, Array]:
    """Returns horizontal directions (..., 3) across the arm's plane (axes 2, 3, 4) and along it."""
    cos = np.cos(q1)
    sin = np.sin(q1)
    nothing = np.zeros_like(q1)
    return np.stack([sin, -cos, nothing], axis=-1), np.stack([cos, sin, nothing], axis=-1)


def _wrist(across: Array, x6: Array, y6: Array, z6: Array) -> tuple[Array, Array, Array, Mask]:
    """Returns joint 5, cosine and sine of joint 6 (..., 8), and where joint 6 is free.

    The axes 2, 3, 4 are (s5 c6, -s5 s6, c5) in the flange.
    """
    x = _dot(across, x6)
    y = _dot(across, y6)
    z = _dot(across, z6)
    sine = np.hypot(x, y)
    free = sine < WRIST_FREE
    scale = _SIGNS[:, 1] / np.where(free, 1.0, sine)
    return np.arctan2(_SIGNS[:, 1] * sine, z), x * scale, -y * scale, free


def _elbow_at_right_angle(p: Array, robot: Robot) -> Array:
    """Returns the direction (..., 2) from wrist 1 to the wrist's centre with the elbow closest to a right angle."""
    reach = np.maximum(np.hypot(p[..., 0], p[..., 1]), REACH_TOLERANCE_M)
    wanted = robot.a[1] ** 2 + robot.a[2] ** 2
    cosine = np.clip((reach**2 + robot.d[4] ** 2 - wanted) / (2.0 * reach * robot.d[4]), -1.0, 1.0)
    angle = np.arctan2(p[..., 1], p[..., 0]) + np.arccos(cosine)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _last_joint(down: Array, along: Array, x6: Array, y6: Array) -> Array:
    """Returns joint 6 (..., 8) with the axis of joint 5 along `down`."""
    z4 = down[..., :1] * along + down[..., 1:] * np.array([0.0, 0.0, 1.0])
    return np.arctan2(-_dot(z4, x6), -_dot(z4, y6))


def _elbow(p4: Array, robot: Robot) -> tuple[Array, Array, Array]:
    """Returns joints 2 and 3 (..., 8) with wrist 1 at a point (..., 2) of the arm's plane; the missing reach [m]."""
    upper = robot.a[1]
    fore = robot.a[2]
    reach = np.hypot(p4[..., 0], p4[..., 1])
    longest = abs(upper + fore)
    shortest = abs(upper - fore)
    room = np.maximum(longest - reach, 0.0) * (longest + reach)
    slack = np.maximum(reach - shortest, 0.0) * (reach + shortest)
    q3 = _SIGNS[:, 2] * 2.0 * np.arctan2(np.sqrt(room), np.sqrt(slack))  # half-angle form: exact near 0 and pi
    q2 = np.arctan2(p4[..., 1], p4[..., 0]) - np.arctan2(fore * np.sin(q3), upper + fore * np.cos(q3))
    return q2, q3, _beyond_tolerance(np.maximum(reach - longest, shortest - reach))


def _beyond_tolerance(excess: Array) -> Array:
    return np.where(excess > REACH_TOLERANCE_M, excess, 0.0)


def _dot(a: Array, b: Array) -> Array:
    """Returns the dot product (...) of vectors (..., 3)."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _wrapped(q: Array) -> Array:
    """Returns the same angles in (-pi, pi]."""
    return q - 2.0 * np.pi * np.ceil(q / (2.0 * np.pi) - 0.5)


def _distinct(q: Array) -> Array:
    """Returns the rows of q (n, 6) without those that coincide with an earlier one in a singularity."""
    apart = np.abs(_wrapped(q[:, None] - q[None])).max(axis=-1) > SAME_RAD
    first = [i for i in range(len(q)) if apart[i, :i].all()]
    return q[first]


def _all_turns(q: Array, lower: Array, upper: Array) -> tuple[Array, Index]:
    """Returns every row of q (k, 6) at every turn within the limits (6,), and which row it is.

    A turn that exceeds a limit by rounding is moved onto it.
    """
    origin = np.arange(len(q))
    low = lower - LIMIT_SLACK_RAD
    high = upper + LIMIT_SLACK_RAD
    first = _turns(low - q.max(axis=0))
    last = _turns(high - q.min(axis=0)) + 1
    for joint in range(6):
        turns = 2.0 * np.pi * np.arange(first[joint], last[joint] + 1)
        angles = q[:, joint, None] + turns
        row, column = np.nonzero((angles >= low[joint]) & (angles <= high[joint]))
        q = q[row]
        origin = origin[row]
        q[:, joint] = angles[row, column]
    return np.clip(q, lower, upper), origin


def _turns(angle: Array) -> Index:
    return np.floor(angle / (2.0 * np.pi)).astype(np.intp)

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

from planner.arrays import Array, Index
from planner.kinematics.forward_kinematics import forward, jacobian
from planner.kinematics.singularities import SINGULARITIES, signed_singularity_distances
from planner.native import loops
from planner.robots import Robot
from planner.rotations import invert_pose, matrix_to_rotation_vector

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
    lengths = np.array([*robot.d[[0, 3, 4, 5]], *robot.a[[1, 2]], REACH_TOLERANCE_M, WRIST_FREE])
    found = loops.branches(X_BF.reshape(-1, 4, 4), lengths).reshape(*X_BF.shape[:-2], len(_SIGNS), 7)
    q = found[..., :6]
    excess = found[..., 6]
    if robot.fixed is not None:
        q, excess = _refined(robot, X_BF, q, excess)
    q[excess > 0.0] = np.nan
    return q, excess


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

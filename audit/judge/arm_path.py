"""Pinocchio's arm at many postures, as arrays: one call of the library a posture, everything after that at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from audit.judge.pinocchio_arm import dh_frames_in_urdf
from planner.cell import Cell

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ArmPath:
    """The arm at n postures, in the world.

    Attributes:
        R, p: axes (n, 7, 3, 3) and origins (n, 7, 3) [m] of base and DH frames.
        v, w: linear velocity of the tool centre point and its angular velocity (n, 3) [m/s, rad/s].
    """

    R: Vector
    p: Vector
    v: Vector
    w: Vector

    @classmethod
    def of(cls, cell: Cell, model: pin.Model, q: Vector, qd: Vector) -> ArmPath:
        """Evaluates an arm of `arm_model` at joint positions and velocities (n, 6) [rad, rad/s]."""
        data = model.createData()
        joints = np.empty((len(q), 6, 4, 4))
        twists = np.empty((len(q), 6))
        for k in range(len(q)):
            pin.forwardKinematics(model, data, q[k], qd[k])
            for i in range(6):
                joints[k, i] = data.oMi[i + 1].homogeneous
            twists[k] = pin.getVelocity(model, data, 6, pin.LOCAL_WORLD_ALIGNED).vector
        frames = joints @ np.array([X.homogeneous for X in dh_frames_in_urdf(cell.robot)])
        base = np.broadcast_to(cell.X_WB, (len(q), 1, 4, 4))
        X = np.concatenate([base, frames], axis=1)
        arm_W = joints[:, 5, :3, :3] @ cell.tool.X_FT[:3, 3]
        v = twists[:, :3] + np.cross(twists[:, 3:], arm_W)
        return cls(X[..., :3, :3], X[..., :3, 3], v, twists[:, 3:])

    def points(self, frame: int, at: Vector) -> Vector:
        """Returns places (n, m, 3) in the world of points (m, 3) that are fixed in a frame [m]."""
        return self.p[:, frame, None] + at @ np.swapaxes(self.R[:, frame], 1, 2)

    def placed(self, frame: int, X: pin.SE3) -> tuple[Vector, Vector]:
        """Returns axes (n, 3, 3) and origin (n, 3) [m] of what is fixed in a frame."""
        return self.R[:, frame] @ X.rotation, self.points(frame, X.translation[None])[:, 0]

    def rows(self, which: slice | NDArray[np.intp]) -> ArmPath:
        """Returns the arm at some of the postures."""
        return ArmPath(self.R[which], self.p[which], self.v[which], self.w[which])

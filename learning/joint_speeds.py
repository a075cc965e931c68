"""What joint speeds at the release will be, from the ones that were recorded: gains, and scatter from throw to throw.

Recorded speed of joint j in throw k: qd_jk (1 + e_j) + n_jk, with the planned qd_jk, a gain error e_j that stays and a
scatter n_jk that does not. Conjugate Bayesian regression a joint, normal and inverse gamma; source: Gelman et al.,
Bayesian Data Analysis, 3rd edition, chapter 14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.arrays import Array

GAIN_STD = 0.02  # [-] prior of a gain about 1; source: a real UR5's peaks are 0.99 to 1.04 of the command
# [rad/s] prior scatter at the release; source: 0.020 to 0.027 rad/s rms on a real UR5
SCATTER_RAD_S = 0.022
SCATTER_SHAPE = 2.0  # [-] of the inverse gamma: the least for which the variance has a mean


@dataclass(frozen=True, eq=False)
class JointSpeeds:
    """Posterior of gain errors and scatter.

    Attributes:
        gain_error: of each joint (6,) [-].
        gain_std: its standard error (6,) [-].
        shape: of the inverse gamma of the scatter's variance [-].
        scale: of the same [rad^2/s^2].
    """

    gain_error: Array
    gain_std: Array
    shape: float
    scale: float

    @property
    def scatter_rad_s(self) -> float:
        """Typical scatter of a joint's speed at the release [rad/s]."""
        return float(np.sqrt(self.scale / self.shape))

    def expected(self, planned_qd: Array) -> Array:
        """Returns the expected deviation from planned speeds (..., 6) [rad/s]."""
        return self.gain_error * planned_qd

    def std(self, planned_qd: Array) -> Array:
        """Returns the standard deviation of a throw's deviation from planned speeds (..., 6) [rad/s]."""
        return np.hypot(self.gain_std * planned_qd, self.scatter_rad_s)

    def drawn(self, rng: np.random.Generator, planned_qd: Array, count: int, repeats: int) -> Array:
        """Returns deviations (count, repeats, 6) from `planned_qd` (6,): `count` arms, `repeats` throws of each."""
        gains = self.gain_error + self.gain_std * rng.standard_normal((count, 1, 6))
        scatter = np.sqrt(self.scale / rng.gamma(self.shape, size=(count, 1, 1)))
        return gains * planned_qd + scatter * rng.standard_normal((count, repeats, 6))


def learn_joint_speeds(planned_qd: Array, deviations: Array) -> JointSpeeds:
    """Returns the posterior after n throws.

    Args:
        planned_qd: planned joint speeds at the release (n, 6) [rad/s].
        deviations: measured less planned (n, 6) [rad/s].
    """
    shape = SCATTER_SHAPE
    scale = (SCATTER_SHAPE - 1.0) * SCATTER_RAD_S**2
    x = np.reshape(planned_qd, (-1, 6))
    y = np.reshape(deviations, (-1, 6))
    precision = (SCATTER_RAD_S / GAIN_STD) ** 2 + (x * x).sum(axis=0)  # in units of the scatter's own precision
    gain = (x * y).sum(axis=0) / precision
    shape += 0.5 * y.size
    scale += 0.5 * float(((y * y).sum(axis=0) - precision * gain**2).sum())
    std = np.sqrt(scale / shape / precision)
    return JointSpeeds(gain, std, shape, scale)

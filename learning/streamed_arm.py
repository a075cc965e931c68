"""How a streamed arm deviates from its plan: its lag and gains, and the executor's feedback, tick by tick."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.trajectory import Trajectory, columns_at

# The position feedback that the executor adds to planned joint speeds.
FEEDBACK_GAIN = 5.0  # [1/s] with a lag of 20 ms the loop loses 0.1 rad of phase: far from ringing
FEEDBACK_MAX = 0.25  # [rad/s] bound of the correction: that of the error at which a run ends, 0.05 rad
AFTER_S = 0.15  # [s] that are simulated after the plan's end, while the arm settles


@dataclass(frozen=True, eq=False)
class StreamedArm:
    """An arm under speedj.

    Attributes:
        lag_s: of the arm [s].
        gain: of each joint (6,) [-].
    """

    lag_s: float
    gain: Array

    def deviation(
        self, trajectory: Trajectory, assumed_lag_s: float, qd_max: Array, times: Array
    ) -> tuple[Array, Array]:
        """Returns by how much positions and speeds are off the plan (m, 6) at plan times (m,).

        A tick sends the planned speed one assumed lag ahead, and feedback on the position of now, both together no
        faster than the joints may be; the arm moves with gain times what was sent one lag ago. The first-order part
        counts as delay.

        Args:
            trajectory: as planned.
            assumed_lag_s: lag that it was streamed with [s].
            qd_max: the arm's limits on joint speed (6,) [rad/s].
            times: on the plan's clock [s].
        """
        dt = trajectory.dt
        lead = math.ceil(max(assumed_lag_s, self.lag_s) / dt) + 2
        t = np.asarray(dt * np.arange(-lead, math.ceil((trajectory.duration_s + AFTER_S) / dt)), float)
        q_plan, qd_plan = _standing(trajectory, t)
        sent = _standing(trajectory, t + assumed_lag_s)[1].copy()
        q = np.empty_like(q_plan)
        qd = np.zeros_like(qd_plan)
        back = max(self.lag_s / dt, 1.0)  # what is sent in a tick moves nothing before the next
        whole = int(back)
        share = back - int(back)
        q[0] = q_plan[0]
        for k in range(len(t)):
            if k > 0:
                late = sent[max(k - whole, 0)]
                later = sent[max(k - whole - 1, 0)]
                qd[k] = self.gain * ((1.0 - share) * late + share * later)
                q[k] = q[k - 1] + 0.5 * dt * (qd[k - 1] + qd[k])
            sent[k] += np.clip(FEEDBACK_GAIN * (q_plan[k] - q[k]), -FEEDBACK_MAX, FEEDBACK_MAX)
            sent[k] = np.clip(sent[k], -qd_max, qd_max)
        return columns_at(times, t, q - q_plan), columns_at(times, t, qd - qd_plan)


def _standing(trajectory: Trajectory, times: Array) -> tuple[Array, Array]:
    """Returns positions and speeds (n, 6) at times (n,), at rest before and after the plan."""
    q, qd, _ = trajectory.at(times)
    return q, np.where(((times < 0.0) | (times > trajectory.duration_s))[:, None], 0.0, qd)

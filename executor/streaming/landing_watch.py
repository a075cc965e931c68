"""Whether the object would land within its tolerance, judged in the launch from how the arm follows the plan.

With the speed u_j that was sent one lag before, planned speed and feedback together, a joint's measured speed less that
is modelled as a_j u_j - d qdd_j: a gain error a_j of the joint, and a lateness d of the whole arm. Both are fitted by
least squares over the launch so far, with priors that a real arm's figures give, and carried on to the release, the
feedback until then included. Plain floats: the streaming process imports no numpy.
"""

from __future__ import annotations

import math

from executor.stream_job import ExpectedLanding, Row, StreamJob

JOINTS = range(6)
CORRELATED_S = 0.02  # [s] within which errors of an arm's speed go together; source: a real UR5 (docs/learning.md)
GAIN_STD = 0.05  # [-] prior of a gain error: twice what real arms show, so that it hardly draws the fit
LATENESS_STD_S = 0.03  # [s] prior of the lateness: an arm whose lag nobody measured
NOISE_MIN_RAD_S = 0.005  # [rad/s] scatter of a measured joint speed, at least
DEVIATIONS = 2.0  # [-] standard errors beyond the tolerance at which the object is kept: 98 % of what was just right


class LandingWatch:
    """Running sums of the fit, one tick at a time.

    Attributes:
        lateness_s: of the arm behind the plan, once `miss` was called [s].
        gain_error: of each joint, likewise (6,) [-].
    """

    def __init__(self, job: StreamJob, expected: ExpectedLanding) -> None:
        self.job, self.expected = job, expected
        self.together = max(CORRELATED_S / job.dt, 1.0)  # [ticks] that count as one
        self.count = 0
        self.speed2, self.rate2, self.cross, self.error2 = [0.0] * 6, [0.0] * 6, [0.0] * 6, [0.0] * 6
        self.by_speed, self.by_rate = [0.0] * 6, [0.0] * 6
        self.feedback: list[Row] = []  # [rad/s] sent with each row so far
        self.arrived = self.offset = [0.0] * 6  # [rad/s, rad] feedback that the arm follows now, and its position error
        self.lateness_s, self.gain_error = 0.0, [0.0] * 6

    def add(self, row: int, reference: tuple[Row, Row, Row], measured: tuple[Row, Row], feedback: Row) -> None:
        """Adds a tick; rows that were lost sent what the row before them had sent.

        Args:
            row: of the schedule.
            reference: planned q, qd and qdd of now, (6,) each [rad, rad/s, rad/s^2].
            measured: q and qd of now, (6,) each [rad, rad/s].
            feedback: sent with this row beside the planned speed (6,) [rad/s].
        """
        self.feedback += [self.feedback[-1] if self.feedback else feedback] * (row - len(self.feedback)) + [feedback]
        self.arrived = self._arrived(row)
        self.offset = [a - b for a, b in zip(measured[0], reference[0], strict=True)]
        self.count += 1
        for j in JOINTS:
            u, a = reference[1][j] + self.arrived[j], reference[2][j]
            e = measured[1][j] - u
            self.speed2[j] += u * u
            self.rate2[j] += a * a
            self.cross[j] += u * a
            self.by_speed[j] += u * e
            self.by_rate[j] += a * e
            self.error2[j] += e * e

    def miss(self, q: Row, qd: Row, rest_s: float) -> tuple[float, float]:
        """Returns how far from the expected landing the object would land, and the standard error of that [m].

        Args:
            q, qd: planned state of now (6,) [rad, rad/s].
            rest_s: time from now to the release [s].
        """
        noise = NOISE_MIN_RAD_S
        for _ in range(2):  # the priors weigh against the noise, which the first fit shows
            self._fit(noise)
            noise = max(NOISE_MIN_RAD_S, self._residual())
        known, prior = self.expected, self._speed_prior(noise)
        x, y = known.shift_when_late(self.lateness_s)
        variance = [0.0, 0.0]
        for j in JOINTS:
            ahead, faster = self._at_release(j, q[j], qd[j], rest_s)
            x += known.by_q[0][j] * ahead + known.by_qd[0][j] * faster
            y += known.by_q[1][j] * ahead + known.by_qd[1][j] * faster
            spread = self.together * noise**2 / (self.speed2[j] + prior)
            for axis in (0, 1):
                variance[axis] += (known.by_qd[axis][j] * known.qd[j]) ** 2 * spread
        return math.hypot(x - known.shift[0], y - known.shift[1]), math.sqrt(max(variance))

    def _arrived(self, row: int) -> Row:
        """Returns the feedback that reaches the arm now (6,): that of one lag before."""
        back = int(self.job.lag_ticks)
        share, rows = self.job.lag_ticks - back, self.feedback
        if row - back < 1:
            return [0.0] * 6
        return [(1.0 - share) * a + share * b for a, b in zip(rows[row - back], rows[row - back - 1], strict=True)]

    def _at_release(self, j: int, q: float, qd: float, rest_s: float) -> tuple[float, float]:
        """Returns how far joint j will be ahead [rad], and how much faster than planned [rad/s], lateness apart."""
        late, gain, known = self.lateness_s, self.gain_error[j], self.expected
        ahead = self.offset[j] + late * qd + gain * (known.q[j] - q) + self.arrived[j] * rest_s
        share = max(0.0, 1.0 - self.job.lag_ticks * self.job.dt / rest_s)  # of the way, when the last feedback is sent
        error = (1.0 - share) * self.offset[j] + share * (ahead - late * known.qd[j])
        most = self.job.feedback_max
        feedback = min(max(-self.job.feedback_gain * error, -most), most)
        return ahead, gain * known.qd[j] + (1.0 + gain) * feedback

    def reason(self, q: Row, qd: Row, rest_s: float) -> str:
        """Returns why the object must be kept; empty where it lands within its tolerance. Arguments as of `miss`."""
        miss, error = self.miss(q, qd, rest_s)
        tolerance = self.expected.tolerance_m
        if not miss > tolerance + DEVIATIONS * error:
            return ""
        worst = max(JOINTS, key=lambda j: abs(self.gain_error[j] * self.expected.qd[j]))
        return (
            f"the object was kept: it would have landed {1e3 * miss:.0f} mm (± {1e3 * error:.0f}) off, beyond its "
            f"tolerance of {1e3 * tolerance:.0f} mm; the arm is {1e3 * self.lateness_s:.1f} ms later than planned, "
            f"and joint {worst + 1} {100 * self.gain_error[worst]:+.1f} % off its speed"
        )

    def _fit(self, noise: float) -> None:
        """Solves the least squares: the gains are eliminated, which leaves one equation for the lateness."""
        prior = self._speed_prior(noise)
        weight = [v + prior for v in self.speed2]
        left = self.together * (noise / LATENESS_STD_S) ** 2
        right = 0.0
        for j in JOINTS:
            left += self.rate2[j] - self.cross[j] ** 2 / weight[j]
            right -= self.by_rate[j] - self.cross[j] * self.by_speed[j] / weight[j]
        self.lateness_s = right / left
        self.gain_error = [(self.by_speed[j] + self.lateness_s * self.cross[j]) / weight[j] for j in JOINTS]

    def _speed_prior(self, noise: float) -> float:
        return self.together * (noise / GAIN_STD) ** 2

    def _residual(self) -> float:
        """Returns the scatter about the fit [rad/s]."""
        late, total = self.lateness_s, 0.0
        for j in JOINTS:
            a = self.gain_error[j]
            total += self.error2[j] - 2.0 * a * self.by_speed[j] + 2.0 * late * self.by_rate[j]
            total += a * a * self.speed2[j] - 2.0 * a * late * self.cross[j] + late * late * self.rate2[j]
        return math.sqrt(max(total, 0.0) / (6.0 * max(self.count, 1)))

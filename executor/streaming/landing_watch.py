"""Whether the object would land within its tolerance, judged in the launch from how the arm follows the plan.

The arm's model: a joint moves at 1 + a_j times the speed that was sent one lag and a lateness d before, planned speed
and feedback together; a_j is a gain error of the joint, d of the whole arm. Both are fitted by least squares over the
launch so far, with priors that a real arm's figures give. Lateness bends the speed's course by more than its first
order, so that sums are kept for several assumed ones; the fit about the nearest one counts. The model is then run on
to the release, with the feedback that it makes the stream send. Plain floats: the streaming process imports no numpy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from executor.stream_job import ExpectedLanding, Row, StreamJob

JOINTS = range(6)
CORRELATED_S = 0.02  # [s] within which errors of an arm's speed go together; source: a real UR5
GAIN_STD = 0.05  # [-] prior of a gain error: twice what real arms show, so that it hardly draws the fit
LATENESS_STD_S = 0.03  # [s] prior of the lateness: an arm whose lag nobody measured
ASSUMED_FROM_S = -0.01
ASSUMED_TO_S = 0.03
ASSUMED_STEP_S = 0.01  # [s] assumed latenesses: the rest of one is small
NOISE_MIN_RAD_S = 0.005  # [rad/s] scatter of a measured joint speed, at least
STEPS_MAX = 40  # [-] in which the model is run on to the release: 0.3 ms
DEVIATIONS = 2.0  # [-] standard errors beyond the tolerance at which the object is kept: 98 % of what was just right


class AssumedLateness:
    """Running sums of the fit about one lateness: what is left of it, and the gain errors.

    Attributes:
        lateness_s: the whole lateness, once `fit` was called [s].
        gain_error: of each joint, likewise (6,) [-].
        noise: scatter about the fit, likewise [rad/s].
    """

    def __init__(self, assumed_s: float, together: float) -> None:
        """Takes the lateness [s], and how many ticks count as one."""
        self.assumed_s = assumed_s
        self.together = together
        self.count = 0
        self.speed2 = [0.0] * 6
        self.rate2 = [0.0] * 6
        self.cross = [0.0] * 6
        self.error2 = [0.0] * 6
        self.by_speed = [0.0] * 6
        self.by_rate = [0.0] * 6
        self.lateness_s = 0.0
        self.gain_error = [0.0] * 6
        self.noise = NOISE_MIN_RAD_S

    def add(self, speed: Row, rate: Row, measured: Row) -> None:
        """Adds a tick: expected speed, planned acceleration and measured speed (6,) [rad/s, rad/s^2]."""
        self.count += 1
        for j in JOINTS:
            u = speed[j]
            a = rate[j]
            e = measured[j] - u
            self.speed2[j] += u * u
            self.rate2[j] += a * a
            self.cross[j] += u * a
            self.by_speed[j] += u * e
            self.by_rate[j] += a * e
            self.error2[j] += e * e

    def fit(self) -> None:
        """Fits lateness and gain errors."""
        self.noise = NOISE_MIN_RAD_S
        for _ in range(2):  # the priors weigh against the noise, which the first fit shows
            self._fit(self.noise)
            self.noise = max(NOISE_MIN_RAD_S, self._residual())

    def gain_variance(self, j: int) -> float:
        """Returns the variance of joint j's gain error [-]."""
        return self.together * self.noise**2 / (self.speed2[j] + self._speed_prior(self.noise))

    @property
    def rest_s(self) -> float:
        """What the fit adds to the assumed lateness [s]."""
        return self.lateness_s - self.assumed_s

    def _fit(self, noise: float) -> None:
        """Solves the least squares: the gains are eliminated, which leaves one equation for the lateness."""
        prior = self._speed_prior(noise)
        weight = [v + prior for v in self.speed2]
        of_lateness = self.together * (noise / LATENESS_STD_S) ** 2
        left = of_lateness
        right = -of_lateness * self.assumed_s
        for j in JOINTS:
            left += self.rate2[j] - self.cross[j] ** 2 / weight[j]
            right -= self.by_rate[j] - self.cross[j] * self.by_speed[j] / weight[j]
        rest = right / left
        self.lateness_s = self.assumed_s + rest
        self.gain_error = [(self.by_speed[j] + rest * self.cross[j]) / weight[j] for j in JOINTS]

    def _speed_prior(self, noise: float) -> float:
        return self.together * (noise / GAIN_STD) ** 2

    def _residual(self) -> float:
        """Returns the scatter about the fit [rad/s]."""
        late = self.rest_s
        total = 0.0
        for j in JOINTS:
            a = self.gain_error[j]
            total += self.error2[j] - 2.0 * a * self.by_speed[j] + 2.0 * late * self.by_rate[j]
            total += a * a * self.speed2[j] - 2.0 * a * late * self.cross[j] + late * late * self.rate2[j]
        return math.sqrt(max(total, 0.0) / (6.0 * max(self.count, 1)))


class LandingWatch:
    """What the launch has shown so far, one tick at a time.

    Attributes:
        lateness_s: of the arm behind the plan, once `miss` was called [s].
        gain_error: of each joint, likewise (6,) [-].
    """

    def __init__(self, job: StreamJob, expected: ExpectedLanding) -> None:
        self.job = job
        self.expected = expected
        step = max(round(ASSUMED_STEP_S / job.dt), 1) * job.dt
        first = math.floor(ASSUMED_FROM_S / step)
        last = math.ceil(ASSUMED_TO_S / step)
        together = max(CORRELATED_S / job.dt, 1.0)
        self.assumed = [AssumedLateness(k * step, together) for k in range(first, last + 1)]
        self.feedback: list[Row] = []  # [rad/s] sent with each row so far
        self.q: Row = [0.0] * 6  # [rad] measured last
        self.lateness_s = 0.0
        self.gain_error = [0.0] * 6

    def go_by(self, job: StreamJob, expected: ExpectedLanding) -> None:
        """Goes by another job, whose rows so far are this one's: what they have shown of the arm stays."""
        self.job = job
        self.expected = expected

    def add(self, row: int, measured: tuple[Row, Row], feedback: Row) -> None:
        """Adds a tick; rows that were lost sent what the row before them had sent.

        Args:
            row: of the schedule.
            measured: q and qd of now, (6,) each [rad, rad/s].
            feedback: sent with this row beside the planned speed (6,) [rad/s].
        """
        self.feedback += [self.feedback[-1] if self.feedback else feedback] * (row - len(self.feedback)) + [feedback]
        self.q = measured[0]
        for each in self.assumed:
            at = row - each.assumed_s / self.job.dt
            speed = _between(self.job.reference_qd, at)
            arrived = self._arrived(self.feedback, at)
            expected = [u + b for u, b in zip(speed, arrived, strict=True)]
            each.add(expected, self._acceleration(at), measured[1])

    def miss(self, row: int) -> tuple[float, float]:
        """Returns how far from the expected landing the object would land, and the standard error of that [m].

        Args:
            row: that was added last.
        """
        for each in self.assumed:
            each.fit()
        fitted = min(self.assumed, key=lambda each: abs(each.rest_s))
        self.lateness_s = fitted.lateness_s
        self.gain_error = fitted.gain_error
        known = self.expected
        x, y = known.shift_when_late(self.lateness_s)
        ahead, faster = self._at_release(row)
        variance = [0.0, 0.0]
        for j in JOINTS:
            x += known.by_q[0][j] * ahead[j] + known.by_qd[0][j] * faster[j]
            y += known.by_q[1][j] * ahead[j] + known.by_qd[1][j] * faster[j]
            for axis in (0, 1):
                variance[axis] += (known.by_qd[axis][j] * known.qd[j]) ** 2 * fitted.gain_variance(j)
        return math.hypot(x - known.shift[0], y - known.shift[1]), math.sqrt(max(variance))

    def reason(self, row: int) -> str:
        """Returns why the object must be kept; empty where it lands within its tolerance. Argument as of `miss`."""
        miss, error = self.miss(row)
        tolerance = self.expected.tolerance_m
        if not miss > tolerance + DEVIATIONS * error:
            return ""
        worst = max(JOINTS, key=lambda j: abs(self.gain_error[j] * self.expected.qd[j]))
        return (
            f"the object was kept: it would have landed {1e3 * miss:.0f} mm (± {1e3 * error:.0f}) off, beyond its "
            f"tolerance of {1e3 * tolerance:.0f} mm; the arm is {1e3 * self.lateness_s:.1f} ms later than planned, "
            f"and joint {worst + 1} {100 * self.gain_error[worst]:+.1f} % off its speed"
        )

    def _acceleration(self, at: float) -> Row:
        """Returns the planned acceleration (6,) of what is to be measured at a row [rad/s^2]."""
        before = _between(self.job.reference_qd, at - 1.0)
        after = _between(self.job.reference_qd, at + 1.0)
        return [(b - a) / (2.0 * self.job.dt) for a, b in zip(before, after, strict=True)]

    def _at_release(self, row: int) -> tuple[Row, Row]:
        """Returns how far joints will be ahead [rad], and how much faster than planned [rad/s], lateness apart.

        In so many steps at most that the command which follows the decision is in time.
        """
        job, late, sent = self.job, self.lateness_s / self.job.dt, list(self.feedback)
        end = job.release_row + job.lag_ticks
        now = float(row)
        ticks = max(math.ceil((end - now) / STEPS_MAX), 1)  # of a step
        begun = _between(job.reference_q, now - late)
        offset = ahead = [q - reference for q, reference in zip(self.q, begun, strict=True)]
        passed = [0.0] * 6
        arrived = self._arrived(sent, now - late)  # [rad] by feedback from now on, [rad/s]
        while now < end:
            after = min(now + ticks, end)
            half = 0.5 * job.dt * (after - now)
            before = arrived
            now = after
            arrived = self._arrived(sent, after - late)
            reference = _between(job.reference_q, now - late)
            passed = [x + half * (a + b) for x, a, b in zip(passed, before, arrived, strict=True)]
            ahead = [
                x + gain * (p - p0) + (1.0 + gain) * c
                for x, gain, p, p0, c in zip(offset, self.gain_error, reference, begun, passed, strict=True)
            ]
            sent += [self._feedback(now, reference, ahead)] * ticks
        gains = zip(self.gain_error, self.expected.qd, arrived, strict=True)
        return ahead, [gain * qd + (1.0 + gain) * b for gain, qd, b in gains]

    def _arrived(self, sent: list[Row], at: float) -> Row:
        """Returns the feedback that reaches an arm at a row, by then one lag old (6,) [rad/s]."""
        at -= self.job.lag_ticks
        return _between(sent, at) if at > 0.0 else [0.0] * 6

    def _feedback(self, now: float, late_reference: Row, ahead: Row) -> Row:
        """Returns the feedback (6,) that is sent at a row to an arm so far ahead of the plan as it is late [rad/s]."""
        job, planned = self.job, _between(self.job.reference_q, now)
        if job.mode != "speedj":  # servoj has none
            return [0.0] * 6
        most = job.feedback_max
        errors = zip(planned, late_reference, ahead, strict=True)
        feedback = [min(max(job.feedback_gain * (p - late - x), -most), most) for p, late, x in errors]
        speeds = zip(feedback, _between(job.qd, now), job.qd_max, strict=True)  # both together no faster than these
        return [min(max(b, -m - v), m - v) for b, v, m in speeds]


def _between(rows: Sequence[Row], at: float) -> Row:
    """Returns what lies at a row, from one row to the next linearly; beyond the ends that of the end."""
    i = min(max(int(at), 0), len(rows) - 1)
    share = at - i
    a = rows[i]
    b = rows[min(i + 1, len(rows) - 1)]
    if at <= i or a is b:
        return a
    return [x + share * (y - x) for x, y in zip(a, b, strict=True)]

"""The arm's joints in three motions: commanded, true (its response, a lag later), and measured (true plus noise)."""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from simulator.physics.kinematics import KinematicChain, Transform
from simulator.physics.lag import Lag
from simulator.physics.overshoot import Overshoot

NOISE_TABLE = 8191  # noise samples drawn at the start; a prime, so the sequence of six joints repeats late
MOVING = 5e-3  # [rad/s] true speed above which the arm visibly moves
AT_REST = 1e-9  # [rad/s] commanded speed below which no motion is commanded
TRUE_AT_REST = 1e-6  # [rad/s] true speed below which no motion is left in the lag
HISTORY = 2000  # cycles of measured positions kept for get_actual_joint_positions_history

Noise = tuple[float, float]  # standard deviations of measured position [rad] and speed [rad/s]


@dataclass(frozen=True)
class Response:
    """How the true motion follows the commanded one.

    Attributes:
        gain: speed over that commanded by a speed or servo command, a joint (6,) [-].
        lag: delay and first-order part.
        overshoot: overshoot and scatter; None without.
    """

    gain: Sequence[float]
    lag: Lag
    overshoot: Overshoot | None = None


class MotionConflict(Exception):
    """Two threads of a program moved the arm in one cycle."""


class Arm:
    """Commanded (`q qd qdd`), true (`true_q true_qd`) and measured (`measured_q measured_qd`) joint motion."""

    def __init__(
        self, chain: KinematicChain, dt: float, q: Sequence[float], response: Response, noise: Noise, seed: int
    ) -> None:
        """Places the arm at rest at joint positions `q` (6,) [rad]; `dt` is the cycle time [s]."""
        self.chain = chain
        self.dt = dt
        self.lag = response.lag
        self.overshoot = response.overshoot
        self.gain = None if all(g == 1.0 for g in response.gain) else list(response.gain)
        self.q = list(q)
        self.qd = [0.0] * 6
        self.qdd = [0.0] * 6
        self.true_q = list(q)
        self.true_qd = [0.0] * 6
        self.measured_q = self.true_q
        self.measured_qd = self.true_qd
        draw = random.Random(seed)
        self.q_noise, self.qd_noise = ([draw.gauss(0.0, s) for _ in range(NOISE_TABLE)] * 2 for s in noise)
        self.draws = 0
        self.drives = 0
        self.before = self.q, self.qd, self.qdd  # commanded motion before the one of this cycle
        self.history: deque[list[float]] = deque(maxlen=HISTORY)  # measured positions, cycle by cycle

    @property
    def driven(self) -> bool:
        """Whether a motion was commanded in this cycle."""
        return self.drives > 0

    @property
    def at_rest(self) -> bool:
        """Whether no motion is commanded and none is left in the lag."""
        return max(map(abs, self.qd)) < AT_REST and max(map(abs, self.true_qd)) < TRUE_AT_REST

    @property
    def stands(self) -> bool:
        """Whether no motion is commanded and the arm does not visibly move: a real one takes seconds to `at_rest`."""
        return max(map(abs, self.qd)) < AT_REST and not self.moves

    @property
    def moves(self) -> bool:
        """Whether the arm truly moves."""
        return max(map(abs, self.true_qd)) > MOVING

    def drive(self, q: list[float], qd: list[float]) -> None:
        """Commands joint positions [rad] and speeds [rad/s] for the end of this cycle.

        Raises:
            MotionConflict: the arm was already driven in this cycle.
            ValueError: a position or speed is not finite.
        """
        self.drives += 1
        if self.drives > 1:
            self.drives = 0
            self.q, self.qd, self.qdd = self.before  # both commands are void; the arm brakes
            raise MotionConflict
        if not math.isfinite(sum(q) + sum(qd)):
            raise ValueError("the commanded motion is not finite")
        self.before = self.q, self.qd, self.qdd
        self._set(q, qd)

    def ramp(self, qd: Sequence[float], acceleration: float, change: float = 1.0) -> bool:
        """Ramps towards joint speeds for one cycle; the position advances with the mean of old and new speed.

        Here the gain takes effect: the arm moves by what it understood, and stands where it believes it does.

        Args:
            qd: target speeds (6,) [rad/s].
            acceleration: of the leading axis [rad/s^2]; the others keep in proportion.
            change: factor on the present speed beforehand, by which the speed scaling has changed.

        Returns:
            Whether the target is reached.
        """
        qd = qd if self.gain is None else [g * v for g, v in zip(self.gain, qd, strict=True)]
        begin = self.qd if change == 1.0 else [change * v for v in self.qd]
        missing = [b - a for a, b in zip(begin, qd, strict=True)]
        largest = max(map(abs, missing))
        most = acceleration * self.dt
        half = 0.5 * self.dt
        reached = largest <= most
        now = list(qd) if reached else [a + c * most / largest for a, c in zip(begin, missing, strict=True)]
        self.drive([x + half * (a + b) for x, a, b in zip(self.q, self.qd, now, strict=True)], now)
        return reached

    def brake(self, deceleration: float) -> None:
        """Ramps to rest at `deceleration` [rad/s^2] if no motion was commanded in this cycle."""
        if self.drives:
            return
        if any(self.qd):
            self.ramp((0.0,) * 6, deceleration)
        else:
            self._set(self.q, self.qd)

    def finish_cycle(self) -> None:
        """Advances the true motion to the end of this cycle and measures it."""
        q = self.q
        qd = self.qd
        if self.overshoot is not None:
            q, qd = self.overshoot.step(q, qd)
            if self.overshoot.began:
                self.lag.shift(self.overshoot.lag_later_s)
        self.true_q, self.true_qd = self.lag.step(q, qd)
        at = self.draws
        self.draws = (at + 6) % NOISE_TABLE
        self.measured_q = [x + n for x, n in zip(self.true_q, self.q_noise[at : at + 6], strict=True)]
        self.measured_qd = [x + n for x, n in zip(self.true_qd, self.qd_noise[at : at + 6], strict=True)]
        self.history.append(self.measured_q)
        self.drives = 0

    def measured_before(self, steps: int) -> list[float]:
        """Returns the measured joint positions (6,) [rad] of `steps` cycles ago."""
        if not self.history:
            return self.measured_q
        return self.history[-1 - min(max(steps, 0), len(self.history) - 1)]

    def true_motion_before(self, back_s: float, tool: Transform) -> tuple[Transform, list[float]]:
        """Returns true pose and twist of the tool in the base, `back_s` [s] before the end of the last cycle."""
        q, qd = self.lag.before(back_s)
        return self.chain.motion(q, qd, tool)

    def _set(self, q: list[float], qd: list[float]) -> None:
        rate = 1.0 / self.dt
        self.qdd = [(b - a) * rate for a, b in zip(self.qd, qd, strict=True)]
        self.q = q
        self.qd = qd

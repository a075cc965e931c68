"""Lag and gains of hidden arms from single runs."""

from __future__ import annotations

import numpy as np

from benchmarks.learning.recorded_arms import RecordedArm
from learning import estimate_timing

CELLS = 20
RUNS = 5
GOAL_S = 0.001  # [s] error of a single run that the goal allows in 1 of 100
RECORDINGS = {  # name: rate [Hz], speedj's acceleration [rad/s^2], white and correlated noise [rad/s]
    "e-Series, ideal arm": (500.0, np.inf, 5e-4, 0.0),
    "CB3, ideal arm": (125.0, np.inf, 5e-4, 0.0),
    "e-Series, residual of a real arm": (500.0, np.inf, 5e-3, 0.02),
    "CB3, residual of a real arm": (125.0, np.inf, 5e-3, 0.02),
    "CB3, held back by a ramp of 6 rad/s²": (125.0, 6.0, 5e-3, 0.0),
}


def timing_report(seed: int) -> str:
    """Returns the errors of single runs over hidden cells, a line for each kind of recording."""
    lines = [f"Timing: {CELLS} hidden cells, {RUNS} runs each, seed {seed}", ""]
    lines += ["| recording | within 1 ms | median, largest error [ms] | error / standard error, rms | gain, rms |"]
    lines += ["|---|---|---|---|---|"]
    return "\n".join([*lines, *(_line(name, seed) for name in RECORDINGS)])


def _line(name: str, seed: int) -> str:
    rate, ramp, white, correlated = RECORDINGS[name]
    rng = np.random.default_rng(seed)
    errors = []
    scores = []
    gains = []
    for _ in range(CELLS):
        lag = rng.uniform(0.005, 0.060)
        gain = rng.uniform(0.96, 1.04, 6)
        arm = RecordedArm(lag, min(rng.uniform(0.0, 0.010), lag), gain, ramp, white, correlated)
        for _ in range(RUNS):
            found = estimate_timing(arm.run(rng, rate))
            errors.append(found.lag_s - lag)
            scores.append(errors[-1] / found.lag_std_s)
            gains += [joint.gain - g for joint, g in zip(found.joints, gain, strict=True)]
    size = np.abs(errors)
    rms = [float(np.sqrt(np.mean(np.square(x)))) for x in (scores, gains)]
    share = f"{int((size < GOAL_S).sum())} of {len(size)}"
    return f"| {name} | {share} | {1e3 * np.median(size):.3f}, {1e3 * size.max():.3f} | {rms[0]:.2f} | {rms[1]:.4f} |"

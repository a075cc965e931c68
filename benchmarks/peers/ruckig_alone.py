"""Ruckig alone: its soonest motion from the start straight to a release state, and its soonest brake.

The release state is the first of a few random ones for which arm and flight are clear. Ruckig keeps the limits of
velocity, acceleration and jerk; positions, torques, tool speed and distances are looked at afterwards.
"""

from __future__ import annotations

import numpy as np

from benchmarks.peers.arm import PeerArm, Problem
from benchmarks.peers.motions import Answer, answer, braked, is_right, refusal, ruckig_motion
from benchmarks.peers.releases import release_states

TRIES = 12  # release states, the soonest answer of which counts


def plan(problem: Problem) -> Answer:
    """Returns the answer to a problem of ThrowBench."""
    arm = PeerArm(problem)
    rate = float(problem["sample_rate_hz"])
    best = None
    still = np.zeros(6)
    for state in release_states(problem, arm, TRIES):
        launch = ruckig_motion(arm, rate, (arm.start, still, still), (state.q, state.qd, still))
        if launch is None or (best is not None and len(launch[0]) > best[2]):
            continue
        motion = braked(arm, rate, launch[0], launch[1], launch[2][-1])
        if motion is not None and is_right(arm, rate, *motion):
            best = motion
    return refusal("no release state with a clear way") if best is None else answer(*best, rate)

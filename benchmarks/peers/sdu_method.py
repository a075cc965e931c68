"""The SDU project's own method, rebuilt from its description.

The slowest throw that hits from a posture, joint velocities by a weighted pseudo-inverse, a lead-up in which every
joint accelerates uniformly from rest on a straight line in joint space, and a follow-through that decelerates in the
same way. The project had one posture for each release point and drove to the lead-up beforehand: here the best of a few
random postures counts, and the way there is a straight line from rest to rest. Neither jerk nor torques nor distances
were theirs: a moving average is added here, so that the jerk is kept, and the rest is looked at afterwards.
"""

from __future__ import annotations

from benchmarks.peers.arm import PeerArm, Problem
from benchmarks.peers.motions import Answer, answer, is_right, line, refusal, straight_throw, thrown
from benchmarks.peers.releases import release_states

TRIES = 60  # release states


def plan(problem: Problem) -> Answer:
    """Returns the answer to a problem of ThrowBench."""
    arm = PeerArm(problem)
    rate = float(problem["sample_rate_hz"])
    best = None
    for state in release_states(problem, arm, TRIES, slowest=True):
        approach = line(arm, rate, straight_throw(arm, rate, state)[0] - arm.start)
        motion = thrown(arm, rate, approach, state)
        if (best is None or motion[2] < best[2]) and is_right(arm, rate, *motion):
            best = motion
    return refusal("no lead-up within limits and box") if best is None else answer(*best, rate)

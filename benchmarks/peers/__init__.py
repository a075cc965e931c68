"""Other planners for the same throws. A peer that is not installed is left out of the tables.

Peers plan the launch to a release state given by Fling, because they have no inverse kinematics or another's. None of
them plans the brake, which is Ruckig's. The first of Fling's three best postures with a certified motion counts.
"""

from benchmarks.peers.answer import PeerAnswer, PeerMissing, PeerPlanner
from benchmarks.peers.drake_spline import solve as _drake
from benchmarks.peers.ipopt_shooting import prepare as _prepare
from benchmarks.peers.ipopt_shooting import solve as _ipopt
from benchmarks.peers.sdu_method import SduTally, tally_sdu_method

__all__ = ["PEERS", "PeerPlanner", "PeerAnswer", "PeerMissing", "SduTally", "tally_sdu_method"]

PEERS = {
    "drake": PeerPlanner("Drake KinematicTrajectoryOptimization", _drake),
    "ipopt": PeerPlanner("plain multiple shooting, IPOPT", _ipopt, tasks=8, prepare=_prepare),
}

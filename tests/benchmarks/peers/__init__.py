"""Other ways to plan the same throws. A peer that is not installed says so and is left out of the tables.

Each has `NAME`, `IGNORED` (checks of the certificate that are not its business) and `solve(problem) -> Answer`. Peers
plan the launch to a release state that we give them (they have no inverse kinematics, or another's); the brake, which
none of them plans, is Ruckig's. The first of our three best postures whose motion certifies counts.
"""

from tests.benchmarks.peers.answer import Answer, Peer, PeerMissing
from tests.benchmarks.peers.drake_spline import solve as _drake
from tests.benchmarks.peers.ipopt_shooting import prepare as _prepare
from tests.benchmarks.peers.ipopt_shooting import solve as _ipopt

__all__ = ["PEERS", "Answer", "Peer", "PeerMissing"]

PEERS = {
    "drake": Peer("Drake KinematicTrajectoryOptimization", _drake),
    "ipopt": Peer("plain multiple shooting, IPOPT", _ipopt, tasks=8, prepare=_prepare),
}

"""Time of the controller: its cycles, their pace in real time, counts of both."""

from executor.simulator.clock.pacing import CyclePacing
from executor.simulator.clock.statistics import StreamCounts
from executor.simulator.clock.timeline import Timeline

__all__ = ["CyclePacing", "StreamCounts", "Timeline"]

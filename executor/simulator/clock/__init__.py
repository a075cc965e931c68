"""Time of the controller: its cycles, their pace in real time, counts of both."""

from executor.simulator.clock.pacing import CyclePacing, LatenessHistogram, SlipCounts
from executor.simulator.clock.timeline import StreamCounts, Timeline

__all__ = ["CyclePacing", "LatenessHistogram", "SlipCounts", "StreamCounts", "Timeline"]

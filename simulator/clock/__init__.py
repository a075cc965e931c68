"""Time of the controller: its cycles, their pace in real time, counts of both."""

from simulator.clock.pacing import CyclePacing, LatenessHistogram, SlipCounts
from simulator.clock.timeline import StreamCounts, Timeline

__all__ = ["CyclePacing", "LatenessHistogram", "SlipCounts", "StreamCounts", "Timeline"]

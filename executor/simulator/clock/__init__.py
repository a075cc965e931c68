"""Time of the controller: its cycles, their pace in real time, what is counted about both, and scheduling."""

from executor.simulator.clock.pacing import CyclePacing
from executor.simulator.clock.scheduling import CORE_VARIABLE, default_core, is_real_time, request_real_time
from executor.simulator.clock.statistics import StreamCounts
from executor.simulator.clock.timeline import Timeline

__all__ = [
    "CORE_VARIABLE",
    "CyclePacing",
    "StreamCounts",
    "Timeline",
    "default_core",
    "is_real_time",
    "request_real_time",
]

"""The streaming part of the benchmark: throws in a row, and Fling's loop beside ur_rtde's documented one."""

from benchmarks.streaming.report import streaming_report

__all__ = ["streaming_report"]

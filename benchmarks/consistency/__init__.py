"""Whether answers are consistent: looser problems beside tighter ones, and the search's answer beside many seeds'."""

from benchmarks.consistency.report import consistency_report

__all__ = ["consistency_report"]

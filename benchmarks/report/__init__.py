"""The report: a Markdown page, three pictures, and the numbers as JSON."""

from benchmarks.report.page import write_report

__all__ = ["write_report"]

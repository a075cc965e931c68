"""Fling's service: HTTP in front of planner and store, the command line, the web page.

This module imports nothing: `fling --help` starts through it.
"""

from __future__ import annotations

__all__ = ["fling_version"]


def fling_version() -> str:
    """Returns the installed version, or "0+unknown" in a checkout that was never installed."""
    import fling

    return fling.__version__

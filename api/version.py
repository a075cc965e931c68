"""Which Fling this is."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version


def fling_version() -> str:
    """Returns the installed version, or "0+unknown" in a checkout that was never installed."""
    try:
        return version("fling")
    except PackageNotFoundError:
        return "0+unknown"

"""The kernel's functions once more, in numpy and as their formulas are written: what the C is compared with."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.planner.native.oracle import arm, candidates, distances, flights, motions, paths

MODULES = (arm, candidates, distances, flights, motions, paths)


def twin(name: str) -> Callable[..., Any]:
    """Returns the numpy function of the name of one of `planner.native.loops`."""
    (found,) = {getattr(module, name) for module in MODULES if hasattr(module, name)}
    return found

"""A numpy function and its compiled twin, which is used if it agrees with numpy on an example."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

from planner.kernel import library
from planner.kernel.library import Kernel

P = ParamSpec("P")
R = TypeVar("R")
Arguments = tuple[Any, ...]

# [-] of the largest value, or absolute where that is below 1: a hundred roundings of the longest sum, which differ by
# the order of its terms; any other difference is a mistake of the compiler or the machine
ROUNDING = 1e-12


def twin_of(
    compiled: Callable[..., Any], example: Callable[[], Arguments]
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Returns a decorator that lets a compiled function do the work of the numpy function it decorates.

    Without a kernel numpy does it. When a kernel is first used, both are compared on the example; where they differ by
    more than rounding, a warning is logged and numpy does it.

    Args:
        compiled: the same function, with the kernel as its first argument.
        example: returns arguments on which the two are compared.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        verdicts: dict[Kernel, bool] = {}

        @wraps(function)
        def call(*arguments: P.args, **named: P.kwargs) -> R:
            kernel = library.loaded()
            if kernel is None:
                return function(*arguments, **named)
            if kernel not in verdicts:
                verdicts[kernel] = _agree(function, compiled, kernel, example())
            return compiled(kernel, *arguments, **named) if verdicts[kernel] else function(*arguments, **named)

        return call

    return decorate


def _agree(function: Callable[..., Any], compiled: Callable[..., Any], kernel: Kernel, example: Arguments) -> bool:
    """Returns whether both give the same numbers, shapes included; logs a difference."""
    expected, found = (np.asarray(each) for each in (function(*example), compiled(kernel, *example)))
    if found.shape == expected.shape:
        differs = found != expected  # infinities of one sign do not
        error = np.abs(found[differs] - expected[differs])
        scale = np.abs(expected[np.isfinite(expected)])
        if (error <= ROUNDING * scale.max(initial=1.0)).all():
            return True
    name = getattr(function, "__name__", "function")
    logging.getLogger(__name__).warning("the compiled twin of %s differs from it and is not used", name)
    return False

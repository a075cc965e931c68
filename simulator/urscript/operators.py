"""The operators of a script, by their sign; a sign with a 1 has one operand."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from simulator.urscript.values import number, written

INTEGER_MAX = 2**31  # an integer of 32 bits; beyond it the result goes on as a float


def _arithmetic(function: Callable[[float, float], float]) -> Callable[[Any, Any], float]:
    def calculate(a: Any, b: Any) -> float:
        result = function(number(a), number(b))
        return result if abs(result) < INTEGER_MAX else float(result)

    return calculate


def _comparison(function: Callable[[float, float], bool]) -> Callable[[Any, Any], bool]:
    return lambda a, b: function(number(a), number(b))


def _boolean(value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"{written(value)} is no boolean")
    return value


OPERATORS: dict[str, Callable[..., Any]] = {
    "+": _arithmetic(operator.add),
    "-": _arithmetic(operator.sub),
    "*": _arithmetic(operator.mul),
    "/": _arithmetic(operator.truediv),
    "%": _arithmetic(operator.mod),
    "<": _comparison(operator.lt),
    "<=": _comparison(operator.le),
    ">": _comparison(operator.gt),
    ">=": _comparison(operator.ge),
    "==": operator.eq,
    "!=": operator.ne,
    "and": lambda a, b: _boolean(a) and _boolean(b),
    "or": lambda a, b: _boolean(a) or _boolean(b),
    "xor": lambda a, b: _boolean(a) != _boolean(b),
    "not1": lambda a: not _boolean(a),
    "-1": lambda a: -number(a),
    "+1": number,
}

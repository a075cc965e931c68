"""The operators of a script, by their sign; a sign with a 1 has one operand.

Lists of numbers, and matrices, are added and subtracted element by element; a number is applied to every element.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from simulator.urscript.values import ScriptPose, number, written

INTEGER_MAX = 2**31  # an integer of 32 bits; beyond it the result goes on as a float
NUMBERS = frozenset({int, float})  # types of plain numbers: what most operators meet
ELEMENTWISE = frozenset({"+", "-"})  # what two lists are combined by

Binary = Callable[[Any, Any], Any]


def _arithmetic(sign: str, function: Callable[[float, float], float]) -> Binary:
    def calculate(a: Any, b: Any) -> Any:
        if a.__class__ in NUMBERS and b.__class__ in NUMBERS:
            result = function(a, b)
        elif isinstance(a, list) or isinstance(b, list):
            return _over_lists(sign, calculate, a, b)
        else:
            result = function(number(a), number(b))
        return result if isinstance(result, float) or abs(result) < INTEGER_MAX else float(result)

    return calculate


def _over_lists(sign: str, calculate: Binary, a: Any, b: Any) -> list[Any]:
    """Returns the result of an operator of which one operand, or both, are lists.

    Raises:
        TypeError: one is a pose, or these lists cannot be combined by this operator.
    """
    if isinstance(a, ScriptPose) or isinstance(b, ScriptPose):
        raise TypeError(f"'{sign}' does not work on poses")
    if not isinstance(b, list):
        return [calculate(x, b) for x in a]
    if not isinstance(a, list):
        return [calculate(a, y) for y in b]
    if sign not in ELEMENTWISE or len(a) != len(b):
        raise TypeError(f"'{sign}' does not work on lists of {len(a)} and {len(b)} elements")
    return [calculate(x, y) for x, y in zip(a, b, strict=True)]


def _comparison(function: Callable[[float, float], bool]) -> Callable[[Any, Any], bool]:
    def compare(a: Any, b: Any) -> bool:
        if a.__class__ in NUMBERS and b.__class__ in NUMBERS:
            return function(a, b)
        return function(number(a), number(b))

    return compare


def truth(value: Any) -> bool:
    """Returns what a value counts as in a condition: a number other than 0 as True.

    Raises:
        TypeError: it is neither a boolean nor a number.
    """
    if isinstance(value, bool | int | float):
        return value != 0
    raise TypeError(f"{written(value)} is not a boolean")


def _negative(value: Any) -> Any:
    if isinstance(value, list) and not isinstance(value, ScriptPose):
        return [_negative(item) for item in value]
    return -number(value)


OPERATORS: dict[str, Callable[..., Any]] = {
    "+": _arithmetic("+", operator.add),
    "-": _arithmetic("-", operator.sub),
    "*": _arithmetic("*", operator.mul),
    "/": _arithmetic("/", operator.truediv),
    "%": _arithmetic("%", operator.mod),
    "<": _comparison(operator.lt),
    "<=": _comparison(operator.le),
    ">": _comparison(operator.gt),
    ">=": _comparison(operator.ge),
    "==": operator.eq,
    "!=": operator.ne,
    "and": lambda a, b: truth(a) and truth(b),
    "or": lambda a, b: truth(a) or truth(b),
    "xor": lambda a, b: truth(a) != truth(b),
    "not1": lambda a: not truth(a),
    "-1": _negative,
    "+1": number,
}

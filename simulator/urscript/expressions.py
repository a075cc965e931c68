"""Expressions that wait for nothing, compiled to Python functions: most of a script, and most of its time.

An expression waits where it calls a function of the script's own, or one that takes controller cycles: it is left to
the interpreter, which evaluates it cycle by cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from simulator.program import ProgramContext, ProgramError
from simulator.urscript.nodes import Call, Index, Items, Literal, Name, Node, Numbers, Operation
from simulator.urscript.operators import OPERATORS
from simulator.urscript.signatures import Signature
from simulator.urscript.values import ScriptPose, item

Frame = dict[str, Any]
Evaluate = Callable[[Frame], Any]  # local variables -> value

FAILURES = (TypeError, ValueError, ArithmeticError, LookupError)


def error_at(node: Node, text: str) -> ProgramError:
    """Returns a runtime error at a place of the text."""
    return ProgramError(text, node.place.line, node.place.column)


def element(node: Index, container: Any, index: Any) -> Any:
    """Returns an item of a list.

    Raises:
        ProgramError: there is none of that number.
    """
    if not isinstance(container, list) or not isinstance(index, int) or not 0 <= index < len(container):
        raise error_at(node, "index out of bounds")
    return container[index]


class Expressions:
    """The expressions of one script; each is compiled once."""

    def __init__(self, context: ProgramContext, functions: Mapping[str, Signature], variables: Frame) -> None:
        """`functions` are the built-in ones that wait for nothing, `variables` the global ones."""
        self.context = context
        self.functions = functions
        self.globals = variables
        self.compiled: dict[int, tuple[Node, Evaluate | None]] = {}

    def of(self, node: Node) -> Evaluate | None:
        """Returns the function that evaluates an expression, None for one that waits."""
        found = self.compiled.get(id(node))
        if found is None:  # the node is kept with it: its id stays its own
            found = self.compiled[id(node)] = (node, self._compile(node))
        return found[1]

    def _compile(self, node: Node) -> Evaluate | None:
        if isinstance(node, Literal):
            value = node.value
            return lambda frame: value
        if isinstance(node, Numbers):
            numbers = node.values
            return lambda frame: [*numbers]
        if isinstance(node, Name):
            return self._variable(node)
        if isinstance(node, Index):
            return self._index(node)
        if isinstance(node, Items):
            return self._items(node)
        if isinstance(node, Operation):
            return self._operation(node)
        return self._call(node) if isinstance(node, Call) else None

    def _all(self, nodes: tuple[Node, ...]) -> list[Evaluate] | None:
        found = [self.of(node) for node in nodes]
        return None if None in found else found  # pyright: ignore[reportReturnType]

    def _variable(self, node: Name) -> Evaluate:
        name = node.name
        variables = self.globals

        def read(frame: Frame) -> Any:
            if name in frame:
                return frame[name]
            if name in variables:
                return variables[name]
            raise error_at(node, f"the variable '{name}' has no value yet")

        return read

    def _index(self, node: Index) -> Evaluate | None:
        container = self.of(node.container)
        index = self.of(node.index)
        if container is None or index is None:
            return None
        return lambda frame: element(node, container(frame), index(frame))

    def _items(self, node: Items) -> Evaluate | None:
        parts = self._all(node.items)
        if parts is None:
            return None
        return lambda frame: collected(node, [part(frame) for part in parts])

    def _operation(self, node: Operation) -> Evaluate | None:
        parts = self._all(node.operands)
        if parts is None:
            return None
        if len(parts) == 1:
            (only,) = parts
            return lambda frame: applied(node, only(frame))
        left, right = parts
        calculate = OPERATORS[node.operator]

        def apply(frame: Frame) -> Any:
            a = left(frame)
            b = right(frame)
            try:
                return calculate(a, b)
            except FAILURES as error:
                raise error_at(node, str(error)) from error

        return apply

    def _call(self, node: Call) -> Evaluate | None:
        function = self.functions.get(node.name)
        arguments = self._all(node.arguments)
        named = self._all(tuple(value for _, value in node.named))
        if function is None or node.run or arguments is None or named is None:
            return None
        names = [name for name, _ in node.named]

        def call(frame: Frame) -> Any:
            values = [argument(frame) for argument in arguments]
            words = {name: value(frame) for name, value in zip(names, named, strict=True)}
            return called(node, function, self.context, values, words)

        return call


def collected(node: Items, values: list[Any]) -> list[Any]:
    """Returns a list, or a pose.

    Raises:
        ProgramError: a pose of other than six numbers, or lists nested too deep.
    """
    try:
        return ScriptPose(values) if node.is_pose else [*map(item, values)]
    except FAILURES as error:
        raise error_at(node, str(error)) from error


def applied(node: Operation, *operands: Any) -> Any:
    """Returns the result of an operator.

    Raises:
        ProgramError: it does not work on these operands.
    """
    try:
        return OPERATORS[node.operator](*operands)
    except FAILURES as error:
        raise error_at(node, str(error)) from error


def called(node: Call, function: Signature, context: ProgramContext, values: list[Any], words: dict[str, Any]) -> Any:
    """Returns the answer of a built-in function: a value, or a motion.

    Raises:
        ProgramError: the arguments are wrong, or the function fails.
    """
    try:
        return function.body(context, *function.bound(values, words))
    except ProgramError as error:
        raise error_at(node, str(error)) from error
    except FAILURES as error:
        raise error_at(node, f"{node.name}: {error}") from error

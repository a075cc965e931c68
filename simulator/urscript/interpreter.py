"""Runs a script cycle by cycle: its threads are generators, one `yield` a controller cycle."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from typing import Any

from simulator.program import Program, ProgramContext, ProgramError
from simulator.urscript.functions import FUNCTIONS
from simulator.urscript.nodes import (
    Assignment,
    Branches,
    Call,
    Function,
    Index,
    Items,
    Jump,
    Literal,
    Name,
    Node,
    Operation,
    ThreadCommand,
    While,
    children,
)
from simulator.urscript.operators import OPERATORS
from simulator.urscript.parser import parse
from simulator.urscript.values import ScriptPose, item

STATEMENTS_PER_CYCLE = 100  # chosen: a loop without `sync` goes on in the next cycle and holds up nobody
CALLS_MAX = 30  # nested calls of the script's own functions
THREAD_NAME = "thread {}"
UNNAMED = "unnamed"  # chosen: name of a program that is a line without `def`

Frame = dict[str, Any]
Evaluation = Generator[None, None, Any]  # one `yield` a cycle; returns the value


class Script(Program):
    """A script as a program.

    Attributes:
        context: parts of the controller that its functions may use.
        functions: the script's own functions and threads by name.
    """

    def __init__(self, context: ProgramContext, text: str) -> None:
        """Compiles a text.

        Raises:
            ProgramError: it is no script, or names something that does not exist.
        """
        statements = _parsed(text)
        program = next((s for s in statements if isinstance(s, Function)), None)
        body = statements if program is None else program.block
        self.context = context
        self.globals: Frame = {}
        self.functions = {node.name: node for node in _walk(body) if isinstance(node, Function)}
        self.handles = self.spent = self.calls = 0
        check_names(body, self.functions)
        super().__init__(program.name if program else UNNAMED, self._main(body))

    def step(self) -> bool:
        """Gives every thread its turn; see `Program.step`."""
        self.spent = 0
        return super().step()

    def _main(self, body: Sequence[Node]) -> Iterator[None]:
        yield from self.block(body, self.globals)

    # -- statements; a block returns the jump that ended it: (word, value)
    def block(self, statements: Sequence[Node], frame: Frame) -> Generator[None, None, tuple[str, Any] | None]:
        """Runs statements; returns the jump that ended them, None at their end."""
        for statement in statements:
            self.spent += 1
            if self.spent > STATEMENTS_PER_CYCLE:
                yield
            jump = yield from self.statement(statement, frame)
            if jump is not None:
                return jump
        return None

    def statement(self, node: Node, frame: Frame) -> Generator[None, None, tuple[str, Any] | None]:
        """Runs one statement."""
        if isinstance(node, Assignment):
            yield from self.assign(node, frame)
        elif isinstance(node, Branches):
            return (yield from self.branches(node, frame))
        elif isinstance(node, While):
            return (yield from self.loop(node, frame))
        elif isinstance(node, Jump):
            return (yield from self.jump(node, frame))
        elif isinstance(node, ThreadCommand):
            yield from self.command_thread(node, frame)
        elif not isinstance(node, Function):
            yield from self.value(node, frame)
        return None

    def assign(self, node: Assignment, frame: Frame) -> Evaluation:
        """Assigns to a variable or to an item."""
        value = yield from self.value(node.value, frame)
        if isinstance(node.target, Name):
            self._frame_of(node.target.name, node.scope, frame)[node.target.name] = value
        elif isinstance(node.target, Index):
            container = yield from self.value(node.target.container, frame)
            index = yield from self.value(node.target.index, frame)
            before = self._item(node.target, container, index)
            if isinstance(before, list) != isinstance(value, list):
                raise self.error(node, "an item keeps its type")
            try:
                container[index] = item(value)
            except ValueError as error:
                raise self.error(node, str(error)) from error

    def _frame_of(self, name: str, scope: str, frame: Frame) -> Frame:
        """Returns where a variable is assigned: where it is known already, unless its scope is given."""
        if scope == "global" or (scope != "local" and name not in frame and name in self.globals):
            return self.globals
        return frame

    def branches(self, node: Branches, frame: Frame) -> Evaluation:
        """Runs the first block whose condition holds."""
        for condition, block in node.branches:
            if condition is None or (yield from self.truth(condition, frame)):
                return (yield from self.block(block, frame))
        return None

    def loop(self, node: While, frame: Frame) -> Evaluation:
        """Runs a loop."""
        while (yield from self.truth(node.condition, frame)):
            self.spent += 1
            if self.spent > STATEMENTS_PER_CYCLE:
                yield
            jump = yield from self.block(node.block, frame)
            if jump is not None and jump[0] == "break":
                return None
            if jump is not None and jump[0] != "continue":
                return jump
        return None

    def jump(self, node: Jump, frame: Frame) -> Evaluation:
        """Returns the jump; `halt` ends the program at once."""
        if node.word == "halt":
            self.halt()
            yield
        if node.word in ("pass", "halt"):
            return None
        value = None if node.value is None else (yield from self.value(node.value, frame))
        return node.word, value

    def command_thread(self, node: ThreadCommand, frame: Frame) -> Evaluation:
        """Ends a thread, or waits for its end."""
        handle = yield from self.value(node.handle, frame)
        name = THREAD_NAME.format(handle)
        if node.word == "kill":
            self.kill(name)
        while name in self.threads:
            yield

    def halt(self) -> None:
        """Ends the program with the present cycle."""
        self.threads = {name: iter(()) for name in self.threads}

    # -- expressions
    def truth(self, node: Node, frame: Frame) -> Evaluation:
        """Returns a condition's value, which must be a boolean."""
        value = yield from self.value(node, frame)
        if not isinstance(value, bool):
            raise self.error(node, "the condition is not a boolean")
        return value

    def value(self, node: Node, frame: Frame) -> Evaluation:
        """Returns the value of an expression."""
        if isinstance(node, Literal):
            return node.value
        if isinstance(node, Name):
            return self.variable(node, frame)
        if isinstance(node, Call):
            return (yield from self.call(node, frame))
        if isinstance(node, Index):
            container = yield from self.value(node.container, frame)
            index = yield from self.value(node.index, frame)
            return self._item(node, container, index)
        operands = node.items if isinstance(node, Items) else node.operands if isinstance(node, Operation) else ()
        values = []
        for operand in operands:
            values.append((yield from self.value(operand, frame)))
        return self.combined(node, values)

    def variable(self, node: Name, frame: Frame) -> Any:
        """Returns a variable's value, the nearest one."""
        for place in (frame, self.globals):
            if node.name in place:
                return place[node.name]
        raise self.error(node, f"the variable '{node.name}' has no value yet")

    def combined(self, node: Node, values: list[Any]) -> Any:
        """Returns a list, a pose, or the result of an operator."""
        try:
            if isinstance(node, Items):
                return ScriptPose(values) if node.is_pose else [*map(item, values)]
            assert isinstance(node, Operation)
            return OPERATORS[node.operator](*values)
        except (TypeError, ValueError, ArithmeticError) as error:
            raise self.error(node, str(error)) from error

    def _item(self, node: Index, container: Any, index: Any) -> Any:
        if not isinstance(container, list) or not isinstance(index, int) or not 0 <= index < len(container):
            raise self.error(node, "index out of bounds")
        return container[index]

    def call(self, node: Call, frame: Frame) -> Evaluation:
        """Calls a function, or starts one as a thread."""
        arguments = []
        named = {}
        for argument in node.arguments:
            arguments.append((yield from self.value(argument, frame)))
        for name, argument in node.named:
            named[name] = yield from self.value(argument, frame)
        if node.name in self.functions:
            own = self._own(node, self.functions[node.name], arguments)
            return self._run(own) if node.run else (yield from own)
        return (yield from self._built_in(node, arguments, named))

    def _run(self, thread: Evaluation) -> int:
        self.handles += 1
        self.start(THREAD_NAME.format(self.handles), thread)
        return self.handles

    def _own(self, node: Call, function: Function, arguments: list[Any]) -> Evaluation:
        if len(arguments) != len(function.parameters):
            raise self.error(node, f"'{node.name}' takes {len(function.parameters)} arguments")
        self.calls += 1
        try:
            if self.calls > CALLS_MAX:
                raise self.error(node, "too many nested calls")
            jump = yield from self.block(function.block, dict(zip(function.parameters, arguments, strict=True)))
        finally:
            self.calls -= 1
        return jump[1] if jump is not None else None

    def _built_in(self, node: Call, arguments: list[Any], named: dict[str, Any]) -> Evaluation:
        try:
            function = FUNCTIONS[node.name]
            answer = function.body(self.context, *function.bound(arguments, named))
            return (yield from answer) if isinstance(answer, Generator) else answer
        except ProgramError as error:
            raise self.error(node, str(error)) from error
        except (TypeError, ValueError, ArithmeticError, LookupError) as error:
            raise self.error(node, f"{node.name}: {error}") from error

    @staticmethod
    def error(node: Node, text: str) -> ProgramError:
        """Returns a runtime error at a place of the text."""
        return ProgramError(text, node.place.line, node.place.column)


def _parsed(text: str) -> tuple[Node, ...]:
    try:
        return parse(text)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits, brackets without an end
        raise ProgramError(f"syntax_error_on_line:1:{error}:", 1, 1) from error


def check_names(body: Sequence[Node], functions: dict[str, Function]) -> None:
    """Checks that every function that is called and every variable that is read exists.

    Raises:
        ProgramError: one does not; in the controller's words.
    """
    variables = set(_assigned(body))
    for node in _walk(body):
        missing = isinstance(node, Call) and node.name not in functions and node.name not in FUNCTIONS
        missing = missing or (isinstance(node, Name) and node.name not in variables)
        if missing:
            name = node.name  # pyright: ignore[reportAttributeAccessIssue]
            raise ProgramError(f"compile_error_name_not_found:{name}:", node.place.line, node.place.column)


def _walk(nodes: Sequence[Node]) -> Iterator[Node]:
    for node in nodes:
        yield node
        yield from _walk(children(node))


def _assigned(nodes: Sequence[Node]) -> Iterator[str]:
    for node in _walk(nodes):
        if isinstance(node, Assignment) and isinstance(node.target, Name):
            yield node.target.name
        if isinstance(node, Function):
            yield from node.parameters

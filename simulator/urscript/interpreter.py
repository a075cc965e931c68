"""Runs a script cycle by cycle: its threads are generators, one `yield` a controller cycle."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from typing import Any

from simulator.program import Program, ProgramContext, ProgramError
from simulator.urscript.context import ScriptContext
from simulator.urscript.expressions import Expressions, Frame, applied, called, collected, element, error_at
from simulator.urscript.functions import functions_of
from simulator.urscript.interpreter_mode import interpret
from simulator.urscript.nodes import (
    Assignment,
    Branches,
    Call,
    Critical,
    Function,
    Index,
    Items,
    Jump,
    Name,
    Node,
    Operation,
    ThreadCommand,
    While,
    walk,
)
from simulator.urscript.operators import truth
from simulator.urscript.parser import parse
from simulator.urscript.signatures import REQUIRED, Signature
from simulator.urscript.values import item

STATEMENTS_PER_CYCLE = 1000  # chosen: a loop without `sync` goes on in the next cycle and holds up nobody
CALLS_MAX = 30  # nested calls of the script's own functions, a thread
THREADS_MAX = 100  # chosen: a script that starts threads for ever does not hold up the process
THREAD_NAME = "thread {}"
UNNAMED = "unnamed"  # chosen: name of a program that is a line without `def`

Evaluation = Generator[None, None, Any]  # one `yield` a cycle; returns the value


class Script(Program):
    """A script as a program.

    Attributes:
        context: parts of the controller that its functions may use, and its own sockets.
        functions: the script's own functions and threads by name.
        built_in: those of the controller.
    """

    def __init__(self, context: ProgramContext, text: str) -> None:
        """Compiles a text.

        Raises:
            ProgramError: it is no script, or names something that does not exist.
        """
        statements = _parsed(text)
        program = next((s for s in statements if isinstance(s, Function)), None)
        body = statements if program is None else program.block
        self.context = ScriptContext(**vars(context))
        self.globals: Frame = {}
        nodes = walk(body)
        self.functions = {node.name: node for node in nodes if isinstance(node, Function)}
        self.built_in = functions_of(context.version)
        self.handles = self.spent = 0
        self.calls: Counter[str] = Counter()  # nested at present, by thread
        self.critical: set[str] = set()  # threads between enter_critical and exit_critical
        self.resumed = ""  # the one of them that had to wait for this cycle
        self.variables = set(_assigned(nodes))
        check_names(nodes, self.functions, self.built_in, self.variables)
        immediate = {name: f for name, f in self.built_in.items() if not f.waits and name not in self.functions}
        self.expressions = Expressions(self.context, immediate, self.globals)
        self.direct: dict[int, tuple[Node, Callable[[Frame], Any] | None]] = {}
        super().__init__(program.name if program else UNNAMED, self._main(body))

    def step(self) -> bool:
        """Gives every thread its turn, first one that was interrupted in a critical section; see `Program.step`."""
        self.spent = 0
        self.resumed = self.interrupted
        if self.resumed in self.threads:
            self.threads = {self.resumed: self.threads[self.resumed], **self.threads}
        self.interrupted = ""
        return super().step()

    def close(self) -> None:
        """Closes the sockets that the program left open, and ends interpreter mode."""
        self.context.sockets.close_all()
        self.context.interpreter.close(self.compiled)

    def _main(self, body: Sequence[Node]) -> Iterator[None]:
        yield from self.block(body, self.globals)

    # -- statements; a block returns the jump that ended it: (word, value)
    def block(self, statements: Sequence[Node], frame: Frame) -> Generator[None, None, tuple[str, Any] | None]:
        """Runs statements; returns the jump that ended them, None at their end."""
        for statement in statements:
            self.spent += 1
            if self.spent > STATEMENTS_PER_CYCLE:
                yield from self._rest()
            direct = self._direct(statement)
            if direct is not None:
                direct(frame)
                continue
            jump = yield from self.statement(statement, frame)
            if jump is not None:
                return jump
        return None

    def _rest(self) -> Generator[None, None, None]:
        """Leaves the rest of the work to the next cycle."""
        if self.running in self.critical:
            self.interrupted = self.running
        yield

    def _direct(self, node: Node) -> Callable[[Frame], Any] | None:
        """Returns the function that runs a statement at once; None for one that may wait or jump."""
        found = self.direct.get(id(node))
        if found is None:
            found = self.direct[id(node)] = (node, self._compiled(node))
        return found[1]

    def _compiled(self, node: Node) -> Callable[[Frame], Any] | None:
        if not isinstance(node, Assignment):
            return self.expressions.of(node)
        value = self.expressions.of(node.value)
        if value is None or not isinstance(node.target, Name):
            return None
        name = node.target.name
        scope = node.scope

        def assign(frame: Frame) -> None:
            result = value(frame)
            self._frame_of(name, scope, frame)[name] = result

        return assign

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
        elif isinstance(node, Critical):
            yield from self.critical_section(node)
        elif not isinstance(node, Function):
            yield from self.value(node, frame)
        return None

    def critical_section(self, node: Critical) -> Evaluation:
        """Enters or leaves a critical section; after one that took more than a cycle it is the others' turn."""
        if node.enters:
            self.critical.add(self.running)
            return
        self.critical.discard(self.running)
        if self.running == self.resumed:
            self.resumed = ""
            yield

    def assign(self, node: Assignment, frame: Frame) -> Evaluation:
        """Assigns to a variable or to an item."""
        value = yield from self.value(node.value, frame)
        if isinstance(node.target, Name):
            self._frame_of(node.target.name, node.scope, frame)[node.target.name] = value
        elif isinstance(node.target, Index):
            container = yield from self.value(node.target.container, frame)
            index = yield from self.value(node.target.index, frame)
            before = element(node.target, container, index)
            if isinstance(before, list) != isinstance(value, list):
                raise error_at(node, "an item keeps its type")
            try:
                container[index] = item(value)
            except ValueError as error:
                raise error_at(node, str(error)) from error

    def _frame_of(self, name: str, scope: str, frame: Frame) -> Frame:
        """Returns where a variable is assigned: where it is known already, unless its scope is given."""
        if scope == "global" or (scope != "local" and name not in frame and name in self.globals):
            return self.globals
        return frame

    def branches(self, node: Branches, frame: Frame) -> Evaluation:
        """Runs the first block whose condition holds."""
        for condition, block in node.branches:
            if condition is None:
                return (yield from self.block(block, frame))
            evaluate = self.expressions.of(condition)
            value = (yield from self.value(condition, frame)) if evaluate is None else evaluate(frame)
            if value is True or (value is not False and holds(condition, value)):
                return (yield from self.block(block, frame))
        return None

    def loop(self, node: While, frame: Frame) -> Evaluation:
        """Runs a loop."""
        condition = node.condition
        evaluate = self.expressions.of(condition)
        while True:
            value = (yield from self.value(condition, frame)) if evaluate is None else evaluate(frame)
            if value is not True and (value is False or not holds(condition, value)):
                return None
            self.spent += 1
            if self.spent > STATEMENTS_PER_CYCLE:
                yield from self._rest()
            jump = yield from self.block(node.block, frame)
            if jump is not None and jump[0] == "break":
                return None
            if jump is not None and jump[0] != "continue":
                return jump

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
    def value(self, node: Node, frame: Frame) -> Evaluation:
        """Returns the value of an expression."""
        evaluate = self.expressions.of(node)
        if evaluate is not None:
            return evaluate(frame)
        if isinstance(node, Call):
            return (yield from self.call(node, frame))
        if isinstance(node, Index):
            container = yield from self.value(node.container, frame)
            index = yield from self.value(node.index, frame)
            return element(node, container, index)
        if isinstance(node, Items):
            return collected(node, (yield from self._values(node.items, frame)))
        assert isinstance(node, Operation)
        return applied(node, *(yield from self._values(node.operands, frame)))

    def _values(self, nodes: Sequence[Node], frame: Frame) -> Evaluation:
        values = []
        for node in nodes:
            values.append((yield from self.value(node, frame)))
        return values

    def call(self, node: Call, frame: Frame) -> Evaluation:
        """Calls a function, or starts one as a thread."""
        arguments = yield from self._values(node.arguments, frame)
        named = {}
        for name, argument in node.named:
            named[name] = yield from self.value(argument, frame)
        if node.name in self.functions:
            own = self._own(node, self.functions[node.name], arguments, named)
            return self._run(node, own) if node.run else (yield from own)
        return (yield from self._built_in(node, arguments, named))

    def _run(self, node: Call, thread: Evaluation) -> int:
        if len(self.threads) > THREADS_MAX:
            raise error_at(node, f"more than {THREADS_MAX} threads run")
        self.handles += 1
        self.start(THREAD_NAME.format(self.handles), thread)
        return self.handles

    def _own(self, node: Call, function: Function, arguments: list[Any], named: dict[str, Any]) -> Evaluation:
        first = len(function.parameters) - len(function.defaults)
        table = dict.fromkeys(function.parameters[:first], REQUIRED)
        for name, default in zip(function.parameters[first:], function.defaults, strict=True):
            table[name] = yield from self.value(default, self.globals)
        try:
            values = Signature(table, lambda: None).bound(arguments, named)
        except TypeError as error:
            raise error_at(node, f"{node.name}: {error}") from error
        thread = self.running  # another one's may be the turn in which this is ended
        self.calls[thread] += 1
        try:
            if self.calls[thread] > CALLS_MAX:
                raise error_at(node, "too many nested calls")
            jump = yield from self.block(function.block, dict(zip(function.parameters, values, strict=True)))
        finally:
            self.calls[thread] -= 1
            if not self.calls[thread]:
                del self.calls[thread]
        return jump[1] if jump is not None else None

    def compiled(self, text: str) -> InterpretedLine:
        """Returns a line of interpreter mode, whose functions and variables are the script's from now on.

        Raises:
            ProgramError: it is no statement, or names something that does not exist.
        """
        body = _parsed(text, one_line=True)
        nodes = walk(body)
        functions = {node.name: node for node in nodes if isinstance(node, Function)}
        variables = self.variables | set(_assigned(nodes))
        check_names(nodes, self.functions | functions, self.built_in, variables)
        self.functions |= functions
        self.variables = variables
        return InterpretedLine(self, body, [] if functions else nodes)

    def _built_in(self, node: Call, arguments: list[Any], named: dict[str, Any]) -> Evaluation:
        if node.name == "interpreter_mode":
            return (yield from interpret(self.context, self.compiled))
        answer = called(node, self.built_in[node.name], self.context, arguments, named)
        if not isinstance(answer, Generator):
            return answer
        try:
            return (yield from answer)
        except ProgramError as error:
            raise error_at(node, str(error)) from error
        except (TypeError, ValueError, ArithmeticError, LookupError) as error:
            raise error_at(node, f"{node.name}: {error}") from error


class InterpretedLine:
    """One line of interpreter mode."""

    def __init__(self, script: Script, body: Sequence[Node], nodes: Sequence[Node]) -> None:
        """`nodes` are those that nothing refers to once the line has run."""
        self.script = script
        self.body = body
        self.nodes = nodes

    def run(self) -> Generator[None, None, Any]:
        """Runs the line."""
        return self.script.block(self.body, self.script.globals)

    def forget(self) -> None:
        """Gives back what was compiled for the line."""
        for node in self.nodes:
            self.script.direct.pop(id(node), None)
            self.script.expressions.compiled.pop(id(node), None)


def holds(condition: Node, value: Any) -> bool:
    """Returns whether a condition of this value holds.

    Raises:
        ProgramError: it is neither a boolean nor a number.
    """
    try:
        return truth(value)
    except TypeError as error:
        raise error_at(condition, f"the condition: {error}") from error


def _parsed(text: str, one_line: bool = False) -> tuple[Node, ...]:
    try:
        return parse(text, one_line)
    except (ValueError, RecursionError) as error:  # a number of thousands of digits, brackets without an end
        raise ProgramError(f"syntax_error_on_line:1:{error}:", 1, 1) from error


def check_names(
    nodes: Sequence[Node], functions: Mapping[str, Function], built_in: Mapping[str, Signature], variables: set[str]
) -> None:
    """Checks that every function that is called and every variable that is read exists.

    Args:
        nodes: every node of the script.
        functions: the script's own, by name.
        built_in: those of the controller.
        variables: those that are assigned somewhere.

    Raises:
        ProgramError: one does not; in the controller's words.
    """
    for node in nodes:
        missing = isinstance(node, Call) and node.name not in functions and node.name not in built_in
        missing = missing or (isinstance(node, Name) and node.name not in variables)
        if missing:
            name = node.name  # pyright: ignore[reportAttributeAccessIssue]
            raise ProgramError(f"compile_error_name_not_found:{name}:", node.place.line, node.place.column)


def _assigned(nodes: Sequence[Node]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, Assignment) and isinstance(node.target, Name):
            yield node.target.name
        if isinstance(node, Function):
            yield from node.parameters

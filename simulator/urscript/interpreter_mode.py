"""`interpreter_mode()`: a script that runs the statements which clients send on a port of their own."""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any, Protocol

from simulator.program import motions
from simulator.urscript.context import ScriptContext

ABORT_DECELERATION = 4.0  # [rad/s^2] chosen: `abort` is a controlled stop


class Statement(Protocol):
    """A compiled statement, or several of one line."""

    def run(self) -> Generator[None, None, Any]:
        """Runs it: one `yield` a cycle."""
        ...

    def forget(self) -> None:
        """Gives back what was compiled for it."""
        ...


def interpret(context: ScriptContext, compiled: Callable[[str], Statement]) -> Generator[None, None, None]:
    """Runs the statements of the queue one after another until it ends.

    Args:
        context: of the script.
        compiled: compiles a statement; raises ProgramError.
    """
    queue = context.interpreter
    queue.open(compiled)
    try:
        while not queue.ends:
            if queue.waiting:
                yield from _one(context, queue.take())
            else:
                yield
    finally:
        queue.close(compiled)


def _one(context: ScriptContext, statement: Statement) -> Generator[None, None, None]:
    """Runs one statement, unless the client aborts its motion."""
    queue = context.interpreter
    for _ in statement.run():
        yield
        if queue.aborts:
            yield from motions.stop_joints(context, ABORT_DECELERATION)
            break
    statement.forget()

"""Statements that clients send one by one to a program in interpreter mode, and what becomes of them.

Source of commands and answers: Universal Robots, "Interpreter mode".
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from simulator.program.threads import ProgramError

WAITING_MAX = 500  # statements; source: Universal Robots, "Interpreter mode"
INVALID = "discard: Program is in an invalid state: {}"
TOO_MANY = "discard: Too many interpreted messages: {}"
NOT_COMPILED = "discard: Compile error: {}: {}"
Compile = Callable[[str], Any]  # statement -> what runs it; raises ProgramError


class InterpreterQueue:
    """The queue between the clients and the program, whose numbers go on from program to program.

    Attributes:
        compile: compiles a statement; None while no program is in interpreter mode.
        waiting: (number, statement compiled) of those that are still to be run.
        interpreted, executed, cleared: number of the latest statement of which this is true, 0 before the first.
        aborts: whether the motion that runs is to be ended.
        ends: whether interpreter mode is to be left.
    """

    def __init__(self) -> None:
        self.compile: Compile | None = None
        self.waiting: deque[tuple[int, Any]] = deque()
        self.interpreted = 0
        self.executed = 0
        self.cleared = 0
        self.aborts = False
        self.ends = False

    def open(self, compile_statement: Compile) -> None:
        """Enters interpreter mode."""
        self.compile = compile_statement
        self.waiting.clear()
        self.aborts = False
        self.ends = False

    def close(self, compile_statement: Compile) -> None:
        """Leaves it, if it was entered with this; what is still waiting is cleared."""
        if self.compile == compile_statement:
            self.compile = None
            self.clear()

    def clear(self) -> None:
        """Notes that everything interpreted so far is cleared."""
        self.waiting.clear()
        self.cleared = self.interpreted

    def end(self) -> None:
        """Requests to leave interpreter mode after the present statement."""
        self.ends = True

    def take(self) -> Any:
        """Returns the next statement, which begins now."""
        self.executed, statement = self.waiting.popleft()
        self.aborts = False
        return statement

    def answer(self, text: str) -> str:
        """Returns the answer to one line of a client: a command, or a statement that is queued."""
        command = text.strip().lower()
        if command == "abort":
            self.aborts = True
        elif command == "skipbuffer":
            self.waiting.clear()
        states = {
            "abort": self.executed,
            "skipbuffer": self.executed,
            "statelastexecuted": self.executed,
            "statelastinterpreted": self.interpreted,
            "statelastcleared": self.cleared,
            "stateunexecuted": len(self.waiting),
        }
        return f"state: {states[command]}: {command}" if command in states else self._queued(text.strip())

    def _queued(self, text: str) -> str:
        if self.compile is None:
            return INVALID.format(text)
        if len(self.waiting) >= WAITING_MAX:
            return TOO_MANY.format(text)
        try:
            statement = self.compile(text)
        except ProgramError as error:
            return NOT_COMPILED.format(error, text)
        self.interpreted += 1
        self.waiting.append((self.interpreted, statement))
        return f"ack: {self.interpreted}: {text}"

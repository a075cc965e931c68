"""A running program: its main thread and the threads it started, as generators with one step per cycle."""

from __future__ import annotations

from collections.abc import Iterator

Thread = Iterator[None]  # one `yield` ends the turn of the thread in this cycle
MAIN = "main"
ENDED = object()  # returned by `next` once a generator is exhausted


class ProgramError(Exception):
    """A text that is no program, or a runtime error of one: the controller stops it.

    Attributes:
        line, column: place in the text, from 1; 0 where it is not known.
    """

    def __init__(self, text: str, line: int = 0, column: int = 0) -> None:
        super().__init__(text)
        self.line = line
        self.column = column


class SuddenTargetChange(Exception):
    """A target so far away that reaching it would exceed the joint speed limit; causes a protective stop."""


class Program:
    """A named program with its threads.

    Attributes:
        running: name of the thread whose turn it is.
        interrupted: name of a thread that nobody's turn may divide: it goes on first in the next cycle; "": none.
    """

    def __init__(self, name: str, main: Thread) -> None:
        self.name = name
        self.threads: dict[str, Thread] = {MAIN: main}
        self.running = MAIN
        self.interrupted = ""

    def close(self) -> None:
        """Gives back what the program holds once it has ended."""

    def start(self, name: str, thread: Thread) -> None:
        """Starts a thread; its first turn is in this cycle, after that of the thread that started it."""
        self.threads[name] = thread

    def start_once(self, name: str, thread: Thread, *rivals: str) -> None:
        """Starts a thread unless it, or one of its rivals, runs already."""
        if not {name, *rivals} & self.threads.keys():
            self.start(name, thread)

    def kill(self, name: str) -> bool:
        """Ends a thread; returns whether there was one."""
        return self.threads.pop(name, None) is not None

    def step(self) -> bool:
        """Gives every thread its turn, until one is interrupted.

        Returns:
            False once the main thread has ended, and with it the program.

        Raises:
            ProgramError: a thread met a runtime error.
        """
        done: set[str] = set()
        while waiting := [name for name in self.threads if name not in done]:
            self.running = waiting[0]  # a thread may start others, whose turn comes after its own, or end some
            done.add(self.running)
            thread = self.threads[self.running]
            ended = next(thread, ENDED) is ENDED
            if self.interrupted:
                break
            if not ended:
                continue
            if self.running == MAIN:
                return False
            if self.threads.get(self.running) is thread:
                del self.threads[self.running]
        return True

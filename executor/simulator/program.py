"""A running program: its main thread and the threads it started, one step each a cycle."""

from __future__ import annotations

from collections.abc import Iterator

Thread = Iterator[None]
MAIN = "main"
ENDED = object()  # what `next` gives once a generator is over


class ProgramError(Exception):
    """A runtime error of the program: the controller stops it."""


class Program:
    """Threads as generators; one `yield` is the end of a thread's turn in this cycle."""

    def __init__(self, name: str, main: Thread) -> None:
        self.name = name
        self.threads: dict[str, Thread] = {MAIN: main}

    def start(self, name: str, thread: Thread) -> None:
        """Starts a thread; it has its first turn in this cycle, after the thread that started it."""
        self.threads[name] = thread

    def kill(self, name: str) -> bool:
        """Ends a thread; returns whether there was one."""
        return self.threads.pop(name, None) is not None

    def step(self) -> bool:
        """Gives every thread its turn; returns False once the main thread has ended, and with it the program.

        Raises:
            ProgramError: a thread met a runtime error.
        """
        turn = 0
        while turn < len(self.threads):  # a thread may start others, which have their turn after it
            name = list(self.threads)[turn]
            ended = next(self.threads[name], ENDED) is ENDED
            if ended and name == MAIN:
                return False
            if ended:
                self.threads.pop(name, None)
            turn += not ended
        return True

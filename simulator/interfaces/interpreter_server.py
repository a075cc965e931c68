"""The port of interpreter mode: one statement or command a line in, one answer a line out."""

from __future__ import annotations

from simulator.interfaces.connections import Connection, ConnectionHandler
from simulator.program import InterpreterQueue


class InterpreterServer(ConnectionHandler):
    """Passes statements on to the program in interpreter mode."""

    def __init__(self, queue: InterpreterQueue) -> None:
        self.queue = queue

    def arrived(self, connection: Connection) -> None:
        """Answers every complete line that is not empty."""
        lines = [line.decode("utf-8", "replace").strip() for line in connection.take_lines()]
        answers = [f"{self.queue.answer(line)}\n" for line in lines if line]
        if answers:
            connection.send("".join(answers).encode())

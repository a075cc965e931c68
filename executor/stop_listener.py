"""The executor's end of the stop socket: a stop reaches the run at once, whatever database and main thread wait for."""

from __future__ import annotations

import json
import select
import socket
import time
from collections import deque
from pathlib import Path
from typing import Any

from executor.execution import Execution
from executor.logs import log
from executor.worker import Worker
from fling import stop_socket

POLL_S = 0.2  # [s] after which the thread looks whether it is to end
CLIENTS_MAX = 64  # that have connected and said nothing yet; the oldest makes room
REMEMBERED = 100  # stops of executions that this executor does not run yet


class StopListener(Worker):
    """Answers on the stop socket of one executor.

    Attributes:
        execution: the one that is claimed; None between executions.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__("stop listener")
        self.folder = folder
        self.execution: Execution | None = None
        self._asked: deque[str] = deque(maxlen=REMEMBERED)

    def is_asked(self, execution_id: str) -> bool:
        """Returns whether somebody asked for a stop of an execution."""
        return execution_id in self._asked

    def run(self) -> None:
        """Answers until the end."""
        with stop_socket.listen(self.folder) as listener:
            clients: dict[int, socket.socket] = {}
            waiting = select.poll()
            waiting.register(listener, select.POLLIN)
            try:
                while not self.ended.is_set():
                    for number, _ in waiting.poll(1e3 * POLL_S):
                        if number == listener.fileno():
                            self._accept(listener, clients, waiting)
                        elif number in clients:  # one that has just made room for another is gone
                            waiting.unregister(number)
                            self._serve(clients.pop(number))
            finally:
                for client in clients.values():
                    client.close()
                (self.folder / stop_socket.NAME).unlink(missing_ok=True)

    def _accept(self, listener: socket.socket, clients: dict[int, socket.socket], waiting: select.poll) -> None:
        """Accepts a client; one too many takes the place of the oldest, which is answered if it has just spoken."""
        client, _ = listener.accept()
        client.setblocking(False)
        if len(clients) >= CLIENTS_MAX:
            oldest = next(iter(clients))
            waiting.unregister(oldest)
            self._serve(clients.pop(oldest))
        clients[client.fileno()] = client
        waiting.register(client, select.POLLIN)

    def _serve(self, client: socket.socket) -> None:
        """Answers one message, and closes the connection; what is no message has no answer."""
        with client:
            try:
                message = json.loads(client.recv(stop_socket.MESSAGE_BYTES))
                client.send(json.dumps(self._answer(message)).encode())
            except (OSError, ValueError, RecursionError, TypeError, KeyError):
                return

    def _answer(self, message: dict[str, Any]) -> dict[str, Any] | None:
        """Returns the execution that is claimed, asked to brake where the message says so; None without one."""
        execution = self.execution
        if message["ask"] == "stop":
            id = str(message["execution_id"])
            self._asked.append(id)
            log("stop", execution=id, who=str(message["who"]))
            if execution is not None and execution.row.id == id:
                execution.abort()
        if execution is None:
            return None
        return {**vars(execution.row), "state": execution.states()[-1], "abort_requested_at": self._asked_at(execution)}

    def _asked_at(self, execution: Execution) -> float | None:
        asked = execution.row.id in self._asked
        return time.time() if asked else execution.row.abort_requested_at

"""The control port: one JSON request per line in, one JSON answer per line out. No robot has it."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from simulator.interfaces.connections import Connection, ConnectionHandler

Document = dict[str, Any]


class BadRequest(Exception):
    """A request of the control port that cannot be carried out; the text is the reason."""


class ControlServer(ConnectionHandler):
    """Answers requests {"op": name, ...} by the operation of that name."""

    def __init__(self, operations: Mapping[str, Callable[[Document], Document | None]]) -> None:
        """`operations`: name -> function from a request to its answer, None for an empty one; may raise BadRequest."""
        self.operations = operations

    def arrived(self, connection: Connection) -> None:
        """Answers every complete line."""
        for line in connection.take_lines():
            connection.send(json.dumps(self.answer(line)).encode() + b"\n")

    def answer(self, line: bytes) -> Document:
        """Returns the answer to one request: {"ok": true, ...} or {"ok": false, "error": text}."""
        try:
            request = json.loads(line)
            if not isinstance(request, dict) or str(request.get("op")) not in self.operations:
                raise BadRequest(f"op must be one of {', '.join(self.operations)}")
            return {"ok": True, **(self.operations[request["op"]](request) or {})}
        except (ValueError, TypeError, RecursionError, BadRequest) as error:
            return {"ok": False, "error": str(error)}

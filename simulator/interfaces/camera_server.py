"""A camera above the places of a feeder, as a small service of its own: what it sees of them, in JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simulator.interfaces.connections import Connection, ConnectionHandler
from simulator.interfaces.http_request import HttpRequest, answer_requests

PATH = "/objects"


class CameraServer(ConnectionHandler):
    """Answers GET of its one path; each is another look."""

    def __init__(self, look: Callable[[], dict[str, Any]]) -> None:
        """`look` returns what the camera sees now."""
        self.look = look

    def arrived(self, connection: Connection) -> None:
        """Answers every complete request."""
        answer_requests(connection, self.answer)

    def answer(self, request: HttpRequest) -> tuple[int, dict[str, Any]]:
        """Returns status and document of the answer to a request."""
        if request.path != PATH:
            return 404, {"detail": f"the camera has {PATH} alone"}
        return (200, self.look()) if request.method == "GET" else (405, {"detail": "the camera only looks: GET"})

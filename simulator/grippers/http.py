"""A gripper that is opened and closed by HTTP calls, as one behind somebody's own server."""

from __future__ import annotations

import urllib.parse

from planner.grippers import GripperLink
from simulator.interfaces import Connection, ConnectionHandler
from simulator.physics import SimulatedGripper

HEAD_MAX = 65536  # [bytes] a longer head is no call
END = b"\r\n\r\n"


def twin(link: GripperLink, gripper: SimulatedGripper) -> ConnectionHandler:
    """Returns the server that the calls reach."""
    return HttpTwin(link, gripper)


class HttpTwin(ConnectionHandler):
    """Answers 200 to a POST of the two addresses, 404 or 405 to anything else, and keeps the connection."""

    def __init__(self, link: GripperLink, gripper: SimulatedGripper) -> None:
        self.gripper = gripper
        self.targets = {_target(link.open_text): True, _target(link.close_text): False}

    def arrived(self, connection: Connection) -> None:
        """Answers every complete call; none of them has a body."""
        while END in connection.received:
            head, _, rest = bytes(connection.received).partition(END)
            connection.received[:] = rest
            connection.send(self._answer(head.split(b"\r\n")[0].decode("latin-1").split()))
        if len(connection.received) > HEAD_MAX:
            connection.open = False

    def _answer(self, words: list[str]) -> bytes:
        opens = self.targets.get(words[1]) if len(words) == 3 else None
        if opens is None:
            return _response("404 Not Found")
        if words[0] != "POST":
            return _response("405 Method Not Allowed")
        self.gripper.request(opens)
        return _response("200 OK")


def _target(url: str) -> str:
    parts = urllib.parse.urlsplit(url)
    return urllib.parse.urlunsplit(("", "", parts.path or "/", parts.query, ""))


def _response(status: str) -> bytes:
    return f"HTTP/1.1 {status}\r\nContent-Length: 0\r\n\r\n".encode()

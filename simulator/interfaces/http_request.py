"""HTTP/1.1 as far as a small service needs it: requests cut from what has arrived, and answers in JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any

from simulator.interfaces.connections import Connection

HEAD_END = b"\r\n\r\n"
HEAD_BYTES = 16_384  # [byte] a longer head is no request
BODY_BYTES = 65_536  # [byte] nothing that is asked here needs more


class NotHttp(Exception):
    """What arrived is no request that can be answered: the connection is closed."""


@dataclass(frozen=True)
class HttpRequest:
    """A request: `method`, `path` without its query, `body`, and whether the client keeps the connection."""

    method: str
    path: str
    body: bytes
    keeps: bool

    def document(self) -> dict[str, Any] | None:
        """Returns the body's JSON object; None where it is none."""
        try:
            found = json.loads(self.body)
        except (ValueError, RecursionError):
            return None
        return found if isinstance(found, dict) else None


def take_request(received: bytearray) -> HttpRequest | None:
    """Returns the first request, and removes it; None while it is not complete.

    Raises:
        NotHttp: it can never be.
    """
    end = received.find(HEAD_END)
    if end < 0 and len(received) <= HEAD_BYTES:
        return None
    lines = bytes(received[: max(end, 0)]).decode("latin-1").split("\r\n")
    words = lines[0].split(" ")
    if end < 0 or len(words) != 3 or not words[2].startswith("HTTP/1."):
        raise NotHttp
    headers = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines[1:])}
    length = headers.get("content-length", "0")
    if "transfer-encoding" in headers or not length.isdecimal() or int(length) > BODY_BYTES:
        raise NotHttp
    begin = end + len(HEAD_END)
    if len(received) < begin + int(length):
        return None
    body = bytes(received[begin : begin + int(length)])
    del received[: begin + int(length)]
    keeps = headers.get("connection", "").lower() != "close" and words[2] != "HTTP/1.0"
    return HttpRequest(words[0], words[1].partition("?")[0], body, keeps)


def answer_bytes(status: int, document: Any) -> bytes:
    """Returns an answer whose body is a document."""
    body = json.dumps(document).encode()
    head = f"HTTP/1.1 {status} {HTTPStatus(status).phrase}\r\ncontent-type: application/json\r\n"
    return f"{head}content-length: {len(body)}\r\n\r\n".encode() + body


def answer_requests(connection: Connection, answer: Callable[[HttpRequest], tuple[int, Any]]) -> None:
    """Answers every complete request by what `answer` returns for it: status and document."""
    try:
        while connection.open and (request := take_request(connection.received)) is not None:
            connection.send(answer_bytes(*answer(request)))
            if not request.keeps:
                connection.flush()
                connection.open = False
    except NotHttp:
        connection.open = False

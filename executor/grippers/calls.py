"""Grippers that a person's own code opens: a snippet of URScript, or a call by HTTP."""

from __future__ import annotations

import textwrap
import urllib.parse
from collections import deque

from planner.grippers import GripperLink

PROGRAM = "fling_gripper"  # name of the secondary programs that Fling sends: no other client's


class UnseenGripper:
    """A gripper that tells nothing of its fingers: there is nothing to ask it."""

    reports = False
    quiet_s = 0.0

    def preparation(self) -> tuple[bytes, ...]:
        """Returns nothing: what there is to call would move the gripper."""
        return ()

    def unready(self) -> str:
        """Returns nothing."""
        return ""

    def question(self) -> bytes:
        """Returns nothing."""
        return b""

    def is_closed(self) -> bool:
        """Returns False: an answer to a call does not tell where the gripper is."""
        return False

    def holds(self) -> None:
        """Returns None."""
        return

    def motion(self) -> None:
        """Returns None."""
        return

    def has_lost_object(self) -> bool:
        """Returns False."""
        return False


class ScriptGripper(UnseenGripper):
    """Snippets that run as secondary programs, beside the program that moves the arm; nothing tells how they ended."""

    answers = False
    fault = ""
    reconnects = False

    def __init__(self, link: GripperLink) -> None:
        self._texts = {True: _secondary(link.open_text), False: _secondary(link.close_text)}

    def tell(self, opens: bool) -> bytes:
        """Returns the snippet as a program."""
        return self._texts[opens]

    def take(self, received: bytearray) -> int:
        """Discards the states that the controller sends here."""
        received.clear()
        return 0

    def is_open(self) -> bool | None:
        """Returns None."""
        return None


class HttpGripper(UnseenGripper):
    """Calls (POST, without a body) to one server; what it answered last is what the gripper did."""

    answers = True
    reconnects = True

    def __init__(self, link: GripperLink) -> None:
        self._requests = {True: _post(link, link.open_text), False: _post(link, link.close_text)}
        self._told: deque[bool] = deque()  # calls without an answer
        self._is_open: bool | None = None
        self.fault = ""

    def tell(self, opens: bool) -> bytes:
        """Returns the call."""
        self._told.append(opens)
        return self._requests[opens]

    def take(self, received: bytearray) -> int:
        """Takes whole answers."""
        count = 0
        while (status := _take_answer(received)) is not None:
            count += 1
            opens = self._told.popleft() if self._told else None
            if not 200 <= status < 300:
                self.fault = f"the server answered {status}"
            elif opens is not None:
                self._is_open = opens
        return count

    def is_open(self) -> bool | None:
        """Returns what the call that was answered last did; None before any."""
        return self._is_open


def _secondary(snippet: str) -> bytes:
    body = textwrap.indent(textwrap.dedent(snippet).strip(), "  ")
    return f"sec {PROGRAM}():\n{body}\nend\n".encode()


def _post(link: GripperLink, url: str) -> bytes:
    parts = urllib.parse.urlsplit(url)
    path = urllib.parse.urlunsplit(("", "", parts.path or "/", parts.query, ""))
    lines = [f"POST {path} HTTP/1.1", f"Host: {link.host}:{link.port}", "Content-Length: 0", "Connection: keep-alive"]
    return "\r\n".join([*lines, "", ""]).encode()


def _take_answer(received: bytearray) -> int | None:
    """Takes an answer of HTTP; returns its status, 0 for what is no HTTP, or None while it is not complete."""
    head, end, rest = bytes(received).partition(b"\r\n\r\n")
    if not end:
        return None
    first, *lines = head.decode("latin-1").split("\r\n")
    fields = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    if fields.get("transfer-encoding", "").lower() == "chunked":
        size = rest.find(b"0\r\n\r\n") + 5
        complete = size >= 5
    else:
        length = fields.get("content-length", "0")
        size = int(length) if length.isdigit() else 0
        complete = len(rest) >= size
    if not complete:
        return None
    del received[: len(head) + len(end) + size]
    words = first.split()
    return int(words[1]) if len(words) > 1 and words[0].startswith("HTTP/") and words[1].isdigit() else 0

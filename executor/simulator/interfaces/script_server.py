"""The script port: receives the text of programs and sends nothing (ur_rtde never reads the state of a real one)."""

from __future__ import annotations

import re
from collections.abc import Callable

from executor.simulator.interfaces.connections import Connection, ConnectionHandler

END = re.compile(rb"^end[ \t\r]*\n", re.MULTILINE)  # the last line of a program, in column 0
SCRIPT_MAX = 1 << 20  # [bytes] a longer text is no program: the connection is closed


class ScriptServer(ConnectionHandler):
    """Hands complete programs to the controller."""

    def __init__(self, upload: Callable[[str], None], note: Callable[[str], None]) -> None:
        """`upload` takes the text of a program, `note` an event."""
        self.upload, self.note = upload, note

    def arrived(self, connection: Connection) -> None:
        """Uploads every complete program."""
        while (end := END.search(connection.received)) is not None:
            text = bytes(connection.received[: end.end()]).decode("utf-8", "replace")
            del connection.received[: end.end()]
            self.upload(text)
        if len(connection.received) > SCRIPT_MAX:
            self.note("script port: no program within the largest size")
            connection.open = False

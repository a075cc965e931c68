"""The script port: the text of a program in, nothing out (ur_rtde never reads the state a real one streams here)."""

from __future__ import annotations

import re

from executor.simulator.connections import Connection
from executor.simulator.controller import Controller

END = re.compile(rb"^end[ \t\r]*\n", re.MULTILINE)  # the last line of a program, in column 0
SCRIPT_MAX = 1 << 20  # [bytes] longer texts are no programs: the connection is closed


class ScriptPort:
    """Hands whole programs to the controller."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller

    def opened(self, connection: Connection) -> None:
        """A client has connected."""

    def closed(self, connection: Connection) -> None:
        """Half a program is forgotten."""

    def arrived(self, connection: Connection) -> None:
        """Uploads every program that is whole."""
        while (end := END.search(connection.received)) is not None:
            text = bytes(connection.received[: end.end()]).decode("utf-8", "replace")
            del connection.received[: end.end()]
            self.controller.execution.upload(text)
        if len(connection.received) > SCRIPT_MAX:
            self.controller.note("script port: no program within the largest size")
            connection.open = False

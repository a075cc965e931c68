"""What clients send to the client interfaces: programs, single lines of script, and plain commands.

Source: Universal Robots, "Primary and secondary interfaces" and "Realtime client interface": each of the three ports
takes scripts. The plain commands are those of URControl that PolyScope and UR's own client library send.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

from simulator.interfaces.connections import Connection, ConnectionHandler

BLOCK_WORD = re.compile(rb"^[ \t]*(def|sec|thread|if|while|for|switch|end)\b", re.MULTILINE)
NOTHING = re.compile(rb"[ \t\r]*(#[^\n]*)?\n")  # a line without a statement
SCRIPT_MAX = 1 << 20  # [bytes] a longer text is no program: the connection is closed

Commands = Mapping[str, Callable[[], object]]


class ScriptReader:
    """Cuts the text that arrives on one connection into programs and single lines; each byte is scanned once."""

    def __init__(self) -> None:
        self.scanned = self.depth = 0  # bytes of the present text already looked at, and its open blocks there

    def take(self, received: bytearray) -> Iterator[str]:
        """Yields every complete program or line at the front of `received`, and removes it."""
        while (end := self._end(received)) > 0:
            text = bytes(received[:end])
            del received[:end]
            self.scanned = self.depth = 0
            if not NOTHING.fullmatch(text):
                yield text.decode("utf-8", "replace")

    def _end(self, received: bytearray) -> int:
        """Returns where the first program or line ends; 0 while it is not complete."""
        complete = received.rfind(b"\n") + 1
        while self.scanned < complete:
            line_end = received.find(b"\n", self.scanned) + 1
            if self.depth > 0:  # within a program: jump to the next line that opens or closes a block
                match = BLOCK_WORD.search(received, self.scanned, complete)
                if match is None:
                    self.scanned = complete
                    return 0
                line_end = received.find(b"\n", match.end()) + 1
                self._count(match)
            else:
                self._count(BLOCK_WORD.match(received, self.scanned, line_end))
            self.scanned = line_end
            if self.depth <= 0:
                return line_end
        return 0

    def _count(self, match: re.Match[bytes] | None) -> None:
        if match is not None:
            self.depth += -1 if match.group(1) == b"end" else 1


class ScriptServer(ConnectionHandler):
    """Hands complete programs to the controller, and carries out plain commands."""

    def __init__(
        self, upload: Callable[[str], object], note: Callable[[str], None], commands: Commands | None = None
    ) -> None:
        """`upload` takes the text of a program, `note` an event; `commands` are the actions of plain commands."""
        self.upload = upload
        self.note = note
        self.commands = commands or {}
        self.readers: dict[Connection, ScriptReader] = {}

    def opened(self, connection: Connection) -> None:
        """Waits for the first text."""
        self.readers[connection] = ScriptReader()

    def closed(self, connection: Connection) -> None:
        """Forgets the connection."""
        self.readers.pop(connection, None)

    def arrived(self, connection: Connection) -> None:
        """Uploads every complete program, and obeys every complete command."""
        for text in self.readers.setdefault(connection, ScriptReader()).take(connection.received):
            command = self.commands.get(" ".join(text.lower().split()))
            if command is not None:
                command()
            else:
                self.upload(text)
        if len(connection.received) > SCRIPT_MAX:
            self.note("script port: no program within the largest size")
            connection.open = False

"""Programs stored on the controller, which the dashboard loads by name.

PolyScope saves `NAME.urp` together with the script it becomes, `NAME.script`; the latter is what runs here.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath

from planner.documents import read_file
from planner.errors import FileRefused

PROGRAM_BYTES = 5_000_000  # [byte] of a script
PROGRAM_FOLDERS = ("/ursim/programs/", "/programs/")  # where programs are on URSim and on a robot


class StoredPrograms:
    """The scripts in a folder, and the one that is loaded.

    Attributes:
        loaded: path of the loaded program as a client gave it, empty without one.
        text: its script.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = None if folder is None else folder.resolve()
        self.loaded = self.text = ""

    @property
    def name(self) -> str:
        """File name of the loaded program, empty without one."""
        return PurePosixPath(self.loaded).name

    def load(self, path: str) -> bool:
        """Loads a program; returns whether it is there."""
        text = self._text(path)
        if text is not None:
            self.loaded = path
            self.text = text
        return text is not None

    def _text(self, path: str) -> str | None:
        if self.folder is None:
            return None
        for root in PROGRAM_FOLDERS:
            path = path.removeprefix(root)
        try:
            file = (self.folder / path).with_suffix(".script").resolve()
            if not file.is_relative_to(self.folder):
                return None
            return read_file(file, PROGRAM_BYTES).decode(errors="replace")
        except (OSError, RuntimeError, ValueError, FileRefused):  # RuntimeError: a link to itself
            return None

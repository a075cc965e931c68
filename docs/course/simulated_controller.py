"""A simulated controller for the pages that control one, on an address of their own."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fling.cells import cells_folder

END_S = 10.0  # [s] to end in order


@contextmanager
def simulated_controller(host: str, cell: str = "ur5e-sim") -> Iterator[str]:
    """Runs `fling sim` for a cell on a loopback address; yields the address.

    Raises:
        RuntimeError: it did not start.
    """
    with tempfile.TemporaryDirectory() as folder:
        text = (cells_folder() / f"{cell}.toml").read_text()
        (Path(folder) / f"{cell}.toml").write_text(re.sub(r'host = "127[^"]*"', f'host = "{host}"', text))
        command = [sys.executable, "-P", "-m", "simulator", "--cell", f"{folder}/{cell}.toml"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            if not process.stdout.readline().startswith("ready"):
                raise RuntimeError(f"no simulated controller on {host}")
            yield host
        finally:
            process.terminate()
            process.wait(END_S)

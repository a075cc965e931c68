"""A process that plans for the service beside its workers, such as the driver of a batch; it ends with its task."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import tempfile
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

EXIT_POLL_S = 0.2  # [s] between two looks at whether the process has ended
STOP_S = 10.0  # [s] after which a process that was asked to stop is killed


async def _nothing() -> None: ...


@dataclass(frozen=True)
class PlanningCommand:
    """A module of `jobs` that is run with Python: `python -m jobs ID`, `python -m jobs.maps ID`.

    Attributes:
        module: Its name.
        database_url: Of the store that it works on.
        workers: Number of its planner processes; None: one a core.
        ray_address: Address of a Ray cluster; None: processes of this machine.
    """

    module: str
    database_url: str
    workers: int | None
    ray_address: str | None

    async def run(self, *arguments: str, meanwhile: Callable[[], Awaitable[None]] = _nothing) -> tuple[int, str]:
        """Runs it to its end; a cancelled task asks it to stop, and sees to it.

        Args:
            arguments: Of this run.
            meanwhile: Called every `EXIT_POLL_S`.

        Returns:
            Its exit status, and what it wrote to standard error.
        """
        options = ["--workers", str(self.workers)] if self.workers else []
        options += ["--ray", self.ray_address] if self.ray_address else []
        with tempfile.TemporaryFile() as errors:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", self.module, *arguments, *options],
                env={**os.environ, "FLING_DATABASE_URL": self.database_url},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                start_new_session=True,
            )
            try:
                while process.poll() is None:
                    await asyncio.sleep(EXIT_POLL_S)
                    await meanwhile()
            finally:
                _end(process)
            errors.seek(0)
            return process.returncode, errors.read().decode(errors="replace").strip()


def _end(process: subprocess.Popen[bytes]) -> None:
    """Asks a process to stop, and sees to it."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

"""Child processes that live and die together."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Self

STOP_S = 5.0  # [s] a child may take to end; the executor brakes its robot first
PR_SET_PDEATHSIG = 1  # source: Linux prctl(2)


class ChildFailed(RuntimeError):
    """A child did not come up, or ended by itself."""


class Children:
    """Starts children in sessions of their own, so that Ctrl-C reaches this process alone, which ends them in turn.

    Should this process be killed, the kernel sends them SIGTERM.
    """

    def __init__(self, environment: Mapping[str, str], log: Path | None = None) -> None:
        self._environment = {**os.environ, **environment}
        self._log = None if log is None else log.open("wb")
        self._children: list[tuple[str, subprocess.Popen[bytes]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def start(self, name: str, module: str, arguments: Sequence[str] = (), ready_s: float | None = None) -> None:
        """Starts `python -m module`; with `ready_s` waits until it says "ready" on its standard output.

        Raises:
            ChildFailed: it ended, or said nothing in time.
        """
        libc = ctypes.CDLL(None)
        child = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            env=self._environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=self._log,
            start_new_session=True, preexec_fn=lambda: libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM),
        )  # fmt: skip
        self._children.append((name, child))
        assert child.stdout is not None
        ready = threading.Event()
        threading.Thread(target=_listen, args=(child.stdout, ready, self._log), daemon=True).start()
        if ready_s is not None:
            self._wait(name, child, ready, ready_s)

    def check(self) -> None:
        """Raises ChildFailed where a child has ended."""
        for name, child in self._children:
            if child.poll() is not None:
                raise ChildFailed(f"the {name} ended with status {child.returncode}")

    def stop(self) -> None:
        """Ends the children, the last started first; kills what does not obey. Doing it twice does no harm."""
        for _, child in reversed(self._children):
            _end(child)
        self._children.clear()
        if self._log is not None:
            self._log.close()

    def _wait(self, name: str, child: subprocess.Popen[bytes], ready: threading.Event, ready_s: float) -> None:
        deadline = time.monotonic() + ready_s
        while not ready.wait(0.05):
            if child.poll() is not None:
                raise ChildFailed(f"the {name} ended with status {child.returncode} before it was ready")
            if time.monotonic() > deadline:
                raise ChildFailed(f"the {name} was not ready within {ready_s:g} s")


def _end(child: subprocess.Popen[bytes]) -> None:
    if child.poll() is None:
        child.terminate()
        try:
            child.wait(STOP_S)
        except subprocess.TimeoutExpired:
            child.kill()
    child.wait()


def _listen(output: IO[bytes], ready: threading.Event, log: IO[bytes] | None) -> None:
    """Waits for the word, and keeps the pipe from filling; the output goes to the log where there is one."""
    with output:
        for line in output:
            if line.startswith(b"ready"):
                ready.set()
            if log is not None and not log.closed:
                log.write(line)
                log.flush()

"""Child processes of `fling up` and `fling demo`, which start and stop together."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import IO, Self

import click

from api.cli.support.client import ServiceClient, ServiceError

STOP_S = 5.0  # [s] for a child to end; the executor brakes its robot first
READY_S = 300.0  # [s] for a child to get ready: it imports and builds for ten seconds, longer beside busy processes
SAID_AFTER_S = 3.0  # [s] of waiting until it is said what for; then whenever the wait has doubled
POLL_S = 0.1  # [s] between two looks at a child's readiness
DEATHS_MAX = 3
DEATHS_WITHIN_S = 60.0  # [-], [s] a child that ends more often within this time does not come back
NO_CLIENT = (
    "ur_rtde is not installed, without which nothing streams to an arm, a simulated one included: pip install "
    "'fling-robotics[executor]', with Python 3.11 or 3.12 (in a clone: make PYTHON=python3.12 ...); planning works "
    "without it"
)
PR_SET_PDEATHSIG = 1  # source: Linux prctl(2)


READYING = {  # what a child does until it is ready
    "simulator": "the simulated controller loads its libraries",
    "executor": "the executor loads its libraries and connects to the controller",
    "service": "the service loads the planner",
}


class ChildFailed(RuntimeError):
    """A child did not start, or ended by itself."""


class Waiting:
    """A wait that says what it is for.

    Args:
        patience_s: until it ends [s].
    """

    def __init__(self, patience_s: float) -> None:
        self._begun = time.monotonic()
        self._said_next_s = SAID_AFTER_S
        self._patience_s = patience_s

    def goes_on(self, reason: str) -> bool:
        """Returns whether there is time left; says now and then what is waited for."""
        waited_s = time.monotonic() - self._begun
        if waited_s >= self._said_next_s:
            click.echo(f"  {waited_s:.0f} s: {reason} …")
            self._said_next_s = 2.0 * waited_s
        return waited_s < self._patience_s


@dataclass
class Child:
    """One child process, and how to start it again.

    Attributes:
        name: what a person calls it.
        module: that it runs.
        arguments: of its command line.
        process: the running one.
        deaths_s: when earlier ones ended by themselves, on the monotonic clock [s].
    """

    name: str
    module: str
    arguments: Sequence[str]
    process: subprocess.Popen[bytes]
    deaths_s: list[float] = field(default_factory=list)


class ChildProcesses:
    """Starts and stops child processes.

    Each child has a session of its own, so that Ctrl-C reaches only this process, which stops the children in order. If
    this process is killed, the kernel sends them SIGTERM.

    Args:
        environment: Added to the environment of the children.
        log: File for their output; discarded without one.
    """

    def __init__(self, environment: Mapping[str, str], log: Path | None = None) -> None:
        self._environment = {**os.environ, **environment}
        self._log = None if log is None else log.open("wb")
        self._children: list[Child] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    def start(self, name: str, module: str, arguments: Sequence[str] = (), ready_s: float | None = None) -> None:
        """Starts `python -m module`; with `ready_s`, waits until it prints "ready".

        Raises:
            ChildFailed: It ended, or was not ready in time.
        """
        process, ready = self._spawn(module, arguments)
        self._children.append(Child(name, module, arguments, process))
        if ready_s is not None:
            self._wait(name, process, ready, ready_s)

    def check(self) -> None:
        """Checks that every child runs.

        Raises:
            ChildFailed: A child has ended.
        """
        for child in self._children:
            if child.process.poll() is not None:
                raise ChildFailed(f"the {child.name} ended with status {child.process.returncode}")

    def revive(self) -> list[str]:
        """Starts children again that ended by themselves. Returns a sentence about each.

        Raises:
            ChildFailed: One ends again and again.
        """
        return [self._start_again(child) for child in self._children if child.process.poll() is not None]

    def _start_again(self, child: Child) -> str:
        now = time.monotonic()
        child.deaths_s = [at for at in child.deaths_s if now - at < DEATHS_WITHIN_S] + [now]
        ended = f"the {child.name} {_how_it_ended(child.process.returncode)}"
        if len(child.deaths_s) > DEATHS_MAX:
            raise ChildFailed(f"{ended}, the {len(child.deaths_s)}th time within {DEATHS_WITHIN_S:g} s")
        child.process, _ = self._spawn(child.module, child.arguments)
        return f"{ended}; started again"

    def _spawn(self, module: str, arguments: Sequence[str]) -> tuple[subprocess.Popen[bytes], threading.Event]:
        """Starts a process. Returns it, and what is set once it prints "ready"."""
        libc = ctypes.CDLL(None)  # loaded before the fork
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", module, *arguments],
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self._log,
            start_new_session=True,
            preexec_fn=lambda: libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM),
        )
        assert process.stdout is not None
        ready = threading.Event()
        threading.Thread(target=_read_output, args=(process.stdout, ready, self._log), daemon=True).start()
        return process, ready

    def end(self, name: str) -> None:
        """Stops the child of this name."""
        for child in [child for child in self._children if child.name == name]:
            _end(child.process)
            self._children.remove(child)

    def stop(self) -> None:
        """Stops the children, the last started first, and kills those that do not end. May be called twice."""
        for child in reversed(self._children):
            _end(child.process)
        self._children.clear()
        if self._log is not None:
            self._log.close()

    def _wait(self, name: str, child: subprocess.Popen[bytes], ready: threading.Event, ready_s: float) -> None:
        waiting = Waiting(ready_s)
        while not ready.wait(POLL_S):
            if child.poll() is not None:
                raise ChildFailed(f"the {name} ended with status {child.returncode} before it was ready")
            if not waiting.goes_on(READYING.get(name, f"the {name} gets ready")):
                raise ChildFailed(f"the {name} was not ready within {ready_s:g} s")


def start_all(
    children: ChildProcesses,
    cells: Path,
    cell: str,
    url: str,
    is_simulated: bool,
    truth: Sequence[str] = (),
    ready_s: float = READY_S,
) -> None:
    """Starts simulator, executor and service of a cell; waits until the service plans and sees the executor.

    Args:
        children: Receives the processes.
        cells: Folder of the cell files.
        cell: Name of the cell.
        url: URL of the service.
        is_simulated: Whether the cell's controller is simulated.
        truth: Arguments of the simulator for its truth file.
        ready_s: Time for each of them to get ready [s].

    Raises:
        ChildFailed: One of them did not start.
    """
    if is_simulated:
        click.echo("starting the simulated controller …")
        start_simulator(children, cells / f"{cell}.toml", truth, ready_s)
    click.echo("starting the executor …")
    children.start("executor", "executor", ["--cell", cell], ready_s)
    click.echo("starting the service …")
    children.start("service", "api")
    _wait_until_ready(children, url, cell, ready_s)


def require_streaming_client() -> None:
    """Checks that executions can be streamed here.

    Raises:
        click.ClickException: ur_rtde is missing.
    """
    if find_spec("rtde_control") is None:
        raise click.ClickException(NO_CLIENT)


def start_simulator(children: ChildProcesses, cell: Path, truth: Sequence[str] = (), ready_s: float = READY_S) -> None:
    """Starts the simulated controller of a cell file.

    Raises:
        ChildFailed: It did not start.
    """
    children.start("simulator", "simulator", ["--cell", str(cell), *truth], ready_s)


def cell_path(folder: Path, name: str) -> Path:
    """Returns the path of a cell file.

    Raises:
        click.ClickException: There is no such file.
    """
    path = folder / f"{name}.toml"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.toml"))) or "none"
        reason = f"no cell {name!r} in {folder}, the folder of cell files (FLING_CELLS); there are: {known}"
        raise click.ClickException(reason)
    return path


def catch_signals() -> None:
    """Makes SIGTERM and SIGINT raise KeyboardInterrupt, even if the shell had SIGINT ignored."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _interrupt)


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt


def _wait_until_ready(children: ChildProcesses, url: str, cell: str, ready_s: float) -> None:
    waiting = Waiting(ready_s)
    reason = READYING["service"]
    with ServiceClient(url, os.environ.get("FLING_TOKEN")) as client:
        while waiting.goes_on(reason):
            children.check()
            try:
                if client.get("/readyz")["cells"].get(cell):
                    return
                reason = "the executor sent no heartbeat yet"
            except ServiceError as error:
                is_answered = error.problem.get("status")  # 0: nothing listens yet
                reason = error.message if is_answered else READYING["service"]
            time.sleep(POLL_S)
    raise ChildFailed(f"not ready within {ready_s:g} s: {reason}")


def _how_it_ended(status: int) -> str:
    return f"was ended by signal {-status}" if status < 0 else f"ended with status {status}"


def _end(child: subprocess.Popen[bytes]) -> None:
    if child.poll() is None:
        child.terminate()
        try:
            child.wait(STOP_S)
        except subprocess.TimeoutExpired:
            child.kill()
    child.wait()


def _read_output(output: IO[bytes], ready: threading.Event, log: IO[bytes] | None) -> None:
    """Reads a child's output, so that the pipe never fills; sets `ready` at the line "ready" and copies to the log."""
    with output:
        for line in output:
            if line.startswith(b"ready"):
                ready.set()
            if log is not None and not log.closed:
                log.write(line)
                log.flush()

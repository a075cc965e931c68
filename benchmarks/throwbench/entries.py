"""Entries: functions in a process of their own, and HTTP addresses; each answers a problem within a time limit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, Protocol

import httpx2

from benchmarks.throwbench.fling_entries import service_answer, service_request
from benchmarks.throwbench.problem_document import Problem

ROOT = Path(__file__).parents[2]
WORKER = Path(__file__).with_name("worker.py")
START_S = 300.0
END_S = 5.0  # [s] for an entry's process to load, and to end by itself
OWN = "benchmarks.throwbench.fling_entries"
PEERS = "benchmarks.peers"
# Name in the table: place of the function, package that it needs.
BUILT_IN = {
    "fling": (f"{OWN}:auto", "casadi"),
    "fling-casadi": (f"{OWN}:casadi", "casadi"),
    "fling-ruckig": (f"{OWN}:ruckig", "ruckig"),
    "fling-toppra": (f"{OWN}:toppra", "toppra"),
    "ruckig-alone": (f"{PEERS}.ruckig_alone:plan", "ruckig"),
    "drake": (f"{PEERS}.drake_spline:plan", "pydrake"),
    "ipopt": (f"{PEERS}.ipopt_transcription:plan", "casadi"),
    "moveit-like": (f"{PEERS}.moveit_like:plan", "toppra"),
    "sdu-method": (f"{PEERS}.sdu_method:plan", "numpy"),
}


@dataclass(frozen=True)
class Reply:
    """What came back for one problem.

    Attributes:
        outcome: "answered", "timed out" or "crashed".
        answer: The answer, from JSON.
        wall_s: Time from the question to the reply [s].
        processor_s: Processor time of the entry [s]; None where it is not known.
        reason: Of a crash, in words.
    """

    outcome: str
    answer: Any = None
    wall_s: float = 0.0
    processor_s: float | None = None
    reason: str = ""


class ThrowEntry(Protocol):
    """A planner that takes part."""

    name: str

    def ask(self, problem: Problem, time_limit_s: float) -> Reply:
        """Returns the reply to a problem."""
        ...

    def close(self) -> None:
        """Ends what the entry has started."""
        ...


class EntryMissing(Exception):
    """The entry cannot be loaded."""


def entry_of(text: str) -> ThrowEntry:
    """Returns the entry that a command line names.

    Args:
        text: A name in `BUILT_IN`, "module:function", "file.py:function", an HTTP address, "fling+http://…" for the
            address of Fling's service; before each of these "NAME=" for the table.
    """
    name, given, place = text.partition("=")
    if not given or "/" in name or ":" in name:
        name = text
        place = text
    if place.startswith(("http://", "https://")):
        return HttpEntry(name, place)
    if place.startswith(("fling+http://", "fling+https://")):
        return HttpEntry(name, place.removeprefix("fling+").rstrip("/") + "/plan?store=false", fling=True)
    place, package = BUILT_IN.get(place, (place, ""))
    if ":" not in place:
        raise EntryMissing(f"{text!r} is none of {', '.join(BUILT_IN)}, no module:function and no HTTP address")
    return FunctionEntry(name, place, package)


class FunctionEntry:
    """A function, in a process that is kept between problems and ended where it takes too long.

    Args:
        name: In the table.
        place: "module:function" or "file.py:function".
        package: That it imports when it is asked; empty: none.
    """

    def __init__(self, name: str, place: str, package: str = "") -> None:
        self.name = name
        self._place = place
        self._package = package
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Connection[Any, Any] | None = None
        self._errors: IO[bytes] | None = None

    def ask(self, problem: Problem, time_limit_s: float) -> Reply:
        """Returns the reply to a problem.

        Raises:
            EntryMissing: The function cannot be loaded, or its package is missing.
        """
        connection = self._connected()
        begun = time.perf_counter()
        try:
            connection.send(json.dumps(problem))
            if not connection.poll(time_limit_s):
                self.close()
                return Reply("timed out", wall_s=time.perf_counter() - begun)
            text, processor_s = connection.recv()
        except (EOFError, OSError):
            return Reply("crashed", wall_s=time.perf_counter() - begun, reason=self._last_words())
        return Reply("answered", json.loads(text), time.perf_counter() - begun, processor_s)

    def close(self) -> None:
        """Ends the process."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        if self._connection is not None:
            self._connection.close()
        if self._errors is not None:
            self._errors.close()
        self._process = self._connection = self._errors = None

    def _connected(self) -> Connection[Any, Any]:
        if self._connection is not None:
            return self._connection
        if self._package and find_spec(self._package) is None:
            raise EntryMissing(f"{self._package} is not installed")
        self._connection, other = Pipe()
        command = [sys.executable, str(WORKER), str(other.fileno()), self._place]
        paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}
        self._errors = TemporaryFile()  # noqa: SIM115 closed by `close`
        self._process = subprocess.Popen(command, env=environment, pass_fds=[other.fileno()], stderr=self._errors)
        other.close()
        try:
            if self._connection.poll(START_S):
                self._connection.recv()
                return self._connection
            reason = f"not loaded after {START_S:g} s"
            self.close()
        except EOFError:
            reason = self._last_words()
        raise EntryMissing(f"{self._place}: {reason}")

    def _last_words(self) -> str:
        """Returns how a process that has ended by itself did; the next problem gets a new one."""
        assert self._process is not None and self._errors is not None
        try:
            code = self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            code = None
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        self.close()
        return f"its process ended with {code}: {lines[-1] if lines else 'without a word'}"


class HttpEntry:
    """An HTTP address that problems are posted to; with `fling`, Fling's own service."""

    def __init__(self, name: str, address: str, fling: bool = False) -> None:
        self.name = name
        self._address = address
        self._request: Callable[[Problem], dict[str, Any]] = service_request if fling else dict
        self._fling, self._client = fling, httpx2.Client()

    def ask(self, problem: Problem, time_limit_s: float) -> Reply:
        """Returns the reply to a problem.

        Raises:
            EntryMissing: Nobody listens at the address.
        """
        try:
            request = self._request(problem)
        except ValueError as error:
            return Reply("answered", {"refused": str(error)})
        begun = time.perf_counter()
        try:
            response = self._client.post(self._address, json=request, timeout=time_limit_s)
            wall_s = time.perf_counter() - begun
            return self._read(response, wall_s)
        except httpx2.ConnectError as error:
            raise EntryMissing(f"nobody answers at {self._address}: {error}") from error
        except httpx2.TimeoutException:
            return Reply("timed out", wall_s=time.perf_counter() - begun)
        except (httpx2.HTTPError, ValueError) as error:
            return Reply("crashed", wall_s=time.perf_counter() - begun, reason=f"{type(error).__name__}: {error}")

    def close(self) -> None:
        """Closes the connection."""
        self._client.close()

    def _read(self, response: httpx2.Response, wall_s: float) -> Reply:
        if self._fling:
            return Reply("answered", service_answer(response.status_code, response.json()), wall_s)
        if response.status_code != 200:
            return Reply("crashed", None, wall_s, None, f"status {response.status_code}")
        answer = response.json()
        used = answer.get("processor_time_s") if isinstance(answer, dict) else None
        return Reply("answered", answer, wall_s, used if isinstance(used, int | float) else None)

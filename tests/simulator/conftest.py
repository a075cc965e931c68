"""Simulators for tests, each with a cell and an address of its own; and parts of them without an arm."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from planner.cell import Cell, parse_cell
from simulator.clock import Timeline
from simulator.controller import Controller
from simulator.interfaces import Connection, ConnectionHandler, DashboardServer, InputValues
from simulator.loop import SimulatorLoop
from simulator.physics import Arm
from simulator.physics.world import World
from simulator.program import Program, ProgramError, ProgramRunner, Stops, messages
from simulator.settings import SimulatorSettings
from simulator.simulation import Simulation
from simulator.truth import Truth, truth_of

ROOT = Path(__file__).parents[2]
READY_WITHIN_S = 20.0  # [s] importing numpy is slow on a loaded machine
CONTROL_PORT = 29900
NUMBERS = count(31)  # second byte of the addresses: one per simulator, apart from those of other packages' tests
FUNCTIONS = "get_steptime() get_tcp_offset() get_inverse_kin_has_solution() protective_stop() tool_contact()"
SCRIPT = f"def rtde_control():\n  {FUNCTIONS}\nend\n"
ORDINARY = SimulatorSettings()

CELL = """
robot = "{robot}"
home_rad = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
tool = {{ tcp_position_m = [0.0, 0.0, 0.17], mass_kg = 1.0 }}
{tables}
[link]
kind = "sim"
host = "{host}"
[sim]
{sim}
"""


def unique_address() -> str:
    """Returns a loopback address that no other test of this or another run uses."""
    pid = os.getpid()
    return f"127.{31 + next(NUMBERS) % 40}.{pid >> 8 & 255}.{pid & 255 or 1}"


def cell_text(robot: str = "ur5e", host: str = "127.0.0.1", tables: str = "", **sim: object) -> str:
    """Returns the text of a cell file; `sim` are keys of its table [sim]."""
    lines = [f"{key} = {json.dumps(value)}" for key, value in sim.items()]
    return CELL.format(robot=robot, host=host, tables=tables, sim="\n".join(lines))


def make_cell(robot: str = "ur5e", tables: str = "", **sim: object) -> Cell:
    """Returns a cell for tests inside this process."""
    return parse_cell(cell_text(robot, tables=tables, **sim), "test")


def world_of(cell: Cell, restitution: float = 0.0) -> World:
    """Returns the world of a cell without a truth file."""
    return World(cell, restitution, truth_of(cell))


class Simulator:
    """A simulator process."""

    def __init__(self, folder: Path, text: str, host: str, *options: str) -> None:
        self.host = host
        path = folder / "cell.toml"
        path.write_text(text)
        # ordinary priority: several simulators at once would starve everything else on a small machine
        command = [sys.executable, "-m", "simulator", "--cell", str(path), "--priority", "0", *options]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout
        line = self.process.stdout.readline()
        assert line.startswith("ready"), line

    def ask(self, op: str, **request: object) -> dict[str, Any]:
        """Sends one request to the control port and returns the answer."""
        with socket.create_connection((self.host, CONTROL_PORT), timeout=READY_WITHIN_S) as sock:
            sock.sendall(json.dumps({"op": op, **request}).encode() + b"\n")
            with sock.makefile() as file:
                answer = json.loads(file.readline())
        assert answer.pop("ok"), answer
        return answer

    def fault(self, name: str, **parameters: object) -> None:
        """Causes a fault."""
        self.ask("fault", name=name, **parameters)

    def close(self) -> None:
        """Ends the process."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        self.process.wait(READY_WITHIN_S)
        assert self.process.stdout
        self.process.stdout.close()


Start = Callable[..., Simulator]


@pytest.fixture(scope="module")
def start_simulator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Start]:
    """Starts simulators: `start_simulator(robot, options=(), tables="", **sim)`; they end with the module."""
    started: list[Simulator] = []
    tmp_path_factory.getbasetemp()  # made here, once: simulators are started by threads

    def start(robot: str = "ur5e", options: tuple[str, ...] = (), tables: str = "", **sim: object) -> Simulator:
        host = unique_address()
        text = cell_text(robot, host, tables, **sim)
        started.append(Simulator(tmp_path_factory.mktemp("cell"), text, host, *options))
        return started[-1]

    yield start
    for simulator in started:
        simulator.close()


class Driven:
    """A controller inside this process with its program running, driven cycle by cycle as ur_rtde would."""

    def __init__(
        self, cell: Cell, settings: SimulatorSettings = ORDINARY, script: str = SCRIPT, truth: Truth | None = None
    ) -> None:
        self.controller = Controller(cell, settings, truth)
        self.controller.runner.upload(script)
        while self.controller.runner.due:
            self.cycle()

    @property
    def arm(self) -> Arm:
        return self.controller.arm

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            self.controller.cycle()

    def write(self, command: int, doubles: Sequence[float] = (), ints: Sequence[int] = ()) -> None:
        """Writes a command and its arguments, as one data package does; ints from register 1 on."""
        integers = [(0, command), *enumerate(ints, start=1)]
        self.controller.take_inputs(InputValues(integers, [(0, doubles)] if doubles else []))

    def set(self, **others: object) -> None:
        """Writes inputs that are no registers."""
        self.controller.take_inputs(InputValues(others=others))

    def out_int(self, index: int) -> int:
        return int(self.controller.registers.int_out[index][0])

    def out_doubles(self, count: int = 6) -> list[float]:
        return [value for (value,) in self.controller.registers.double_out[:count]]

    def call(self, command: int, doubles: Sequence[float] = (), ints: Sequence[int] = (), cycles: int = 5000) -> int:
        """Sends a command, waits until it is done, clears it; returns the cycles it took."""
        self.write(command, doubles, ints)
        taken = 0
        while self.out_int(0) != 2 and self.controller.runner.playing:
            self.cycle()
            taken += 1
            assert taken < cycles, f"command {command} is not done after {cycles} cycles"
        self.write(0)
        self.cycle()
        return taken


def dashboard_server(driven: Driven) -> DashboardServer:
    """Returns the dashboard of a driven controller."""
    return DashboardServer(driven.controller.identity, driven.controller.stops)


class Peer:
    """The other end of a connection, inside this process."""

    def __init__(self, simulation: Simulation, port: str) -> None:
        self.socket, self.served = socket.socketpair()
        self.served.setblocking(False)
        self.simulation = simulation
        self.port = next(p for p in simulation.network.ports if p.name == port)
        self.connection = simulation.network.connect(self.served, self.port)

    def send(self, data: bytes, cycles: int = 1) -> bytes:
        """Sends, lets the simulation serve it and run cycles; returns what came back."""
        if self.connection.open:
            self.socket.sendall(data)
            self.simulation.network.readable(self.served)
        for _ in range(cycles):
            self.simulation.tick()
        self.socket.setblocking(False)
        answer = b""
        with suppress(BlockingIOError):
            answer = self.socket.recv(1 << 20)
        self.socket.setblocking(True)
        return answer

    def close(self) -> None:
        self.simulation.network.drop(self.connection)
        self.socket.close()


@pytest.fixture(scope="module")
def simulation() -> Iterator[Simulation]:
    """A simulation inside this process: its ports listen, but nobody runs its loop."""
    loop = SimulatorLoop(Simulation(make_cell(), SimulatorSettings(), unique_address()))
    yield loop.simulation
    loop.simulation.network.close()


class Line:
    """The client's end of a connection to one service: no network, no controller, no arm."""

    def __init__(self, service: ConnectionHandler) -> None:
        self.socket, served = socket.socketpair()
        served.setblocking(False)
        self.socket.setblocking(False)
        self.service, self.connection = service, Connection(served)
        service.opened(self.connection)

    def send(self, data: bytes) -> bytes:
        """Sends, lets the service answer; returns what came back."""
        self.socket.sendall(data)
        if self.connection.read():
            self.service.arrived(self.connection)
        return self.received()

    def received(self) -> bytes:
        """Returns what the service has sent."""
        with suppress(BlockingIOError):
            return self.socket.recv(1 << 20)
        return b""

    def close(self) -> None:
        self.service.closed(self.connection)
        self.connection.close()
        self.socket.close()


Connect = Callable[[ConnectionHandler], Line]


@pytest.fixture
def connect() -> Iterator[Connect]:
    """Connects clients to services: `connect(service)`; they are closed with the test."""
    lines: list[Line] = []

    def to(service: ConnectionHandler) -> Line:
        lines.append(Line(service))
        return lines[-1]

    yield to
    for line in lines:
        line.close()


class ProgramParts:
    """Runner and stops of a program that counts its cycles: no controller, no arm. The text "wrong" does not compile.

    `said` are the messages to the clients; `at_rest` stands in for the arm; `failure` is raised by the program in its
    next cycle.
    """

    def __init__(self, settings: SimulatorSettings = ORDINARY) -> None:
        self.timeline = Timeline(0.002)
        self.at_rest = True
        self.turns = 0
        self.failure: Exception | None = None
        self.runner = ProgramRunner(self._load, lambda: self.at_rest, self.timeline, settings)
        self.said: list[messages.Message] = []
        self.runner.board.listeners.append(self.said.append)
        self.safety, self.stops = self.runner.safety, Stops(self.runner)

    def _load(self, text: str) -> Program:
        if text == "wrong":
            raise ProgramError("no such text", 2, 3)
        return Program("counting", self._count())

    def _count(self) -> Iterator[None]:
        while self.turns < 1000:
            self.turns += 1
            if self.failure:
                raise self.failure
            yield

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            self.timeline.cycles += 1
            self.runner.cycle()

    def play(self) -> None:
        """Uploads the program and waits until it plays."""
        self.runner.upload(SCRIPT)
        while not self.runner.playing:
            self.cycle()

    @property
    def notes(self) -> list[str]:
        """Texts of the events noted so far."""
        return [text for _, text in self.timeline.events]

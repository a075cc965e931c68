"""The RTDE port: protocol version, recipes, start and pause, data packages in and out."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from executor.simulator import wire
from executor.simulator.connections import Connection
from executor.simulator.controller import Controller
from executor.simulator.recipes import (
    OUTPUT_RECIPE_ID,
    RECIPES_MAX,
    InputOwners,
    InputRecipe,
    OutputRecipe,
    input_recipe,
    output_recipe,
    output_types,
)
from executor.simulator.variables import IN_USE, NOT_FOUND

VERSION = struct.Struct(">IIII")
FREQUENCY = struct.Struct(">d")
FREQUENCY_MIN_HZ = 0.1  # slower output is sent at this rate


@dataclass(eq=False)
class Session:
    """What one RTDE connection has set up."""

    connection: Connection
    inputs: dict[int, InputRecipe] = field(default_factory=dict)
    output: OutputRecipe | None = None
    started: bool = False
    packages_in: int = 0
    packages_out: int = 0
    skipped: int = 0

    @property
    def role(self) -> str:
        """Which of ur_rtde's interfaces this looks like: control, receive or io."""
        if self.started:
            return "control" if self.inputs else "receive"
        return "io" if self.inputs else "none"


class RtdeServer:
    """Serves every RTDE connection of a controller."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.sessions: dict[Connection, Session] = {}
        self.owners = InputOwners()
        self.malformed = 0
        self.handlers: dict[int, Callable[[Session, bytes], bytes | None]] = {
            wire.REQUEST_PROTOCOL_VERSION: self._protocol,
            wire.GET_CONTROLLER_VERSION: self._version,
            wire.SETUP_OUTPUTS: self._outputs,
            wire.SETUP_INPUTS: self._inputs,
            wire.START: self._start,
            wire.PAUSE: self._pause,
            wire.DATA_PACKAGE: self._data,
            wire.TEXT_MESSAGE: lambda session, body: None,
        }

    def opened(self, connection: Connection) -> None:
        """A client has connected; it speaks first."""
        self.sessions[connection] = Session(connection)

    def closed(self, connection: Connection) -> None:
        """A client has gone; what it owned is free."""
        session = self.sessions.pop(connection, None)
        if session:
            self.owners.release(session)

    def arrived(self, connection: Connection) -> None:
        """Answers every whole package; a malformed one ends the connection, a malformed body is counted."""
        session = self.sessions[connection]
        try:
            for kind, body in wire.take_packages(connection.received):
                self._serve(session, kind, body)
        except wire.MalformedPackage as error:
            self._note_malformed(error)
            connection.open = False

    def _serve(self, session: Session, kind: int, body: bytes) -> None:
        handler = self.handlers.get(kind)
        if handler is None:
            self._note_malformed(f"unknown package type {kind}")
            return
        try:
            answer = handler(session, body)
        except (wire.MalformedPackage, struct.error) as error:
            self._note_malformed(error)
            return
        if answer is not None:
            session.connection.send(wire.package(kind, answer), time.monotonic())

    def _note_malformed(self, what: object) -> None:
        self.malformed += 1
        self.controller.note(f"RTDE: malformed: {what}")

    def _protocol(self, session: Session, body: bytes) -> bytes:
        (version,) = struct.unpack(">H", body)
        return bytes([version == wire.PROTOCOL_VERSION])

    def _version(self, session: Session, body: bytes) -> bytes:
        return VERSION.pack(*self.controller.version, self.controller.settings.build)

    def _outputs(self, session: Session, body: bytes) -> bytes:
        (frequency,) = FREQUENCY.unpack_from(body)
        names = wire.names_in(body[FREQUENCY.size :])
        types = output_types(names, self.controller.version)
        if not names or NOT_FOUND in types or not frequency > 0.0:
            return bytes([0]) + ",".join(types).encode()
        every = max(1, round(1.0 / (self.controller.dt * max(frequency, FREQUENCY_MIN_HZ))))
        recipe = output_recipe(names, every)
        if recipe.layout.size > wire.PACKAGE_MAX:
            raise wire.MalformedPackage(f"an output package of {recipe.layout.size} bytes")
        session.output = recipe
        return bytes([OUTPUT_RECIPE_ID]) + ",".join(types).encode()

    def _inputs(self, session: Session, body: bytes) -> bytes:
        names = wire.names_in(body)
        types = self.owners.types(names, session, self.controller.version)
        number = len(session.inputs) + 1
        if not names or NOT_FOUND in types or IN_USE in types or number > RECIPES_MAX:
            return bytes([0]) + ",".join(types).encode()
        self.owners.claim(names, session)
        session.inputs[number] = input_recipe(names)
        return bytes([number]) + ",".join(types).encode()

    def _start(self, session: Session, body: bytes) -> bytes:
        session.started = session.output is not None
        return bytes([session.started])

    def _pause(self, session: Session, body: bytes) -> bytes:
        session.started = False
        return bytes([1])

    def _data(self, session: Session, body: bytes) -> None:
        if session.connection.disturbance.loses():
            return
        recipe = session.inputs.get(body[0]) if body else None
        if recipe is None:
            raise wire.MalformedPackage(f"data package for an unknown recipe {body[:1].hex()}")
        inputs = recipe.decode(body[1:])
        if len(body) - 1 > recipe.layout.size:
            self._note_malformed(f"recipe {body[0]}: {len(body) - 1} bytes, expected {recipe.layout.size}")
        session.packages_in += 1
        self.controller.take_inputs(inputs)

    def publish(self, now: float) -> None:
        """Sends the outputs of this cycle to every started client; one that does not keep up misses packages."""
        outputs, cycle = self.controller.registers.outputs, self.controller.cycles
        for session in self.sessions.values():
            if session.output is None or not session.started or cycle % session.output.every:
                continue
            connection = session.connection
            if connection.unsent or connection.disturbance.loses() or connection.disturbance.stalled:
                session.skipped += 1
                connection.flush()
                continue
            connection.send(session.output.encode(outputs), now)
            session.packages_out += 1

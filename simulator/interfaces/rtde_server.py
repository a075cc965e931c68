"""The RTDE port: protocol version, recipes, start and pause, data packages in and out."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field

from simulator.clock import Timeline
from simulator.interfaces import recipes, wire
from simulator.interfaces.connections import Connection, ConnectionHandler
from simulator.interfaces.variables import IN_USE, NOT_FOUND
from simulator.settings import ControllerIdentity

VERSION = struct.Struct(">IIII")
FREQUENCY = struct.Struct(">d")
FREQUENCY_MIN_HZ = 0.1  # [Hz] lower frequencies are raised to this one
PROTOCOL_1_HZ = 125.0  # [Hz] of the outputs in protocol 1, whose set-up names no frequency; source: RTDE guide
Derived = Mapping[str, Callable[[], Sequence[float]]]


@dataclass(eq=False)
class RtdeSession:
    """Set-up and counts of one RTDE connection."""

    connection: Connection
    protocol: int = 1  # until the client requests another one; source: RTDE guide, "otherwise version 1 is assumed"
    inputs: dict[int, recipes.InputRecipe] = field(default_factory=dict)
    output: recipes.OutputRecipe | None = None
    derived: tuple[str, ...] = ()  # output variables that are computed only for a client that asks for them
    started: bool = False
    packages_in: int = 0
    packages_out: int = 0
    skipped: int = 0

    @property
    def role(self) -> str:
        """Interface of ur_rtde that this connection resembles: control, receive or io."""
        if self.started and len(self.inputs) < 2:  # one input may be kept by a client that receives
            return "receive"
        if self.started and not any(recipe.switches for recipe in self.inputs.values()):
            return "control"
        return "io" if self.inputs else "none"


class RtdeServer(ConnectionHandler):
    """Serves every RTDE connection of a controller.

    Attributes:
        sessions: set-up of each connection.
        malformed: number of malformed packages received.
    """

    def __init__(
        self,
        identity: ControllerIdentity,
        timeline: Timeline,
        outputs: MutableMapping[str, list[float]],
        take_inputs: Callable[[recipes.InputValues], None],
        derived: Derived | None = None,
    ) -> None:
        """Serves variables from plain values, independent of their origin.

        Args:
            identity: version and build of the controller.
            timeline: cycle count and cycle time.
            outputs: output variable -> its numbers, filled in by the controller every cycle.
            take_inputs: called with the values of every data package.
            derived: output variables that are computed when a client is about to get them.
        """
        self.identity = identity
        self.timeline = timeline
        self.derived = derived or {}
        self.outputs = outputs
        self.take_inputs = take_inputs
        self.sessions: dict[Connection, RtdeSession] = {}
        self.owners = recipes.InputOwners()
        self.malformed = 0
        self.handlers: dict[int, Callable[[RtdeSession, bytes], bytes | None]] = {
            wire.REQUEST_PROTOCOL_VERSION: self._protocol,
            wire.GET_CONTROLLER_VERSION: self._version,
            wire.SETUP_OUTPUTS: self._setup_outputs,
            wire.SETUP_INPUTS: self._setup_inputs,
            wire.START: self._start,
            wire.PAUSE: self._pause,
            wire.DATA_PACKAGE: self._data,
            wire.TEXT_MESSAGE: self._text,
        }

    def opened(self, connection: Connection) -> None:
        """Starts a session; the client speaks first."""
        self.sessions[connection] = RtdeSession(connection)

    def closed(self, connection: Connection) -> None:
        """Ends the session and frees its input variables."""
        session = self.sessions.pop(connection, None)
        if session:
            self.owners.release(session)

    def arrived(self, connection: Connection) -> None:
        """Answers every complete package; a malformed one ends the connection, a malformed body is only counted."""
        session = self.sessions[connection]
        try:
            for kind, body in wire.take_packages(connection.received):
                self._serve(session, kind, body)
        except wire.MalformedPackage as error:
            self._note_malformed(error)
            connection.open = False

    def _serve(self, session: RtdeSession, kind: int, body: bytes) -> None:
        handler = self.handlers.get(kind)
        if handler is None:
            self._note_malformed(f"unknown package type {kind}")
            return
        try:
            answer = handler(session, body)
        except (wire.MalformedPackage, struct.error) as error:
            self._note_malformed(error)
            self._warn(session, f"package of type {kind} ignored: {error}")
            return
        if answer is not None:
            session.connection.send(wire.package(kind, answer))

    def _warn(self, session: RtdeSession, text: str) -> None:
        """Sends a text message, but never where it could be taken for the answer of a set-up."""
        if session.started:
            session.connection.send(wire.text_message(session.protocol, text, wire.WARNING))

    def _note_malformed(self, cause: object) -> None:
        self.malformed += 1
        self.timeline.note(f"RTDE: malformed: {cause}")

    def _protocol(self, session: RtdeSession, body: bytes) -> bytes:
        (version,) = struct.unpack(">H", body)
        if version in wire.PROTOCOL_VERSIONS:
            session.protocol = version
        return bytes([version in wire.PROTOCOL_VERSIONS])

    def _version(self, session: RtdeSession, body: bytes) -> bytes:
        return VERSION.pack(*self.identity.version, self.identity.build)

    def _text(self, session: RtdeSession, body: bytes) -> None:
        self.timeline.note(f"RTDE client: {wire.text_in(session.protocol, body)}")

    def _setup_outputs(self, session: RtdeSession, body: bytes) -> bytes:
        numbered = session.protocol > 1
        (frequency,) = FREQUENCY.unpack_from(body) if numbered else (PROTOCOL_1_HZ,)
        names = wire.names_in(body[FREQUENCY.size if numbered else 0 :])
        types = recipes.output_types(names, self.identity.version)
        accepted = bool(names) and NOT_FOUND not in types and frequency > 0.0
        if accepted:
            self._accept_outputs(session, names, frequency)
        return bytes([recipes.OUTPUT_RECIPE_ID * accepted] * numbered) + ",".join(types).encode()

    def _accept_outputs(self, session: RtdeSession, names: list[str], frequency: float) -> None:
        every = max(1, round(1.0 / (self.timeline.dt * max(frequency, FREQUENCY_MIN_HZ))))
        recipe = recipes.output_recipe(names, every, session.protocol)
        if recipe.layout.size > wire.PACKAGE_MAX:
            raise wire.MalformedPackage(f"an output package of {recipe.layout.size} bytes")
        session.output, session.derived = recipe, tuple(name for name in names if name in self.derived)

    def _setup_inputs(self, session: RtdeSession, body: bytes) -> bytes:
        names = wire.names_in(body)
        types = self.owners.types(names, session, self.identity.version)
        number = len(session.inputs) + 1
        if not names or NOT_FOUND in types or IN_USE in types or number > recipes.RECIPES_MAX:
            return bytes([0]) + ",".join(types).encode()
        self.owners.claim(names, session)
        session.inputs[number] = recipes.input_recipe(names)
        return bytes([number]) + ",".join(types).encode()

    def _start(self, session: RtdeSession, body: bytes) -> bytes:
        session.started = session.output is not None
        return bytes([session.started])

    def _pause(self, session: RtdeSession, body: bytes) -> bytes:
        session.started = False
        return bytes([1])

    def _data(self, session: RtdeSession, body: bytes) -> None:
        if session.connection.disturbance.loses():
            return
        recipe = session.inputs.get(body[0]) if body else None
        if recipe is None:
            raise wire.MalformedPackage(f"data package for an unknown recipe {body[:1].hex()}")
        inputs = recipe.decode(body[1:])
        if len(body) - 1 > recipe.layout.size:
            self._note_malformed(f"recipe {body[0]}: {len(body) - 1} bytes, expected {recipe.layout.size}")
        session.packages_in += 1
        self.take_inputs(inputs)

    def publish(self) -> None:
        """Sends the outputs of this cycle to every started client; a client that is too slow misses packages."""
        cycle = self.timeline.cycles
        for session in self.sessions.values():
            if session.output is None or not session.started or cycle % session.output.every:
                continue
            connection = session.connection
            if connection.unsent or connection.disturbance.loses() or connection.disturbance.stalled:
                session.skipped += 1
                connection.flush()
                continue
            for name in session.derived:
                self.outputs[name] = [*self.derived[name]()]
            connection.send(session.output.encode(self.outputs))
            session.packages_out += 1

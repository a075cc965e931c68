"""The primary and the secondary client interface: the robot's state ten times a second, messages, and scripts.

Source: Universal Robots, "Primary and secondary interfaces": ports 30001 and 30002, to read from only 30011 and 30012.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from simulator.clock import Timeline
from simulator.interfaces.connections import Connection
from simulator.interfaces.robot_messages import message_bytes, safety_mode_message, version_message
from simulator.interfaces.robot_state import RobotFacts, robot_state
from simulator.interfaces.script_server import Commands, ScriptServer
from simulator.program import messages
from simulator.settings import ControllerIdentity

MESSAGES_MAX = 1000  # in one period; a program that says more is not heard to the end


class PrimaryServer(ScriptServer):
    """Serves one port: primary clients get the controller's messages, secondary ones state and version alone."""

    def __init__(
        self,
        identity: ControllerIdentity,
        timeline: Timeline,
        values: Mapping[str, Sequence[float]],
        facts: RobotFacts,
        upload: Callable[[str], object],
        commands: Commands | None = None,
        board: messages.MessageBoard | None = None,
    ) -> None:
        """Serves the state from plain values.

        Args:
            identity: version and build of the controller.
            timeline: controller time.
            values: RTDE's output variables -> their numbers.
            facts: kinematics and configuration.
            upload, commands: see `ScriptServer`.
            board: messages for the clients; None on a secondary port.
        """
        super().__init__(upload, timeline.note, commands)
        self.identity = identity
        self.timeline = timeline
        self.values = values
        self.facts = facts
        self.informed: dict[Connection, bool] = {}  # whether a client has got kinematics and configuration
        self.has_messages = board is not None
        self.pending: deque[bytes] = deque(maxlen=MESSAGES_MAX)
        self.safety_mode: float | None = None
        if board is not None:
            board.listeners.append(self.tell)

    def opened(self, connection: Connection) -> None:
        """Greets the client with the version."""
        super().opened(connection)
        self.informed[connection] = False
        connection.send(version_message(self.identity, self.timeline.t))

    def closed(self, connection: Connection) -> None:
        """Forgets the client."""
        super().closed(connection)
        del self.informed[connection]

    def tell(self, message: messages.Message) -> None:
        """Keeps a message of the controller for its clients."""
        if self.informed:
            self.pending.append(message_bytes(message, self.timeline.t))

    def publish(self) -> None:
        """Sends messages, then the state; a client that does not read misses the state. Called ten times a second."""
        mode = self.values["safety_mode"][0]
        if self.informed:
            if self.has_messages and self.safety_mode not in (None, mode):
                self.pending.append(safety_mode_message(int(mode), self.timeline.t))
            self._publish_messages()
            self._publish_state()
        self.safety_mode = mode

    def _publish_messages(self) -> None:
        data = b"".join(self.pending)
        self.pending.clear()
        if data:
            for connection in list(self.informed):
                connection.send(data)

    def _publish_state(self) -> None:
        e_series = self.identity.version[0] > 3
        state = robot_state(self.values, None, e_series)
        first = None
        for connection, informed in list(self.informed.items()):
            if connection.unsent or connection.disturbance.stalled:
                continue
            if not informed:
                first = first or robot_state(self.values, self.facts, e_series)
                self.informed[connection] = True
            connection.send(state if informed or first is None else first)

"""The real-time client interface, ports 30003 and 30013: one packet of the robot's state every cycle.

Source of the layout: Universal Robots, "Realtime client interface", RealTime 3.15 and 5.10 (1220 bytes). The packet is
that of one PolyScope generation of versions; older ones end earlier.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from itertools import chain

from simulator.interfaces.connections import Connection
from simulator.interfaces.script_server import Commands, ScriptServer

# fields in order: RTDE's variable with the same meaning, or the number of doubles that UR keeps to itself
FIELDS: tuple[str | int, ...] = (
    "timestamp", "target_q", "target_qd", "target_qdd", "target_current", "target_moment",
    "actual_q", "actual_qd", "actual_current", "joint_control_output",
    "actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force", "target_TCP_pose", "target_TCP_speed",
    "actual_digital_input_bits", "joint_temperatures", "actual_execution_time", 1,
    "robot_mode", "joint_mode", "safety_mode", 6, "actual_tool_accelerometer", 6,
    "speed_scaling", "actual_momentum", 2, "actual_main_voltage", "actual_robot_voltage", "actual_robot_current",
    "actual_joint_voltage", "actual_digital_output_bits", "runtime_state",
    "elbow_position", "elbow_velocity", "safety_status", 3, "payload", "payload_cog", "payload_inertia",
)  # fmt: skip
SIZES = {3: ((3, 15, 1220), (3, 14, 1140), (3, 10, 1116), (3, 5, 1108), (3, 2, 1060), (3, 0, 1044)),
         5: ((5, 10, 1220), (5, 9, 1140), (5, 4, 1116), (5, 0, 1108))}  # major, minor from which on, bytes  # fmt: skip
SEND_BUFFER = 65536  # [bytes] a client that does not read is 0.1 s behind at most; the rest it misses

RETRY_CYCLES = 25  # after which a client that does not read is tried again


def packet_size(version: tuple[int, ...]) -> int:
    """Returns the size [bytes] of the packet of a PolyScope version."""
    sizes = SIZES.get(version[0], SIZES[5])
    return next((size for major, minor, size in sizes if version[:2] >= (major, minor)), sizes[-1][2])


class RealtimeServer(ScriptServer):
    """Sends the robot's state every cycle to whoever is connected, and takes scripts.

    A client that does not read, as ur_rtde, misses packets; it costs nothing while its buffer is full.
    """

    def __init__(
        self,
        values: Mapping[str, Sequence[float]],
        refresh: Callable[[Sequence[str]], None],
        version: tuple[int, ...],
        upload: Callable[[str], object],
        note: Callable[[str], None],
        commands: Commands | None = None,
    ) -> None:
        """Serves the state from plain values.

        Args:
            values: RTDE's output variables -> their numbers.
            refresh: computes those that are computed on request only.
            version: of PolyScope; it decides the size of the packet.
            upload, note, commands: see `ScriptServer`.
        """
        super().__init__(upload, note, commands)
        self.values = values
        self.refresh = refresh
        self.layout = struct.Struct(f">i{(packet_size(version) - 4) // 8}d")
        self.derived = ("elbow_position", "elbow_velocity")
        self.streams: list[Connection] = []

    def opened(self, connection: Connection) -> None:
        """Begins to send."""
        super().opened(connection)
        connection.expect_deaf_client(SEND_BUFFER, RETRY_CYCLES)
        self.streams.append(connection)

    def closed(self, connection: Connection) -> None:
        """Stops sending."""
        super().closed(connection)
        self.streams.remove(connection)

    def publish(self) -> None:
        """Sends the packet of this cycle to every client that has read the one before."""
        if not self.streams:
            return
        ready = [c for c in self.streams if not c.unsent and not c.disturbance.stalled]
        if ready:
            data = self.packet()
            for connection in ready:
                connection.send(data)

    def packet(self) -> bytes:
        """Returns the packet of the present state."""
        self.refresh(self.derived)
        numbers = chain.from_iterable(self.values[f] if isinstance(f, str) else (0.0,) * f for f in FIELDS)
        wanted = (self.layout.size - 4) // 8
        return self.layout.pack(self.layout.size, *[*numbers][:wanted])

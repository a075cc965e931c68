"""The client interfaces of a controller: primary, secondary and real-time, each also to read from only."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from simulator.controller import Controller
from simulator.interfaces import Commands, PrimaryServer, RealtimeServer, RobotFacts, ServicePort
from simulator.program import messages
from simulator.settings import PRIMARY_PORT, READ_ONLY, SCRIPT_PORT, SECONDARY_PORT

PERIOD_S = 0.1  # [s] between two states on the primary and the secondary interface; source: UR, "(10 Hz)"
Values = dict[str, list[float]]
Derived = dict[str, Callable[[], Sequence[float]]]


class ClientInterfaces:
    """Six ports that send the controller's state, three of which take scripts."""

    def __init__(self, controller: Controller, values: Values, derived: Derived, facts: RobotFacts) -> None:
        """`values` are RTDE's output variables, `derived` the functions of those computed on request only."""
        c = controller
        runner = c.runner
        note = c.timeline.note
        self.values = values
        self.derived = derived
        self.primary: list[PrimaryServer] = []
        self.realtime: list[RealtimeServer] = []
        self.ports: list[ServicePort] = []
        takes = (0, "", runner.upload, plain_commands(c))
        refuses = (READ_ONLY, " read-only", lambda text: note("script refused: a port to read from only"), {})
        for offset, suffix, upload, commands in (takes, refuses):
            for port, name, board in ((PRIMARY_PORT, "primary", runner.board), (SECONDARY_PORT, "secondary", None)):
                server = PrimaryServer(c.identity, c.timeline, values, facts, upload, commands, board)
                self.primary.append(server)
                self.ports.append(ServicePort(f"{name}{suffix}", port + offset, server))
            server = RealtimeServer(values, self.refresh, c.identity.version, upload, note, commands)
            self.realtime.append(server)
            self.ports.append(ServicePort(f"script{suffix}", SCRIPT_PORT + offset, server))  # ur_rtde's use of it
        self.timeline = c.timeline
        self.every = c.timeline.cycles_in(PERIOD_S)

    def refresh(self, names: Sequence[str]) -> None:
        """Computes variables that are computed on request only."""
        for name in names:
            self.values[name] = [*self.derived[name]()]

    def publish(self) -> None:
        """Sends the state of this cycle to the clients that are due for it."""
        for server in self.realtime:
            server.publish()
        if self.timeline.cycles % self.every == self.every // 2:  # other work is done at 0
            for server in self.primary:
                server.publish()


def plain_commands(controller: Controller) -> Commands:
    """Returns the commands that URControl takes beside scripts; in local control they are refused, as scripts are."""
    runner = controller.runner
    safety = controller.safety
    stops = controller.stops
    commands: dict[str, Callable[[], object]] = {
        "power on": safety.power_on,
        "power off": stops.power_loss,
        "set robotmode run": safety.release_brakes,
        "set unlock protective stop": lambda: stops.unlock(at_once=True),
        "stop program": lambda: runner.stop("client: stop program"),
        "pause program": runner.pause,
        "resume program": runner.resume,
        "run program": runner.resume,
    }

    def in_remote_control(action: Callable[[], object]) -> Callable[[], object]:
        refusal = messages.ErrorCode(messages.READ_ONLY_CODE, 0, messages.VIOLATION, "the robot is in local control")
        return lambda: action() if runner.remote_control else runner.board.post(refusal)

    return {name: in_remote_control(action) for name, action in commands.items()}

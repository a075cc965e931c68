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
        self.values = values
        self.derived = derived
        runner = c.runner
        note = c.timeline.note
        commands = plain_commands(c)
        takes = (runner.upload, commands)
        refuses = (lambda text: note("script refused: a port to read from only"), {})
        self.primary: dict[int, PrimaryServer] = {}
        self.realtime: dict[int, RealtimeServer] = {}
        for offset, (upload, obeyed) in ((0, takes), (READ_ONLY, refuses)):
            for port, board in ((PRIMARY_PORT, runner.board), (SECONDARY_PORT, None)):
                server = PrimaryServer(c.identity, c.timeline, values, facts, upload, obeyed, board)
                self.primary[port + offset] = server
            server = RealtimeServer(values, self.refresh, c.identity.version, upload, note, obeyed)
            self.realtime[SCRIPT_PORT + offset] = server
        self._streams = [*self.realtime.values()]
        self.timeline, self.every = c.timeline, c.timeline.cycles_in(PERIOD_S)

    def ports(self) -> list[ServicePort]:
        """Returns the ports; the real-time one is named for what ur_rtde uses it for."""
        names = {PRIMARY_PORT: "primary", SECONDARY_PORT: "secondary", SCRIPT_PORT: "script"}
        names |= {number + READ_ONLY: f"{name} read-only" for number, name in names.items()}
        return [ServicePort(names[number], number, server) for number, server in self._servers().items()]

    def _servers(self) -> dict[int, PrimaryServer | RealtimeServer]:
        return {**self.primary, **self.realtime}

    def refresh(self, names: Sequence[str]) -> None:
        """Computes variables that are computed on request only."""
        for name in names:
            self.values[name] = [*self.derived[name]()]

    def publish(self) -> None:
        """Sends the state of this cycle to the clients that are due for it."""
        for server in self._streams:
            server.publish()
        if self.timeline.cycles % self.every == self.every // 2:  # other work is done at 0
            for server in self.primary.values():
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

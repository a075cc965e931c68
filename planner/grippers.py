"""The grippers that Fling can drive: kinds, models, where each is reached, and what is published of its timing.

Of the standard library alone: planner, streaming process and simulated controller read the same facts.
"""

from __future__ import annotations

from dataclasses import dataclass

OUTPUTS = {"tool_digital": 2, "standard_digital": 8, "configurable_digital": 8}  # of each kind on a UR controller
INPUT_LINES = 18  # of the same kinds: standard, configurable, tool; source: RTDE guide, actual_digital_input_bits
SET_OUTPUT = {  # functions of URScript; source: Universal Robots, URScript manual
    "tool_digital": "set_tool_digital_out",
    "standard_digital": "set_standard_digital_out",
    "configurable_digital": "set_configurable_digital_out",
}
# [s] the URCap's socket passes on what the gripper's registers say, which change at 100 Hz; on the bus itself 5 ms must
# pass between two commands; source: Robotiq, instruction manual of 2F-85 and 2F-140, Modbus RTU
QUANTUM_S = {"socket": 0.010, "tool_serial": 0.005}
PORTS = {
    "socket": 63352,  # source: Robotiq's URCap, the server that its own programs use
    "tool_serial": 54321,  # source: Universal Robots, ROS driver, "tool communication": the bytes of the tool's line
    "modbus_tcp": 502,  # source: Modbus, assigned port
    "secondary": 30002,  # source: Universal Robots, client interfaces
}


@dataclass(frozen=True)
class GripperModel:
    """A gripper with a bus.

    Attributes:
        kind: of gripper, as in a cell file.
        stroke_m: widest opening of its fingers [m]; 0: vacuum cups.
        transports: how it is reached; the first is the default.
        slave_id: its address on a Modbus.
    """

    kind: str
    stroke_m: float
    transports: tuple[str, ...]
    slave_id: int


ROBOTIQ = ("socket", "tool_serial")
COMPUTE_BOX = ("modbus_tcp",)
# source of strokes: data sheets of the makers; of addresses: their manuals, as delivered
MODELS = {
    "2f85": GripperModel("robotiq", 0.085, ROBOTIQ, 9),
    "2f140": GripperModel("robotiq", 0.140, ROBOTIQ, 9),
    "hande": GripperModel("robotiq", 0.050, ROBOTIQ, 9),
    "rg2": GripperModel("onrobot", 0.110, COMPUTE_BOX, 65),
    "rg6": GripperModel("onrobot", 0.160, COMPUTE_BOX, 65),
    "vg10": GripperModel("onrobot", 0.0, COMPUTE_BOX, 65),
}


@dataclass(frozen=True)
class GripperKind:
    """A kind of gripper.

    Attributes:
        keys: of a cell file beyond those that all kinds have.
        close_s: time to close before anything moves, unless the cell file says otherwise [s].
        is_wired: whether digital outputs of the controller switch it, so that it has no link.
        untimed: what its own part of the timing depends on, where nothing is published of that; empty where it is.
        call: what it does to the timing of a release that it runs somebody's own code; empty where it does not.
    """

    keys: tuple[str, ...]
    close_s: float
    is_wired: bool = False
    untimed: str = ""
    call: str = ""


# [s] source: Robotiq, data sheet of the 2F-85: 150 mm/s, with which half of its stroke takes 0.28 s; a call takes
# longer, by as much as nobody knows
WIRED_CLOSE_S = 0.3
CALL_CLOSE_S = 1.0
REPORTED_CLOSE_S = 3.0  # longest: one that reports that it is closed is not waited for any longer
OF_BUS = ("model", "transport", "host", "port", "slave_id", "open_width_m")
KINDS = {
    "digital": GripperKind(("close_output", "close_index"), WIRED_CLOSE_S, is_wired=True),
    "vacuum": GripperKind(("blow_off_output", "blow_off_index", "blow_off_s"), WIRED_CLOSE_S, is_wired=True),
    "robotiq": GripperKind(OF_BUS, REPORTED_CLOSE_S),
    "onrobot": GripperKind(
        OF_BUS, REPORTED_CLOSE_S, untimed="the compute box passes a command on when its own bus is free"
    ),
    "script": GripperKind(
        ("open_script", "close_script"),
        CALL_CLOSE_S,
        untimed="the controller compiles the snippet, and runs it in one of its next cycles",
        call=(
            "the snippet starts milliseconds after its command, at another delay each time, and what it waits for "
            "comes on top; nothing tells whether the gripper opened. It must not move the arm"
        ),
    ),
    "http": GripperKind(
        ("open_url", "close_url"),
        CALL_CLOSE_S,
        untimed="the call crosses a network and a server",
        call=(
            "each call takes as long as network and server do, and one that is answered only once the gripper is open "
            "is taken for one that does not open; nothing else tells what the gripper did"
        ),
    ),
}
NOT_SUPPORTED = {
    "schunk": (
        'is not supported: Fling knows no protocol of these grippers. One with digital inputs is a "digital", and a '
        'driver of its own can be called by "http" or "script"'
    )
}


@dataclass(frozen=True)
class SecondOutput:
    """An output that changes with the one that opens the gripper: it closes the gripper, or blows the object off.

    Attributes:
        output, index: kind and number of the output.
        open_level: its level while the gripper is open.
        lasts_s: how long it has that level [s]; None: as long as the gripper is open.
    """

    output: str
    index: int
    open_level: bool
    lasts_s: float | None


@dataclass(frozen=True, kw_only=True)
class GripperLink:
    """How a gripper is reached that no digital output switches, and what it is told.

    Attributes:
        kind, model, transport: as in the cell file; empty where the kind has none.
        host: network address; empty: the controller's.
        port: TCP port.
        slave_id: address on a Modbus; 0 without one.
        stroke_m: widest opening [m].
        open_width_m: how far it opens [m].
        open_text, close_text: snippets of URScript, or URLs.
    """

    kind: str
    port: int
    model: str = ""
    transport: str = ""
    host: str = ""
    slave_id: int = 0
    stroke_m: float = 0.0
    open_width_m: float = 0.0
    open_text: str = ""
    close_text: str = ""

    @property
    def quantum_s(self) -> float:
        """Period at which the gripper takes commands [s]; 0 where it is not published."""
        return QUANTUM_S.get(self.transport, 0.0)

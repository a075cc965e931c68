"""The whole simulation byte by byte, inside this process: RTDE, dashboard, script and control port."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest

from api.cli.support.addresses import SIMULATOR_PORTS
from planner import kinematics
from planner.dynamics import Payload, joint_torques
from simulator.faults import cause_fault
from simulator.interfaces import OUTPUT_TYPES, wire
from simulator.output_values import OutputValues
from simulator.program.runner import PAUSED, PLAYING, STOPPED
from simulator.settings import CAMERA_PORT, ROBOT_API_SPARE_PORT
from simulator.simulation import Simulation
from tests.simulator.conftest import SCRIPT, Driven, Peer, dashboard_server, make_cell


def packages(data: bytes) -> list[tuple[int, bytes]]:
    return list(wire.take_packages(bytearray(data)))


@pytest.fixture
def rtde(simulation: Simulation) -> Iterator[Peer]:
    peer = Peer(simulation, "rtde")
    assert peer.send(wire.package(wire.REQUEST_PROTOCOL_VERSION, b"\x00\x02"))
    yield peer
    peer.close()


def outputs(frequency: float, names: str) -> bytes:
    return wire.package(wire.SETUP_OUTPUTS, struct.pack(">d", frequency) + names.encode())


# -- RTDE
def test_protocol_and_controller_version(rtde: Peer):
    assert packages(rtde.send(wire.package(86, b"\x00\x02"))) == [(86, b"\x01")]
    assert packages(rtde.send(wire.package(86, b"\x00\x03"))) == [(86, b"\x00")]
    ((kind, body),) = packages(rtde.send(wire.package(118)))
    assert (kind, struct.unpack(">IIII", body)[:3]) == (118, (5, 11, 1))


@pytest.mark.parametrize(("frequency", "count"), [(500.0, 20), (125.0, 5), (50.0, 2), (1e9, 20), (1e-300, 0)])
def test_outputs_come_at_the_requested_frequency(rtde: Peer, simulation: Simulation, frequency: float, count: int):
    assert packages(rtde.send(outputs(frequency, "timestamp,runtime_state,"))) == [(79, b"\x01DOUBLE,UINT32")]
    simulation.controller.timeline.cycles = 0
    rtde.send(wire.package(wire.START), cycles=0)
    found = packages(rtde.send(b"", cycles=20))
    assert len(found) == count
    if count:
        stamps = [struct.unpack(">BdI", body)[1] for _, body in found]
        np.testing.assert_allclose(np.diff(stamps), 20 / count * 0.002, atol=1e-12)
    assert packages(rtde.send(wire.package(wire.PAUSE)))[-1] == (80, b"\x01")
    assert rtde.send(b"", cycles=5) == b""


def test_the_first_version_of_the_protocol_has_no_frequency_and_no_recipe_id(rtde: Peer, simulation: Simulation):
    assert packages(rtde.send(wire.package(86, b"\x00\x01"))) == [(86, b"\x01")]
    assert packages(rtde.send(wire.package(79, b"timestamp,runtime_state"))) == [(79, b"DOUBLE,UINT32")]
    assert packages(rtde.send(wire.package(79, b"timestamp,nonsense"))) == [(79, b"DOUBLE,NOT_FOUND")]
    simulation.controller.timeline.cycles = 0
    rtde.send(wire.package(wire.START), cycles=0)
    found = packages(rtde.send(b"", cycles=20))
    assert [kind for kind, _ in found] == [85] * 5  # at 125 Hz
    assert struct.unpack(">dI", found[-1][1]) == (0.04, simulation.controller.runner.runtime)


def test_every_variable_of_the_guide_is_answered_with_its_type(rtde: Peer):
    """The widths are the guide's; the values must be numbers of the type, so that the package can be built at all."""
    types = OUTPUT_TYPES
    ((kind, body),) = packages(rtde.send(outputs(500.0, ",".join(types))))
    assert (kind, body[:1], body[1:].decode().split(",")) == (79, b"\x01", [*types.values()])
    answers = packages(rtde.send(wire.package(wire.START)))
    assert answers[0] == (83, b"\x01")
    width = {"DOUBLE": 8, "INT32": 4, "UINT32": 4, "UINT64": 8, "UINT8": 1, "BOOL": 1}
    width |= {"VECTOR3D": 24, "VECTOR6D": 48, "VECTOR6INT32": 24}
    assert len(answers[1][1]) == 1 + sum(width[kind] for kind in types.values())


def test_inputs_can_be_read_back_as_outputs(rtde: Peer):
    names = ["input_int_register_5", "input_double_register_47", "input_bit_register_65", "input_bit_registers0_to_31"]
    assert packages(rtde.send(wire.package(73, ",".join(names).encode())))[0][1] == b"\x01INT32,DOUBLE,BOOL,UINT32"
    assert packages(rtde.send(outputs(500.0, ",".join(names))))[0][1] == b"\x01INT32,DOUBLE,BOOL,UINT32"
    rtde.send(wire.package(wire.START))
    sent = struct.pack(">Bid?I", 1, -5, 2.5, True, 1 << 31 | 5)
    assert packages(rtde.send(wire.package(85, sent)))[-1] == (85, sent)


def test_digital_inputs_are_told_together_and_the_configurable_ones_apart(rtde: Peer, simulation: Simulation):
    rtde.send(outputs(500.0, "actual_digital_input_bits,actual_configurable_digital_input_bits"))
    for index in (5, 9):
        cause_fault(simulation, {"name": "digital_input", "index": index})
    *_, (kind, body) = packages(rtde.send(wire.package(wire.START), 3))
    assert (kind, struct.unpack(">BQQ", body)[1:]) == (wire.DATA_PACKAGE, (1 << 5 | 1 << 9, 1 << 1))
    cause_fault(simulation, {"name": "digital_input", "index": 9, "on": False})
    assert simulation.controller.workcell.input_bits == 1 << 5


def test_text_messages_go_both_ways(rtde: Peer, simulation: Simulation):
    message = b"\x05hello\x04test\x03"
    assert rtde.send(wire.package(77, message)) == b""
    assert simulation.controller.timeline.events[-1][1] == "RTDE client: hello"
    rtde.send(outputs(500.0, "timestamp"))
    rtde.send(wire.package(wire.START))
    kinds = dict(packages(rtde.send(wire.package(85, b"\x07"))))
    text = kinds[77]
    assert b"package of type 85 ignored" in text[1 : 1 + text[0]]
    assert text[1 + text[0] :] == b"\x04RTDE\x02"


def test_start_without_a_recipe_is_refused(rtde: Peer):
    assert packages(rtde.send(wire.package(wire.START))) == [(83, b"\x00")]


def test_unknown_variables_refuse_the_recipe(rtde: Peer):
    assert packages(rtde.send(outputs(500.0, "timestamp,nonsense"))) == [(79, b"\x00DOUBLE,NOT_FOUND")]
    assert packages(rtde.send(wire.package(73, b"nonsense,input_int_register_0,"))) == [(73, b"\x00NOT_FOUND,INT32")]


def test_inputs_belong_to_one_connection_and_are_free_when_it_ends(rtde: Peer, simulation: Simulation):
    names = wire.package(73, b"input_int_register_1,input_double_register_1,")
    assert packages(rtde.send(names)) == [(73, b"\x01INT32,DOUBLE")]
    assert packages(rtde.send(names)) == [(73, b"\x02INT32,DOUBLE")]
    other = Peer(simulation, "rtde")
    assert packages(other.send(names)) == [(73, b"\x00IN_USE,IN_USE")]
    rtde.close()
    assert packages(other.send(names)) == [(73, b"\x01INT32,DOUBLE")]
    other.close()


def test_inputs_are_obeyed_before_start_and_wrong_sizes_counted(rtde: Peer, simulation: Simulation):
    simulation.reset_stats()
    rtde.send(wire.package(73, b"input_int_register_1,input_double_register_1,"))
    rtde.send(wire.package(85, struct.pack(">Bid", 1, -7, 2.5)))
    assert simulation.controller.registers.int_in[1] == -7
    assert simulation.controller.registers.double_in[1] == 2.5
    rtde.send(wire.package(85, struct.pack(">Bi", 1, 9)))
    assert simulation.controller.registers.int_in[1] == -7
    rtde.send(wire.package(85, struct.pack(">Bidd", 1, 8, 1.5, 0.0)))
    assert simulation.controller.registers.int_in[1] == 8
    rtde.send(wire.package(85, struct.pack(">Bid", 2, 0, 0.0)))
    assert simulation.stats()["malformed_packages"] == 3


def test_a_client_that_does_not_read_misses_packages_but_gets_whole_ones(rtde: Peer, simulation: Simulation):
    rtde.send(outputs(500.0, "timestamp,actual_q,target_q,target_qd,actual_qd"))
    rtde.send(wire.package(wire.START), cycles=3000)
    data = b""
    rtde.socket.settimeout(0.05)
    with suppress(TimeoutError):
        while chunk := rtde.socket.recv(1 << 20):
            data += chunk
            rtde.connection.flush()
    found = packages(data)
    assert sum(len(body) + 3 for _, body in found) == len(data)
    assert len(found) < 3000
    assert simulation.rtde.sessions[rtde.connection].skipped > 0


# -- dashboard
@pytest.fixture
def dashboard(simulation: Simulation) -> Iterator[Peer]:
    peer = Peer(simulation, "dashboard")
    assert peer.send(b"") == b"Connected: Universal Robots Dashboard Server\n"
    yield peer
    peer.close()


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("PolyscopeVersion", "URSoftware 5.11.1.123456 (Jan 01 2024)"),
        ("get serial number", "20235500001"),
        ("get robot model", "UR5"),
        ("is in remote control", "true"),
        ("robotmode", "Robotmode: RUNNING"),
        ("safetymode", "Safetymode: NORMAL"),
        ("safetystatus", "Safetystatus: NORMAL"),
        ("programState", "STOPPED No program"),
        ("running", "Program running: false"),
        ("isProgramSaved", "True"),
        ("stop", "Stopped"),
        ("play", "Failed to execute: play"),
        ("pause", "Failed to execute: pause"),
        ("load x.urp", "File not found: x.urp"),
        ("unlock protective stop", "Protective stop releasing"),
        ("popup hello", "showing popup"),
        ("close popup", "closing popup"),
        ("close safety popup", "closing safety popup"),
        ("addToLog hello", "Added log message"),
        ("quit", "Disconnected"),
        ("nonsense", "could not understand: 'nonsense'"),
    ],
)
def test_the_dashboard_answers_word_for_word(dashboard: Peer, line: str, answer: str):
    assert dashboard.send(line.encode() + b"\n").decode() == answer + "\n"


def test_lines_may_come_in_pieces_and_several_at_once(dashboard: Peer):
    assert dashboard.send(b"robot") == b""
    assert dashboard.send(b"mode\nrunning\nsafety") == b"Robotmode: RUNNING\nProgram running: false\n"


def test_power_and_brakes_after_an_emergency_stop():
    driven = Driven(make_cell())
    answer = dashboard_of(driven)
    driven.controller.stops.emergency()
    assert answer("power on") == "Powering on"
    assert answer("robotmode") == "Robotmode: POWER_OFF"
    driven.controller.safety.clear()
    answer("power on")
    assert answer("robotmode") == "Robotmode: IDLE"
    answer("brake release")
    assert answer("robotmode") == "Robotmode: RUNNING"


def test_a_protective_stop_is_locked_for_five_seconds():
    driven = Driven(make_cell())
    answer = dashboard_of(driven)
    driven.controller.stops.protective("test")
    driven.cycle(2499)
    assert answer("unlock protective stop").startswith("Cannot unlock protective stop until 5s after occurrence.")
    assert answer("play") == "Failed to execute: play"
    driven.cycle(2)
    assert answer("unlock protective stop") == "Protective stop releasing"
    assert answer("play") == "Starting program"


def test_local_control_refuses_what_needs_remote_control():
    driven = Driven(make_cell())
    answer = dashboard_of(driven)
    driven.controller.runner.remote_control = False
    assert answer("is in remote control") == "false"
    assert "not in remote control" in answer("stop")
    assert driven.controller.runner.playing
    assert answer("robotmode") == "Robotmode: RUNNING"


def dashboard_of(driven: Driven) -> Callable[[str], str]:
    return dashboard_server(driven).answer


# -- script port
def test_a_program_may_come_in_pieces(simulation: Simulation):
    peer = Peer(simulation, "script")
    text = SCRIPT.encode()
    peer.send(text[:20])
    peer.send(text[20:], cycles=60)
    assert simulation.controller.runner.runtime == PLAYING
    peer.send(text, cycles=10)
    assert simulation.controller.runner.runtime == STOPPED
    peer.send(b"", cycles=60)
    assert simulation.controller.runner.runtime == PLAYING
    simulation.controller.runner.pause()
    assert simulation.controller.runner.runtime == PAUSED
    simulation.controller.runner.stop("test")
    peer.close()


def test_no_program_starts_during_a_stop_or_in_local_control():
    driven = Driven(make_cell())
    driven.controller.stops.protective("test", "stopped")
    driven.controller.runner.upload(SCRIPT)
    driven.cycle(100)
    assert driven.controller.runner.runtime == STOPPED
    driven.controller.safety.clear()
    driven.controller.runner.remote_control = False
    driven.controller.runner.upload(SCRIPT)
    driven.cycle(100)
    assert driven.controller.runner.runtime == STOPPED


# -- control port
def test_the_command_line_asks_for_every_port_that_it_listens_on(simulation: Simulation):
    listened = {port.number for port in simulation.network.ports}
    assert listened | {ROBOT_API_SPARE_PORT, CAMERA_PORT} == set(SIMULATOR_PORTS)  # of other arms, and of a feeder


def test_the_control_port_answers_state_world_and_counts(simulation: Simulation):
    peer = Peer(simulation, "control")

    def ask(**request: object) -> dict:
        return json.loads(peer.send(json.dumps(request).encode() + b"\n"))

    assert ask(op="state")["cell"] == "test"
    assert ask(op="world")["gripper_holds"] == 1
    counts = {"none", "one", "more", "longest_gap_cycles"}
    assert ask(op="stats")["commands_per_cycle"].keys() == counts
    assert ask(op="reset_stats")["ok"] is True
    assert ask(op="fault", name="speed_slider", fraction=0.25)["ok"] is True
    assert ask(op="state")["speed_slider"] == 0.25
    assert ask(op="fault", name="speed_slider", fraction=1.0)["ok"] is True
    assert "op must be one of" in ask(op="nonsense")["error"]
    peer.close()


# -- published values
def test_published_poses_and_torques_are_those_of_the_planner():
    cell = make_cell()
    driven = Driven(cell)
    driven.write(9, [0.5, -0.4, 0.3, 0.2, -0.6, 0.7, 10.0, 0.002])
    driven.cycle(80)
    published = OutputValues(driven.controller)
    published.cycle()
    out = published.values
    arm = driven.arm
    X = kinematics.forward(cell.robot, arm.q, cell.tool.X_FT)
    np.testing.assert_allclose(out["target_TCP_pose"][:3], X[:3, 3], atol=1e-12)
    V = kinematics.jacobian(cell.robot, arm.measured_q, cell.tool.X_FT) @ arm.measured_qd
    np.testing.assert_allclose(out["actual_TCP_speed"], V, atol=1e-12)
    load = Payload(1.0, np.array([0.0, 0.0, 0.085]), np.zeros((3, 3)))
    expected = joint_torques(cell.robot, arm.q, arm.qd, arm.qdd, [0.0, 0.0, -9.81], load)
    np.testing.assert_allclose(out["target_moment"], expected, atol=1e-9)

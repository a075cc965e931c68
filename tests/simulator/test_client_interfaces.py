"""Primary, secondary and real-time interface byte by byte, as UR documents them; parsed here on their own."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from planner import kinematics
from planner.robots import robot
from simulator.interfaces import RobotFacts
from simulator.interfaces.realtime_server import packet_size
from simulator.interfaces.robot_state import robot_state
from simulator.loop import SimulatorLoop
from simulator.physics.controller_kinematics import checksums, controller_table, told_checksums
from simulator.program.runner import PLAYING, STOPPED
from simulator.settings import SimulatorSettings
from simulator.simulation import Simulation
from tests.simulator.conftest import SCRIPT, Peer, make_cell, unique_address

PERIOD = 50  # cycles of 2 ms between two states
# source of sizes: Universal Robots, "Primary and secondary interfaces", tables of the sub-packages
SIZES = {0: 47, 1: 251, 2: 37, 3: 75, 4: 101, 7: 61, 8: 9, 11: 26, 12: 8}
ONCE = {5: 225, 6: 445}
LOOP = "def other():\n  while True:\n    sync()\n  end\nend\n"


def packages(data: bytes) -> list[bytes]:
    found = []
    while data:
        (size,) = struct.unpack_from(">i", data)
        found.append(data[:size])
        data = data[size:]
    return found


def sub_packages(state: bytes) -> dict[int, bytes]:
    assert state[4] == 16
    found = {}
    at = 5
    while at < len(state):
        size, kind = struct.unpack_from(">iB", state, at)
        found[kind] = state[at + 5 : at + size]
        at += size
    assert at == len(state)
    return found


def messages(data: bytes) -> list[tuple[int, bytes]]:
    """Returns type and fields of the robot messages."""
    return [(p[14], p[15:]) for p in packages(data) if p[4] == 20]


def keys(data: bytes) -> list[tuple[str, str]]:
    """Returns title and text of the key messages."""
    bodies = [body for kind, body in messages(data) if kind == 7]
    return [(b[9 : 9 + b[8]].decode(), b[9 + b[8] :].decode()) for b in bodies]


@pytest.fixture
def sim() -> Iterator[Simulation]:
    loop = SimulatorLoop(Simulation(make_cell(), SimulatorSettings(), unique_address()))
    yield loop.simulation
    loop.simulation.network.close()


@pytest.fixture
def clients(sim: Simulation) -> Iterator[Any]:
    """Connects a client to a port by name."""
    peers: list[Peer] = []

    def connect(port: str) -> Peer:
        peers.append(Peer(sim, port))
        return peers[-1]

    yield connect
    for peer in peers:
        peer.close()


@pytest.mark.parametrize("port", ["primary", "secondary", "primary read-only", "secondary read-only"])
def test_version_first_then_ten_states_a_second(clients: Any, port: str):
    client = clients(port)
    version, *states = packages(client.send(b"", 10 * PERIOD))
    assert version[4:5] + version[13:15] == bytes([20, 0xFE, 3])
    name = version[15]
    assert version[16 : 16 + name] == b"URControl"
    assert struct.unpack_from(">BBii", version, 16 + name) == (5, 11, 1, 123456)
    assert len(states) == 10
    stamps = [struct.unpack_from(">Q", sub_packages(state)[0])[0] for state in states]
    assert set(np.diff(stamps)) == {100_000}


def test_the_first_state_has_everything_in_the_documented_sizes(clients: Any):
    first, second = packages(clients("primary").send(b"", 2 * PERIOD))[1:]
    assert {kind: len(body) + 5 for kind, body in sub_packages(first).items()} == SIZES | ONCE
    assert {kind: len(body) + 5 for kind, body in sub_packages(second).items()} == SIZES


def test_kinematics_and_configuration_are_those_of_the_arm(clients: Any):
    found = sub_packages(packages(clients("primary").send(b"", PERIOD))[1])
    arm = robot("ur5e")
    checks = struct.unpack_from(">6I", found[5])
    numbers = struct.unpack_from(">24d", found[5], 24)
    theta, a, d, alpha = np.reshape(numbers, (4, 6))
    assert checks == (0xFFFFFFFF,) * 6  # as URSim, whose arm is its model
    np.testing.assert_array_equal([theta, a, d, alpha], [np.zeros(6), arm.a, arm.d, arm.alpha])
    limits = struct.unpack_from(">12d", found[6])
    motion = struct.unpack_from(">12d", found[6], 96)
    np.testing.assert_array_equal(limits[::2], arm.q_lower)
    np.testing.assert_array_equal(motion[::2], arm.qd_max)
    assert struct.unpack_from(">4i", found[6], len(found[6]) - 16)[2:] == (1, 3)  # UR5, e-Series


def test_an_arm_that_differs_from_its_model_has_kinematics_and_checksums_of_its_own(sim: Simulation):
    model = robot("ur5e")
    table = controller_table(model)
    table = replace(table, a=table.a + 1e-4)
    facts = RobotFacts(model, table, told_checksums(model, table))
    found = sub_packages(robot_state(sim.output_values.values, facts, e_series=True))
    assert struct.unpack_from(">6I", found[5]) == checksums(table)
    theta, a, d, alpha = np.reshape(struct.unpack_from(">24d", found[5], 24), (4, 6))
    np.testing.assert_array_equal([theta, a, d, alpha], [table.theta, model.a + 1e-4, model.d, model.alpha])
    nominal = np.reshape(struct.unpack_from(">24d", found[6], (12 + 12 + 5) * 8), (4, 6))
    np.testing.assert_array_equal(nominal, [model.a, model.d, model.alpha, np.zeros(6)])


# source: Universal Robots Client Library, `RobotType`
TYPES = {"ur5": 1, "ur10": 2, "ur3": 3, "ur16e": 4, "ur18": 5, "ur20": 7, "ur30": 8, "ur15": 9, "ur7e": 1, "ur12e": 2}


@pytest.mark.parametrize(("name", "code"), TYPES.items())
def test_every_model_is_told_by_its_number(sim: Simulation, name: str, code: int):
    model = robot(name)
    table = controller_table(model)
    facts = RobotFacts(model, table, told_checksums(model, table))
    found = sub_packages(robot_state(sim.output_values.values, facts, e_series=model.generation != "CB3"))
    assert struct.unpack_from(">i", found[6], len(found[6]) - 8) == (code,)


def test_a_checksum_changes_with_every_parameter():
    table = controller_table(robot("ur5e"))
    other = replace(table, a=table.a + 1e-9 * np.eye(6)[0])
    assert [a != b for a, b in zip(checksums(table), checksums(other), strict=True)] == [True, *[False] * 5]


def test_the_state_is_that_of_the_robot(clients: Any, sim: Simulation):
    c = sim.controller
    client = clients("primary")
    client.send(b"", PERIOD)
    sim.controller.runner.upload(SCRIPT)
    state = sub_packages(packages(client.send(b"", PERIOD))[-1])
    flags = struct.unpack_from(">7?BB", state[0], 8)
    assert flags == (True, True, True, False, False, True, False, 7, 0)  # connected, powered, program running, RUNNING
    joints = np.array([struct.unpack_from(">ddd", state[1], 41 * i) for i in range(6)])
    np.testing.assert_allclose(joints[:, 1], c.arm.q)
    np.testing.assert_allclose(joints[:, 0], c.arm.q, atol=1e-4)
    X = kinematics.forward(c.cell.robot, np.array(c.arm.q), c.cell.tool.X_FT)
    np.testing.assert_allclose(struct.unpack_from(">3d", state[4]), X[:3, 3], atol=1e-4)
    c.stops.protective("test")
    c.workcell.outputs.bits = 0b101
    state = sub_packages(packages(client.send(b"", PERIOD))[-1])
    assert struct.unpack_from(">7?", state[0], 8)[4:] == (True, False, True)  # protective stop, program paused
    assert struct.unpack_from(">II", state[3]) == (0, 0b101)
    assert state[3][8 + 2 + 16 + 2 + 16 + 16] == 3  # safety mode: protective stop


def test_a_cb3_has_no_tool_communication():
    cell = make_cell("ur5", polyscope="3.15")
    loop = SimulatorLoop(Simulation(cell, SimulatorSettings(), unique_address()))
    peer = Peer(loop.simulation, "primary")
    found = sub_packages(packages(peer.send(b"", 13))[1])
    assert not found.keys() & {11, 12}
    assert struct.unpack_from(">i", found[6], len(found[6]) - 4) == (1,)
    peer.close()
    loop.simulation.network.close()


@pytest.mark.parametrize("port", ["primary", "secondary", "script"])
def test_a_script_on_any_port_takes_the_place_of_what_runs(clients: Any, sim: Simulation, port: str):
    sim.controller.runner.upload(SCRIPT)
    listener = clients("primary")
    other = clients(port)
    listener.send(b"", PERIOD)
    assert sim.controller.runner.runtime == PLAYING
    other.send(LOOP.encode())
    assert sim.controller.runner.runtime == STOPPED
    heard = keys(listener.send(b"", 2 * PERIOD))
    assert heard == [("PROGRAM_XXX_STOPPED", "rtde_control"), ("PROGRAM_XXX_STARTED", "other")]
    assert sim.controller.runner.program is not None


def test_a_script_that_does_not_compile_stops_what_runs_too_and_says_why(clients: Any, sim: Simulation):
    sim.controller.runner.upload(SCRIPT)
    client = clients("primary")
    client.send(b"", PERIOD)
    client.send(b"def x():\n  unknown()\nend\n")
    assert sim.controller.runner.program is None
    kinds = dict(messages(client.send(b"", PERIOD)))
    assert struct.unpack_from(">ii", kinds[10]) == (2, 3)
    assert kinds[10][8:] == b"compile_error_name_not_found:unknown:"


def test_messages_are_for_primary_clients_only(clients: Any):
    primary = clients("primary")
    secondary = clients("secondary")
    secondary.send(b"", PERIOD)
    primary.send(b'textmsg("hello")\n', 2 * PERIOD)
    heard = messages(primary.send(b"", 1)) + messages(secondary.send(b"", 2 * PERIOD))
    assert not [kind for kind, _ in heard if kind != 3]
    primary.send(b'textmsg("hello")\n', 1)
    assert (0, b"hello") in messages(primary.send(b"", 2 * PERIOD))


def test_stops_and_popups_are_said(clients: Any, sim: Simulation):
    client = clients("primary")
    client.send(b"", PERIOD)
    sim.controller.stops.protective("test")
    heard = dict(messages(client.send(b"", PERIOD)))
    assert struct.unpack_from(">iii", heard[6]) == (0, 0, 2)  # an error code, a warning
    assert heard[5][8] == 3  # the new safety mode
    client.send(b"set unlock protective stop\n")
    heard = dict(messages(client.send(b"", PERIOD)))
    assert heard[5][8] == 1
    client.send(b'popup("text", "title", blocking=True)\n')
    heard = dict(messages(client.send(b"", 2 * PERIOD)))
    assert heard[2] == struct.pack(">IB???B", 0, 0, False, False, True, 5) + b"titletext"


def test_plain_commands_power_the_arm_and_stop_programs(clients: Any, sim: Simulation):
    client = clients("primary")
    c = sim.controller
    client.send(LOOP.encode(), 30)
    assert c.runner.playing
    client.send(b"stop program\n")
    assert c.runner.runtime == STOPPED
    for command, mode in ((b"power off", 3), (b"power on", 5), (b"power off", 3), (b"set robotmode run", 7)):
        client.send(command + b"\n")
        assert c.safety.robot_mode == mode


def test_in_local_control_scripts_and_commands_are_refused_with_their_code(clients: Any, sim: Simulation):
    client = clients("primary")
    c = sim.controller
    c.runner.upload(SCRIPT)
    client.send(b"", PERIOD)
    c.runner.remote_control = False
    for text in (LOOP.encode(), b"power off\n"):
        client.send(text)
        assert struct.unpack_from(">iii", dict(messages(client.send(b"", PERIOD)))[6]) == (210, 0, 3)
    assert c.runner.playing
    assert c.safety.powered


def test_a_port_to_read_from_takes_no_script(clients: Any, sim: Simulation):
    sim.controller.runner.upload(SCRIPT)
    for port in ("primary read-only", "secondary read-only", "script read-only"):
        clients(port).send(LOOP.encode() + b"power off\n", 40)
    assert sim.controller.runner.playing


# -- the real-time interface
def test_the_real_time_packet_comes_every_cycle_with_the_documented_fields(clients: Any, sim: Simulation):
    client = clients("script read-only")
    c = sim.controller
    c.workcell.outputs.bits = 0b11
    found = packages(client.send(b"", 20))
    assert [len(p) for p in found] == [1220] * 20
    doubles = [struct.unpack(">152d", p[4:]) for p in found]
    np.testing.assert_allclose(np.diff([d[0] for d in doubles]), 0.002)
    # column numbers, from 1, are those of UR's table
    last = (0.0, *doubles[-1])
    np.testing.assert_allclose(last[2:8], c.arm.q)
    np.testing.assert_allclose(last[32:38], c.arm.measured_q)
    X = kinematics.forward(c.cell.robot, np.array(c.arm.measured_q), c.cell.tool.X_FT)
    np.testing.assert_allclose(last[56:59], X[:3, 3], atol=1e-4)  # held while the arm rests
    assert (last[95], last[96:102], last[102]) == (7.0, (253.0,) * 6, 1.0)  # robot mode, joint modes, safety mode
    assert last[118] == 1.0  # speed scaling
    assert last[131:133] == (0b11, 1.0)  # digital outputs, program state
    elbow = kinematics.link_poses(c.cell.robot, np.array(c.arm.measured_q)[None])[0, 2][:3, 3]
    np.testing.assert_allclose(last[133:136], elbow, atol=1e-9)
    assert last[139] == 1.0  # safety status
    assert last[143] == c.installation.payload_kg


@pytest.mark.parametrize(
    ("version", "size"),
    [((3, 0), 1044), ((3, 2), 1060), ((3, 5), 1108), ((3, 10), 1116), ((3, 14), 1140), ((3, 15), 1220),
     ((5, 0), 1108), ((5, 4), 1116), ((5, 9), 1140), ((5, 10), 1220), ((5, 22), 1220)],
)  # fmt: skip
def test_the_packet_has_the_size_of_its_version(version: tuple[int, int], size: int):
    assert packet_size((*version, 0)) == size


def test_a_client_that_does_not_read_the_stream_can_still_send_scripts(clients: Any, sim: Simulation):
    client = clients("script")
    for _ in range(2000):
        sim.tick()
    assert client.connection.open
    assert client.connection.unsent  # its buffer is full, and it misses the rest
    client.socket.sendall(SCRIPT.encode())
    sim.network.readable(client.served)
    for _ in range(30):
        sim.tick()
    assert sim.controller.runner.playing
    data = b""
    client.socket.settimeout(0.05)
    while chunk := received(client):
        data += chunk
        client.connection.flush()
    assert {len(p) for p in packages(data)} == {1220}


def received(client: Peer) -> bytes:
    try:
        return client.socket.recv(1 << 20)
    except TimeoutError:
        return b""


def test_the_elbow_moves_as_its_position_changes(sim: Simulation):
    """By finite differences of the planner's kinematics."""
    c = sim.controller
    q = np.array([0.3, -1.1, 1.2, -0.5, 0.4, 0.1])
    qd = np.array([0.5, -0.7, 1.1, 2.0, 1.0, -3.0])
    c.arm.measured_q, c.arm.measured_qd = q.tolist(), qd.tolist()

    def elbow(at: float) -> np.ndarray:
        return kinematics.link_poses(c.cell.robot, (q + at * qd)[None])[0, 2][:3, 3]

    derived = sim.output_values.derived
    np.testing.assert_allclose(derived["elbow_position"](), elbow(0.0), atol=1e-12)
    np.testing.assert_allclose(derived["elbow_velocity"](), (elbow(1e-6) - elbow(-1e-6)) / 2e-6, atol=1e-8)
    assert math.isfinite(sum(derived["target_TCP_acceleration"]()))


def test_the_momentum_is_that_of_links_and_payload(sim: Simulation):
    """By finite differences of the planner's kinematics."""
    c = sim.controller
    q = np.array([0.3, -1.1, 1.2, -0.5, 0.4, 0.1])
    qd = np.array([0.5, -0.7, 1.1, 2.0, 1.0, -3.0])
    c.arm.measured_q, c.arm.measured_qd = q.tolist(), qd.tolist()
    bodies = [(i + 1, link.mass, link.com) for i, link in enumerate(c.cell.robot.links)]
    bodies.append((6, c.installation.payload_kg, np.array(c.installation.payload_cog_m)))

    def moment(at: float) -> np.ndarray:
        X = kinematics.link_poses(c.cell.robot, (q + at * qd)[None])[0]
        return sum((mass * (X[i, :3, :3] @ com + X[i, :3, 3]) for i, mass, com in bodies), np.zeros(3))

    sim.output_values.torques()
    expected = np.linalg.norm(moment(1e-6) - moment(-1e-6)) / 2e-6
    assert sim.output_values.values["actual_momentum"][0] == pytest.approx(expected, rel=1e-6)

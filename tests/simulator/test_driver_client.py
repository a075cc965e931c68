"""A driver of the usual kind: it uploads a program that connects back to it, and then streams what the arm is to do.

The program below is our own: three sockets, a thread for each way of moving, a trajectory point by point. The first
tests tick the controller by hand; the last ones meet three controllers as processes, on their ports and in real time.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from simulator.program.runner import STOPPED
from simulator.settings import PRIMARY_PORT, SECONDARY_PORT
from simulator.simulation import Simulation
from tests.simulator.conftest import READY_WITHIN_S, Peer, Simulator, Start

STOP = 0
HOLD = 1
SERVO = 2
SPEED = 3
TRAJECTORY = 4
CANCEL = 5
TOOL = 6
DONE = 0
CANCELED = 1
MISSING = 2
SCALE = 1_000_000  # of the numbers on the sockets
VALUES = 8  # of a command: timeout [ms], kind, six numbers
POINT = 9  # values of a trajectory point: six joints, time, blend radius, whether it is a joint speed to run through
STEP = np.array([0.001, 0.0, 0.0, 0.0, 0.0, -0.0005])  # [rad] between two streamed positions
LEG_S = 0.3  # [s] from one of these points to the next
SWING = np.array([0.1, 0.05, -0.05, 0.0, 0.0, 0.1]) * np.arange(1, 6)[:, None]  # [rad] points of a trajectory
SWING[3:, 0] = [0.2, 0.1]  # the foot turns back
BEGUN_WITHIN_S = 1.0  # [s] from a question to the first motion, on a busy machine
PATIENCE = 6000  # cycles within which everything here happens

PROGRAM = """
def our_driver():
  global kind = 1
  global goal = get_joint_positions()
  global speed = [0, 0, 0, 0, 0, 0]
  global points_left = 0
  global thread_of_move = 0
  scale = {scale}

  def scaled(values, first=1, by=scale):
    return [values[first], values[first + 1], values[first + 2], values[first + 3], values[first + 4],
            values[first + 5]] / by
  end

  def reached(name, attempts=5):
    while attempts:
      if socket_open("{host}", {{port}}, name):
        return True
      end
      sleep(0.1)
      attempts = attempts - 1
    end
    return False
  end

  thread servo():
    while kind == {servo}:
      enter_critical
      q = goal
      exit_critical
      servoj(q, t=get_steptime(), lookahead_time=0.03, gain=2000)
    end
    stopj(10)
  end

  thread speeds():
    while kind == {speed}:
      speedj(speed, 40, get_steptime())
    end
    stopj(10)
  end

  thread trajectory():
    local result = {done}
    while points_left > 0 and result == {done}:
      local point = socket_read_binary_integer({point}, "points", 0.5)
      points_left = points_left - 1
      if not point[0]:
        result = {missing}
      elif point[9]:
        local start = get_target_joint_speeds()
        local end_speed = scaled(point)
        local whole = point[7] / scale
        local t = 0
        while t < whole - 0.0001:
          t = t + get_steptime()
          speedj(start + (end_speed - start) * (t / whole), 40, get_steptime())
        end
      else:
        movej(scaled(point), t=point[7] / scale, r=point[8] / scale)
      end
    end
    stopj(10)
    socket_send_int(result, "points")
    kind = {hold}
  end

  thread tools():
    while True:
      local command = socket_read_binary_integer(2, "tools", 0)
      if command[0] == 2 and (command[1] == 1 or
        command[1] == 2):
        set_standard_digital_out(command[1], command[2] != 0)
        zero_ftsensor()
      end
    end
  end

  if not (reached("commands") and reached("points", attempts=3) and reached("tools")):
    halt
  end
  run tools()
  timeout = 0.0
  while kind != {stop}:
    command = socket_read_binary_integer({values}, "commands", timeout)
    if command[0] < {values}:
      textmsg("the driver is silent after ", timeout)
      kind = {stop}
    else:
      timeout = command[1] / 1000.0
      if command[2] != kind:
        was = kind
        kind = command[2]
        if was == {trajectory}:
          kill thread_of_move
          stopj(10)
          socket_send_int({canceled}, "points")
        else:
          join thread_of_move
        end
        if kind == {servo}:
          goal = get_joint_positions()
          thread_of_move = run servo()
        elif kind == {speed}:
          thread_of_move = run speeds()
        elif kind == {trajectory}:
          points_left = command[3]
          thread_of_move = run trajectory()
        end
      end
      if kind == {servo}:
        goal = scaled(command, 3)
      elif kind == {speed}:
        speed = scaled(command, first=3)
      end
    end
  end
  join thread_of_move
  socket_close("commands")
end
""".replace("{{port}}", "{port}")


def program(host: str, port: int) -> str:
    """Returns the program for a driver that listens at an address."""
    kinds = {"stop": STOP, "hold": HOLD, "servo": SERVO, "speed": SPEED, "trajectory": TRAJECTORY}
    results = {"done": DONE, "canceled": CANCELED, "missing": MISSING}
    return PROGRAM.format(host=host, port=port, scale=SCALE, values=VALUES, point=POINT, **kinds, **results)


class Driver:
    """The driver's end: one port, on which the program connects for commands, points and tools, in this order."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.setblocking(False)
        self.port = self.listener.getsockname()[1]
        self.sockets: list[socket.socket] = []

    def poll(self) -> None:
        """Accepts the next connection, if there is one."""
        with suppress(BlockingIOError):
            self.sockets.append(self.listener.accept()[0])
            self.sockets[-1].setblocking(False)
            self.sockets[-1].setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def command(self, kind: int, values: Sequence[float] = (0.0,) * 6, timeout_ms: int = 100) -> None:
        self.sockets[0].sendall(struct.pack(">8i", timeout_ms, kind, *(round(SCALE * v) for v in values)))

    def start_trajectory(self, count: int) -> None:
        self.sockets[0].sendall(struct.pack(">8i", 0, TRAJECTORY, count, *(0,) * 5))

    def point(self, values: Sequence[float], time_s: float, blend_m: float = 0.0, is_speed: bool = False) -> None:
        numbers = [*values, time_s, blend_m]
        self.sockets[1].sendall(struct.pack(">9i", *(round(SCALE * v) for v in numbers), is_speed))

    def result(self) -> int | None:
        """Returns the result of a trajectory, None while there is none."""
        with suppress(BlockingIOError):
            return struct.unpack(">i", self.sockets[1].recv(4))[0]
        return None

    def close(self) -> None:
        for sock in [*self.sockets, self.listener]:
            sock.close()


class Session:
    """A driver with its program running in a simulation that is ticked by hand."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self.controller = simulation.controller
        self.driver = Driver()
        self.client = Peer(simulation, "primary")
        self.client.send(program("127.0.0.1", self.driver.port).encode())
        self.until(lambda: len(self.driver.sockets) == 3)

    @property
    def q(self) -> np.ndarray:
        return np.array(self.controller.arm.q)

    @property
    def qd(self) -> np.ndarray:
        return np.array(self.controller.arm.qd)

    def tick(self, count: int = 1) -> None:
        for _ in range(count):
            self.simulation.tick()
            self.driver.poll()

    def until(self, condition: Callable[[], object]) -> None:
        for _ in range(PATIENCE):
            if condition():
                return
            self.tick()
        raise AssertionError(list(self.controller.timeline.events)[-5:])

    def result(self) -> int:
        found: list[int] = []
        self.until(lambda: found.append(self.driver.result()) or found[-1] is not None)
        return found[-1]

    def close(self) -> None:
        self.controller.runner.stop("the test is over")
        self.tick(200)
        self.client.close()
        self.driver.close()


@pytest.fixture
def session(simulation: Simulation) -> Iterator[Session]:
    session = Session(simulation)
    yield session
    session.close()


def test_streamed_positions_are_followed(session: Session):
    start = session.q
    for k in range(1, 301):
        session.driver.command(SERVO, start + k * STEP)
        session.tick()
    assert session.qd[0] == pytest.approx(0.5, abs=0.05)
    session.tick(40)
    np.testing.assert_allclose(session.q, np.add(start, [0.3, 0.0, 0.0, 0.0, 0.0, -0.15]), atol=1e-4)
    assert not session.controller.safety.stopped


def test_streamed_speeds_are_run_and_then_held(session: Session):
    for _ in range(100):
        session.driver.command(SPEED, [0.0, 0.1, -0.2, 0.0, 0.0, 0.3])
        session.tick()
    np.testing.assert_allclose(session.qd, [0.0, 0.1, -0.2, 0.0, 0.0, 0.3], atol=1e-9)
    session.driver.command(HOLD, timeout_ms=0)
    session.tick(100)
    assert not session.qd.any()
    assert session.controller.runner.playing


def test_a_silent_driver_ends_the_program_and_the_arm_rests(session: Session):
    session.driver.command(SPEED, [0.2, 0.0, 0.0, 0.0, 0.0, 0.0], timeout_ms=20)
    session.tick(5)
    assert session.qd[0] > 0.1
    session.until(lambda: session.controller.runner.runtime == STOPPED)
    assert not session.qd.any()


def test_a_driver_that_is_gone_ends_the_program_too(session: Session):
    session.driver.command(SPEED, [0.2, 0.0, 0.0, 0.0, 0.0, 0.0], timeout_ms=0)
    session.tick(50)
    session.driver.sockets[0].close()
    session.until(lambda: session.controller.runner.runtime == STOPPED)
    session.tick(100)
    assert not session.qd.any()


def test_a_trajectory_passes_its_points_and_reports_its_end(session: Session):
    waypoints = session.q + SWING
    began = session.controller.timeline.t
    session.driver.start_trajectory(len(waypoints))
    for waypoint in waypoints:
        session.driver.point(waypoint, LEG_S)
    passed: list[np.ndarray] = []
    session.until(lambda: passed.append(session.q) or session.driver.result() == DONE)
    apart = np.abs(np.array(passed)[:, None] - waypoints).max(axis=2)
    assert apart.min(axis=0).max() < 1e-3
    assert apart.argmin(axis=0) == pytest.approx(LEG_S / 0.002 * np.arange(1, len(waypoints) + 1), abs=10)
    assert session.controller.timeline.t - began == pytest.approx(len(waypoints) * LEG_S, abs=0.05)
    np.testing.assert_allclose(session.q, waypoints[-1], atol=1e-5)
    assert session.driver.result() is None


def test_a_trajectory_cuts_a_corner_by_its_blend(session: Session):
    start = session.q
    waypoint = np.add(start, [0.2, 0.0, 0.0, 0.0, 0.0, 0.0])
    end = np.add(start, [0.2, 0.1, 0.0, 0.0, 0.0, 0.1])
    session.driver.start_trajectory(2)
    session.driver.point(waypoint, 0.5, 0.03)
    session.driver.point(end, 0.5)
    assert session.result() == DONE
    np.testing.assert_allclose(session.q, end, atol=1e-5)


def test_a_trajectory_of_speeds_covers_its_area(session: Session):
    start = session.q
    session.driver.start_trajectory(3)
    for speed, time_s in ((0.4, 0.2), (0.4, 0.3), (0.0, 0.2)):
        session.driver.point([speed, 0.0, 0.0, 0.0, 0.0, 0.0], time_s, is_speed=True)
    assert session.result() == DONE
    np.testing.assert_allclose(session.q, np.add(start, [0.4 * 0.5, 0.0, 0.0, 0.0, 0.0, 0.0]), atol=2e-3)


def test_a_trajectory_is_canceled_or_misses_a_point(session: Session):
    start = session.q
    session.driver.start_trajectory(2)
    session.driver.point(np.add(start, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 2.0)
    session.tick(500)
    assert session.qd[0] > 0.3
    session.driver.command(HOLD, timeout_ms=0)
    assert session.result() == CANCELED
    assert not session.qd.any()
    session.driver.start_trajectory(1)
    assert session.result() == MISSING
    assert session.controller.runner.playing


def test_other_commands_are_obeyed_beside_a_motion(session: Session):
    session.driver.command(SPEED, [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], timeout_ms=0)
    session.tick(20)
    session.driver.sockets[2].sendall(struct.pack(">2i", 2, 1))
    session.tick(40)
    assert session.controller.workcell.outputs.bits >> 2 & 1
    assert session.qd[0] == pytest.approx(0.1)
    session.driver.sockets[2].sendall(struct.pack(">2i", 2, 0))
    session.tick(40)


class Remote:
    """A driver with its program running in a simulator process: real ports, real time."""

    def __init__(self, simulator: Simulator, port: int) -> None:
        self.simulator = simulator
        self.driver = Driver()
        self.client = socket.create_connection((simulator.host, port), timeout=READY_WITHIN_S)
        self.client.sendall(program("127.0.0.1", self.driver.port).encode())
        self.until(lambda: len(self.driver.sockets) == 3)

    def state(self) -> dict[str, Any]:
        return self.simulator.ask("state")

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + READY_WITHIN_S
        while not condition():
            assert time.monotonic() < deadline, self.state()
            self.driver.poll()
            time.sleep(0.005)

    def result(self) -> int:
        found: list[int] = []
        self.until(lambda: found.append(self.driver.result()) or found[-1] is not None)
        return found[-1]

    def until_it_moves(self) -> None:
        self.until(lambda: max(map(abs, self.state()["qd"])) > 0.1)

    def close(self) -> None:
        self.client.sendall(b"stop program\n")
        self.until(lambda: self.state()["runtime_state"] == STOPPED and not any(self.state()["qd"]))
        self.client.close()
        self.driver.close()


CONTROLLERS = {  # arm, options, and the port that takes the program
    "PolyScope 5": ("ur5e", (), PRIMARY_PORT),
    "PolyScope X": ("ur5e", ("--polyscope", "x"), SECONDARY_PORT),
    "CB3": ("ur5", (), PRIMARY_PORT),
}


@pytest.fixture(scope="module", params=CONTROLLERS)
def controller(request: pytest.FixtureRequest, start_simulator: Start) -> tuple[Simulator, int]:
    robot, options, port = CONTROLLERS[request.param]
    return start_simulator(robot, options=("--no-noise", *options)), port


@pytest.fixture
def remote(controller: tuple[Simulator, int]) -> Iterator[Remote]:
    remote = Remote(*controller)
    yield remote
    remote.close()


def test_positions_and_speeds_are_streamed_over_the_network(remote: Remote):
    start = np.array(remote.state()["target_q"])
    for k in range(1, 101):
        remote.driver.command(SERVO, np.add(start, [0.002 * k, 0.0, 0.0, 0.0, 0.0, 0.0]), timeout_ms=0)
        time.sleep(0.002)
    goal = np.add(start, [0.2, 0.0, 0.0, 0.0, 0.0, 0.0])
    remote.until(lambda: np.abs(remote.state()["measured_q"] - goal).max() < 1e-3)
    assert remote.state()["program"] == "our_driver"
    remote.driver.command(SPEED, [-0.2, 0.0, 0.0, 0.0, 0.0, 0.1], timeout_ms=0)
    remote.until(lambda: np.allclose(remote.state()["qd"], [-0.2, 0.0, 0.0, 0.0, 0.0, 0.1], atol=1e-6))
    remote.driver.command(HOLD, timeout_ms=0)
    remote.until(lambda: not any(remote.state()["qd"]))
    remote.driver.command(STOP)
    remote.until(lambda: remote.state()["runtime_state"] == STOPPED)


def test_a_trajectory_is_run_and_another_canceled_over_the_network(remote: Remote):
    began = remote.state()
    waypoints = np.array(began["target_q"]) + SWING
    remote.driver.start_trajectory(len(waypoints))
    for waypoint in waypoints:
        remote.driver.point(waypoint, LEG_S)
    assert remote.result() == DONE
    ended = remote.state()
    np.testing.assert_allclose(ended["measured_q"], waypoints[-1], atol=1e-3)
    assert len(waypoints) * LEG_S < ended["moved_at"] - began["t"] < len(waypoints) * LEG_S + BEGUN_WITHIN_S
    remote.driver.start_trajectory(2)
    remote.driver.point(np.add(waypoints[-1], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 2.0)
    remote.until_it_moves()
    remote.driver.command(HOLD, timeout_ms=0)
    assert remote.result() == CANCELED
    assert not np.any(remote.state()["target_qd"])
    assert remote.state()["program"] == "our_driver"


@pytest.mark.slow
@pytest.mark.parametrize("end", ["silence", "closed socket", "stop program"])
def test_the_arm_comes_to_rest_whichever_end_goes_away(remote: Remote, end: str):
    remote.driver.command(SPEED, [0.2, 0.0, 0.0, 0.0, 0.0, 0.0], timeout_ms=500 if end == "silence" else 0)
    remote.until_it_moves()
    if end == "closed socket":
        remote.driver.sockets[0].close()
    elif end == "stop program":
        remote.client.sendall(b"stop program\n")
    remote.until(lambda: remote.state()["runtime_state"] == STOPPED and not any(remote.state()["qd"]))
    remote.until(lambda: remote.driver.sockets[1].recv(1) == b"")  # the program's own end is closed
    assert remote.state()["program"] is None
    assert remote.state()["safety_bits"] & 1  # normal

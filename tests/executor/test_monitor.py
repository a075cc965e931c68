"""The monitor beside a controller that answers wrongly: it goes on, and the executor says that it is not fit."""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from executor import rtde_packages
from executor.robot import session
from executor.robot.session import FORMATS, OWNER_INPUT, Monitor
from executor.rtde_packages import RTDE_PORT
from executor.worker import Worker
from tests.waiting import until

HOST = "127.0.42.1"
WIDTHS = {"actual_q": "VECTOR6D", "actual_qd": "VECTOR6D", "target_qd": "VECTOR6D", "tcp_offset": "VECTOR6D"}
KINDS = {"robot_mode": "INT32", "safety_status_bits": "UINT32", "runtime_state": "UINT32",
         "actual_digital_output_bits": "UINT64", "actual_digital_input_bits": "UINT64"}  # fmt: skip


def types(names: list[str]) -> list[str]:
    return [WIDTHS.get(name) or KINDS.get(name) or "DOUBLE" for name in names]


class FakeReceiver:
    """An RTDE port that answers every output set-up as the test says, and publishes zeros."""

    def __init__(self) -> None:
        self.answer: Callable[[list[str]], bytes] = lambda names: b"\x01" + ",".join(types(names)).encode()
        self.claim = b"\x01BOOL"
        self.set_ups = 0
        self.server = socket.create_server((HOST, RTDE_PORT))
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self.server.accept()
            except OSError:
                return
            threading.Thread(target=self._talk, args=(connection,), daemon=True).start()

    def _talk(self, connection: socket.socket) -> None:
        try:
            with connection, connection.makefile("rb") as stream:
                while len(head := stream.read(3)) == 3:
                    size, kind = struct.unpack(">HB", head)
                    self._reply(connection, kind, stream.read(size - 3))
        except OSError:
            return

    def _reply(self, connection: socket.socket, kind: int, body: bytes) -> None:
        if kind == rtde_packages.SETUP_OUTPUTS:
            self.set_ups += 1
            names = body[8:].decode().split(",")
            self._send(connection, kind, self.answer(names))
            self.state = struct.pack(">B" + "".join(FORMATS[t] for t in types(names)), *self._zeros(names))
        elif kind == rtde_packages.SETUP_INPUTS:
            assert body.decode() == OWNER_INPUT
            self._send(connection, kind, self.claim)
        elif kind == rtde_packages.CONTROLLER_VERSION:
            self._send(connection, kind, struct.pack(">4I", 10, 14, 0, 7))
        else:
            self._send(connection, kind, b"\x01")
        while kind == rtde_packages.START:
            self._send(connection, rtde_packages.DATA, self.state)
            time.sleep(0.02)

    def _zeros(self, names: list[str]) -> list[float]:
        return [1, *[0] * sum(6 if name in WIDTHS else 1 for name in names)]

    def _send(self, connection: socket.socket, kind: int, body: bytes) -> None:
        connection.sendall(struct.pack(">HB", 3 + len(body), kind) + body)


@pytest.fixture
def controller() -> Iterator[FakeReceiver]:
    found = FakeReceiver()
    yield found
    found.server.shutdown(socket.SHUT_RDWR)  # ends the wait for a client too
    found.server.close()
    found.thread.join()


@pytest.fixture
def monitor() -> Iterator[Monitor]:
    found = Monitor(HOST, owns=True)
    yield found
    found.stop()


def instead(names: list[str], name: str, kind: str) -> bytes:
    """Returns the answer of a set-up, with another type for one name."""
    listed = types(names)
    if name in names:
        listed[names.index(name)] = kind
    return b"\x01" + ",".join(listed).encode()


WRONG = {
    "a type that RTDE does not have": lambda names: instead(names, "actual_q", "QUATERNION"),
    "no speed slider": lambda names: instead(names, "target_speed_fraction", "NOT_FOUND"),
    "nothing at all": lambda names: b"\x01" + ",".join(["NOT_FOUND"] * len(names)).encode(),
    "another number of types": lambda names: b"\x01DOUBLE",
    "an empty body": lambda names: b"",
    "no text": lambda names: b"\x01\xff\xfe\xff",
    "another width": lambda names: instead(names, "actual_q", "DOUBLE"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_one_wrong_answer_does_not_end_the_monitor(controller: FakeReceiver, monitor: Monitor, wrong: str) -> None:
    right = controller.answer
    controller.answer = WRONG[wrong]
    monitor.start()
    until(lambda: controller.set_ups)
    controller.answer = right
    until(monitor.fresh)
    assert monitor.complaint() == ""
    assert monitor.owned is True


def test_outputs_that_older_controllers_lack_are_left_out(controller: FakeReceiver, monitor: Monitor) -> None:
    controller.answer = lambda names: instead(names, "payload", "NOT_FOUND")
    monitor.start()
    until(monitor.fresh)
    assert monitor.state is not None
    assert monitor.state.payload_kg is None


def test_an_input_that_another_has_is_asked_for_again(
    controller: FakeReceiver, monitor: Monitor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "RECLAIM_S", 0.1)
    controller.claim = b"\x00IN_USE"
    monitor.start()
    until(lambda: monitor.owned is False)
    until(monitor.fresh)  # it reports all the same
    controller.claim = b"\x01BOOL"
    until(lambda: monitor.owned)
    controller.claim = b"\x00NOT_FOUND"  # of a controller that is too old
    with socket.create_connection((HOST, RTDE_PORT)) as connection:
        assert session.RtdeReceiver(connection, inputs=[session.OWNER_INPUT]).owned is None


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_dies_is_started_again_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    starts = []

    class Mortal(Worker):
        def run(self) -> None:
            starts.append(len(starts))
            if len(starts) < 3:
                raise KeyError("first")
            self.ended.wait()

    monkeypatch.setattr("executor.worker.PAUSE_S", 0.01)
    worker = Mortal("monitor")
    worker.revive()  # not started yet
    worker.start()
    until(lambda: worker.revive() or len(starts) == 3)
    assert "monitor died a moment ago of KeyError('first')" in worker.complaint()
    worker.revive()
    assert len(starts) == 3
    monkeypatch.setattr("executor.worker.FIT_AFTER_S", 0.0)
    assert worker.complaint() == ""
    worker.stop()
    worker.revive()
    assert len(starts) == 3

"""The stop socket: what is asked of it, by whom, and what hostile clients can do to it."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from select import poll

import pytest

from executor import stop_listener
from executor.execution import Execution
from executor.stop_listener import CLIENTS_MAX, StopListener
from fling import stop_socket
from store import ExecutionRow, new_id
from tests.waiting import until


class CountedPoll:
    """`select.poll`, which cannot be a base class; it knows how many it looks at."""

    def __init__(self) -> None:
        self.numbers: set[int] = set()
        self._poll = poll()

    def register(self, what: int | socket.socket, events: int) -> None:
        self.numbers.add(what if isinstance(what, int) else what.fileno())
        self._poll.register(what, events)

    def unregister(self, what: int | socket.socket) -> None:
        self.numbers.discard(what if isinstance(what, int) else what.fileno())
        self._poll.unregister(what)

    def poll(self, timeout_ms: float) -> list[tuple[int, int]]:
        return self._poll.poll(timeout_ms)


class StoppedRun:
    """The run of an execution, which notes that it was asked to brake."""

    state = row_count = furthest = 0

    def __init__(self) -> None:
        self.asked = threading.Event()

    def abort(self, reason: str = "") -> None:
        self.asked.set()


def execution(cell: str) -> Execution:
    row = ExecutionRow(new_id(), "plan", cell, "speedj", False, "me", 1.0, None, 2.0, "x", "preparing", *[None] * 4)
    return Execution(session=None, row=row, run=StoppedRun())


def listening(data: Path, cell: str) -> StopListener:
    folder = stop_socket.executor_folder(data, cell)
    folder.mkdir(parents=True)
    listener = StopListener(folder)
    listener.start()
    until((folder / stop_socket.NAME).exists, period_s=0.0)
    return listener


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A folder whose path is too long for the address of a socket."""
    return tmp_path / ("long" * 30)


@pytest.fixture
def listener(data: Path) -> Iterator[StopListener]:
    found = listening(data, "a")
    yield found
    found.stop()
    assert not (found.folder / stop_socket.NAME).exists()


def test_a_stop_reaches_the_run_and_is_answered(data: Path, listener: StopListener) -> None:
    listener.execution = execution("a")
    row = listener.execution.row
    answer = stop_socket.stop(data, row.id, "me")
    assert answer is not None
    assert listener.execution.run.asked.is_set()
    assert ExecutionRow(**answer).plan_id == "plan"
    assert answer["abort_requested_at"] > 0.0


def test_another_execution_is_remembered_and_runs_on(data: Path, listener: StopListener) -> None:
    listener.execution = execution("a")
    other = new_id()
    assert stop_socket.stop(data, other, "me") is None
    assert not listener.execution.run.asked.is_set()
    assert listener.is_asked(other)
    assert not listener.is_asked(listener.execution.row.id)


def test_of_many_executors_the_newest_execution_is_stopped(data: Path, listener: StopListener) -> None:
    assert stop_socket.stop_newest(data, "me") is None
    listener.execution = execution("a")
    second = listening(data, "b")
    second.execution = execution("b")
    assert [run["cell"] for run in stop_socket.running(data)] == ["b", "a"]
    assert stop_socket.stop_newest(data, "me")["id"] == second.execution.row.id
    assert not listener.execution.run.asked.is_set()
    second.stop()
    assert [run["cell"] for run in stop_socket.running(data)] == ["a"]


def test_the_socket_of_an_executor_that_died_is_nobody(data: Path, listener: StopListener) -> None:
    gone = stop_socket.executor_folder(data, "gone")
    gone.mkdir()
    stop_socket.listen(gone).close()
    listener.execution = execution("a")
    assert [run["cell"] for run in stop_socket.running(data)] == ["a"]
    again = stop_socket.listen(gone)  # the next executor takes its place
    again.close()


@pytest.mark.parametrize("message", [b"", b"{", b"[]", b"null", b"{}", b'{"ask": "stop"}', b"[" * 50000])
def test_what_is_no_message_has_no_answer_and_harms_nobody(data: Path, listener: StopListener, message: bytes) -> None:
    listener.execution = execution("a")
    with socket.socket(socket.AF_UNIX, stop_socket.KIND) as client, stop_socket._short_path(listener.folder) as path:
        client.connect(path)
        client.send(message)
        if message:  # an empty one is none
            assert client.recv(10) == b""
    assert stop_socket.stop_newest(data, "me") is not None


def test_clients_that_say_nothing_keep_nobody_waiting(data: Path, listener: StopListener) -> None:
    listener.execution = execution("a")
    silent = []
    with stop_socket._short_path(listener.folder) as path:
        for _ in range(CLIENTS_MAX + 20):
            silent.append(socket.socket(socket.AF_UNIX, stop_socket.KIND))
            silent[-1].connect(path)
    assert stop_socket.stop_newest(data, "me") is not None
    for client in silent:
        client.close()


def test_one_that_hangs_up_as_it_makes_room_for_another_ends_nothing(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The listener was suspended meanwhile, and sees both in one look."""
    looks = [threading.Event(), threading.Event()]

    class LateLooks(CountedPoll):
        def poll(self, timeout_ms: float) -> list[tuple[int, int]]:
            if len(self.numbers) > CLIENTS_MAX:  # all have connected
                looks[0].set()
                looks[1].wait(60.0)
            return super().poll(timeout_ms)

    monkeypatch.setattr(stop_listener.select, "poll", LateLooks)
    found = listening(data, "a")
    found.execution = execution("a")
    clients = []
    with stop_socket._short_path(found.folder) as path:
        for number in range(CLIENTS_MAX + 1):
            if number == CLIENTS_MAX:
                assert looks[0].wait(60.0)
                clients[0].close()
            clients.append(socket.socket(socket.AF_UNIX, stop_socket.KIND))
            clients[-1].connect(path)
    looks[1].set()
    assert stop_socket.stop_newest(data, "me") is not None
    assert found.complaint() == ""
    for client in clients:
        client.close()
    found.stop()

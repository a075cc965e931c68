"""Latched faults, whatever ends the executor or its database in between: no fault is lost, none is cleared unseen."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from executor import daemon
from executor.daemon import Daemon
from executor.records import ExecutionResult, Journal
from executor.robot import ActionRefused, RobotSession
from executor.stream_process import STREAM_MODULE
from planner.cell import load_cell
from store import PlanRow, Store, StoreUnavailable, new_id
from tests.executor.conftest import CELLS, settings, waiting_process
from tests.processes import children_with

CELL = "ur5e-sim"
FAULT = {"outcome": "late", "reason": "ticks were lost", "execution_id": "one", "at": 1.5}
LATER = {"outcome": "tracking", "reason": "too far from the plan", "execution_id": "two", "at": 2.5}


class Gone(BaseException):
    """The process ends here."""


def kill(*_: object, **__: object) -> None:
    raise Gone


def lose(*_: object, **__: object) -> None:
    raise StoreUnavailable("gone")


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    found = Store.open(f"sqlite:///{tmp_path / 'fling.db'}")
    yield found
    found.close()


@pytest.fixture
def start(store: Store, tmp_path: Path) -> Iterator[Callable[[], Daemon]]:
    """Returns the next daemon of the cell; the one before has been killed. No controller answers."""
    daemons: list[Daemon] = []

    def next_daemon() -> Daemon:
        if daemons:
            end(daemons.pop())
        journal = Journal(tmp_path / "journal")
        session = RobotSession.open(load_cell(CELLS / f"{CELL}.toml"), settings(data=tmp_path))
        daemon = Daemon(session, store, journal)
        daemons.append(daemon)
        store.take_cell(CELL, daemon.executor_id, "sim", "a test", store.cell_status(CELL))
        return daemon

    def end(daemon: Daemon) -> None:
        daemon.spare.close()  # as the kernel does it where a daemon is killed
        daemon.journal.close()

    yield next_daemon
    end(daemons.pop())


def run_and_lose_an_execution(store: Store, daemon: Daemon) -> str:
    """Queues and claims an execution, whose daemon then is killed; returns its id."""
    plan = PlanRow(new_id(), 0.0, CELL, "0" * 64, "ruckig", b"{}")
    store.add_plan(plan)
    id = store.queue_execution(plan.id, CELL).id
    assert store.claim_execution(CELL, daemon.executor_id) is not None
    return id


@pytest.mark.parametrize("end", [kill, lose])
def test_what_a_lost_execution_implies_is_latched_before_it_is_closed(
    store: Store, start: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch, end: Callable[..., None]
) -> None:
    id = run_and_lose_an_execution(store, start())
    with monkeypatch.context() as patch:
        close = store.close_open_executions

        def end_after(*given: str) -> None:
            close(*given)
            end()

        patch.setattr(store, "close_open_executions", end_after)
        second = start()
        if end is kill:
            with pytest.raises(Gone):
                second.recover()
        else:
            second.recover()
    assert store.execution(id).outcome == "executor_lost"
    third = start()
    third.recover()
    assert third.journal.fault()["execution_id"] == id
    assert store.cell_status(CELL).fault == third.journal.fault()  # who reads that it is finished reads this, too


def test_a_claim_whose_answer_was_lost_gets_its_outcome(
    store: Store, start: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The database takes the claim, and its connection ends before it says so."""
    daemon = start()
    daemon.recover()
    plan = PlanRow(new_id(), 0.0, CELL, "0" * 64, "ruckig", b"{}")
    store.add_plan(plan)
    id = store.queue_execution(plan.id, CELL).id
    with monkeypatch.context() as patch:
        claim = store.claim_execution

        def lose_answer(*given: str) -> None:
            claim(*given)
            lose()

        patch.setattr(store, "claim_execution", lose_answer)
        daemon._poll(threading.Event())
    assert store.execution(id).state == "preparing"
    daemon._store_paused_until = 0.0
    daemon._poll(threading.Event())
    assert store.execution(id).outcome == "refused"  # its plan is none
    states = [event.data["state"] for event in store.events(id)]
    assert states == ["queued", "preparing", "finished"]


def test_a_result_that_was_not_delivered_is_not_claimed_again(
    store: Store, start: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon = start()
    daemon.recover()
    id = run_and_lose_an_execution(store, daemon)
    daemon.journal.keep(ExecutionResult(id, "completed", "", None))
    with monkeypatch.context() as patch:
        patch.setattr(daemon, "_deliver_kept", lambda: None)  # as where the database comes back in between
        daemon._poll(threading.Event())
    daemon._poll(threading.Event())
    assert store.execution(id).outcome == "completed"
    assert daemon.journal.fault() is None


def test_an_execution_that_nobody_claimed_is_closed_without_a_fault(store: Store, start: Callable[[], Daemon]) -> None:
    plan = PlanRow(new_id(), 0.0, CELL, "0" * 64, "ruckig", b"{}")
    store.add_plan(plan)
    id = store.queue_execution(plan.id, CELL).id
    daemon = start()
    daemon.recover()
    assert store.execution(id).outcome == "executor_lost"
    assert daemon.journal.fault() is None


def test_an_acknowledgement_clears_the_fault_that_was_shown(store: Store, start: Callable[[], Daemon]) -> None:
    daemon = start()
    daemon.journal.latch(FAULT)
    daemon.heartbeat.report()
    store.request_acknowledge(CELL, "a person")
    following = start()  # finds it in the store
    following.heartbeat.report()
    assert following.journal.fault() is None
    assert store.cell_status(CELL).fault is None


@pytest.mark.parametrize("end", [kill, lose])
def test_an_acknowledgement_clears_no_later_fault(
    store: Store, start: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch, end: Callable[..., None]
) -> None:
    daemon = start()
    daemon.journal.latch(FAULT)
    daemon.heartbeat.report()
    store.request_acknowledge(CELL, "a person")
    with monkeypatch.context() as patch:
        patch.setattr(store, "clear_acknowledge", end)
        if end is kill:
            with pytest.raises(Gone):
                daemon.heartbeat.report()
        else:
            daemon.heartbeat.report()
    after = start()
    after.journal.latch(LATER)
    after.heartbeat.report()
    assert after.journal.fault() == LATER


def test_an_acknowledgement_of_nothing_clears_nothing(store: Store, start: Callable[[], Daemon]) -> None:
    daemon = start()
    daemon.heartbeat.report()
    store.request_acknowledge(CELL, "a person who saw no fault")
    daemon.journal.latch(FAULT)
    daemon.heartbeat.report()
    assert store.cell_status(CELL).fault == FAULT


class FakeConsole:
    """What operates the robot; `refusal` is what it answers, in words."""

    def __init__(self) -> None:
        self.acts: list[str] = []
        self.refusal = ""

    def act(self, action: str) -> str:
        self.acts.append(action)
        if self.refusal:
            raise ActionRefused(self.refusal)
        return "dashboard"


@pytest.fixture
def operated(start: Callable[[], Daemon]) -> tuple[Daemon, FakeConsole]:
    daemon = start()
    daemon.session.console = console = FakeConsole()
    daemon.recover()
    return daemon, console


@pytest.mark.parametrize(("refusal", "text"), [("", "by the dashboard"), ("not now", "not now")])
def test_a_request_to_operate_the_robot_is_obeyed_once(
    store: Store, operated: tuple[Daemon, FakeConsole], refusal: str, text: str
) -> None:
    daemon, console = operated
    console.refusal = refusal
    store.request_robot_action(CELL, "power_on", "a person")
    for _ in range(3):
        daemon._operate_at = 0.0
        daemon._poll(threading.Event())
    assert console.acts == ["power_on"]
    answer = store.cell_status(CELL).robot_answer
    assert (answer["done"], answer["text"]) == (not refusal, text)


def test_a_request_is_not_obeyed_again_where_its_answer_was_not_stored(
    store: Store, operated: tuple[Daemon, FakeConsole], monkeypatch: pytest.MonkeyPatch
) -> None:
    daemon, console = operated
    store.request_robot_action(CELL, "power_off", "a person")
    with monkeypatch.context() as patch:
        patch.setattr(store, "answer_robot_request", lose)
        daemon._operate()
    daemon._store_paused_until = 0.0
    assert store.cell_status(CELL).open_robot_request is not None
    daemon._operate()
    assert console.acts == ["power_off"]
    assert store.cell_status(CELL).open_robot_request is None


@pytest.mark.parametrize("words", ["an execution was running", "the executor was started meanwhile"])
def test_a_request_that_met_something_else_is_refused_and_not_kept(
    store: Store, operated: tuple[Daemon, FakeConsole], words: str
) -> None:
    daemon, console = operated
    store.request_robot_action(CELL, "power_on", "a person")
    daemon._operate(words)
    daemon._operate()
    assert console.acts == []
    assert store.cell_status(CELL).robot_answer["text"] == words


def test_its_own_process_that_waits_is_no_orphan(
    start: Callable[[], Daemon], capfd: pytest.CaptureFixture[str]
) -> None:
    daemon = start()
    daemon.spare.prepare()
    waiting_process()
    daemon.recover()
    assert children_with(STREAM_MODULE) == []
    assert "of an earlier executor" not in "".join(capfd.readouterr())


def test_a_lost_execution_ends_the_controllers_program_once(
    store: Store, start: Callable[[], Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The database can be read and not written for a while, as on a full disk: a person may run a program meanwhile."""
    id = run_and_lose_an_execution(store, start())
    second = start()
    stopped: list[str] = []
    monkeypatch.setattr(daemon, "stop_program", stopped.append)
    with monkeypatch.context() as patch:
        patch.setattr(store, "close_open_executions", lose)
        for _ in range(3):
            second._store_paused_until = 0.0
            second.recover()
        assert store.execution(id).outcome is None
    assert second.journal.fault()["execution_id"] == id
    second._store_paused_until = 0.0
    second.recover()
    assert store.execution(id).outcome == "executor_lost"
    assert len(stopped) == 1

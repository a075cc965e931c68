"""Refusals and recoveries of the daemon, with real processes.

H numbers are those of `tests.system`.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import orjson
import pytest

from store import new_id, split_plan
from tests.system.rig import LOB, NUDGE, ROOT, Rig


def test_a_plan_of_another_cell_file_is_refused(rig: Rig) -> None:  # C7
    document = orjson.loads(rig.store.plan(rig.plan(NUDGE)).document)
    stale = {**document, "id": new_id(), "cell_sha256": "0" * 64}
    rig.add_plan(stale)
    row = rig.end(rig.queue_plan(stale["id"]))
    assert row.outcome == "refused"
    assert "another version of the cell" in row.reason


def test_a_plan_that_was_tampered_with_is_refused(rig: Rig) -> None:  # C11
    document = orjson.loads(rig.store.plan(rig.plan(NUDGE)).document)
    document["id"] = new_id()
    document["trajectory"]["positions"][20][1] += 0.1
    rig.add_plan(document)
    before = rig.state()["q"]
    row = rig.end(rig.queue_plan(document["id"]))
    assert row.outcome == "refused"
    assert "certificate" in row.reason
    assert rig.state()["q"] == pytest.approx(before, abs=1e-9)


CHANGES = {  # of a stored plan's summary, that its certificate permits
    "aim": lambda plan: {**plan, "aim": {"position": [1.7, 0.3, 0.0], "shift_m": [0.5, 0.0, 0.0]}},
    "window": lambda plan: {**plan, "flight": {**plan["flight"], "release_window_s": 0.0, "landing_tolerance_m": 0.0}},
    "certificate": lambda plan: {**plan, "certificate": {**plan["certificate"], "checks": []}},
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_plan_whose_row_was_changed_is_refused(rig: Rig, what: str) -> None:
    stored = rig.store.plan(rig.plan(LOB, release_window_s=0.002, landing_tolerance_m=0.05))
    assert stored is not None
    document = {**orjson.loads(stored.document), "id": new_id()}
    summary, _ = split_plan(orjson.dumps(CHANGES[what](document)))
    rig.add_plan(document, summary=summary)
    row = rig.end(rig.queue_plan(document["id"]))
    assert row.outcome == "refused"
    assert row.reason == "the stored plan is not what its planner wrote (its hash differs): plan again"


def test_another_plans_content_under_an_id_is_refused(rig: Rig) -> None:
    document = orjson.loads(rig.store.plan(rig.plan(NUDGE)).document)
    id = new_id()
    rig.add_plan(document, id=id)
    row = rig.end(rig.queue_plan(id))
    assert (row.outcome, "its hash differs" in row.reason) == ("refused", True)


def test_a_plan_of_an_earlier_version_must_be_planned_again(rig: Rig) -> None:
    document = {**orjson.loads(rig.store.plan(rig.plan(NUDGE)).document), "id": new_id()}
    rig.add_plan(document, sha256=None)
    row = rig.end(rig.queue_plan(document["id"]))
    assert row.outcome == "refused"
    assert "earlier version of Fling" in row.reason
    assert row.reason.endswith("plan again")


def test_a_start_elsewhere_is_approached_first(rig: Rig) -> None:  # C6
    start = [0.4, -1.4, 1.4, -1.5, -1.5, 0.2]
    row = rig.end(rig.queue_plan(rig.plan(NUDGE, start={"positions": start})))
    assert row.outcome == "completed", row.reason


def test_a_controller_whose_tool_differs_is_refused(own_rig: Rig) -> None:
    own_rig.start_simulator()
    text = own_rig.path.read_text()
    own_rig.rewrite(text.replace("[0.0, 0.0, 0.17]", "[0.0, 0.0, 0.12]").replace("mass_kg = 1.0", "mass_kg = 2.0"))
    own_rig.start_executor()
    row = own_rig.throw(NUDGE)
    assert row.outcome == "refused"
    assert "payload of 1.00 kg" in row.reason
    assert "50.0 mm" in row.reason


@pytest.mark.slow
def test_a_read_only_executor_reports_and_never_moves(own_rig: Rig) -> None:
    own_rig.start_simulator()
    own_rig.start_executor("--read-only")
    assert own_rig.store.cell_status("rig").read_only
    assert own_rig.robot()["positions"] == pytest.approx(own_rig.cell.home, abs=1e-3)
    row = own_rig.throw(NUDGE)
    assert (row.outcome, "read-only" in row.reason) == ("refused", True)


COMMAND = [sys.executable, "-m", "executor", "--cell", "rig"]


def test_a_second_executor_of_a_cell_does_not_start(rig: Rig) -> None:
    second = subprocess.run(COMMAND, cwd=ROOT, env=rig.environment, capture_output=True, text=True)
    assert second.returncode == 1
    assert "another executor" in second.stderr


@contextlib.contextmanager
def newcomer(rig: Rig, **environment: str) -> Iterator[Callable[[], str]]:
    """Loads another executor of the rig's cell, with other settings.

    Yields a function that lets it begin, and returns what it says as it ends.
    """
    script = "import sys; from executor.__main__ import main; print(flush=True); input(); sys.exit(main())"
    command = [sys.executable, "-c", script, "--cell", "rig"]
    pipe = subprocess.PIPE
    surroundings = {**rig.environment, **environment}
    process = subprocess.Popen(command, cwd=ROOT, env=surroundings, text=True, stdin=pipe, stdout=pipe, stderr=pipe)
    assert process.stdout is not None
    process.stdout.readline()  # it is loaded, and waits for the word

    def begin() -> str:
        said = process.communicate("\n")[1]
        assert process.returncode == 1
        return said

    with process:
        yield begin


@pytest.mark.slow
@pytest.mark.parametrize("database", ["same", "other"])
def test_a_newcomer_with_a_folder_of_its_own_ends_and_the_throw_goes_on(
    rig: Rig, tmp_path: Path, database: str
) -> None:
    url = rig.url if database == "same" else f"sqlite:///{tmp_path / 'other.db'}"
    with newcomer(rig, FLING_DATA=str(tmp_path), FLING_DATABASE_URL=url) as begin:
        id = rig.launch(0.1)
        said = begin()
    assert "another executor is connected to the controller" in said
    row = rig.end(id)
    assert row.outcome == "completed", row.reason
    assert not rig.is_latched()


@pytest.mark.slow
def test_a_newcomer_that_cannot_see_the_controller_is_refused_by_the_store(rig: Rig, tmp_path: Path) -> None:
    cells = tmp_path / "cells"
    cells.mkdir()
    (cells / "rig.toml").write_text(rig.path.read_text().replace(rig.host, "127.0.43.43"))
    with newcomer(rig, FLING_DATA=str(tmp_path), FLING_CELLS=str(cells)) as begin:
        said = begin()
    assert "another executor of cell 'rig' is running (process" in said
    assert rig.throw(NUDGE).outcome == "completed"


def test_an_executor_that_was_replaced_ends(own_rig: Rig) -> None:
    own_rig.start()
    assert own_rig.executor is not None
    seen = own_rig.store.cell_status("rig")
    while not own_rig.store.take_cell("rig", "next", "sim", "a test", seen):  # as after a long sleep of this one
        seen = own_rig.store.cell_status("rig")
    assert own_rig.executor.wait(30.0) == 1
    assert own_rig.store.cell_status("rig").executor_id == "next"


@pytest.mark.slow
def test_what_was_queued_while_no_executor_lived_never_starts_by_surprise(own_rig: Rig) -> None:
    own_rig.start_simulator()
    id = own_rig.queue(NUDGE)
    own_rig.start_executor()
    assert own_rig.end(id).outcome == "executor_lost"
    assert not own_rig.is_latched()  # nothing had moved
    assert own_rig.throw(NUDGE).outcome == "completed"


@pytest.mark.slow
def test_a_controller_that_is_not_there_is_a_refusal(own_rig: Rig) -> None:
    own_rig.start()
    own_rig.simulator.send_signal(signal.SIGKILL)
    own_rig.simulator.wait()
    own_rig.until(lambda: own_rig.robot().get("connected") is False)
    row = own_rig.throw(NUDGE)
    assert row.outcome == "refused"
    assert "no state" in row.reason


@pytest.mark.slow
def test_without_real_time_permission_it_works_and_reports_it(own_rig: Rig, tmp_path: Path) -> None:  # H9
    dropped = "-sys_nice,-ipc_lock"
    if os.geteuid() == 0 and (setpriv := shutil.which("setpriv")):
        own_rig.wrap = [setpriv, f"--bounding-set={dropped}", f"--inh-caps={dropped}"]
    own_rig.start()
    row = own_rig.throw(NUDGE)
    assert row.outcome in ("completed", "late"), row.reason  # late: the machine is busy
    assert row.metrics["realtime"] is False or os.geteuid() != 0


NO_DATABASES = ("postgresql+psycopg://fling@127.0.0.1:1/fling", "sqlite:////proc/nowhere/fling.db", "nonsense")


@pytest.mark.slow
def test_without_its_database_it_ends_with_a_message(rig: Rig) -> None:  # H7: nobody listens, no folder, no address
    started = [
        subprocess.Popen(
            COMMAND, cwd=ROOT, text=True, stderr=subprocess.PIPE,
            env={**rig.environment, "FLING_DATABASE_URL": url, "FLING_DATA": str(rig.folder / f"other{i}")},
        )
        for i, url in enumerate(NO_DATABASES)
    ]  # fmt: skip
    for process in started:
        _, message = process.communicate()
        assert process.returncode == 1
        assert message.startswith("executor: the database cannot be reached: ")
        assert "Traceback" not in message


JUMPING_CLOCK = """
import time
real = time.time
time.time = lambda: real() + (3600.0 if int(5 * real()) % 2 else -3600.0)
"""


@pytest.mark.slow
def test_a_wall_clock_that_jumps_by_hours_changes_no_throw(own_rig: Rig) -> None:  # H5
    """Five times a second, by two hours, for every process of the executor; motion uses the monotonic clock only."""
    (own_rig.folder / "sitecustomize.py").write_text(JUMPING_CLOCK)
    own_rig.environment["PYTHONPATH"] = str(own_rig.folder)
    own_rig.start()
    row = own_rig.throw(LOB)
    assert row.outcome == "completed", row.reason
    assert row.metrics["landing_error_m"] < 0.005


@pytest.mark.slow
def test_the_executor_continues_with_what_its_cell_file_says_now(own_rig: Rig) -> None:
    own_rig.start()
    assert own_rig.throw(NUDGE).outcome == "completed"
    text = own_rig.path.read_text()
    own_rig.rewrite(text.replace("joint_velocity_rad_s = 3.0", "joint_velocity_rad_s = 2.9"))
    row = own_rig.throw(NUDGE)  # planned for the new file
    assert row.outcome == "completed", row.reason
    assert own_rig.robot()["cell_sha256"] == own_rig.cell.sha256

    own_rig.path.write_text(text.replace("[gripper]", "[griper]"))
    own_rig.until(own_rig.is_latched)
    assert "griper: unknown key" in own_rig.store.cell_status("rig").fault["reason"]
    row = own_rig.end(own_rig.queue(NUDGE))
    assert (row.outcome, "the cell file is refused" in row.reason) == ("refused", True)

    own_rig.rewrite(text)
    own_rig.until(lambda: not own_rig.is_latched())  # nobody acknowledged anything
    assert own_rig.throw(NUDGE).outcome == "completed"


@pytest.mark.slow
def test_a_cell_file_with_another_address_leads_to_another_controller(own_rig: Rig, tmp_path: Path) -> None:
    other = Rig(tmp_path / "other")
    try:
        own_rig.start()
        other.start_simulator()
        own_rig.rewrite(own_rig.path.read_text().replace(own_rig.host, other.host))
        own_rig.until(lambda: own_rig.robot().get("cell_sha256") == own_rig.cell.sha256)
        row = own_rig.throw(NUDGE)
        assert row.outcome == "completed", row.reason
        assert other.state()["measured_q"] == pytest.approx(NUDGE["positions"], abs=1e-3)
    finally:
        other.stop()

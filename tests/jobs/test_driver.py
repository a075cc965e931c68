"""Driving a batch: nothing lost, nothing twice, whoever is killed. Workers are real processes whose work is a fake."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import orjson
import pytest

from jobs import driver
from jobs.batches import BatchRequests, BatchSpecification, CellUse, DrivenBatch, wait_and_claim, write_table
from store import BatchLost, BatchRow, Store
from tests.jobs.fake_planner import CELL, FAKE_PLANS, fake_load_noted, fake_plan_once_loaded


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'fling.db'}"


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    opened = Store.open(url)
    yield opened
    opened.close()


def queue(store: Store, requests: Sequence[dict[str, Any]]) -> str:
    version = store.note_cell_version(CELL.name, CELL.sha256, CELL.text)
    specification = BatchSpecification(BatchRequests(requests), CELL.name, {CELL.name: CellUse(version, None)})
    return store.add_batch(specification.pack(), len(requests)).id


def drive(store: Store, id: str, driver_id: str = "test", **options: Any) -> BatchRow:
    task = DrivenBatch(store, wait_and_claim(store, id, driver_id), **options)
    driver.run(task, 1, work=FAKE_PLANS)
    return store.batch(id)


@pytest.mark.slow
def test_a_worker_has_loaded_everything_before_the_first_row_however_small_the_batch(store: Store):
    """Otherwise the duration of the first rows is that of loading."""
    id = queue(store, [{"value": 1}])
    task = DrivenBatch(store, wait_and_claim(store, id, "test"))
    driver.run(task, 1, work=replace(FAKE_PLANS, load=fake_load_noted, solve=fake_plan_once_loaded))
    ((row,), _) = store.batch_results(id, 10)
    assert row.outcome == "planned"


def test_every_request_has_its_result_and_a_problem_one_plan(store: Store, tmp_path: Path):
    log = tmp_path / "log"
    requests = [{"value": number % 30, "log": str(log)} for number in range(60)]
    requests.append({"value": 100, "infeasible": True})
    progress: list[int] = []
    id = queue(store, requests)
    row = drive(store, id, on_progress=lambda row: progress.append(row.done))
    assert (row.state, row.outcome, row.counts) == ("finished", "completed", {"planned": 60, "infeasible": 1})
    assert progress == sorted(progress)
    assert progress[-1] == 61
    results = store.batch_results(id, 100)[0]
    assert [result.number for result in results] == list(range(61))
    assert [result.release_time_s for result in results[:60]] == [number % 30 for number in range(60)]
    assert len({result.plan_id for result in results[:60]}) == 30
    assert Counter(log.read_text().split()) == {str(value): 1 for value in range(30)}
    stored = store.plan(results[7].plan_id)
    assert orjson.loads(stored.summary)["id"] == stored.id
    assert stored.samples == b"49"
    assert results[60].refusal["violations"][0]["constraint"] == "floor"


def test_a_cancelled_batch_ends_soon(store: Store):
    id = queue(store, [{"value": number, "sleep_s": 0.02} for number in range(3000)])
    row = drive(store, id, on_progress=lambda row: row.done > 10 and store.cancel_batch(id))
    assert (row.outcome, row.state) == ("cancelled", "finished")
    assert 10 < row.done < 1000


@pytest.mark.slow
def test_a_stopped_batch_is_taken_up_again(store: Store):
    id = queue(store, [{"value": number, "sleep_s": 0.005} for number in range(120)])
    stop = threading.Event()
    task = DrivenBatch(store, wait_and_claim(store, id, "one"), lambda row: row.done > 10 and stop.set())
    driver.run(task, 1, must_stop=stop.is_set, work=FAKE_PLANS)
    row = store.batch(id)
    assert row.state == "queued"
    assert 10 < row.done < 120
    assert drive(store, id).counts == {"planned": 120}


@pytest.mark.slow
def test_a_driver_that_was_taken_for_dead_writes_nothing(store: Store):
    id = queue(store, [{"value": number, "sleep_s": 0.01} for number in range(1000)])
    first = DrivenBatch(store, store.claim_batch(id, "one"))
    thief = threading.Timer(2.0, lambda: store.release_batch(id, "one"))
    thief.start()
    with pytest.raises(BatchLost):
        driver.run(first, 1, work=FAKE_PLANS)
    thief.join()
    done = store.batch(id).done
    time.sleep(1.0)
    assert store.batch(id).done == done
    assert store.batch(id).state == "queued"


DRIVER = """
import sys
from jobs import driver
from jobs.batches import DrivenBatch
from store import Store
from tests.jobs.fake_planner import FAKE_PLANS
if __name__ == "__main__":
    store = Store.open(sys.argv[1])
    driver.run(DrivenBatch(store, store.claim_batch(sys.argv[2], "same")), 1, work=FAKE_PLANS)
"""


@pytest.mark.slow
def test_nothing_is_lost_and_nothing_twice_when_the_driver_is_killed(
    store: Store, url: str, tmp_path: Path, root: Path
):
    log = tmp_path / "log"
    script = tmp_path / "driver.py"
    script.write_text(DRIVER)
    count = 150
    id = queue(store, [{"value": number, "sleep_s": 0.01, "log": str(log)} for number in range(count)])
    environment = {**os.environ, "PYTHONPATH": str(root)}
    process = subprocess.Popen([sys.executable, str(script), url, id], env=environment)
    while store.batch(id).done < 20:
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    at_kill = store.batch(id).done
    assert 20 <= at_kill < count
    stored = {row.plan_id: store.plan(row.plan_id).created_at for row in store.batch_results(id, count)[0]}
    row = drive(store, id, "same")
    assert row.counts == {"planned": count}
    rows = store.batch_results(id, count)[0]
    assert [one.number for one in rows] == list(range(count))
    assert {id: store.plan(id).created_at for id in stored} == stored  # untouched
    made = Counter(map(int, log.read_text().split()))
    assert set(made) == set(range(count))
    assert sum(made.values()) - count < 100  # planned twice, for want of a record: what was in hand


def test_tables_have_a_row_a_request(store: Store, tmp_path: Path):
    id = queue(store, [{"value": 1}, {"value": 2, "infeasible": True}])
    drive(store, id)
    results = [(row, {}) for row in store.batch_results(id)[0]]
    for name in ("t.csv", "t.jsonl"):
        write_table(tmp_path / name, results)
    planned, refused = csv.DictReader((tmp_path / "t.csv").read_text().splitlines())
    assert (planned["number"], planned["release_time_s"], planned["constraints"]) == ("0", "1.0", "")
    assert (refused["plan_id"], refused["constraints"], refused["proven"]) == ("", "floor", "True")
    lines = [orjson.loads(line) for line in (tmp_path / "t.jsonl").read_text().splitlines()]
    assert [line["plan_id"] for line in lines] == [results[0][0].plan_id, None]
    with pytest.raises(ValueError, match=r"must end in \.parquet, \.csv, \.jsonl"):
        write_table(tmp_path / "t.txt", results)
    pyarrow = pytest.importorskip("pyarrow.parquet")
    write_table(tmp_path / "t.parquet", results)
    table = pyarrow.read_table(tmp_path / "t.parquet").to_pylist()
    assert [row["release_time_s"] for row in table] == [1.0, None]
    assert [row["proven"] for row in table] == [None, True]


def test_a_table_has_the_values_of_the_grids_axes(store: Store, tmp_path: Path):
    id = queue(store, [{"value": 1}, {"value": 2}])
    drive(store, id)
    axes = [{"release.position[0]": 0.5, "backend": "ruckig"}, {"release.position[0]": 0.6, "backend": "null"}]
    results = list(zip(store.batch_results(id)[0], axes, strict=True))
    write_table(tmp_path / "t.csv", results)
    lines = (tmp_path / "t.csv").read_text().splitlines()
    assert lines[0].startswith("number,release.position[0],backend,outcome,")
    assert [line.split(",")[:3] for line in lines[1:]] == [["0", "0.5", "ruckig"], ["1", "0.6", "null"]]
    pyarrow = pytest.importorskip("pyarrow.parquet")
    write_table(tmp_path / "t.parquet", results)
    table = pyarrow.read_table(tmp_path / "t.parquet")
    assert table.column("release.position[0]").to_pylist() == [0.5, 0.6]
    assert table.column("backend").to_pylist() == ["ruckig", "null"]
    write_table(tmp_path / "none.csv", [])
    assert (tmp_path / "none.csv").read_text().startswith("number,outcome,")

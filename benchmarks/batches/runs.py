"""One batch through a driver process, watched from outside: progress, memory, and whoever is killed on the way."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import psutil

from jobs.batches import BatchRequests, BatchSpecification, CellUse
from planner.cell import read_source
from planner.cell_folder import default_cells_folder
from store import BatchRow, Store

CELL = "ur5e-sim"
POLL_S = 0.25  # [s] between two looks at progress and memory
Kill = Callable[[psutil.Process], None]


@dataclass
class BatchRun:
    """What was seen of one batch.

    Attributes:
        row: the batch at its end.
        hashes: of each request's trajectory, or of its refusal in words.
        plans: number of plans in the store.
        memory: resident bytes of driver and workers, at every look.
        killed: what was killed, with the number of results then.
    """

    row: BatchRow
    hashes: list[str]
    plans: int
    memory: list[int]
    killed: list[tuple[str, int]]


def run_batch(
    folder: Path, requests: Sequence[dict], workers: int, ray: str | None, kills: Sequence[tuple[float, str, Kill]] = ()
) -> BatchRun:
    """Plans requests with `python -m jobs batch` and a store of its own; a driver that was killed is started again.

    Args:
        folder: of the store.
        requests: what to plan.
        workers: number of workers.
        ray: address of a Ray cluster; None: processes of this machine.
        kills: share of the results [-] at which something is killed, its name, and what kills it, given the driver.
    """
    url = f"sqlite:///{folder / 'fling.db'}"
    store = Store.open(url)
    id = _queue(store, requests)
    memory = []
    killed = []
    waiting = list(kills)
    while (row := store.batch(id)) is not None and row.state != "finished":
        driver = _start(url, id, workers, ray)
        while driver.poll() is None:
            time.sleep(POLL_S)
            row = store.batch(id) or row
            memory.append(_resident(driver.pid))
            if waiting and row.done >= waiting[0][0] * row.total:
                _, name, kill = waiting.pop(0)
                killed.append((name, row.done))
                kill(psutil.Process(driver.pid))
    assert row is not None
    results = list(store.all_batch_results(id))
    hashes = [result.trajectory_sha256 or str((result.refusal or {}).get("detail")) for result in results]
    ids = {result.plan_id for result in results if result.plan_id}
    stored = sum(store.plan_summary(one) is not None for one in ids)
    assert [result.number for result in results] == list(range(len(requests)))
    store.close()
    return BatchRun(row, hashes, stored, memory, killed)


def kill_worker(driver: psutil.Process) -> None:
    """Kills a planner process of a driver with processes of this machine."""
    workers = [child for child in driver.children() if "spawn_main" in " ".join(child.cmdline())]
    workers[0].kill()


def kill_actor(_: psutil.Process) -> None:
    """Kills a planner process of a Ray cluster on this machine."""
    actors = [process for process in psutil.process_iter(["cmdline"]) if _is_actor(process)]
    actors[0].kill()


def kill_driver(driver: psutil.Process) -> None:
    """Kills the driver."""
    driver.kill()


def _is_actor(process: psutil.Process) -> bool:
    return bool(process.info["cmdline"]) and process.info["cmdline"][0].startswith("ray::RayPlanner")


def _queue(store: Store, requests: Sequence[dict]) -> str:
    source = read_source(default_cells_folder() / f"{CELL}.toml")
    version = store.note_cell_version(CELL, source.sha256, source.text, source.calibration, "benchmark", source.meshes)
    asked = BatchSpecification(BatchRequests(requests), CELL, {CELL: CellUse(version, None)})
    return store.add_batch(asked.pack(), len(requests), driven_by="command").id


def _start(url: str, id: str, workers: int, ray: str | None) -> subprocess.Popen[bytes]:
    options = ["--workers", str(workers), "--driver", "benchmark", *(["--ray", ray] if ray else [])]
    environment = {**os.environ, "FLING_DATABASE_URL": url}
    return subprocess.Popen([sys.executable, "-m", "jobs", "batch", id, *options], env=environment)


def _resident(pid: int) -> int:
    """Returns the resident bytes of a process and its children; of those of a cluster, none."""
    try:
        process = psutil.Process(pid)
        return sum(one.memory_info().rss for one in [process, *process.children(recursive=True)])
    except psutil.NoSuchProcess:
        return 0

"""`python -m benchmarks.operations`: the service under load; writes `build/benchmarks/operations.md`.

Fifty clients that plan without a pause, against the planner alone on as many processes; and two hundred listeners of
one execution. Service, clients and planner share this machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import platform
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import httpx2
import numpy as np

from benchmarks.results import write_report
from jobs.planning import PlanningJob, solve
from jobs.pool import Work
from planner.cell import read_source
from store import Store

ROOT = Path(__file__).parents[1]
CELL = "ur5e-sim"
REQUEST = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "backend": "ruckig"}
CLIENTS = 50
WORKERS = 2
LISTENERS = 200
HEALTH_S = 0.05  # [s] between two requests for /healthz
EVENT_S = 0.04  # [s] between two telemetry events: 25 Hz, as the executor writes them
READY_S = 600.0  # [s] planner processes of lowest priority load and warm up on a busy machine
END_S = 300.0  # [s] beyond a load for its last answers
PAUSE_S = 0.2  # [s] of a client after a connection that failed
NO_ANSWER = "no answer"
LATER = " after the end"


def main(argv: Sequence[str]) -> int:
    """Measures, writes the page and returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.operations", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each of the three loads")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "benchmarks")
    given = parser.parse_args(argv)
    alone = planner_alone(given.seconds)
    with tempfile.TemporaryDirectory() as folder, service(Path(folder)) as (port, url):
        planning = asyncio.run(clients(port, given.seconds))
        listening = asyncio.run(listeners(port, url, given.seconds))
    text = page(given.seconds, alone, planning, listening)
    write_report(text, given.out, "operations.md")
    print(text)
    return 0


def planner_alone(seconds: float) -> float:
    """Returns the plans per second of as many processes without a service."""
    job = PlanningJob("alone", 0.0, read_source(ROOT / "cells" / f"{CELL}.toml"), {**REQUEST, "cell": CELL})
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(WORKERS, context, Work(warm_up=job).begin) as pool:
        list(pool.map(solve, [job] * WORKERS))
        return sum(pool.map(_plans_within, [job] * WORKERS, [seconds] * WORKERS)) / seconds


def _plans_within(job: PlanningJob, seconds: float) -> int:
    end = time.monotonic() + seconds
    count = 0
    while True:
        solve(job)
        if time.monotonic() > end:  # this one was not made within the load
            return count
        count += 1


@contextmanager
def service(folder: Path) -> Iterator[tuple[int, str]]:
    """Runs a service; yields its port and the URL of its database."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    url = f"sqlite:///{folder / 'fling.db'}"
    own = {"FLING_DATABASE_URL": url, "FLING_PORT": str(port), "FLING_CELLS": str(ROOT / "cells")}
    own |= {"FLING_PLANNER_WORKERS": str(WORKERS)}
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen([sys.executable, "-m", "api"], cwd=ROOT, env={**os.environ, **own}, stderr=log)
    try:
        _await_ready(port)
        yield port, url
    finally:
        process.terminate()
        process.wait(150.0)


def _await_ready(port: int) -> None:
    deadline = time.monotonic() + READY_S
    while time.monotonic() < deadline:
        try:
            if httpx2.get(f"http://127.0.0.1:{port}/readyz").status_code == 200:
                return
        except httpx2.TransportError:
            pass
        time.sleep(0.1)
    raise TimeoutError(f"the service was not ready within {READY_S:g} s")


async def clients(port: int, seconds: float) -> dict[str, Any]:
    """Returns statuses, plans per second and times of /healthz [s] under fifty clients."""
    statuses: Counter[str] = Counter()
    limits = httpx2.Limits(max_connections=None)
    async with (
        _health_reader() as health_times,
        httpx2.AsyncClient(base_url=f"http://127.0.0.1:{port}", timeout=120.0, limits=limits) as http,
    ):

        async def plan() -> None:
            while time.monotonic() < end:
                try:
                    response = await http.post("/plan?trajectory=false", json=REQUEST)
                except httpx2.TransportError:
                    statuses[NO_ANSWER] += 1
                    await asyncio.sleep(PAUSE_S)
                    continue
                in_time = time.monotonic() < end  # a plan that ends later was not made within the load
                statuses[_kind(response) + ("" if in_time else LATER)] += 1
                if response.status_code == 429:
                    await asyncio.sleep(float(response.headers["retry-after"]))

        end = time.monotonic() + seconds
        health = asyncio.create_task(health_times(port, seconds))
        async with asyncio.timeout(seconds + END_S):
            await asyncio.gather(*(plan() for _ in range(CLIENTS)))
            return {"statuses": dict(statuses), "rate": statuses["201"] / seconds, "health": await health}


def _kind(response: httpx2.Response) -> str:
    if response.status_code < 400:
        return str(response.status_code)
    return f"{response.status_code} {response.json()['type'].rsplit('/', 1)[1]}"


@asynccontextmanager
async def _health_reader() -> AsyncIterator[Callable[[int, float], Coroutine[Any, Any, list[float]]]]:
    """Yields a function that returns how long each request for /healthz took [s], as a process of its own sees it."""
    loop = asyncio.get_running_loop()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context) as pool:  # not behind fifty clients in one event loop: it would measure them

        async def health_times(port: int, seconds: float) -> list[float]:
            return await loop.run_in_executor(pool, _health_times, port, seconds)

        await health_times(0, 0.0)  # its start is no part of the load
        yield health_times


def _health_times(port: int, seconds: float) -> list[float]:
    times = []
    end = time.monotonic() + seconds
    with httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=60.0) as http:
        while time.monotonic() < end:
            began = time.perf_counter()
            http.get("/healthz").raise_for_status()
            times.append(time.perf_counter() - began)
            time.sleep(HEALTH_S)
    return times


async def listeners(port: int, url: str, seconds: float) -> dict[str, Any]:
    """Returns the delays of events at two hundred listeners, and times of /healthz [s]."""
    store = Store.open(url)
    plan_id = store.plans(1)[0][0].id
    execution_id = store.queue_execution(plan_id, CELL).id
    store.close()
    writer = multiprocessing.get_context("spawn").Process(target=_write, args=(url, execution_id, seconds))
    delays: list[float] = []
    async with _health_reader() as health_times, asyncio.timeout(seconds + END_S):
        tasks = [asyncio.create_task(_listen(port, execution_id, delays)) for _ in range(LISTENERS)]
        await asyncio.sleep(2.0)
        writer.start()
        health = asyncio.create_task(health_times(port, seconds))
        ended = await asyncio.gather(*tasks)
        writer.join()
        return {"delays": delays, "health": await health, "complete": sum(ended)}


def _write(url: str, execution_id: str, seconds: float) -> None:
    """Writes telemetry as the executor does, then ends the execution."""
    store = Store.open(url)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        data = {
            "written_at": time.time(),
            "positions": [0.1] * 6,
            "velocities": [0.2] * 6,
            "planned_positions": [0.3] * 6,
        }
        store.add_event(execution_id, "telemetry", data)
        time.sleep(EVENT_S)
    store.finish_execution(execution_id, "completed")
    store.close()


async def _listen(port: int, execution_id: str, delays: list[float]) -> bool:
    """Adds the delay of each telemetry event [s]; returns whether the stream came to its end."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(f"GET /executions/{execution_id}/events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
    finished = False
    while not finished and (line := await reader.readline()):
        if line.startswith(b"data: "):
            data = json.loads(line[6:])
            finished = data.get("state") == "finished"
            if "written_at" in data:
                delays.append(time.time() - data["written_at"])
    writer.close()
    return finished


def page(seconds: float, alone: float, planning: dict[str, Any], listening: dict[str, Any]) -> str:
    """Returns the page."""
    statuses = ", ".join(f"{count} × {kind}" for kind, count in sorted(planning["statuses"].items()))
    delays = listening["delays"]
    share = planning["rate"] / alone
    load = f"{os.getloadavg()[0]:.1f}"
    machine = f"{os.cpu_count()} cores, Python {platform.python_version()}, SQLite"
    shared = f"service, {WORKERS} planner processes and clients share them. Load average at the end: {load}."
    return f"""# The service under load

`python -m benchmarks.operations --seconds {seconds:g}` on {machine}; {shared}

| {CLIENTS} clients that plan without a pause, for {seconds:g} s | |
|---|---|
| answers | {statuses} |
| plans per second | {planning["rate"]:.1f} |
| plans per second of {WORKERS} planner processes alone | {alone:.1f} |
| share | {100.0 * share:.0f} % |
| `/healthz`, p50, p99 | {_ms(planning["health"], 50)}, {_ms(planning["health"], 99)} |

| {LISTENERS} listeners of one execution, 25 events per second, for {seconds:g} s | |
|---|---|
| streams that came to their end | {listening["complete"]} |
| delay of an event, p50, p99, largest | {_ms(delays, 50)}, {_ms(delays, 99)}, {_ms(delays, 100)} |
| `/healthz`, p50, p99 | {_ms(listening["health"], 50)}, {_ms(listening["health"], 99)} |
"""


def _ms(times_s: Sequence[float], percentile: float) -> str:
    return f"{1e3 * float(np.percentile(times_s, percentile)):.0f} ms"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

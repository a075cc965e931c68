"""Clients of a soak: they throw, plan batches and maps, watch, read; and one that asks for stops."""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import httpx2

from benchmarks.soak.station import CELL

TIMEOUT_S = 120.0  # [s] of a request: a plan waits in line
RETRY_S = 0.5  # [s] after an answer that says "not now"
STOP_PERIOD_S = 0.5  # [s] between two stops
ASTRAY_M = 0.05  # [m] a completed throw that lands farther off is one that went astray
JOINT = {"kind": "joint", "positions": [0.25, -1.45, 1.45, -1.5, -1.45, 0.1],
         "velocities": [1.2, 0.6, -0.6, 0.3, 0.5, 0.2]}  # fmt: skip


class Tally:
    """What the clients were answered, for all threads.

    Attributes:
        statuses: answers by status.
        outcomes: executions by outcome.
        lost: what was promised and is not there, in words.
        stops_s: how long each stop took [s].
    """

    def __init__(self) -> None:
        self.statuses: Counter[int] = Counter()
        self.outcomes: Counter[str] = Counter()
        self.lost: list[str] = []
        self.stops_s: list[float] = []


class Client:
    """One client in a thread: it does one thing after another until it is told to end.

    Args:
        url: of the service.
        tally: takes the answers.
        seed: of what it does.
    """

    def __init__(self, url: str, tally: Tally, seed: int) -> None:
        self._http = httpx2.Client(base_url=url, timeout=TIMEOUT_S)
        self._tally = tally
        self._random = random.Random(seed)
        self.ended = threading.Event()
        self._thread = threading.Thread(target=self._go_on, daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Tells it to end, and waits for that."""
        self.ended.set()
        self._thread.join()
        self._http.close()

    def _go_on(self) -> None:
        acts: list[Callable[[], None]] = [self._throw, self._throw, self._throw, self._read, self._batch, self._map]
        while not self.ended.is_set():
            try:
                self._random.choice(acts)()
            except httpx2.TransportError as error:  # the service never goes away in a soak
                self._tally.lost.append(f"no answer: {error!r}")
                self.ended.wait(RETRY_S)

    def _ask(self, method: str, path: str, body: Any = None) -> Any:
        """Returns the document of an answer, None of a refusal."""
        answer = self._http.request(method, path, json=body)
        self._tally.statuses[answer.status_code] += 1
        return answer.json() if answer.status_code < 400 else None

    def _throw(self) -> None:
        """Plans, executes, watches to the end, and reads the recording."""
        release = JOINT
        if self._random.random() < 0.5:
            x, y = self._random.uniform(0.9, 1.3), self._random.uniform(-0.4, 0.4)
            release = {"kind": "target", "position": [x, y, 0.0]}
        plan = self._ask("POST", "/plan", {"release": release})
        if plan is None:
            self.ended.wait(RETRY_S)
            return
        if self._ask("GET", f"/plans/{plan['id']}?trajectory=false") is None:
            self._tally.lost.append(f"plan {plan['id']}")
        run = self._ask("POST", "/execute", {"plan_id": plan["id"]})
        if run is None:
            self.ended.wait(RETRY_S)
            return
        self._watch(f"/executions/{run['id']}/events")
        self._judge(run["id"])

    def _watch(self, path: str) -> None:
        with self._http.stream("GET", path) as stream:
            self._tally.statuses[stream.status_code] += 1
            for _ in stream.iter_lines():
                pass

    def _judge(self, id: str) -> None:
        run = self._ask("GET", f"/executions/{id}")
        if run is None or run["outcome"] is None:
            self._tally.lost.append(f"execution {id} has no end")
            return
        self._tally.outcomes[run["outcome"]] += 1
        error_m = (run["metrics"] or {}).get("landing_error_m")
        if run["outcome"] == "completed" and error_m is not None and error_m > ASTRAY_M:
            self._tally.lost.append(f"execution {id} is completed, and landed {error_m:.3f} m off")
        if run["outcome"] != "completed":
            self._ask("POST", f"/cells/{CELL}/acknowledge")
        self._http.get(f"/executions/{id}/recording")

    def _read(self) -> None:
        for path in ("/plans?limit=50", "/executions?limit=50", "/cells", "/plans/latest/curves", "/metrics"):
            self._http.get(path)

    def _batch(self) -> None:
        """Has some requests planned, watches, reads the results; every other one is cancelled."""
        grid = {"release.position[0]": [1.0, 1.2, 0.1], "release.position[1]": [-0.1, 0.1, 0.1]}
        template = {"release": {"kind": "target", "position": [1.0, 0.0, 0.0]}, "release_window_s": 0.0}
        batch = self._ask("POST", "/batches", {"template": template, "grid": grid})
        if batch is None:
            self.ended.wait(RETRY_S)
            return
        if self._random.random() < 0.5:
            self._ask("POST", f"/batches/{batch['id']}/cancel")
        self._watch(f"/batches/{batch['id']}/events")
        self._http.get(f"/batches/{batch['id']}/results", headers={"Accept": "text/csv"})

    def _map(self) -> None:
        z = round(self._random.uniform(0.0, 0.3), 2)
        body = {"plane_z_m": z, "resolution_m": 0.5, "extent_m": [0.8, 1.8, -0.5, 0.5]}
        head = self._ask("POST", f"/cells/{CELL}/map", body)
        if head is not None:
            self._ask("GET", f"/cells/{CELL}/map?id={head['id']}")


class Stopper:
    """Asks for a stop twice a second, of an execution that has ended: the same way, without an end to the load."""

    def __init__(self, url: str, tally: Tally) -> None:
        self._url = url
        self._tally = tally
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._go_on, daemon=True)
        self._thread.start()

    def join(self) -> None:
        """Tells it to end, and waits for that."""
        self._ended.set()
        self._thread.join()

    def _go_on(self) -> None:
        with httpx2.Client(base_url=self._url, timeout=TIMEOUT_S) as http:
            finished = None
            while not self._ended.wait(STOP_PERIOD_S):
                if finished is None:
                    listed = http.get("/executions?limit=5").json()["executions"]
                    finished = next((run["id"] for run in listed if run["state"] == "finished"), None)
                    continue
                began_at = time.perf_counter()
                answer = http.post(f"/executions/{finished}/abort")
                self._tally.stops_s.append(time.perf_counter() - began_at)
                self._tally.statuses[answer.status_code] += 1
                if answer.status_code == 404:  # retention has deleted it
                    finished = None

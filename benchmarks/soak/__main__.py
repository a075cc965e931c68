"""`python -m benchmarks.soak --minutes 10`: exit status 0 where everything held."""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

from benchmarks.soak.clients import Client, Stopper, Tally
from benchmarks.soak.station import ROOT, Station, Usage
from benchmarks.soak.verdict import faults, growth

CLIENTS = 4
HOSTILE = 20
SAMPLE_S = 5.0  # [s] between two looks at what the processes use
KILL_S = 20.0  # [s] between two kills, in the mean
ATTACK_S = 20.0  # [s] of hostile requests, and of peace after them
VICTIMS = ("planner", "streaming", "driver")
DAEMON_SHARE = 0.2  # [-] of the soak in which the executor's daemon is killed, too: what is young has not grown yet


class Attacks:
    """Hostile clients for a while, and again after a while, in a process of their own."""

    def __init__(self, url: str, clients: int) -> None:
        self._url = url
        self._clients = clients
        self._next_at = time.monotonic() + ATTACK_S
        self._process: subprocess.Popen[str] | None = None
        self.statuses: dict[str, int] = {}

    def go_on(self) -> None:
        """Begins an attack that is due, and takes the answers of one that has ended."""
        if self._process is not None and self._process.poll() is not None:
            self._take()
        if self._clients and self._process is None and time.monotonic() > self._next_at:
            command = [sys.executable, "-m", "benchmarks.soak.hostile", self._url, str(ATTACK_S), str(self._clients)]
            self._process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)

    def end(self) -> None:
        """Waits for an attack under way."""
        if self._process is not None:
            self._take()

    def _take(self) -> None:
        assert self._process is not None
        text, _ = self._process.communicate()
        for status, count in json.loads(text).items():
            self.statuses[status] = self.statuses.get(status, 0) + count
        self._process = None
        self._next_at = time.monotonic() + ATTACK_S


def soak(station: Station, minutes: float, hostile: int, seed: int) -> list[str]:
    """Returns what did not hold, in words; prints what was seen."""
    chance = random.Random(seed)
    tally = Tally()
    clients = [Client(station.url, tally, seed + k) for k in range(CLIENTS)]
    stopper = Stopper(station.url, tally)
    attacks = Attacks(station.url, hostile)
    usages: list[Usage] = []
    shared: list[int] = []
    kills: Counter[str] = Counter()
    began_at = time.monotonic()
    kill_at = began_at + KILL_S
    ends_at = began_at + 60.0 * minutes
    while time.monotonic() < ends_at:
        time.sleep(SAMPLE_S)
        usages += station.usages()
        shared.append(station.shared_memory())
        attacks.go_on()
        if time.monotonic() > kill_at:
            is_early = time.monotonic() - began_at < DAEMON_SHARE * 60.0 * minutes
            victim = chance.choice([*VICTIMS, "executor"] if is_early else VICTIMS)
            kills[victim] += station.kill(victim)
            kill_at = time.monotonic() + chance.uniform(0.5, 1.5) * KILL_S
        station.revive()
        _print_line(station, usages, shared[-1], tally)
    attacks.end()
    stopper.join()
    for client in clients:
        client.ended.set()
    for client in clients:
        client.join()
    stops = sorted(tally.stops_s) or [0.0]
    print(
        f"kills {dict(kills)}; answers {dict(tally.statuses)}; outcomes {dict(tally.outcomes)}; hostile {attacks.statuses}"
    )
    high = stops[int(0.99 * len(stops))]
    print(f"{len(stops)} stops: p50 {stops[len(stops) // 2]:.3f} s, p99 {high:.3f} s, max {stops[-1]:.3f} s")
    return [*growth(usages, shared), *faults(tally, attacks.statuses), *station.errors()]


def _print_line(station: Station, usages: list[Usage], shared: int, tally: Tally) -> None:
    newest = {usage.role: usage for usage in usages}
    parts = [
        f"{role} {u.memory_mb:.0f} MB {u.descriptors} fds {u.threads} threads {u.sockets} sockets"
        for role, u in newest.items()
    ]
    at = time.monotonic() - station.began_at
    print(f"{at:6.0f} s: {'; '.join(parts)}; shm {shared}; {sum(tally.outcomes.values())} throws", flush=True)


def main() -> int:
    """Returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--hostile", type=int, default=HOSTILE, help="hostile clients; 0: none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--host", default="127.0.46.1", help="loopback address of the simulated controller")
    parser.add_argument("--keep", type=Path, help="folder for database and logs; by default they are deleted")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="fling-soak-", ignore_cleanup_errors=True) as temporary:
        folder = asked.keep or Path(temporary)
        with Station(folder, asked.host) as station, suppress(KeyboardInterrupt):
            found = soak(station, asked.minutes, asked.hostile, asked.seed)
            print("\n".join(found) or "everything held")
            return 1 if found else 0
    return 130


if __name__ == "__main__":
    sys.exit(main())

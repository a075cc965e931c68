"""How soon an execution moves: `python -m benchmarks.streaming.first_motion [--throws 10]`.

A service, an executor and a simulated controller, in real time. Throws from where the arm stands, so that no approach
precedes them: the gripper is open, as the throw before left it, or was closed before, as a pick does it. Told: the
median time from the request (`POST /execute`) to the first tick of the motion, by the controller's own clock, to the
executor's claim, and `metrics.ready_s`; and from the end of the motion to the result, which the next request waits for.
"""

from __future__ import annotations

import argparse
import csv
import io
import socket
import time
from collections.abc import Mapping
from datetime import datetime
from statistics import median
from typing import Any

from benchmarks.learning.whole_stack import CELL, SEEN_S, Laboratory, running_cell
from executor.robot import simulator_client

HOST = "127.0.82.11"
PORT = 8821
SECONDARY = 30002  # port of the controller's secondary interface
CLOSE = b"sec close():\n  set_tool_digital_out(0, False)\nend\n"
CLOSED_S = 0.5  # [s] that the gripper is given
KEYS = ("claimed", "ready", "first tick", "result")


def main() -> None:
    """Measures, and prints the medians."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming.first_motion", description=__doc__)
    parser.add_argument("--throws", type=int, default=10)
    given = parser.parse_args()
    with running_cell("", host=HOST, port=PORT) as lab:
        thrown(lab, 0)  # the first loads what later ones have
        for words, is_closed in (("gripper open", False), ("gripper closed", True)):
            found = []
            while len(found) < given.throws:
                if is_closed:
                    closed()
                one = thrown(lab, len(found))
                if one is not None:
                    found.append(one)
            told = ", ".join(f"{key} {median(each[key] for each in found):.3f} s" for key in KEYS)
            print(f"{words}, {len(found)} throws: {told}", flush=True)


def closed() -> None:
    """Closes the gripper, as a person at the pendant does."""
    with socket.create_connection((HOST, SECONDARY)) as pendant:
        pendant.sendall(CLOSE)
        time.sleep(CLOSED_S)


def thrown(lab: Laboratory, number: int) -> Mapping[str, float] | None:
    """Makes one throw; returns its times [s], None where the machine was too busy for it."""
    release = {"kind": "target", "position": [1.2, 0.3 + 0.01 * number, 0.0]}
    start = {"current": True}
    plan = lab.client.plan({"cell": CELL, "release": release, "start": start}, trajectory=False).document
    asked_s = controller_s()
    asked_at = time.time()
    id = lab.client.execute(plan["id"])["id"]
    outcome = dict(lab.client.finished(id))["outcome"]
    result_s = controller_s()
    if outcome != "completed":
        print(f"  {outcome}: {lab.client.get(f'/executions/{id}')['reason']}", flush=True)
        lab.acknowledge()
        return None
    time.sleep(SEEN_S)
    return times(lab.client.get(f"/executions/{id}"), rows(lab, id), asked_at, asked_s, result_s)


def times(
    row: Mapping[str, Any], ticks: list[dict[str, str]], asked_at: float, asked_s: float, result_s: float
) -> dict[str, float]:
    """Returns the times of an execution that was asked for at a wall time and a controller's time [s]."""
    first_s, last_s = (float(ticks[at]["timestamp_s"]) for at in (0, -1))
    return {
        "claimed": datetime.fromisoformat(row["claimed_at"]).timestamp() - asked_at,
        "ready": row["metrics"]["ready_s"],
        "first tick": first_s - asked_s,
        "result": result_s - last_s,
    }


def rows(lab: Laboratory, id: str) -> list[dict[str, str]]:
    """Returns the ticks of a recording."""
    return list(csv.DictReader(io.StringIO(lab.client.text(f"/executions/{id}/recording", "text/csv"))))


def controller_s() -> float:
    """Returns the controller's time [s]."""
    return float(simulator_client.request(HOST, "state")["t"])


if __name__ == "__main__":
    main()

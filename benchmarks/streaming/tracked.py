"""Throws into bins that a camera tracks: `python -m benchmarks.streaming.tracked [--throws 20] [--stops 0.2]`.

A service, an executor and a simulated controller with a hidden truth (lag, gripper, release, drag, arm), calibrated as
docs/learning.md has it unless `--no-calibration`, in real time. A bin of 12 cm radius passes in front of the arm at 0.1
to 0.5 m/s. From `--seen-s` before it passes a camera sees it at 30 Hz with 3 mm of noise. After `--tracked-s` of that a
throw at the tracked target is asked for, again and again until there is a plan or the bin is out of reach, and executed
while the camera goes on; one that is refused as too late is asked for anew, up to three times. In a share of `--stops`
the belt stops at a random instant before the throw. Where the bin really is only this module knows: the object is in it
if it lands with all of it within the mouth there. "At a bin that is gone" is a throw whose last plan met the bin
farther from where it really was than that room.
"""

from __future__ import annotations

import argparse
import threading
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

import fling
from benchmarks.learning.whole_stack import CELL, Laboratory, drawn_truth, running_cell
from executor.robot import simulator_client

HOST = "127.0.62.21"
PORT = 8762
BIN = {"radius_m": 0.12, "rim_height_m": 0.15}
ROOM_M = 0.10  # of an object of 2 cm radius
SPEEDS_M_S = (0.1, 0.5)
SLANT_RAD = 0.5  # [rad] of the belt against the arm's side
PASSES_M = ((0.9, 1.3), (-0.3, 0.3))  # [m] along x and y
CAMERA_HZ = 30.0
NOISE_M = 0.003
STARTS_BEFORE_S = 1.0  # [s] a throw is to begin before the bin is at the middle of its way, known to the line
GONE_S = 3.0  # [s] after which a bin that has passed is out of reach, at most speeds
ATTEMPTS = 3
MARGIN_S = 0.1
SLOWER = 1.2  # than the slowest of late: an attempt that was not even prepared in time
SHORTER = 0.8  # than the middle of late: or one slow attempt keeps every later bin out of reach
AGAIN_S = 0.1  # [s] between two attempts to plan


@dataclass(frozen=True)
class BeltRun:
    """How a bin really moves: evenly, until the belt stops.

    Attributes:
        passes: where it is at `passes_s` unless the belt has stopped (2,) [m].
        velocity: (2,) [m/s].
        passes_s, stops_s: times on the controller's clock [s].
    """

    passes: np.ndarray
    velocity: np.ndarray
    passes_s: float
    stops_s: float

    def at(self, t: float) -> np.ndarray:
        """Returns where the bin is (2,) [m]."""
        return self.passes + (min(t, self.stops_s) - self.passes_s) * self.velocity


class Camera(threading.Thread):
    """Tells the service what it sees of a bin, until it is stopped."""

    def __init__(self, client: fling.Client, belt: BeltRun, rng: np.random.Generator, drift_m_s: float) -> None:
        super().__init__(daemon=True)
        self.client = client
        self.belt = belt
        self.rng = rng
        self.drift_m_s = drift_m_s
        self.target: dict[str, Any] = {}
        self.refused = 0
        self.begun = threading.Event()
        self.ended = threading.Event()

    def run(self) -> None:
        """Observes at the camera's rate, or as fast as the service answers."""
        while not self.ended.is_set():
            due_s = time.monotonic() + 1.0 / CAMERA_HZ
            now_s = clock_s()
            place = [*(self.belt.at(now_s) + NOISE_M * self.rng.standard_normal(2)).tolist(), 0.0]
            try:
                if self.target:
                    self.client.observe(self.target, place, NOISE_M, now_s)
                else:
                    self.target = self.client.track(CELL, place, NOISE_M, now_s, drift_m_s=self.drift_m_s)
                    self.begun.set()
            except fling.ServiceRefusal:
                self.refused += 1
            time.sleep(max(due_s - time.monotonic(), 0.0))


def clock_s() -> float:
    """Returns the controller's time [s]."""
    return float(simulator_client.request(HOST, "state")["t"])


def drawn_belt(rng: np.random.Generator, now_s: float, seen_s: float, stops: float) -> BeltRun:
    """Returns a belt whose bin passes in front of the arm `seen_s` [s] from now; a share of them stops before."""
    angle = float(rng.uniform(-SLANT_RAD, SLANT_RAD)) + float(rng.choice([0.5, -0.5])) * np.pi
    velocity = float(rng.uniform(*SPEEDS_M_S)) * np.array([np.cos(angle), np.sin(angle)])
    passes = np.array([float(rng.uniform(*each)) for each in PASSES_M])
    stop_s = now_s + float(rng.uniform(0.3, 1.0)) * seen_s
    return BeltRun(passes, velocity, now_s + seen_s, stop_s if rng.random() < stops else np.inf)


def planned(
    lab: Laboratory, camera: Camera, belt: BeltRun, needed_s: list[float]
) -> tuple[dict[str, Any], float] | str:
    """Returns a plan to a tracked bin and how long it took [s], or the last refusal once the bin is out of reach.

    It is to start as soon as nine of the last ten attempts that were noted would have been ready, see `executed`.
    """
    release = {"kind": "target", "position": {"target": camera.target["id"]}, "opening": BIN}
    while True:
        now_s = clock_s()
        starts_s = max(belt.passes_s - STARTS_BEFORE_S, now_s + float(np.quantile(needed_s[-10:], 0.9)))
        asked = {"cell": CELL, "start": {"current": True}, "release": release, "starts_not_before_s": starts_s}
        asked["time_limit_s"] = starts_s - now_s  # a plan found after its start comes too late
        begun_s = time.monotonic()
        try:
            return dict(lab.client.plan(asked, trajectory=False).document), time.monotonic() - begun_s
        except fling.ServiceRefusal as refusal:
            if clock_s() > belt.passes_s + GONE_S:
                return f"{refusal.name}: {str(refusal.problem.get('detail'))[:50]}"
            time.sleep(AGAIN_S)


def executed(
    lab: Laboratory, camera: Camera, belt: BeltRun, needed_s: list[float]
) -> tuple[dict[str, Any] | str, dict[str, Any]]:
    """Returns a plan, or why there is none, and its execution; plans again where it was refused as too late.

    `needed_s` receives what each attempt took.
    """
    refusal = "no attempt"
    for attempt in range(1, ATTEMPTS + 1):
        found = planned(lab, camera, belt, needed_s)
        if isinstance(found, str):
            return found, {}
        plan, took_s = found
        done = {**lab.client.finished(lab.client.execute(plan["id"])["id"]), "attempt": attempt, "took_s": took_s}
        ready_s = (done["metrics"] or {}).get("ready_s")
        needed_s.append(SLOWER * max(needed_s[-10:]) if ready_s is None else MARGIN_S + took_s + ready_s)
        if done["outcome"] != "refused":
            return plan, done
        lab.acknowledge()
        refusal = str(done["reason"])
    return refusal, {}


def throw_once(
    lab: Laboratory,
    rng: np.random.Generator,
    given: argparse.Namespace,
    needed_s: list[float],
    tally: Counter[str],
    misses_m: list[float],
) -> str:
    """Throws at one bin; returns what became of it."""
    belt = drawn_belt(rng, clock_s(), given.seen_s, given.stops)
    camera = Camera(lab.client, belt, rng, given.drift_m_s)
    camera.start()
    landings = len(simulator_client.request(HOST, "world")["landings"])
    try:
        camera.begun.wait(10.0)
        time.sleep(given.tracked_s)
        plan, done = executed(lab, camera, belt, needed_s)
        if isinstance(plan, str):
            if plan.startswith("solver-failed"):
                needed_s.append(SLOWER * max(needed_s[-10:]))
            if plan.startswith("invalid-request"):  # nobody knows where a bin is so long after
                needed_s.append(SHORTER * float(np.median(needed_s[-10:])))
            tally["refused"] += 1
            return f"refused: {plan}"
    finally:
        camera.ended.set()
        camera.join()
    joined = [each for each in done["replacements"] if each["joins_s"] is not None]
    times = f"attempt {done['attempt']}, planned in {done['took_s']:.2f} s and again {len(joined)} times"
    words = f"{done['outcome']}: {times}, {camera.refused} observations refused"
    found = simulator_client.request(HOST, "world")["landings"]
    if len(found) == landings:
        tally["kept"] += 1
        lab.acknowledge()
        return f"{words}: {done['reason']}"
    last = lab.client.get(f"/plans/{joined[-1]['plan_id']}?trajectory=false") if joined else plan
    landing = found[-1]
    real = belt.at(landing["t"])
    off_m = float(np.linalg.norm(np.array(landing["position_m"][:2]) - real))
    meant_off_m = float(np.linalg.norm(met_at(last) - real))
    misses_m.append(off_m)
    gone = meant_off_m > ROOM_M
    tally["at a bin that is gone" if gone else "in the bin" if off_m <= ROOM_M else "missed"] += 1
    if done["outcome"] not in ("completed", "held"):
        lab.acknowledge()
    return f"{words}: {1e3 * off_m:.0f} mm off the bin, which was {1e3 * meant_off_m:.0f} mm from where the plan met it"


def met_at(plan: dict[str, Any]) -> np.ndarray:
    """Returns where a plan meets its target (2,) [m]."""
    release = plan["request"]["release"]
    lands_s = plan["starts_at_s"] + plan["release_time_s"] + plan["flight"]["time_of_flight_s"]
    place = np.array(release["position"]) + (lands_s - release["observed_at_s"]) * np.array(release["velocity"])
    return place[:2]


def main() -> None:
    """Throws, and prints each throw and the tally."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming.tracked", description=__doc__)
    parser.add_argument("--throws", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seen-s", type=float, default=8.0, help="from the first look until the bin passes")
    parser.add_argument("--tracked-s", type=float, default=1.0, help="from the first look until a plan is asked for")
    parser.add_argument("--soon-s", type=float, default=2.0, help="to plan and to start, for the first throw")
    parser.add_argument("--drift-m-s", type=float, default=0.005, help="as the tracked target states it")
    parser.add_argument("--stops", type=float, default=0.0, help="share of belts that stop before")
    parser.add_argument("--no-calibration", action="store_true")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    tally: Counter[str] = Counter()
    misses_m: list[float] = []
    needed_s = [float(given.soon_s)]
    with running_cell(drawn_truth(rng).text, host=HOST, port=PORT) as lab:
        if not given.no_calibration:
            lab.command("calibrate", "lag", "--cell", CELL, "--adopt")
            lab.command("calibrate", "gripper", "--cell", CELL, "--adopt")
        for number in range(given.throws):
            print(number, throw_once(lab, rng, given, needed_s, tally, misses_m), flush=True)
    p50, p95 = 1e3 * np.percentile(misses_m or [np.nan], [50, 95])
    print(f"{dict(tally)}; off the real bin {p50:.0f} mm (p50), {p95:.0f} mm (p95)")


if __name__ == "__main__":
    main()

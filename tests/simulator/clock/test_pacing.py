"""The grid of cycles on a machine that stalls: controller time slips, and a client keeps its time to answer."""

from __future__ import annotations

import random
from collections.abc import Callable
from itertools import pairwise

import pytest

from simulator.clock.pacing import CyclePacing, LatenessHistogram

TICK_S = 0.0003  # [s] to compute a cycle and send its state
JITTER_S = 50e-6  # [s] by which every wake-up is late
ANSWER_S = 0.0006  # [s] processor time of a client's answer


class Machine:
    """A processor shared by a simulator and a client that is interrupted by it; stalls stop both."""

    def __init__(self, dt: float, stall: Callable[[], float], stall_tolerant: bool = True) -> None:
        self.dt = dt
        self.stall = stall
        self.pacing = CyclePacing(dt, stall_tolerant)
        self.now = 0.0
        self.begun = []
        self.unanswered = 0
        self.pacing.is_real_time = True
        self.pacing.start(0.0)

    def cycle(self) -> None:
        """Sleeps until a cycle is due, as the loop does, and runs it."""
        pacing = self.pacing
        client_s = 0.0
        while True:
            rest = pacing.sleep_s(self.now)
            client_s += rest
            self.now += rest + JITTER_S + self.stall()
            pacing.woke(self.now, client_s < ANSWER_S)
            if self.now >= pacing.due:
                break
        self.unanswered += client_s < ANSWER_S
        self.begun.append(self.now)
        pacing.cycle_begun(self.now)
        self.now += TICK_S + self.stall()
        pacing.state_sent(self.now)


@pytest.mark.parametrize("dt", [0.002, 0.008])
def test_a_punctual_machine_keeps_to_the_grid(dt: float) -> None:
    machine = Machine(dt, lambda: 0.0)
    for _ in range(1000):
        machine.cycle()
    assert 0.0 <= machine.begun[-1] - 1000 * dt <= 1.001 * JITTER_S
    assert vars(machine.pacing.slips) == {"count": 0, "total_s": 0.0, "max_s": 0.0}
    assert machine.pacing.lateness.largest <= 1.001 * JITTER_S


@pytest.mark.parametrize("dt", [0.002, 0.008])
def test_on_a_machine_that_stalls_a_client_has_its_time_for_every_answer(dt: float) -> None:
    draw = random.Random(0)
    machine = Machine(dt, lambda: draw.uniform(0.0, 0.015) if draw.random() < 0.02 else 0.0)
    for _ in range(5000):
        machine.cycle()
    slips = machine.pacing.slips
    assert slips.count > 100
    assert machine.unanswered == 0
    assert machine.pacing.due == pytest.approx(5001 * dt + slips.total_s)  # all that the grid has lost is counted
    assert slips.max_s < 0.030 + dt


def test_a_long_stall_is_one_slip_and_one_cycle() -> None:
    stalls = [0.0] * 10 + [3.0] + [0.0] * 20
    machine = Machine(0.002, lambda: stalls.pop(0) if stalls else 0.0)
    for _ in range(10):
        machine.cycle()
    assert (machine.pacing.slips.count, machine.pacing.slips.max_s) == (1, pytest.approx(3.0, abs=0.003))
    steps = [b - a for a, b in pairwise(machine.begun)]
    assert sorted(steps)[-1] > 3.0
    assert min(steps) > 0.0019


def test_at_ordinary_priority_the_grid_slips_by_what_is_overdue_alone() -> None:
    draw = random.Random(0)
    lost: list[float] = []

    def stall() -> float:
        lost.append(draw.uniform(0.0, 0.015) if draw.random() < 0.02 else 0.0)
        return lost[-1]

    machine = Machine(0.002, stall)
    machine.pacing.is_real_time = False
    for _ in range(2000):
        machine.cycle()
    assert machine.pacing.slips.total_s <= sum(lost) + TICK_S * machine.pacing.slips.count
    assert min(b - a for a, b in pairwise(machine.begun)) > 0.5 * 0.002  # never a burst


def test_a_strict_clock_keeps_the_grid_through_a_stall_and_catches_up() -> None:
    stalls = [0.0] * 3 + [0.1] + [0.0] * 200
    machine = Machine(0.002, lambda: stalls.pop(0), stall_tolerant=False)
    for _ in range(80):
        machine.cycle()
    assert machine.pacing.slips.count == 0
    assert machine.pacing.due == pytest.approx(81 * 0.002)
    assert machine.begun[-1] - 80 * 0.002 <= 1.001 * JITTER_S


def test_quantiles_of_lateness():
    lateness = LatenessHistogram()
    for k in range(1000):
        lateness.add(k * 1e-6)
    assert lateness.quantile(0.5) == pytest.approx(500e-6, abs=4e-6)
    assert lateness.quantile(0.99) == pytest.approx(990e-6, abs=4e-6)
    assert lateness.as_document()["max_s"] == pytest.approx(999e-6)

"""A motion as a program of the controller: its rows are the plan's, and the simulated controller makes that motion."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from executor.streaming.loop import Schedule
from planner.controller_program import (
    BRAKE,
    BRAKE_ROW,
    BRAKED,
    END,
    FINISHED,
    GO,
    HEARTBEAT,
    KEEP,
    OFF_COURSE,
    REQUEST,
    ROW,
    ROWS_MAX,
    RUN,
    SWITCHED_ROW,
    UNHEARD,
    NoProgram,
    SwitchRow,
    Watch,
)
from planner.grippers import SecondOutput
from planner.stream_rows import StreamRows, controller_program
from simulator.interfaces import InputValues
from tests.executor.conftest import Prepared, prepare
from tests.simulator.conftest import Driven

WATCH = Watch(run=800, dead_man_s=0.04)
NUMBERS = r"follow\(\[([^\]]*)\], (-?\d+)\)"
BRAKE_RAD = 1e-3  # [rad] the acceleration at which a brake begins is a difference of two rows
STOPPED_RAD = 0.01  # [rad] of a joint that sped up for a cycle and was stopped
PUBLISHED_RAD_S = 1e-6  # [rad/s] to which speeds are written


@pytest.fixture(scope="module", params=["ur5e-sim", "ur5-sim"])
def prepared(request: pytest.FixtureRequest) -> Prepared:
    return prepare(request.param)


class Running(Driven):
    """A controller whose arm stands at the start of a throw, and that runs its program."""

    def __init__(self, prepared: Prepared, watch: Watch | None = WATCH, thinned_to: StreamRows | None = None) -> None:
        rows = thinned_to or prepared.rows
        program = controller_program(prepared.cell, rows, prepared.brakes, thinned=thinned_to is not None)
        super().__init__(prepared.cell, script=program.text(watch))
        self.q: list[list[float]] = []
        self.qd: list[list[float]] = []
        self.opened: list[bool] = []
        self.beats = 0

    def tell(self, request: int) -> None:
        self.controller.take_inputs(InputValues([(REQUEST, WATCH.run + request)], []))

    def beat(self) -> None:
        self.beats += 1
        self.controller.take_inputs(InputValues([(HEARTBEAT, self.beats)], []))

    def row(self) -> int:
        return self.out_int(ROW)

    def go(self, cycles: int = 10_000, until_row: int = 10_000, beating: bool = True) -> None:
        """Runs on, to a row or to the end of the program."""
        while cycles and self.controller.runner.playing and self.row() < until_row:
            if beating:
                self.beat()
            self.cycle()
            cycles -= 1
            if self.row() >= 0:
                self.q.append(self.arm.q)
                self.qd.append(self.arm.qd)

    def starts(self) -> None:
        self.tell(GO)
        self.go(until_row=0)


def rows_of(text: str) -> tuple[np.ndarray, list[int]]:
    found = re.findall(NUMBERS, text)
    return np.array([[float(x) for x in qd.split(",")] for qd, _ in found]), [int(ticks) for _, ticks in found]


def test_its_rows_are_the_plans(prepared: Prepared) -> None:
    text = controller_program(prepared.cell, prepared.rows, prepared.brakes).text(WATCH)
    qd, ticks = rows_of(text)
    assert qd == pytest.approx(prepared.rows.qd, abs=0.51 * PUBLISHED_RAD_S)
    own = prepared.brakes.row == np.arange(len(qd))
    assert ticks == np.where(own, prepared.brakes.ticks, -1).tolist()


def test_its_rows_integrate_to_the_release_state(prepared: Prepared) -> None:
    """By the trapezoid rule, by which the controller ramps its speed in a cycle."""
    qd, _ = rows_of(controller_program(prepared.cell, prepared.rows, prepared.brakes).text(WATCH))
    steps = 0.5 * (qd[1:] + qd[:-1]) / prepared.cell.robot.sample_rate_hz
    q = prepared.rows.q[0] + np.vstack([np.zeros(6), np.cumsum(steps, axis=0)])
    release = prepared.rows.release_row
    assert q[release] == pytest.approx(prepared.rows.q[release], abs=2e-4)
    assert qd[release] == pytest.approx(prepared.rows.qd[release], abs=PUBLISHED_RAD_S)


def test_the_controller_makes_the_motion_a_row_a_cycle(prepared: Prepared) -> None:
    running = Running(prepared)
    running.starts()
    running.go()
    count = len(prepared.rows.q)
    assert running.out_int(END) == FINISHED
    assert running.out_int(RUN) == WATCH.run
    assert np.array(running.qd)[:count] == pytest.approx(prepared.rows.qd, abs=1e-3)  # with what draws it to its course
    assert np.array(running.q)[:count] == pytest.approx(prepared.rows.q, abs=2e-4)
    assert running.out_int(BRAKE_ROW) == -1


def test_the_output_is_switched_with_its_row(prepared: Prepared) -> None:
    running = Running(prepared)
    running.starts()
    running.go(until_row=prepared.rows.output_row - 1)
    assert running.out_int(SWITCHED_ROW) == -1
    running.go(until_row=prepared.rows.output_row)
    assert running.out_int(SWITCHED_ROW) == prepared.rows.output_row


@pytest.mark.parametrize(("asked_after", "ends"), [(-3, False), (-2, False), (0, True), (2, True), (30, True)])
def test_a_brake_gives_an_output_its_last_level_only_if_it_was_switched(
    prepared: Prepared, asked_after: int, ends: bool
) -> None:
    first = prepared.rows.release_row // 2
    line = ("standard_digital", 3)
    switches = (SwitchRow(first, *line, False), SwitchRow(first + 20, *line, True))
    running = Running(replace(prepared, rows=replace(prepared.rows, switches=switches)))
    running.starts()
    running.go(until_row=first + asked_after)
    running.tell(BRAKE)
    running.go()
    running.cycle(20)
    assert running.out_int(END) == BRAKED
    assert bool(running.controller.workcell.outputs.bits >> 3 & 1) is ends


def test_it_waits_for_its_start_and_ends_without_one(prepared: Prepared) -> None:
    running = Running(prepared)
    running.go(cycles=100)
    assert running.controller.runner.playing and running.row() == -1
    running.tell(BRAKE)
    running.go(cycles=5)
    assert not running.controller.runner.playing
    assert not any(running.arm.qd)


@pytest.mark.parametrize("share", [0.4, 0.8, 1.1])
def test_a_request_flies_the_verified_brake(prepared: Prepared, share: float) -> None:
    running = Running(prepared)
    running.starts()
    asked = int(share * prepared.rows.release_row)
    running.go(until_row=asked)
    running.tell(BRAKE)
    running.go()
    assert running.out_int(END) == BRAKED
    start = running.out_int(BRAKE_ROW)
    assert start == prepared.job.brake_row[asked + 1]
    schedule = Schedule(prepared.job)
    schedule.divert(start)
    expected = np.array([schedule.command(row) for row in range(schedule.last + 1)])
    assert np.array(running.qd)[: schedule.last + 1] == pytest.approx(expected[:, 1], abs=0.02)
    assert np.array(running.q)[: schedule.last + 1] == pytest.approx(expected[:, 0], abs=BRAKE_RAD)
    assert not any(running.arm.qd)


def test_before_the_release_a_brake_closes_the_gripper_again(prepared: Prepared) -> None:
    running = Running(prepared)
    running.starts()
    running.go(until_row=prepared.rows.output_row + 1)
    running.tell(BRAKE)
    running.go()
    running.cycle(100)
    gripper = prepared.cell.gripper
    assert bool(running.controller.workcell.outputs.bits >> 16 + gripper.index & 1) != gripper.open_level


def test_an_object_that_is_kept_flies_on_to_the_end(prepared: Prepared) -> None:
    running = Running(prepared)
    running.starts()
    running.tell(KEEP)
    running.go()
    assert running.out_int(END) == FINISHED
    assert running.out_int(SWITCHED_ROW) == -1


def test_without_a_heartbeat_it_stops_within_the_dead_man_time(prepared: Prepared) -> None:
    running = Running(prepared)
    running.starts()
    running.go(until_row=prepared.rows.release_row)
    begin = running.controller.timeline.t
    running.go(beating=False)
    assert running.out_int(END) == UNHEARD
    assert not any(running.arm.qd)
    dt = 1.0 / prepared.cell.robot.sample_rate_hz
    braking_s = np.abs(prepared.rows.qd).max() / prepared.cell.robot.qdd_max.min()
    assert running.controller.timeline.t - begin < WATCH.dead_man_s + braking_s + 4.0 * dt


@pytest.mark.parametrize("fraction", [0.9, 0.5, 0.3])
def test_under_a_speed_slider_it_stops_and_keeps_the_object(prepared: Prepared, fraction: float) -> None:
    """A slider stretches the time of a row: the arm stays near its course, at another speed."""
    running = Running(prepared)
    running.starts()
    running.go(until_row=prepared.rows.release_row // 3)
    running.controller.slider = running.controller.speed_scaling = fraction
    running.go()
    assert running.out_int(END) == OFF_COURSE
    assert running.out_int(SWITCHED_ROW) == -1
    assert not any(running.arm.qd)


@pytest.mark.parametrize("watch", [WATCH, None], ids=["watched", "pendant"])
@pytest.mark.parametrize("speed", [0.5, 2.0])
def test_a_paused_program_that_is_resumed_does_not_move(prepared: Prepared, watch: Watch | None, speed: float) -> None:
    running = Running(prepared, watch)
    running.tell(GO)
    while np.abs(running.arm.qd).max() < speed:
        running.go(cycles=1)
    before = running.controller.workcell.outputs.bits
    running.controller.runner.pause()
    running.cycle(500)
    stands = running.arm.q
    assert running.controller.runner.resume()
    running.go()
    running.cycle(100)
    assert running.arm.q == pytest.approx(stands, abs=STOPPED_RAD)
    assert running.controller.workcell.outputs.bits == before


def test_an_approach_leaves_rows_out_and_arrives(prepared: Prepared) -> None:
    """Made longer than a program may be, by as many rows at rest in front."""
    rest = ROWS_MAX
    rows = prepared.rows

    def longer(values: np.ndarray) -> np.ndarray:
        return np.concatenate([np.repeat(values[:1], rest, axis=0), values])

    extended = replace(rows, q=longer(rows.q), qd=longer(rows.qd), qdd=longer(rows.qdd), output_row=-1)
    brakes = replace(
        prepared.brakes,
        row=np.concatenate([np.arange(rest), prepared.brakes.row + rest]),
        ticks=np.concatenate([np.zeros(rest, np.int64), prepared.brakes.ticks]),
    )
    if prepared.cell.robot.sample_rate_hz < 500:  # a CB3's rows lie as far apart as those of an approach may
        with pytest.raises(NoProgram):
            controller_program(prepared.cell, extended, brakes, thinned=True)
        return
    assert controller_program(prepared.cell, extended, brakes, thinned=True).stride == 2
    running = Running(replace(prepared, brakes=brakes), thinned_to=extended)
    running.starts()
    running.go()
    assert running.out_int(END) == FINISHED
    assert running.arm.q == pytest.approx(rows.q[-1], abs=1e-3)


def test_a_motion_that_no_program_holds_is_refused(prepared: Prepared) -> None:
    rows = replace(prepared.rows, qd=np.zeros((ROWS_MAX + 1, 6)), q=np.zeros((ROWS_MAX + 1, 6)))
    brakes = replace(prepared.brakes, row=np.arange(ROWS_MAX + 1), ticks=np.zeros(ROWS_MAX + 1, np.int64))
    with pytest.raises(NoProgram, match=f"{ROWS_MAX + 1} rows; a program holds {ROWS_MAX}"):
        controller_program(prepared.cell, rows, brakes)


def test_a_gripper_of_two_outputs_is_refused(prepared: Prepared) -> None:
    second = SecondOutput("standard_digital", 3, open_level=False, lasts_s=None)
    cell = replace(prepared.cell, gripper=replace(prepared.cell.gripper, second=second))
    with pytest.raises(NoProgram, match="'digital' has more than one output: use speedj"):
        controller_program(cell, prepared.rows, prepared.brakes)


def test_on_the_pendant_it_moves_only_from_its_start(prepared: Prepared) -> None:
    running = Running(prepared, watch=None)
    running.go()
    assert np.array(running.arm.q) == pytest.approx(prepared.rows.q[-1], abs=1e-3)
    elsewhere = prepared.cell.home + 0.05
    cell = replace(prepared.cell, home=elsewhere)
    away = Running(replace(prepared, problem=replace(prepared.problem, cell=cell)), watch=None)
    away.go()
    assert away.arm.q == pytest.approx(elsewhere)


def test_the_head_is_a_comment(prepared: Prepared) -> None:
    program = controller_program(prepared.cell, prepared.rows, prepared.brakes)
    lines = program.text(None, ["plan 1", "", "two"]).splitlines()
    assert lines[:4] == ["# plan 1", "#", "# two", "def fling_motion():"]
    assert lines[-1] == "fling_motion()"
    assert max(map(len, lines)) < 130

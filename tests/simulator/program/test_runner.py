"""Life of a program and stops over it, with a program that only counts: no sockets, no arm."""

from __future__ import annotations

import pytest

from simulator.physics import MotionConflict
from simulator.program import PAUSED, PLAYING, STOPPED, ProgramError, SuddenTargetChange, messages
from simulator.settings import Decelerations, SimulatorSettings
from tests.simulator.conftest import SCRIPT, ProgramParts


@pytest.fixture
def parts() -> ProgramParts:
    return ProgramParts()


def test_an_upload_plays_after_its_start_time_and_replaces_what_runs(parts: ProgramParts):
    parts.runner.upload(SCRIPT)
    parts.cycle(24)
    assert parts.runner.runtime == STOPPED
    parts.cycle(1)
    assert (parts.runner.runtime, parts.turns) == (PLAYING, 1)
    parts.runner.upload(SCRIPT)
    assert parts.runner.runtime == STOPPED
    assert "program stopped: replaced by a new script" in parts.notes


def test_a_text_that_does_not_compile_ends_what_runs_all_the_same(parts: ProgramParts):
    parts.play()
    parts.said.clear()
    parts.runner.upload("wrong")
    assert (parts.runner.runtime, parts.runner.program, parts.runner.due) == (STOPPED, None, None)
    assert parts.notes[-1] == "script refused: no such text"
    stopped, exception = parts.said
    assert stopped == messages.KeyMessage("PROGRAM_XXX_STOPPED", "counting")
    assert exception == messages.RuntimeException(2, 3, "no such text")


def test_a_secondary_program_runs_beside_and_ends_alone(parts: ProgramParts):
    parts.play()
    parts.runner.upload("sec beside():\nend\n")
    assert parts.runner.playing
    parts.cycle(3)
    assert len(parts.runner.secondary) == 1
    parts.turns = 1000
    parts.cycle(1)
    assert not parts.runner.secondary


def test_where_no_program_may_run_a_script_is_refused_with_an_error_code(parts: ProgramParts):
    parts.play()
    parts.runner.remote_control = False
    parts.runner.upload(SCRIPT)
    assert parts.runner.playing
    assert parts.said[-1] == messages.ErrorCode(210, 0, messages.VIOLATION, "the robot is in local control")
    parts.runner.remote_control = True
    parts.stops.emergency()
    parts.runner.upload(SCRIPT)
    assert isinstance(parts.said[-1], messages.ErrorCode)
    assert not parts.runner.due


def test_a_program_that_was_about_to_start_is_named_when_it_is_stopped(parts: ProgramParts):
    parts.runner.upload(SCRIPT)
    parts.runner.stop("dashboard: stop")
    assert parts.said == [messages.KeyMessage("PROGRAM_XXX_STOPPED", "counting")]


def test_a_program_has_one_turn_a_cycle_while_it_plays(parts: ProgramParts):
    parts.play()
    parts.cycle(9)
    assert parts.turns == 10
    assert parts.runner.pause()
    parts.cycle(10)
    assert (parts.runner.runtime, parts.turns) == (PAUSED, 10)
    assert not parts.runner.pause()
    assert parts.runner.resume()
    parts.cycle(1)
    assert parts.turns == 11


def test_the_end_of_the_main_thread_is_the_end_of_the_program(parts: ProgramParts):
    parts.play()
    parts.turns = 1000
    parts.cycle(1)
    assert parts.runner.runtime == STOPPED
    assert parts.notes[-1] == "program stopped: it has come to its end"


@pytest.mark.parametrize(
    ("failure", "note"),
    [
        (MotionConflict(), "another thread is already controlling the robot"),
        (ProgramError("why"), "runtime error: why"),
        (ValueError("why"), "runtime error: why"),
        (ZeroDivisionError("why"), "runtime error: why"),
    ],
)
def test_a_failure_stops_the_program_and_is_noted(parts: ProgramParts, failure: Exception, note: str):
    parts.play()
    parts.failure = failure
    parts.cycle(1)
    assert parts.runner.runtime == STOPPED
    assert parts.notes[-1] == f"program stopped: {note}"


def test_a_sudden_target_is_left_to_the_controller(parts: ProgramParts):
    parts.play()
    parts.failure = SuddenTargetChange("far")
    with pytest.raises(SuddenTargetChange, match="far"):
        parts.cycle(1)


def test_the_watchdog_ends_a_program_whose_register_is_silent(parts: ProgramParts):
    parts.play()
    parts.runner.set_watchdog(24, 50.0)
    parts.cycle(10)
    assert parts.runner.playing
    parts.cycle(1)
    assert parts.notes[-1] == "program stopped: the RTDE watchdog expired"
    parts.play()
    parts.cycle(100)
    assert parts.runner.playing  # the watchdog ended with the program before


@pytest.mark.parametrize(("fate", "runtime"), [("paused", PAUSED), ("stopped", STOPPED), ("playing", PLAYING)])
def test_a_protective_stop_does_to_the_program_what_is_asked(parts: ProgramParts, fate: str, runtime: int):
    parts.play()
    parts.stops.protective("test", fate)
    assert parts.runner.runtime == runtime
    assert parts.safety.deceleration == Decelerations.protective_stop
    turns = parts.turns
    parts.cycle(5)
    assert parts.turns == turns  # nothing moves while the stop is in force


def test_only_the_first_of_two_stops_counts_but_an_emergency_always_does(parts: ProgramParts):
    parts.stops.safeguard()
    parts.stops.protective("late")
    assert parts.safety.reason == "safeguard stop"
    parts.stops.emergency()
    assert parts.safety.reason == "emergency stop"
    assert not parts.safety.may_move


def test_a_stop_by_hand_brakes_as_at_the_end_of_a_program():
    parts = ProgramParts(SimulatorSettings(decelerations=Decelerations(program_end=7.0)))
    parts.play()
    parts.stops.power_loss()
    assert parts.safety.deceleration == Decelerations.power_loss
    parts.runner.stop("test")
    assert parts.safety.deceleration == 7.0

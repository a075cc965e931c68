"""Interpreter mode: statements that clients send on port 30020, answered as Universal Robots describes."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from simulator.program.runner import STOPPED
from simulator.simulation import Simulation
from tests.simulator.conftest import Peer

START_CYCLES = 40


class InterpreterClient:
    """A client of a program in interpreter mode."""

    def __init__(self, simulation: Simulation) -> None:
        self.controller = simulation.controller
        self.simulation = simulation
        self.script = Peer(simulation, "primary")
        self.client = Peer(simulation, "interpreter")

    def enter(self) -> None:
        self.script.send(b"interpreter_mode()\n", START_CYCLES)

    def ask(self, line: str, cycles: int = 3) -> str:
        return self.client.send(f"{line}\n".encode(), cycles).decode().strip()

    def number(self, line: str) -> int:
        return int(self.ask(line).split(":")[1])

    @property
    def told(self) -> list[float]:
        return [box[0] for box in self.controller.registers.int_out[30:34]]


@pytest.fixture
def interpreted(simulation: Simulation) -> Iterator[InterpreterClient]:
    found = InterpreterClient(simulation)
    found.enter()
    yield found
    found.controller.runner.stop("the test is over")
    found.script.close()
    found.client.close()
    for _ in range(200):
        simulation.tick()


def test_statements_are_run_in_order_and_keep_their_variables(interpreted: InterpreterClient):
    first = interpreted.number("x = 1")
    assert interpreted.ask("x = x + 4 y = [x, 2]") == f"ack: {first + 1}: x = x + 4 y = [x, 2]"
    interpreted.ask("def doubled(a, by=2): b = a * by return b end")
    interpreted.ask("write_output_integer_register(30, doubled(x)) write_output_integer_register(31, y[0])")
    interpreted.ask("if x > 4: write_output_integer_register(32, doubled(x, by=3)) end")
    assert interpreted.told[:3] == [10, 5, 15]
    assert interpreted.ask("statelastexecuted") == f"state: {first + 4}: statelastexecuted"
    assert interpreted.ask("statelastinterpreted") == f"state: {first + 4}: statelastinterpreted"
    assert interpreted.ask("stateunexecuted") == "state: 0: stateunexecuted"


@pytest.mark.parametrize("wrong", ["nothing_like_it()", "x = = 1", "y = never + 1"])
def test_what_does_not_compile_is_discarded(interpreted: InterpreterClient, wrong: str):
    assert interpreted.ask(wrong).startswith("discard: Compile error: ")
    assert interpreted.ask("z = 1").startswith("ack: ")


def test_a_motion_goes_on_while_statements_wait_and_can_be_aborted(interpreted: InterpreterClient):
    interpreted.ask("movej([1, -1.57, 1.57, -1.57, -1.57, 0])", 100)
    assert interpreted.controller.arm.qd[0] > 0.1
    interpreted.ask("write_output_integer_register(33, 7)")
    interpreted.ask("write_output_integer_register(33, 8)")
    assert interpreted.number("stateunexecuted") == 2
    interpreted.ask("abort", 300)
    assert not any(interpreted.controller.arm.qd)
    assert interpreted.told[3] == 8


@pytest.mark.parametrize("commands", ["abort\nskipbuffer", "skipbuffer\nabort"])
def test_a_motion_is_aborted_and_the_rest_skipped_at_once(interpreted: InterpreterClient, commands: str):
    interpreted.ask("movej([2, -1.57, 1.57, -1.57, -1.57, 0])", 100)
    interpreted.ask("write_output_integer_register(33, 5)")
    interpreted.ask(commands, 300)
    assert not any(interpreted.controller.arm.qd)
    assert interpreted.controller.arm.q[0] < 1.5
    assert interpreted.told[3] != 5


def test_waiting_statements_are_skipped(interpreted: InterpreterClient):
    interpreted.ask("sleep(0.1)")
    interpreted.ask("write_output_integer_register(33, 9)")
    assert interpreted.ask("skipbuffer", 100).startswith("state: ")
    assert interpreted.told[3] != 9


def test_a_full_queue_discards(interpreted: InterpreterClient):
    interpreted.ask("sleep(100)")
    answers = interpreted.client.send(b"x = 1\n" * 501, 1).decode().splitlines()
    assert [answer.partition(":")[0] for answer in answers] == ["ack"] * 500 + ["discard"]
    assert answers[-1] == "discard: Too many interpreted messages: x = 1"


def test_the_mode_ends_and_the_program_goes_on(interpreted: InterpreterClient):
    number = interpreted.number("end_interpreter()")
    assert interpreted.controller.runner.runtime == STOPPED  # the program was this one line
    assert interpreted.ask("statelastcleared") == f"state: {number}: statelastcleared"
    assert interpreted.ask("x = 1") == "discard: Program is in an invalid state: x = 1"


def test_a_statement_that_fails_ends_the_program(interpreted: InterpreterClient):
    assert interpreted.ask("x = 1 / 0").startswith("ack")
    assert interpreted.controller.runner.runtime == STOPPED
    assert interpreted.ask("x = 1").startswith("discard: Program is in an invalid state")


def test_statements_leave_nothing_behind(interpreted: InterpreterClient):
    for _ in range(50):
        interpreted.ask("x = [1, 2, 3] x[0] = 4 write_output_integer_register(30, x[0])")
    program = interpreted.controller.runner.program
    assert program is not None
    assert len(program.direct) < 10
    assert len(program.expressions.compiled) < 10

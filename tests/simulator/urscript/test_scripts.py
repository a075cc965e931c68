"""Scripts as other clients send them, run by a controller without sockets; results are read from output registers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import kinematics
from simulator.program import messages
from simulator.program.runner import PAUSED, PLAYING, STOPPED
from tests.simulator.conftest import Driven, make_cell

CYCLES = 3000  # longer than any script here


class ScriptedController(Driven):
    """A controller that runs a script to its end; `said` are the messages to its clients."""

    def __init__(self) -> None:
        super().__init__(make_cell())
        self.said: list[messages.Message] = []
        self.controller.runner.board.listeners.append(self.said.append)

    def run(self, text: str, cycles: int = CYCLES) -> None:
        runner = self.controller.runner
        runner.upload(text)
        while cycles and (runner.due or runner.playing or runner.secondary):
            self.cycle()
            cycles -= 1

    @property
    def exception(self) -> messages.RuntimeException:
        return next(m for m in self.said if isinstance(m, messages.RuntimeException))

    @property
    def texts(self) -> list[str]:
        return [m.text for m in self.said if isinstance(m, messages.TextMessage)]


@pytest.fixture
def controller() -> ScriptedController:
    return ScriptedController()


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 + 2 * 3 - 4 / 2", 5.0),
        ("-(2 + 3) % 4", 3.0),
        ("[1, 2.5, 3][1]", 2.5),
        ("p[1, 2, 3, 4, 5, 6][5]", 6.0),
        ("norm([3, 4, 0])", 5.0),
        ("sqrt(2) * cos(d2r(60))", math.sqrt(2) / 2),
        ("atan2(1, 1)", math.pi / 4),
        ("pose_trans(p[1,0,0,0,0,1.5707963267948966], p[1,0,0,0,0,0])[1]", 1.0),
        ("pose_inv(p[1,2,3,0,0,0])[2]", -3.0),
        ("get_list_length([[1, 2], [3, 4]])", 2.0),
        ("2e3", 2000.0),
        ("([1, 2] + [3, 4])[1]", 6.0),
        ("([1, 2] - [3, 5])[1]", -3.0),
        ("(2 * [1, 2] / 4)[1]", 1.0),
        ("(-3 * [1, 2] + 1)[1]", -5.0),
        ("(-[1, 2])[0]", -1.0),
        ("([[1, 2], [3, 4]] * 2)[1][0]", 6.0),
        ("get_inverse_kin(get_target_tcp_pose(), get_joint_positions())[2]", 1.57),
        ("get_inverse_kin(get_target_tcp_pose(), qnear=[0, -1.6, 1.5, -1.5, -1.5, 6])[5]", 2.0 * math.pi),
        ("get_actual_joint_positions_history(0)[1] * 0 + get_steptime()", 0.002),
        ("tool_contact()", 0.0),
        ('to_num("1.5") + to_num("2")', 3.5),
        ('str_len(str_cat("ab", "c")) + str_find("abc", "c") + 10 * str_find("abc", "d")', -5.0),
        ('to_num(str_sub("a12b", 1, 2)) + to_num(str_at("a7", 1))', 19.0),
    ],
)
def test_an_expression_has_its_value(controller: ScriptedController, expression: str, value: float):
    controller.run(f"write_output_float_register(0, {expression})\n")
    assert controller.out_doubles(1)[0] == pytest.approx(value)


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        ("1", True),
        ("0.0 or not 2.5", False),
        ("3 and 1 > 0", True),
        ("1 > 2 or\n   3 > 2 and\n   not\n False", True),
        ("1 < 2 and not 2 <= 1", True),
        ("True xor True or False", False),
        ('"a" == "a"', True),
        ("[1] != [1]", False),
    ],
)
def test_a_condition_decides(controller: ScriptedController, condition: str, holds: bool):
    one, two = (f"  write_output_integer_register(3, {value})\n" for value in (1, 2))
    controller.run(f"if {condition}:\n{one}else:\n{two}end\n")
    assert controller.out_int(3) == (1 if holds else 2)


def test_a_function_of_the_script_has_defaults_and_named_arguments(controller: ScriptedController):
    controller.run(
        """def program():
  def weighted(a, b=two(), c=100 * 4):
    return a + 10 * b + c
  end
  def two():
    return 2
  end
  write_output_integer_register(3, weighted(1))
  write_output_integer_register(4, weighted(1, c=300))
  write_output_integer_register(5, weighted(b=7, a=5))
  write_output_integer_register(6, weighted(1, 3, 200))
end
"""
    )
    assert [controller.out_int(i) for i in (3, 4, 5, 6)] == [421, 321, 475, 231]


def test_a_critical_section_is_not_divided_by_another_thread(controller: ScriptedController):
    """Each thread raises both numbers, thousands of statements apart; the other must never see them differ."""
    loop = """
    while count < 20:
      enter_critical
      first = first + 1
      i = 0
      while i < 1500:
        i = i + 1
      end
      second = second + 1
      exit_critical
      if first != second:
        torn = torn + 1
      end
      count = count + 1
      sync()
    end
"""
    names = "  global first = 0\n  global second = 0\n  global torn = 0\n"
    thread = f"  thread other():\n    local count = 0\n    local i = 0{loop}  end\n"
    main = f"  handle = run other()\n  count = 0{loop}  join handle\n"
    controller.run(
        f"def program():\n{names}{thread}{main}  write_output_integer_register(3, 100 * torn + first)\nend\n"
    )
    assert controller.out_int(3) == 40


def test_a_thread_without_a_pause_does_not_come_into_a_critical_section(controller: ScriptedController):
    """Nor does the one keep the other from its turns."""
    controller.run(
        """def program():
  global n = 0
  global torn = 0
  thread other():
    while True:
      m = 1
      enter_critical
      n = n + 1
      exit_critical
    end
  end
  run other()
  i = 0
  while i < 200:
    enter_critical
    before = n
    k = 0
    while k < 700 + i:
      k = k + 1
    end
    if n != before:
      torn = torn + 1
    end
    exit_critical
    i = i + 1
    sync()
  end
  write_output_integer_register(3, torn)
  write_output_integer_register(4, n)
end
"""
    )
    assert controller.controller.runner.runtime == STOPPED  # the main thread has come to its end
    assert controller.out_int(3) == 0
    assert controller.out_int(4) > 200


THREADS = """def program():
  global n = 0
  thread deep():
    sleep(0.1)
    n = n + 1
  end
  i = 0
  while i < {}:
    run deep()
    i = i + 1
  end
  sleep(0.2)
  write_output_integer_register(3, n)
end
"""


def test_threads_are_no_nested_calls(controller: ScriptedController):
    controller.run(THREADS.format(60))
    assert controller.out_int(3) == 60


def test_a_script_that_starts_threads_for_ever_ends(controller: ScriptedController):
    controller.run(THREADS.format(101))
    assert controller.exception.text.endswith("more than 100 threads run")


def test_a_thread_has_nested_calls_of_its_own(controller: ScriptedController):
    down = "  def down(k):\n    sync()\n    if k > 1:\n      down(k - 1)\n    end\n    return 0\n  end\n"
    thread = "  thread other():\n    down(29)\n    write_output_integer_register(4, 1)\n  end\n"
    controller.run(f"def program():\n{down}{thread}  run other()\n  down(30)\n  sleep(0.1)\n  down(31)\nend\n")
    assert controller.out_int(4) == 1
    assert "too many nested calls" in controller.exception.text


def test_a_thousand_statements_fit_in_a_cycle(controller: ScriptedController):
    controller.run("def program():\n  i = 0\n  while i < 450:\n    i = i + 1\n  end\n  sync()\nend\n", 27)
    assert controller.controller.runner.runtime == STOPPED  # 25 cycles until it plays, one of work, one of sync


def test_a_thread_that_is_ended_costs_no_other_its_turn(controller: ScriptedController):
    """The thread that drives the arm stands behind one that the main thread ends."""
    controller.run(
        """def program():
  thread waits():
    while True:
      sync()
    end
  end
  thread drives():
    while True:
      speedj([0.4, 0, 0, 0, 0, 0], 10, 0.002)
    end
  end
  thread ends():
    sleep(0.2)
    kill first
    sleep(1)
  end
  global first = run waits()
  run ends()
  run drives()
  sleep(0.4)
end
""",
        30,
    )
    speeds = []
    for _ in range(180):
        controller.cycle()
        speeds.append(controller.arm.qd[0])
    assert min(speeds[50:]) == pytest.approx(0.4)


def test_functions_loops_threads_and_scopes(controller: ScriptedController):
    controller.run(
        """def program():
  global count = 0
  def fib(n):
    if n < 2:
      return n
    end
    return fib(n - 1) + fib(n - 2)  # its own function
  end
  thread counter():
    while True:
      count = count + 1
      sync()
    end
  end
  handle = run counter()
  sleep(0.1)
  kill handle
  kept = count
  sleep(0.1)
  i = 0
  list = [0, 0, 0]
  while True:
    i = i + 1
    if i == 2:
      continue
    elif i > 3:
      break
    end
    list[i - 1] = i
  end
  write_output_integer_register(4, fib(7))
  write_output_integer_register(5, kept)
  write_output_integer_register(6, count - kept)
  write_output_integer_register(7, list[0] + 10 * list[1] + 100 * list[2])
end
"""
    )
    assert controller.said[-1] == messages.KeyMessage("PROGRAM_XXX_STOPPED", "program")
    assert controller.out_int(4) == 13
    assert abs(controller.out_int(5) - 50) <= 2  # 0.1 s at 500 Hz
    assert controller.out_int(6) == 0
    assert controller.out_int(7) == 301


def test_messages_go_out_in_order_with_the_names_of_the_program(controller: ScriptedController):
    said = 'textmsg("x = ", 1.5)\n  textmsg("none: ", 0)\n  popup("look", "title", True)\n  sleep(0.1)'
    controller.run(f"def hello():\n  {said}\nend\n")
    stopped = messages.KeyMessage("PROGRAM_XXX_STOPPED", "rtde_control")
    ours = [messages.KeyMessage(f"PROGRAM_XXX_{word}", "hello") for word in ("STARTED", "STOPPED")]
    texts = [messages.TextMessage("x = 1.5"), messages.TextMessage("none: 0")]
    said = [*texts, messages.Popup("title", "look", True, False, False)]
    assert controller.said == [stopped, ours[0], *said, ours[1]]


def test_moves_reach_their_targets_as_the_planner_computes_them(controller: ScriptedController):
    goal = [0.3, -1.2, 1.4, -1.7, -1.5, 0.2]
    controller.run(
        f"def go():\n  movej({goal}, a=3, v=2)\n  movel(pose_trans(get_target_tcp_pose(), p[0,0,0.05,0,0,0]))\nend\n"
    )
    arm = controller.arm
    cell = controller.controller.cell
    before = kinematics.forward(cell.robot, np.array(goal), cell.tool.X_FT)
    after = kinematics.forward(cell.robot, np.array(arm.q), cell.tool.X_FT)
    np.testing.assert_allclose(after[:3, 3] - before[:3, 3], 0.05 * before[:3, 2], atol=1e-6)
    np.testing.assert_allclose(after[:3, :3], before[:3, :3], atol=1e-6)


def test_a_timed_move_takes_its_time(controller: ScriptedController):
    start = controller.controller.timeline.t
    controller.run("movej([0.2, -1.57, 1.57, -1.57, -1.57, 0], t=1.0)\n")
    assert controller.controller.timeline.t - start == pytest.approx(1.05, abs=0.01)  # 50 ms until it plays


def test_a_script_sees_the_inputs(controller: ScriptedController):
    controller.controller.workcell.input_bits = 1 << 5 | 1 << 8 | 1 << 17
    controller.run(
        """def look():
  write_output_boolean_register(70, get_standard_digital_in(5))
  write_output_boolean_register(71, get_configurable_digital_in(0))
  write_output_boolean_register(72, get_tool_digital_in(1))
  write_output_boolean_register(73, get_standard_digital_in(4))
  sleep(0.1)
end
"""
    )
    assert controller.controller.registers.bit_out[70:74] == [True, True, True, False]


def test_registers_outputs_and_installation(controller: ScriptedController):
    c = controller.controller
    c.registers.int_in[30] = 7
    c.registers.double_in[40] = 2.5
    c.registers.bit_in[70] = True
    controller.run(
        """def io():
  write_output_integer_register(30, read_input_integer_register(30) + 1)
  write_output_float_register(40, read_input_float_register(40))
  write_output_boolean_register(70, read_input_boolean_register(70))
  set_standard_digital_out(2, True)
  set_digital_out(9, True)
  set_tcp(p[0, 0, 0.1, 0, 0, 0])
  set_payload(1.5, [0, 0, 0.02])
  sleep(0.1)
end
"""
    )
    assert (c.registers.int_out[30], c.registers.double_out[40], c.registers.bit_out[70]) == ([8], [2.5], True)
    assert c.workcell.outputs.bits >> 2 & 1
    assert c.workcell.outputs.bits >> 17 & 1
    assert (c.installation.tcp_pose[2], c.installation.payload_kg) == (0.1, 1.5)


@pytest.mark.parametrize(
    ("text", "line", "column", "error"),
    [
        ("def a():\n  nothing_like_it()\nend\n", 2, 3, "compile_error_name_not_found:nothing_like_it:"),
        ("def a():\n  x = y + 1\nend\n", 2, 7, "compile_error_name_not_found:y:"),
        ("def a():\n  x = (1 + \nend\n", 3, 1, "syntax_error_on_line:3:end:"),
        ("def 7a():\nend\n", 1, 5, "syntax_error_on_line:1:def 7a()::"),
        ("x = 1 $ 2\n", 1, 7, "syntax_error_on_line:1:x = 1 $ 2:"),
        ("movej(p[10, 0, 0, 0, 0, 0])\n", 1, 1, "unable to find an inverse kinematics solution"),
        ("def a():\n  x = 1 / 0\nend\n", 2, 9, "division by zero"),
        ("def a():\n  if [1]:\n  end\nend\n", 2, 6, "not a boolean"),
        ("x = [1, 2][2]\n", 1, 11, "index out of bounds"),
        ("movej([1, 2])\n", 1, 1, "six numbers"),
        ("movej()\n", 1, 1, "argument q is missing"),
        ("def a():\n  def f(b=1, c):\n  end\nend\n", 2, 15, "syntax_error_on_line:2:"),
        ("def a():\n  def f(b):\n  end\n  f(1, b=2, c=3)\nend\n", 4, 3, "f: takes b"),
        ("def a():\n  def f(b):\n  end\n  f()\nend\n", 4, 3, "f: the argument b is missing"),
        ("x = [1, 2] + [1, 2, 3]\n", 1, 12, "lists of 2 and 3 elements"),
        ("x = [1, 2] * [1, 2]\n", 1, 12, "lists of 2 and 2 elements"),
        ("x = p[1, 2, 3, 4, 5, 6] * 2\n", 1, 25, "poses"),
        ("optimovej([0, 0, 0, 0, 0, 0])\n", 1, 1, "compile_error_name_not_found:optimovej:"),  # from 5.21 on
        ("set_tool_voltage(13)\n", 1, 1, "0, 12 or 24"),
        ("def f():\n  def g(n):\n    return g(n)\n  end\n  g(1)\nend\n", 3, 12, "too many nested calls"),
    ],
)
def test_a_wrong_script_ends_with_the_controllers_kind_of_error(
    controller: ScriptedController, text: str, line: int, column: int, error: str
):
    controller.run(text)
    found = controller.exception
    assert (found.line, found.column) == (line, column)
    assert error in found.text
    assert controller.controller.runner.runtime == STOPPED
    assert controller.controller.runner.program is None  # and what ran before is gone


def test_an_unreachable_straight_move_is_a_protective_stop(controller: ScriptedController):
    controller.run("movel(p[10, 0, 0, 0, 0, 0])\n", 100)
    code = next(m for m in controller.said if isinstance(m, messages.ErrorCode))
    assert (code.code, code.level) == (204, messages.WARNING)
    assert controller.controller.runner.runtime == PAUSED


def test_a_secondary_program_runs_beside_and_cannot_stop_the_program(controller: ScriptedController):
    controller.run('sec beside():\n  textmsg("here")\nend\n', 10)
    assert controller.texts == ["here"]
    assert controller.controller.runner.program is not None
    controller.run("sec beside():\n  wrong()\nend\n", 10)
    assert "compile_error_name_not_found:wrong:" in controller.exception.text
    assert controller.controller.runner.runtime == PLAYING


def test_a_loop_without_sync_holds_up_nobody(controller: ScriptedController):
    controller.run("def busy():\n  i = 0\n  while True:\n    i = i + 1\n  end\nend\n", 100)
    assert controller.controller.runner.playing
    assert not controller.said[2:]


def test_halt_in_a_thread_ends_the_program(controller: ScriptedController):
    thread = "  thread t():\n    sleep(0.02)\n    halt\n  end\n"
    controller.run(f"def a():\n{thread}  run t()\n  while True:\n    sync()\n  end\nend\n", 200)
    assert controller.controller.runner.runtime == STOPPED


LANGUAGE = """def sec thread if elif else end while return break continue halt run kill join global local and or not
xor True x y f movej sleep textmsg p [ ] ( ) : , = == + - * / % 1 2.5 1e999 "s" ' . # é"""
WORDS = st.sampled_from([*LANGUAGE.split(), "\n"])


@settings(max_examples=150, deadline=None)
@given(st.lists(WORDS, max_size=40))
def test_no_words_break_the_controller(words: list[str]):
    DRIVEN.controller.safety.clear()
    DRIVEN.controller.runner.upload(" ".join(words) + "\n")
    DRIVEN.cycle(40)
    DRIVEN.controller.runner.stop("next")


def test_nesting_without_end_is_an_error(controller: ScriptedController):
    for text in ("x = " + "(" * 5000 + "\n", "if True:\n" * 3000, f"x = {'9' * 6000}\n", "x = " + "-" * 5000 + "1\n"):
        controller.said.clear()
        controller.run(text)
        assert controller.exception.text.startswith("syntax_error_on_line:")


DRIVEN = Driven(make_cell())

"""The table `[gripper]`: kinds, their keys, what is refused and why."""

from __future__ import annotations

import math

import pytest

from planner.cell import CellSource, mended_cell, parse_cell
from planner.errors import CellError

SIM = 'robot = "ur5e"\n[link]\nkind = "sim"\n'
SENSED = '[outputs.valve]\noutput = "standard_digital"\nindex = 2\nsense_input = 5\n'
REAL = SIM.replace('"sim"', '"ur"')


def gripper_of(text: str, cell: str = SIM):
    return parse_cell(f"{cell}[gripper]\n{text}\n", "c").gripper


def test_a_pair_of_outputs_opens_and_closes():
    made = gripper_of('output = "standard_digital"\nindex = 2\nclose_output = "standard_digital"\nclose_index = 3')
    assert (made.kind, made.open_level) == ("digital", True)
    assert (made.second.output, made.second.index, made.second.open_level) == ("standard_digital", 3, False)
    assert made.second.lasts_s is None


def test_a_vacuum_is_off_when_it_is_open_and_blows_for_a_while():
    made = gripper_of('kind = "vacuum"\nblow_off_output = "tool_digital"\nblow_off_index = 1\nblow_off_s = 0.1')
    assert not made.open_level
    assert (made.second.index, made.second.open_level, made.second.lasts_s) == (1, True, 0.1)
    assert gripper_of('kind = "vacuum"').second is None


@pytest.mark.parametrize(("transport", "port", "quantum_s"), [("socket", 63352, 0.010), ("tool_serial", 54321, 0.005)])
def test_a_bus_that_takes_commands_at_times_adds_to_the_jitter(transport, port, quantum_s):
    made = gripper_of(f'kind = "robotiq"\nmodel = "2f85"\ntransport = "{transport}"\njitter_s = 0.001')
    assert made.jitter_s == pytest.approx(math.sqrt(0.001**2 + quantum_s**2 / 12.0))
    assert (made.link.port, made.link.slave_id, made.link.open_width_m) == (port, 9, 0.085)


def test_what_is_filled_in_can_be_read_again():
    cell = parse_cell(f'{SIM}[gripper]\nkind = "robotiq"\nmodel = "hande"\nopen_width_m = 0.04\n', "c")
    assert cell.with_tool(mass_kg=1.0).document["gripper"] == cell.document["gripper"]
    assert cell.gripper.link.open_width_m == 0.04


def test_both_urls_are_of_one_host():
    made = gripper_of(
        'kind = "http"\nopen_url = "http://127.0.0.1:8080/o"\nclose_url = "http://127.0.0.1:8080/c"\njitter_s = 0.01'
    )
    assert (made.link.host, made.link.port) == ("127.0.0.1", 8080)


TIMED = "jitter_s = 0.01\n"
SCRIPT = 'kind = "script"\nopen_script = "a()"\nclose_script = "b()"\n'
HTTP = TIMED + 'kind = "http"\nopen_url = "{}"\nclose_url = "http://h/c"\n'


@pytest.mark.parametrize(
    ("text", "field", "word"),
    [
        ('kind = "schunk"', "kind", "not supported"),
        ('kind = "claw"', "kind", "robotiq"),
        ("kind = 3", "kind", "robotiq"),
        ('kind = "robotiq"', "model", "is missing: it must be one of 2f85, 2f140, hande"),
        ('kind = "robotiq"\nmodel = "rg2"', "model", "hande"),
        ('kind = "robotiq"\nmodel = "2f85"\ntransport = "modbus_tcp"', "transport", "tool_serial"),
        ('kind = "robotiq"\nmodel = "hande"\nopen_width_m = 0.06', "open_width_m", "0.05"),
        ('kind = "robotiq"\nmodel = "2f85"\nport = 80.5', "port", "whole"),
        ('kind = "robotiq"\nmodel = "2f85"\nhost = 3', "host", "host name"),
        ('kind = "robotiq"\nmodel = "2f85"\nopen_url = "http://h/"', "open_url", '"http"'),
        ('model = "2f85"', "model", 'of kind "robotiq" or "onrobot", and'),
        ("blow_off_s = 0.1", "blow_off_s", '"vacuum"'),
        ('kind = "vacuum"\nblow_off_s = 0.1', "blow_off_output", "blow_off_index and blow_off_s belong together"),
        ('close_output = "tool_digital"\nclose_index = 0', "close_output", "opens the gripper"),
        ('close_output = "tool_digital"\nclose_index = 2', "close_index", "[0, 1]"),
        ('kind = "onrobot"\nmodel = "vg10"\njitter_s = 0.01\nopen_width_m = 0.01', "open_width_m", "no fingers"),
        ('kind = "onrobot"\nmodel = "rg2"', "jitter_s", "calibrate gripper"),
        (SCRIPT, "jitter_s", "compiles"),
        (TIMED + 'kind = "script"\nclose_script = "b()"', "open_script", "missing"),
        (TIMED + SCRIPT.replace("a()", 2000 * "a()"), "open_script", "4000"),
        (HTTP.format("http://h/o").replace("0.01", "0.0"), "jitter_s", "network"),
        (HTTP.format("https://h/o"), "open_url", "http://"),
        (HTTP.format("http://h/o p"), "open_url", "blanks"),
        (HTTP.format("http://h:x/o"), "open_url", "ort"),
        (HTTP.format("http://other/o"), "close_url", "same host"),
        ("grip_input = 18", "grip_input", "[0, 17]"),
        ("grip_input = 2.5", "grip_input", "whole"),
        ("grip_input = true", "grip_input", "number"),
        ("close_s = 300", "close_s", "[0, 10]"),
        ("close_s = -0.1", "close_s", "[0, 10]"),
        (f"grip_input = 5\n{SENSED}", "grip_input", "outputs.valve.sense_input"),
    ],
)
def test_refusals_name_the_field_and_say_why(text, field, word):
    with pytest.raises(CellError) as refusal:
        gripper_of(text)
    assert refusal.value.field == f"gripper.{field}"
    assert word in refusal.value.reason


@pytest.mark.parametrize(
    ("text", "close_s"),
    [
        ("", 0.3),
        ('kind = "vacuum"', 0.3),
        (TIMED + SCRIPT, 1.0),
        ('kind = "robotiq"\nmodel = "2f85"', 3.0),
        ("close_s = 0.8", 0.8),
    ],
)
def test_a_gripper_is_given_the_time_of_its_kind_to_close(text, close_s):
    assert gripper_of(text).close_s == close_s


def test_an_input_may_show_the_grip_of_any_gripper():
    assert gripper_of("").grip_input is None
    assert gripper_of("grip_input = 4").grip_input == 4
    assert gripper_of('kind = "vacuum"\ngrip_input = 17').grip_input == 17
    assert gripper_of(f"grip_input = 4\n{SENSED}").grip_input == 4


def test_a_compute_box_of_a_real_arm_has_an_address_of_its_own():
    text = TIMED + 'kind = "onrobot"\nmodel = "rg6"'
    assert gripper_of(text).link.host == ""
    with pytest.raises(CellError, match=r"192\.168\.1\.1"):
        gripper_of(text, REAL)


def test_keys_of_a_mistyped_kind_are_not_judged():
    text = 'robot = "ur5e"\n[link]\nkind = "sim"\n[gripper]\nkind = "onrobt"\nmodel = "vg10"\n'
    assert [fault.field for fault in mended_cell(CellSource("c", text.encode()))[0]] == ["gripper.kind"]

"""Script port and control port with plain functions behind them."""

from __future__ import annotations

import json

from simulator.interfaces import BadRequest, ControlServer, Document, ScriptServer
from simulator.interfaces.script_server import SCRIPT_MAX
from tests.simulator.conftest import Connect


def test_programs_are_handed_on_whole_one_by_one(connect: Connect):
    uploaded: list[str] = []
    line = connect(ScriptServer(uploaded.append, lambda note: None))
    line.send(b"def a():\n  if x:\n  end\n")
    assert uploaded == []
    line.send(b"end\ndef b():\nend \r\ndef c(")
    assert uploaded == ["def a():\n  if x:\n  end\nend\n", "def b():\nend \r\n"]


def test_blocks_are_counted_so_that_no_indentation_is_needed(connect: Connect):
    uploaded: list[str] = []
    line = connect(ScriptServer(uploaded.append, lambda note: None))
    program = b"def a():\nif x:\nend_it()\nend\n#end\nwhile y:\nend\nend\n"
    for byte in program + b"movej(q)\n":
        line.send(bytes([byte]))
    assert uploaded == [program.decode(), "movej(q)\n"]


def test_single_lines_are_programs_and_known_commands_are_obeyed(connect: Connect):
    uploaded: list[str] = []
    obeyed: list[str] = []
    commands = {"power on": lambda: obeyed.append("power on")}
    line = connect(ScriptServer(uploaded.append, lambda note: None, commands))
    line.send(b"\n  # a remark\nstopj(2)\nPower  On\r\npower offf\n")
    assert uploaded == ["stopj(2)\n", "power offf\n"]
    assert obeyed == ["power on"]


def test_a_text_without_end_is_noted_and_ends_the_connection(connect: Connect):
    notes: list[str] = []
    line = connect(ScriptServer(lambda text: None, notes.append))
    line.connection.received += b"x" * SCRIPT_MAX
    line.send(b"x")
    assert not line.connection.open
    assert notes == ["script port: no program within the largest size"]


def refuse(request: Document) -> Document:
    raise BadRequest(f"not {request['what']}")


def test_a_request_is_answered_by_its_operation(connect: Connect):
    line = connect(ControlServer({"double": lambda request: {"n": 2 * request["n"]}, "refuse": refuse}))
    assert json.loads(line.send(b'{"op": "double", "n": 21}\n')) == {"ok": True, "n": 42}
    assert json.loads(line.send(b'{"op": "refuse", "what": "today"}\n')) == {"ok": False, "error": "not today"}
    for bad in (b"[1]\n", b"{\n", b'{"op": "none"}\n', b'{"op": []}\n'):
        assert json.loads(line.send(bad))["ok"] is False

"""The record of an audit on disk: what a kill leaves, rows that stand twice, and two audits of one folder."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from audit.record import AuditRecord, RecordRefused

ABOUT = {"audit": "fling", "seed": 1}
HOLD = "import fcntl, sys; f = open(sys.argv[1], 'a'); fcntl.lockf(f, fcntl.LOCK_EX); print(1, flush=True); input()"


def written(folder: Path, *lines: str) -> Path:
    folder.mkdir(exist_ok=True)
    file = folder / "audit.jsonl"
    file.write_text("".join(lines))
    return file


def test_a_kill_within_the_first_line_leaves_nothing_to_go_on_with(tmp_path: Path) -> None:
    file = written(tmp_path, '{"audit": "fl')
    with AuditRecord(tmp_path, ABOUT, resume=True) as record:
        assert record.rows == {}
    assert json.loads(file.read_text()) == ABOUT


def test_a_row_that_stands_twice_is_refused(tmp_path: Path) -> None:
    row = json.dumps({"index": 3, "faults": ["torque"]}) + "\n"
    written(tmp_path, json.dumps(ABOUT) + "\n", row, json.dumps({"index": 3, "faults": []}) + "\n")
    with pytest.raises(RecordRefused, match="an index stands twice"):
        AuditRecord(tmp_path, ABOUT, resume=True)


def test_two_audits_do_not_write_one_record(tmp_path: Path) -> None:
    file = written(tmp_path, json.dumps(ABOUT) + "\n")
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        other.stdout.readline()
        with pytest.raises(RecordRefused, match="is being written by another audit"):
            AuditRecord(tmp_path, ABOUT, resume=True)
        other.communicate(b"\n")
    with AuditRecord(tmp_path, ABOUT, resume=True) as record:
        assert record.rows == {}

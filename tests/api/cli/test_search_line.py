"""The line about a running search, and what is left of the search where Ctrl-C ends it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from api.cli.support import search_line
from api.cli.support.exit_status import Interrupted
from api.cli.support.search_line import SearchLine, progress_text
from planner.progress import Progress

BEGUN = Progress("search", 1, None, 0.4)
FOUND = Progress("search", 3, 0.512, 7.0)
REFUSED = Progress("nearest", 5, None, 9.04)


@pytest.mark.parametrize(
    ("progress", "text"),
    [
        (Progress("queued", 0, None, 1.0), "waiting for a planner, 1.0 s"),
        (BEGUN, "searching: 1 candidate tried, nothing certified yet, 0.4 s"),
        (FOUND, "searching: 3 candidates tried, best release at 0.512 s, 7.0 s"),
        (REFUSED, "refused; looking for one that works: 5 candidates tried, 9.0 s"),
    ],
)
def test_what_a_search_has_come_to_is_a_short_line(progress: Progress, text: str):
    assert progress_text(progress) == text
    assert len(text) < 78


def test_a_file_gets_a_line_every_few_seconds(capsys: pytest.CaptureFixture[str]):
    with SearchLine() as line:
        for progress in (BEGUN, FOUND, REFUSED, Progress("nearest", 6, None, 12.5)):
            line(progress)
    told = capsys.readouterr()
    assert told.out == ""
    assert [text.split(",")[-1] for text in told.err.splitlines()] == [" 7.0 s", " 12.5 s"]


def test_a_terminal_gets_one_line_that_is_gone_at_the_end(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with SearchLine() as line:
        line(BEGUN)
        line(FOUND)
    told = capsys.readouterr().err
    assert "\n" not in told
    assert told.split(search_line.ERASED)[1:] == [f"  {progress_text(BEGUN)}", f"  {progress_text(FOUND)}", ""]


def test_a_refusal_whose_search_was_cut_stays_a_refusal():
    line = SearchLine(is_quiet=True)
    line(REFUSED)
    with pytest.raises(Interrupted) as ended, line:
        raise KeyboardInterrupt
    assert ended.value.message == (
        "interrupted after 9.0 s and 5 candidates: the request had been refused; the search for one that works was "
        "cut short"
    )


SCRIPT = """
import os, signal
import api.cli.support.search_line as line

class Interrupted(line.SearchLine):
    def __call__(self, progress):
        super().__call__(progress)
        os.kill(os.getpid(), signal.SIGINT)

line.LINE_S = 0.0
line.SearchLine = Interrupted
from api.cli import main
main()
"""


@pytest.mark.slow
def test_ctrl_c_ends_a_plan_with_what_was_found_so_far(tmp_path: Path):
    file = tmp_path / "request.json"
    file.write_text(json.dumps({"release": {"kind": "target", "position": [2.3, 0.0, 0.0]}, "time_limit_s": 120.0}))
    command = [sys.executable, "-c", SCRIPT, "plan", str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    first, *_, last = done.stderr.splitlines()
    assert first.startswith("  searching: ")
    assert (done.returncode, done.stdout) == (130, "")
    assert last.startswith("fling: interrupted after ")
    assert last.endswith("so far nothing certified yet; nothing was planned")

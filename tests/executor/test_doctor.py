"""The doctor's grades and verdict."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from executor import doctor
from executor.doctor import DoctorFinding, grade_jitter, grade_sleep, report, stolen_s
from tests.executor.conftest import Prepared

DT = 0.002


@pytest.mark.parametrize(
    ("late", "grade"),
    [
        ([2e-5] * 1000, "ok"),
        ([2e-5] * 930 + [2e-3] * 70, "warning"),  # libfranka's first band
        ([2e-5] * 800 + [2e-3] * 200, "bad"),
        ([2e-5] * 999 + [0.009], "ok"),
        ([2e-5] * 999 + [0.011], "warning"),  # more than half of it
        ([2e-5] * 999 + [0.030], "warning"),  # one gap longer than the stream bears
        ([2e-5] * 999 + [0.100], "bad"),
    ],
)
def test_jitter_is_graded(late: list[float], grade: str) -> None:
    assert grade_jitter(late, DT).grade == grade


@pytest.mark.parametrize(
    ("grades", "code", "verdict"),
    [(["ok", "ok"], 0, "ready to stream."), (["ok", "warning"], 1, "warnings"), (["bad", "ok"], 2, "cannot stream")],
)
def test_the_worst_finding_decides(prepared: Prepared, grades: list[str], code: int, verdict: str) -> None:
    text, found = report(prepared.cell, [DoctorFinding("x", grade, "a value", "do this") for grade in grades])
    assert found == code
    assert verdict in text.splitlines()[-1]
    assert text.count("-> do this") == 2


@pytest.mark.parametrize(
    ("is_virtual", "may_set", "grade", "word"),
    [(True, True, "warning", "12.3%"), (False, True, "ok", "awake"), (False, False, "warning", "/dev/cpu_dma_latency")],
)
def test_processors_that_sleep_are_reported(is_virtual: bool, may_set: bool, grade: str, word: str) -> None:
    finding = grade_sleep(is_virtual, may_set, stolen=0.123)
    assert (finding.grade, bool(finding.advice)) == (grade, grade != "ok")
    assert word in finding.text


def test_the_time_a_host_has_taken_is_read(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(doctor, "STAT", tmp_path / "stat")
    assert stolen_s() == 0.0
    (tmp_path / "stat").write_text("cpu  10 20 30 40 50 60 70 250 0 0\ncpu0 1 2 3 4 5 6 7 8 0 0\n")
    assert stolen_s() == 250 / os.sysconf("SC_CLK_TCK")

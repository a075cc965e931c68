"""The doctor's grades and verdict."""

from __future__ import annotations

import pytest

from executor.doctor import Finding, judge_jitter, report
from tests.executor.conftest import Prepared

DT = 0.002


@pytest.mark.parametrize(
    ("late", "grade"),
    [
        ([2e-5] * 1000, "ok"),
        ([2e-5] * 930 + [2e-3] * 70, "warning"),  # libfranka's first band
        ([2e-5] * 800 + [2e-3] * 200, "bad"),
        ([2e-5] * 999 + [0.030], "warning"),  # one gap longer than the stream bears
        ([2e-5] * 999 + [0.100], "bad"),
    ],
)
def test_jitter_is_graded(late: list[float], grade: str) -> None:
    assert judge_jitter(late, DT).grade == grade


@pytest.mark.parametrize(
    ("grades", "code", "verdict"),
    [(["ok", "ok"], 0, "fit to stream."), (["ok", "warning"], 1, "warnings"), (["warning", "bad"], 2, "unfit")],
)
def test_the_worst_finding_decides(prepared: Prepared, grades: list[str], code: int, verdict: str) -> None:
    text, found = report(prepared.cell, [Finding("x", grade, "looked at", "do this") for grade in grades])
    assert found == code
    assert verdict in text.splitlines()[-1]
    assert text.count("-> do this") == 2

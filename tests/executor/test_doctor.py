"""The doctor's grades and verdict."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from executor import doctor
from executor.doctor import DoctorFinding, grade_jitter, grade_sleep, report, stolen_s
from executor.robot import FoundRobot, KinematicsInfo, RobotState
from planner.calibration import published_table
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
    findings = [DoctorFinding(f"check {grade}", grade, "a value", f"do {grade}") for grade in grades]
    text, found = report(prepared.cell, FoundRobot(), findings)
    assert found == code
    assert verdict in text.splitlines()[-1]
    assert text.count("-> do ") == 2


@pytest.mark.parametrize(
    ("grades", "missing", "step"),
    [
        ({"link": "warning", "lag": "bad"}, "lag, link", "mend lag"),
        ({"link": "ok", "lag": "warning"}, "lag", "mend lag"),
        ({"link": "ok"}, "nothing", "fling throw X Y Z --cell {cell} --dry-run: all of a throw but its motion"),
    ],
)
def test_the_report_begins_with_what_is_there_what_is_missing_and_what_to_do(
    prepared: Prepared, grades: dict[str, str], missing: str, step: str
) -> None:
    cell = prepared.cell
    findings = [
        DoctorFinding(name, grade, "a value", "" if grade == "ok" else f"mend {name}") for name, grade in grades.items()
    ]
    told = KinematicsInfo(published_table(cell.robot), (0,) * 6, 2)
    text, _ = report(cell, FoundRobot("5.11.1", None, told, "20245500815"), findings)
    lines = text.splitlines()
    gripper = f"gripper on {cell.gripper.output} {cell.gripper.index}"
    assert lines[1].startswith(f"Found: a {cell.robot.name}")
    assert lines[1].endswith(f"serial number 20245500815, PolyScope 5.11.1; {gripper}")
    assert lines[2:5] == [f"Missing or wrong: {missing}", f"Next: {step.format(cell=cell.name)}", ""]


def test_a_controller_that_is_not_there_is_one_finding_with_what_starts_it(
    prepared: Prepared, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "measure_wakeups", lambda dt, duration_s: [0.0])
    cell = prepared.cell
    real = replace(cell, link=replace(cell.link, kind="ur"))
    for each, words in ((cell, f"fling sim --cell {cell.name}"), (real, "that its address is right")):
        findings = doctor.examine(each, FoundRobot())
        assert [finding.name for finding in findings if finding.grade == "bad"] == ["link"]
        text, code = report(each, FoundRobot(), findings)
        assert code == 2
        assert f"nothing answers at {cell.link.host}" in text.splitlines()[1]
        assert words in text.splitlines()[3]


def test_what_keeps_the_robot_from_moving_is_a_finding(prepared: Prepared) -> None:
    zero = (0.0,) * 6
    off = RobotState(0.0, 0.0, zero, zero, zero, 3, 1, 1, 0.5, 0, 20.0)
    finding = doctor.grade_state(prepared.cell, off)
    assert finding.grade == "warning"
    for word in ("powered off", "speed slider", "payload of 20.00 kg"):
        assert word in finding.text


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

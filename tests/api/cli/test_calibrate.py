from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner

from api.cli import calibrate, main
from benchmarks.learning.recorded_arms import RecordedArm
from learning.recordings import COLUMNS
from planner.progress import Progress


def csv_file(folder: Path, arm: RecordedArm, rate_hz: float) -> Path:
    run = arm.run(np.random.default_rng(4), rate_hz)
    table = np.column_stack([run.time_s, run.command, run.measured])
    file = folder / "run.csv"
    np.savetxt(file, table, delimiter=",", header=",".join(COLUMNS), comments="", fmt="%.9g")
    return file


@pytest.mark.parametrize("rate_hz", [125.0, 500.0])
def test_the_lag_of_a_recorded_run_needs_no_service(tmp_path: Path, rate_hz: float):
    gain = np.array([1.02, 0.98, 1.0, 1.03, 0.97, 1.01])
    file = csv_file(tmp_path, RecordedArm(0.034, 0.004, gain), rate_hz)
    result = CliRunner().invoke(main, ["calibrate", "lag", "--cell", "any", "--from-csv", str(file), "--json"])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["lag_s"] == pytest.approx(0.034, abs=0.001)
    assert 0.0 < found["lag_std_s"] < 0.001
    assert found["gain"] == pytest.approx(gain, abs=0.01)
    text = CliRunner().invoke(main, ["calibrate", "lag", "--from-csv", str(file)])
    assert "timing.lag_s = 0.034" in text.stdout


@pytest.mark.parametrize("is_quiet", [False, True])
def test_the_searches_of_a_calibration_are_told(capsys: pytest.CaptureFixture[str], is_quiet: bool):
    class SlowService:
        def planned(self, request: Any, trajectory: bool, progress: Any) -> dict[str, Any]:
            progress(Progress("search", 3, None, 6.0))
            return {"request": request}

    service: Any = SlowService()
    requests = [{"cell": "lab", "release": {}}] * 3
    assert len([*calibrate._soonest_plans(service, requests, 2, is_quiet)]) == 2
    assert calibrate._plan_motion(service, requests, is_quiet)["request"]["cell"] == "lab"
    assert capsys.readouterr().err.count("3 candidates tried") == (0 if is_quiet else 3)


@pytest.mark.parametrize("evidence", ["throws", "reported", ""])
def test_a_profile_of_a_gripper_that_nobody_saw_open_is_refused(evidence: str):
    posts: list[str] = []

    class Service:
        def post(self, path: str) -> dict[str, Any]:
            posts.append(path)
            return {"id": "p", "evidence": {"throws": [], "reported": [], evidence: ["e"]}}

    service: Any = Service()
    if evidence:
        assert calibrate._estimate(service, "lab", adopt=True, of="gripper")["adopted"]
        return
    with pytest.raises(click.ClickException, match="nothing shows when it lets go"):
        calibrate._estimate(service, "lab", adopt=True, of="gripper")
    assert posts == ["/cells/lab/profiles"]  # and none is adopted


LEARNT = {"delay_s": 0.0123, "delay_std_s": 8e-5, "jitter_s": 0.0005, "jitter_std_s": 4e-5, "edges": 24}


def outputs_calibrated(
    monkeypatch: pytest.MonkeyPatch, motions: list[Any], learnt: dict[str, Any], *options: str
) -> tuple[Any, list[str]]:
    """Runs `fling calibrate outputs` for two outputs, against a service that learns so much; returns its posts, too."""
    posts: list[str] = []

    class Service:
        def get(self, path: str) -> dict[str, Any]:
            return {"outputs": motions}

        def planned(self, request: Any, *_: Any, **__: Any) -> dict[str, Any]:
            return {"id": "plan", "passages": [{"name": name, "outputs": [{}] * 8} for name in ("valve", "lamp")]}

        def post(self, path: str) -> dict[str, Any]:
            posts.append(path)
            return {"id": "p", "outputs": learnt, "evidence": {}}

    def executed(*_: Any) -> dict[str, Any]:
        posts.append("motion")
        return {"metrics": {"outputs": [{"edge_time_s": 0.1}, {"edge_time_s": None}]}}

    monkeypatch.setattr("api.cli.support.client.ServiceClient", lambda *_: nullcontext(Service()))
    monkeypatch.setattr(calibrate, "_executed", executed)
    result = CliRunner().invoke(main, ["calibrate", "outputs", "--cell", "lab", *options])
    return result, posts


def test_outputs_are_switched_as_often_as_asked_and_what_was_learnt_is_told(monkeypatch: pytest.MonkeyPatch):
    asked = ("--count", "20", "--adopt")
    result, posts = outputs_calibrated(monkeypatch, [{"cell": "lab"}], {"valve": LEARNT}, *asked)
    assert result.exit_code == 0, result.output
    assert posts == ["motion"] * 3 + ["/cells/lab/profiles", "/profiles/p/adopt"]
    assert "motion 3 of 3: 1 of 2 edges seen" in result.output
    assert "valve: delay 12.30 ± 0.08 ms, jitter 0.50 ± 0.04 ms, from 24 edges" in result.output
    assert "lamp: not seen at its input" in result.output
    assert "profile p is in use" in result.output


def test_learnt_outputs_are_told_in_json_and_not_adopted_unasked(monkeypatch: pytest.MonkeyPatch):
    result, posts = outputs_calibrated(monkeypatch, [{"cell": "lab"}], {"valve": LEARNT}, "--count", "8", "--json")
    assert posts == ["motion", "/cells/lab/profiles"]
    found = json.loads(result.stdout)
    assert found == {"cell": "lab", "profile": "p", "outputs": {"valve": LEARNT}, "adopted": False, "unseen": ["lamp"]}


@pytest.mark.parametrize(("motions", "words"), [([], "has a sense_input"), ([{"cell": "lab"}], "no edge was seen")])
def test_outputs_without_an_input_that_sees_them_are_refused(
    monkeypatch: pytest.MonkeyPatch, motions: list[Any], words: str
):
    result, posts = outputs_calibrated(monkeypatch, motions, {}, "--adopt")
    assert result.exit_code == 1
    assert words in result.output
    assert "/profiles/p/adopt" not in posts


def test_a_motion_without_timing_leaves_the_others_theirs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    class Service:
        def get(self, path: str) -> dict[str, Any]:
            return {"motions": [[]], "assumed_lag_s": 0.02}

    service: Any = Service()
    timing = {"lag_s": 0.02, "lag_std_s": 1e-4, "gain": [1.0] * 6, "gain_std": [0.01] * 6, "mode": "speedj"}
    shown = [timing, None, timing]
    monkeypatch.setattr(calibrate, "_move", lambda *_: shown.pop())
    monkeypatch.setattr("learning.pooled_document", lambda runs, _: {"runs": len(runs)} if runs else None)
    assert calibrate._by_motions("lab", 3, False, None, service)["runs"] == 2
    assert "motion 2 of 3: shows no timing: its recording has gaps" in capsys.readouterr().out
    shown = [None]
    with pytest.raises(click.ClickException, match="each motion shows no timing"):
        calibrate._by_motions("lab", 1, False, None, service)


def test_a_file_that_is_no_recording_is_refused_with_the_reason(tmp_path: Path):
    file = tmp_path / "run.csv"
    file.write_text("time_s,command_0\n0,0\n")
    result = CliRunner().invoke(main, ["calibrate", "lag", "--cell", "any", "--from-csv", str(file)])
    assert result.exit_code == 1
    assert "command_1" in result.stderr

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.learning.recorded_arms import RecordedArm
from executor.doctor import grade_lag, known_timing
from learning import estimate_timing, lag_change
from planner.cell import load_cell
from tests.api.conftest import ROOT, RunningService
from tests.api.test_bad_input import problem_of

CELL = "changing"  # a cell that no other test executes on


def finished(service: RunningService, lag_s: float, seed: int) -> str:
    """Stores a finished execution whose recording shows this lag."""
    found = estimate_timing(RecordedArm(lag_s).run(np.random.default_rng(seed), 125.0), ramp_rad_s2=40.0)
    change = lag_change(found.lag_s, found.lag_std_s, 0.020)
    timing: dict[str, Any] = {**found.as_document(), "mode": "speedj", "assumed_lag_s": 0.020, "lag_change_s": change}
    plan = service.plan(cell=CELL)
    id = service.store.queue_execution(plan["id"], CELL).id
    service.store.finish_execution(id, "completed", None, {"timing": timing})
    return id


def test_a_cell_without_runs_has_no_timing_yet(service: RunningService):
    answer = service.client.get("/cells/real/timing").json()
    assert (answer["pooled"], answer["runs"], answer["assumed_lag_s"]) == (None, [], 0.020)
    problem_of(service.client.get("/cells/nowhere/timing"), 404, "not-found")
    cell = load_cell(ROOT / "cells" / "ur5e-sim.toml")
    assert grade_lag(cell, None).grade == "warning"


def test_timing_by_run_and_pooled_and_what_the_doctor_says(service: RunningService, cells: Path):
    ids = [finished(service, 0.026, seed) for seed in (1, 2)]
    answer = service.client.get(f"/cells/{CELL}/timing").json()
    assert [run["execution_id"] for run in answer["runs"]] == ids[::-1]
    assert answer["pooled"]["lag_s"] == pytest.approx(0.026, abs=5e-4)
    assert answer["pooled"]["lag_change_s"] == pytest.approx(0.006, abs=5e-4)
    assert "set timing.lag_s to 0.02" in answer["pooled"]["advice"]
    cell = service.client.app.state.service.cell(CELL)  # type: ignore[attr-defined]
    finding = grade_lag(cell, known_timing(cell, service.settings.database_url))
    assert (finding.grade, finding.advice) == ("warning", answer["pooled"]["advice"])
    file = cells / f"{CELL}.toml"
    before = file.read_text()
    try:
        file.write_text(before.replace("[timing]\nlag_s = 0.02", "[timing]\nlag_s = 0.021"))
        kept = service.client.get(f"/cells/{CELL}/timing").json()["pooled"]
        file.write_text(before.replace("mass_kg = 1.0", "mass_kg = 1.6"))
        other = service.client.get(f"/cells/{CELL}/timing").json()
    finally:
        file.write_text(before)
    assert kept["lag_s"] == answer["pooled"]["lag_s"]  # the same arm, whatever plans assume of it
    assert kept["lag_change_s"] == pytest.approx(0.005, abs=5e-4)
    assert (other["pooled"], other["runs"]) == (None, [])  # another tool: another arm

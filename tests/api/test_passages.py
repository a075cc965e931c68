"""Plans of passages over HTTP and on the command line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from api.cli import main
from api.report import ReportContent, report_html
from api.schemas import PLAN_EXAMPLES
from api.schemas.responses import PlanAnswer
from tests.api.conftest import RunningService

ROW = PLAN_EXAMPLES["passages"]["value"]
LINE = PLAN_EXAMPLES["line"]["value"]


@pytest.fixture(scope="module")
def plan(shared: RunningService) -> dict[str, Any]:
    """The plan of the example of `POST /plan`."""
    response = shared.client.post("/plan", json=ROW)
    assert response.status_code == 201, response.text
    return response.json()


def test_the_example_is_answered_as_the_schema_says(shared: RunningService, plan: dict[str, Any]) -> None:
    PlanAnswer.model_validate(plan)
    assert plan["release"] is None
    assert plan["release_time_s"] is None
    assert [each["name"] for each in plan["passages"]] == ["part 0", "part 1", "part 2"]
    for each in plan["passages"]:
        assert each["end_index"] == each["index"]
        assert each["time_s"] == each["index"] / plan["sample_rate_hz"]
        assert [output["edge_time_s"] - each["time_s"] for output in each["outputs"]] == pytest.approx([0.0, 0.02])
    assert shared.client.get(f"/plans/{plan['id']}").json() == plan
    curves = shared.client.get(f"/plans/{plan['id']}/curves")
    assert curves.status_code == 200
    assert "flight_clearance" not in [curve["name"] for curve in curves.json()["curves"]]


def test_a_line_is_answered_as_the_schema_says(shared: RunningService) -> None:
    response = shared.client.post("/plan", json=LINE)
    assert response.status_code == 201, response.text
    plan = response.json()
    PlanAnswer.model_validate(plan)
    (bead,) = plan["passages"]
    assert bead["end_index"] - bead["index"] == 500
    assert bead["pose"]["position"] == pytest.approx([0.5, -0.2, 0.25])
    assert [output["edge_time_s"] - bead["time_s"] for output in bead["outputs"]] == pytest.approx([0.05, 0.95])
    assert [output["offset_m"] for output in bead["outputs"]] == [0.02, 0.38]


def test_a_batch_takes_passages_and_a_grid_of_their_fields(shared: RunningService) -> None:
    grid = {"passages[1].state.twist.linear[1]": [0.6, 0.8, 0.2]}
    answer = shared.client.post("/batches", json={"template": ROW, "grid": grid})
    assert answer.status_code == 201, answer.text
    assert answer.json()["total"] == 2


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"passages": [{"name": "bead", "line": {}}]}, "passages[0].line.speed_m_s"),
        ({"passages": [{**ROW["passages"][0], **LINE["passages"][0]}]}, "passages[0].state"),
        ({"release": ROW["passages"][0]["state"]}, "release"),
        ({"backend": "casadi"}, "backend"),
    ],
)
def test_what_is_refused_is_named(shared: RunningService, change: dict[str, Any], field: str) -> None:
    answer = shared.client.post("/plan", json={**ROW, **change})
    assert answer.status_code == 422
    assert answer.json()["type"] == "/problems/invalid-request"
    assert field in [error["field"] for error in answer.json()["errors"]]


def test_a_leg_in_whose_way_something_stands_is_infeasible(shared: RunningService) -> None:
    far = {**ROW["passages"][2]["state"], "pose": {"position": [1.5, 0.0, 0.35], "rotation_vector": [3.14, 0.0, 0.0]}}
    passages = [*ROW["passages"][:2], {"name": "far", "state": far}]
    answer = shared.client.post("/plan", json={"passages": passages})
    assert answer.status_code == 422
    assert answer.json()["type"] == "/problems/infeasible"
    assert answer.json()["nearest"] is None
    assert "passage 'far'" in answer.json()["violations"][0]["detail"]


def test_the_command_line_plans_passages_and_reports_them(tmp_path: Path) -> None:
    file = tmp_path / "row.json"
    file.write_text(json.dumps({"cell": "ur5e-sim", **ROW}))
    result = CliRunner().invoke(main, ["plan", str(file)])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert len(found["passages"]) == 3
    assert "passages after" in result.stderr
    assert "part 1" in report_html(ReportContent(found))
    short = {**ROW, "end": {"kind": "rest"}}
    file.write_text(json.dumps({"cell": "ur5e-sim", **short}))
    plan_file = tmp_path / "plan.json"
    plan_file.write_text(CliRunner().invoke(main, ["plan", str(file)]).stdout)
    result = CliRunner().invoke(main, ["export", "--urscript", str(plan_file)])
    assert result.exit_code == 0, result.output
    program = plan_file.with_suffix(".script").read_text()
    assert "s after its first row it sets standard_digital 0 to True." in program
    assert program.count("set_standard_digital_out(0, True)") == 1

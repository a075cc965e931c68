"""A motion in which two grippers let go, over HTTP: answered as the schema says, drawn, and refused by field."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from api.cli import main
from api.report import ReportContent, report_html
from api.schemas.responses import PlanAnswer
from api.settings import ServiceSettings
from tests.api.conftest import RunningService, running, wait_until_ready
from tests.planner.two_grippers import ROOT, TARGETS, two_grippers, two_throws


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the cell of two grippers."""
    folder = tmp_path_factory.mktemp("two")
    (folder / "two.toml").write_text(two_grippers((ROOT / "cells" / "ur5e-sim.toml").read_text()))
    return folder


@pytest.fixture(scope="module")
def station(folder: Path) -> Iterator[RunningService]:
    """A service with that cell."""
    database = f"sqlite:///{folder / 'fling.db'}"
    with running(ServiceSettings(database_url=database, cells=folder, data=folder, planner_workers=1)) as service:
        wait_until_ready(service)
        yield service


@pytest.fixture(scope="module")
def plan(station: RunningService) -> dict[str, Any]:
    """The plan of both throws."""
    response = station.client.post("/plan", json={"cell": "two", **two_throws()})
    assert response.status_code == 201, response.text
    return response.json()


def test_both_throws_are_answered_as_the_schema_says(station: RunningService, plan: dict[str, Any]) -> None:
    PlanAnswer.model_validate(plan)
    assert [each["releases"] for each in plan["passages"]] == [True, "left"]
    for each, target in zip(plan["passages"], TARGETS.values(), strict=True):
        assert each["flight"]["landing_point"] == pytest.approx(target, abs=1e-3)
    assert plan["release"]["index"] == plan["passages"][0]["index"]
    assert plan["hit_probability"] is None
    names = [check["name"] for check in plan["certificate"]["checks"]]
    assert {"releases_apart", "flights_apart"} <= set(names)
    assert len(names) == len(set(names))
    assert station.client.get(f"/plans/{plan['id']}").json() == plan


def test_its_curves_its_cell_and_its_report_are_told(station: RunningService, plan: dict[str, Any]) -> None:
    curves = station.client.get(f"/plans/{plan['id']}/curves")
    assert curves.status_code == 200, curves.text
    assert station.client.get("/cells/two/model").status_code == 200
    left = station.client.get("/cells/two").json()["grippers"]["left"]
    assert left["tcp_position_m"] == [0.0, -0.06, 0.17]
    assert left["open_level"] is True
    assert left["object"]["radius_m"] == 0.025
    assert "second" in report_html(ReportContent(plan))


def test_an_unknown_gripper_is_refused_by_its_field(station: RunningService) -> None:
    request = two_throws()
    request["passages"][1]["releases"] = "right"
    answer = station.client.post("/plan", json={"cell": "two", **request})
    assert answer.status_code == 422
    (error,) = answer.json()["errors"]
    assert error["field"] == "passages[1].releases"
    assert "there are left" in error["reason"]


def test_no_program_lets_both_go(folder: Path, plan: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLING_CELLS", str(folder))
    file = folder / "plan.json"
    file.write_text(json.dumps(plan))
    result = CliRunner().invoke(main, ["export", "--urscript", str(file)])
    assert result.exit_code != 0
    assert "a program lets go of one object" in result.output

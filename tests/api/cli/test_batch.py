"""`fling batch` without a service: a small real batch in a store of its own."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from api.cli import main
from store import Store
from tests.api.conftest import REQUEST

GRID = {"template": REQUEST, "grid": {"release.positions[0]": [0.3, 0.31, 0.01]}}


@pytest.fixture
def environment(tmp_path: Path, root: Path) -> dict[str, str]:
    return {"FLING_DATABASE_URL": f"sqlite:///{tmp_path / 'fling.db'}", "FLING_CELLS": str(root / "cells")}


def run(environment: dict[str, str], *arguments: str, body: Any = None):
    text = None if body is None else json.dumps(body)
    return CliRunner().invoke(main, ["batch", *arguments], env=environment, input=text)


@pytest.mark.slow
def test_a_batch_without_a_service(environment: dict[str, str], tmp_path: Path):
    out = tmp_path / "results.csv"
    done = run(environment, "-", "--workers", "1", "--json", "--out", str(out), body=GRID)
    assert done.exit_code == 0, done.output
    batch = json.loads(done.stdout)
    assert (batch["outcome"], batch["counts"]) == ("completed", {"planned": 2})
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [float(row["release.positions[0]"]) for row in rows] == [0.3, 0.31]
    store = Store.open(environment["FLING_DATABASE_URL"])
    plans = [json.loads(store.plan(row["plan_id"]).summary) for row in rows]
    waiting = store.add_batch(b"", 1, driven_by="command").id
    store.close()
    assert [plan["request"]["release"]["positions"][0] for plan in plans] == [0.3, 0.31]
    again = run(environment, "--resume", batch["id"], "--out", str(tmp_path / "again.csv"))
    assert again.exit_code == 0
    assert "completed; 2 of 2: 2 planned" in again.stdout
    assert (tmp_path / "again.csv").read_text() == out.read_text()
    cancelled = run(environment, "--cancel", "latest")
    assert cancelled.exit_code == 0
    assert waiting in cancelled.stdout and "cancelled" in cancelled.stdout


@pytest.mark.parametrize(
    ("arguments", "body", "status", "words"),
    [
        ([], None, 64, "give FILE, --resume ID or --cancel ID"),
        (["-", "--resume", "x"], GRID, 64, "give FILE"),
        (["-", "--out", "results.txt"], GRID, 64, "must end in .parquet, .csv or .jsonl"),
        (["-", "--url", "http://127.0.0.1:1", "--workers", "1"], GRID, 64, "do not go with --url"),
        (["-", "--url", "http://127.0.0.1:1"], GRID, 1, "no service"),
        (["--resume", "x"], None, 1, "no batch 'x'"),
        (["-", "--workers", "1"], {"requests": [{"release": {"kind": "joint"}}]}, 1, "requests[0].release.positions"),
        (["-"], {**GRID, "grid": {"release.positions[9]": [0, 1, 1]}}, 1, "no element 9"),
        (["-"], {**GRID, "template": {**REQUEST, "cell": "nowhere"}}, 1, "no cell 'nowhere'"),
        (["nowhere.json"], None, 1, "nowhere.json"),
    ],
)
def test_what_is_wrong_is_said(environment: dict[str, str], arguments: list[str], body: Any, status: int, words: str):
    done = run(environment, *arguments, body=body)
    assert done.exit_code == status, done.output
    assert words in done.stderr

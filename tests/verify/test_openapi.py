"""schemathesis on the running service: whatever its document allows or forbids, it answers as the document says.

All checks, every phase, stateful too; on SQLite and PostgreSQL, with and without tokens. FLING_CASES asks for more than
the short run: `make fuzz`.
"""

from __future__ import annotations

import os
import re
import secrets
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from math import ceil
from pathlib import Path
from typing import Any

import httpx2
import pytest

from api.http import create_token
from api.schemas import JOB_EXAMPLES, MAP_EXAMPLES, PLAN_EXAMPLES, TARGET_EXAMPLES
from store import Store
from tests.postgres import database_on
from tests.verify.conftest import ServiceProcess
from tests.verify.quick_workers import QuickExecutor, QuickPlanner

FOLDER = Path(__file__).parent / "openapi"
CASES = int(os.environ.get("FLING_CASES", "0"))  # at least so many, in each run
EXAMPLES = 5
SHORT_CASES = 2300  # examples of an operation in the short run, and cases that it has at least
CASES_AN_EXAMPLE = 35  # at least so many cases more for each further example
# Database, with tokens, seed. Continuous integration has the first, without `make fuzz` there are the first two, in
# which each database and each kind of access occurs. With tokens a run waits minutes: wrong ones are answered late.
FIRST = ("sqlite", False, 1)
SECOND = ("postgresql", True, 1)
# Seeds of `make fuzz`: three that nobody chose, which each test names; or those of FLING_SEEDS, to see a failure again.
GIVEN = [int(seed) for seed in os.environ.get("FLING_SEEDS", "").split()]
SEEDS = GIVEN or [secrets.randbelow(10**6) for _ in range(3)]
DATABASES = ("sqlite", "postgresql")
RUNS = [(database, guarded, seed) for seed in SEEDS for database in DATABASES for guarded in (False, True)]
SHORT_RUNS = [FIRST, pytest.param(*SECOND, marks=pytest.mark.slow)]
CELL = "ur5e-sim"
PATIENCE_S = 600  # [s] speed is no matter of this test


@pytest.fixture
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """URL of an empty database."""
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'fling.db'}"
        return
    with database_on(request.getfixturevalue("postgres_url")) as found:
        yield found


@contextmanager
def served(url: str, folder: Path, guarded: bool) -> Iterator[tuple[ServiceProcess, dict[str, str]]]:
    """Runs a service that has something of each kind; yields it and its headers."""
    Store.upgrade(url)
    own = {"FLING_BATCH_WORKERS": "0"}
    headers = {}
    if guarded:
        file = folder / "tokens.toml"
        token = create_token(file, "schemathesis", ("plan", "operate"))
        own["FLING_TOKENS_FILE"] = str(file)
        headers = {"Authorization": f"Bearer {token}"}
    service = ServiceProcess(url, folder / "service.log", workers=1, **own)
    try:
        with QuickExecutor(url, CELL), QuickPlanner(url):
            furnish(service, headers)
            yield service, headers
    finally:
        service.stop()


def furnish(service: ServiceProcess, headers: dict[str, str]) -> None:
    """Makes one of each thing that is read as `latest`."""
    joint = PLAN_EXAMPLES["joint"]["value"]
    http = httpx2.Client(base_url=service.address, headers=headers, timeout=PATIENCE_S)
    first: list[tuple[str, dict[str, Any] | None]] = [
        ("/experiments", {"name": "first"}), ("/plan", joint), ("/execute", {"plan_id": "latest"}),
        ("/executions/latest/events", None), ("/executions/latest/landing", {"result": "hit", "radius_m": 0.1}),
        ("/batches", {"requests": [joint]}), ("/batches/latest/events", None),
        (f"/cells/{CELL}/map", MAP_EXAMPLES["coarse"]["value"]), (f"/cells/{CELL}/profiles", {}),
        (f"/cells/{CELL}/targets", TARGET_EXAMPLES["encoder"]["value"]),
        ("/jobs", JOB_EXAMPLES["list"]["value"]), ("/jobs/latest/events", None),
    ]  # fmt: skip
    with http:
        for path, body in first:
            answer = http.get(path) if body is None else http.post(path, json=body)
            assert answer.is_success, (path, answer.text)


@pytest.mark.timeout(1800 + CASES)
@pytest.mark.parametrize(("url", "guarded", "seed"), RUNS if CASES else SHORT_RUNS, indirect=["url"], ids=str)
def test_every_answer_is_as_documented(url: str, guarded: bool, seed: int, tmp_path: Path):
    program = [sys.executable, "-m", "schemathesis.cli", "--config-file", str(FOLDER / "schemathesis.toml"), "run"]
    flags = ["--checks", "all", "--continue-on-failure", "--generation-database", "none", "--no-color",
             "--max-response-time", str(PATIENCE_S)]  # fmt: skip
    examples = EXAMPLES + max(0, ceil((CASES - SHORT_CASES) / CASES_AN_EXAMPLE))
    with served(url, tmp_path, guarded) as (service, headers):
        target = [f"{service.address}/openapi.json", "--seed", str(seed), "-n", str(examples)]
        header = [part for name, value in headers.items() for part in ("-H", f"{name}: {value}")]
        done = subprocess.run(
            [*program, *target, *flags, *header], cwd=FOLDER, capture_output=True, text=True, check=False
        )
        (tmp_path / "schemathesis.txt").write_text(done.stdout)
        errors = service.lines(level="error")
    print(done.stdout[-2000:])
    assert done.returncode == 0, done.stdout[-20000:] + done.stderr[-5000:]
    assert errors == []
    found = re.search(r"(\d+) generated", done.stdout)
    assert found is not None and int(found[1]) >= max(CASES, SHORT_CASES)

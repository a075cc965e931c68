"""schemathesis on the running service: whatever its document allows or forbids, it answers as the document says.

All checks, every phase, stateful too; on SQLite and PostgreSQL, with and without tokens. FLING_CASES asks for more than
the short run: `make fuzz`.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import make_url

from api.http import create_token
from store import Store, new_id
from tests.verify.conftest import ServiceProcess

FOLDER = Path(__file__).parent / "openapi"
CASES = int(os.environ.get("FLING_CASES", "0"))  # at least so many, in each run
EXAMPLES = 5  # an operation, in the short run
CASES_AN_EXAMPLE = 30  # about so many cases more for each further example
# Database, with tokens, seed. The short run has the first two, in which each database and each kind of access occurs.
RUNS = [
    ("sqlite", False, 1), ("postgresql", True, 1), ("sqlite", True, 1), ("postgresql", False, 1),
    ("sqlite", False, 2), ("postgresql", True, 2), ("sqlite", True, 2), ("postgresql", False, 2),
]  # fmt: skip
CELL = "ur5e-sim"
BEAT_S = 0.05
PATIENCE_S = 150  # [s] speed is no matter of this test


class QuickExecutor:
    """An executor that finishes every execution at once, so that there is something to read, abort and report."""

    def __init__(self, url: str) -> None:
        self._store, self._ended = Store.open(url), threading.Event()
        self._thread = threading.Thread(target=self._go_on)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._store.close()

    def _go_on(self) -> None:
        while not self._ended.wait(BEAT_S):
            self._store.record_heartbeat(CELL, "quick", "sim", {"positions": [0.1] * 6}, None, False)
            row = self._store.claim_execution(CELL, "quick")
            if row is not None:
                self._store.finish_execution(row.id, "completed", None, {"released": True, "ticks": 3})


@pytest.fixture
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """URL of an empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'fling.db'}"
    server = make_url(request.getfixturevalue("postgres_url"))
    name = f"fling_{new_id().replace('-', '')}"
    with psycopg.connect(f"postgresql://{server.username}@{server.host}:{server.port}/postgres", autocommit=True) as at:
        at.execute(f"CREATE DATABASE {name}")  # type: ignore[arg-type]  # a name of our own
    return server.set(database=name).render_as_string()


@contextmanager
def served(url: str, folder: Path, guarded: bool) -> Iterator[tuple[ServiceProcess, list[str]]]:
    """Runs a service with an executor; yields it and schemathesis' options for its token."""
    own, options = {}, []
    if guarded:
        file = folder / "tokens.toml"
        token = create_token(file, "schemathesis", ("plan", "operate"))
        own, options = {"FLING_TOKENS_FILE": str(file)}, ["-H", f"Authorization: Bearer {token}"]
    service = ServiceProcess(url, folder / "service.log", workers=1, **own)
    try:
        with QuickExecutor(url):
            yield service, options
    finally:
        service.stop()


@pytest.mark.timeout(900 + CASES)
@pytest.mark.parametrize(("url", "guarded", "seed"), RUNS if CASES else RUNS[:2], indirect=["url"], ids=str)
def test_every_answer_is_as_documented(url: str, guarded: bool, seed: int, tmp_path: Path):
    program = [sys.executable, "-m", "schemathesis.cli", "--config-file", str(FOLDER / "schemathesis.toml"), "run"]
    flags = ["--checks", "all", "--continue-on-failure", "--generation-database", "none", "--no-color",
             "--max-response-time", str(PATIENCE_S)]  # fmt: skip
    examples = max(EXAMPLES, CASES // CASES_AN_EXAMPLE)
    with served(url, tmp_path, guarded) as (service, options):
        target = [f"http://127.0.0.1:{service.port}/openapi.json", "--seed", str(seed), "-n", str(examples)]
        done = subprocess.run(
            [*program, *target, *flags, *options], cwd=FOLDER, capture_output=True, text=True, check=False
        )
        (tmp_path / "schemathesis.txt").write_text(done.stdout)
        errors = service.lines(level="error")
    print(done.stdout[-2000:])
    assert done.returncode == 0, done.stdout[-20000:] + done.stderr[-5000:]
    assert errors == []
    found = re.search(r"(\d+) generated", done.stdout)
    assert found is not None and int(found[1]) >= max(CASES, 1000)

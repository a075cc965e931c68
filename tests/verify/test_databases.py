"""The tests of store and service on a PostgreSQL server; `make test` has them on SQLite alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

STORE = ["tests/store", "-k", "postgresql"]
API = pytest.param(["tests/api"], marks=pytest.mark.slow)


@pytest.mark.parametrize("tests", [STORE, API], ids=["store", "api"])
def test_they_pass_on_postgresql(postgres_url: str, root: Path, tests: list[str]):
    command = [sys.executable, "-m", "pytest", *tests, "-q", "-p", "no:cacheprovider"]
    environment = {**os.environ, "FLING_TEST_POSTGRES": postgres_url}
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr

"""The tests of the store on a PostgreSQL server; `make test` has them on SQLite alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def test_the_store_keeps_its_promises_on_postgresql(postgres_url: str, root: Path):
    command = [sys.executable, "-m", "pytest", "tests/store", "-q", "-k", "postgresql", "-p", "no:cacheprovider"]
    environment = {**os.environ, "FLING_TEST_POSTGRES": postgres_url}
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr

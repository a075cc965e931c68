"""The soak: a short one, or FLING_SOAK_MINUTES of it (`make verify LONG=1`: an hour)."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
MINUTES = float(os.environ.get("FLING_SOAK_MINUTES", "6"))  # two are too short to tell a leak from a cache that fills
HOST = "127.0.45.9"


@pytest.mark.timeout(600 + 90 * MINUTES)
def test_nothing_grows_and_nothing_is_lost(root: Path, tmp_path: Path):
    command = ["-m", "benchmarks.soak", "--minutes", str(MINUTES), "--host", HOST, "--keep", str(tmp_path / "soak")]
    done = subprocess.run([sys.executable, *command], cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]

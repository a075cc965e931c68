"""What the first `make` tells of itself."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import sysconfig
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from setuptools import Distribution

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize(("goal", "steps"), [("demo", 2), ("up", 2), ("setup", 3), ("test", 3), ("sbom", 1)])
def test_steps_are_counted_to_the_last(goal: str, steps: int, tmp_path: Path):
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
    command = ["make", "--dry-run", f"VENV={tmp_path / 'venv'}", goal]
    told = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True).stdout
    counted = re.findall(r"setting up (\d) of (\d):", told)
    assert counted == [(str(i), str(steps)) for i in range(1, steps + 1)]


@pytest.fixture
def setup() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fling_setup", ROOT / "setup.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_compiling_tells_how_far_it_is(
    setup: ModuleType, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(setup, "TELL_S", 0.05)
    with ThreadPoolExecutor(1) as pool:
        setup.tell_until_done([pool.submit(time.sleep, 0.2), pool.submit(int)], "compiled")
    assert capsys.readouterr().err.startswith("  0 of 2 files compiled, 0 s\n")


def test_an_isolated_build_finds_the_casadi_that_stays(
    setup: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """`pip install --editable .` builds beside a casadi of its own, which is gone once it is done."""
    folder = tmp_path / "casadi"
    folder.mkdir()
    (folder / "libfatrop.so.1.1.8").touch()
    monkeypatch.setitem(sys.modules, "casadi", SimpleNamespace(__file__=str(folder / "__init__.py")))
    build = setup.BuildNative(Distribution())
    build._is_in_checkout = True
    build._link_to_fatrop()
    assert str(Path(sysconfig.get_path("platlib"), "casadi")) in setup.OPTIMISER.runtime_library_dirs

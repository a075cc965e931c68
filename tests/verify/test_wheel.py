"""The wheel holds what runs, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import casadi


def test_the_wheel_holds_every_module_and_data_file(wheel: Path, checkout: Path):
    packages = ("fling", "planner", "store", "learning", "jobs", "api", "executor", "simulator")
    kinds = (".py", ".toml", ".html", ".css", ".js", ".svg", ".txt")
    expected = {
        str(file.relative_to(checkout)) for p in packages for file in (checkout / p).rglob("*") if file.suffix in kinds
    }
    held = {
        name for name in zipfile.ZipFile(wheel).namelist() if not name.split("/")[0].endswith((".dist-info", ".data"))
    }
    assert expected - held == set()
    assert {name.split("/")[0] for name in held} == set(packages)


def test_the_wheel_holds_the_compiled_c_for_every_python(wheel: Path):
    """It is linked to casadi's fatrop where casadi is installed beside it, and to nothing of the machine it is from."""
    assert "-cp311-abi3-" in wheel.name
    archive = zipfile.ZipFile(wheel)
    libraries = {name for name in archive.namelist() if name.endswith(".so")}
    assert libraries == {f"planner/native/{name}.abi3.so" for name in ("kernel", "optimiser")}
    optimiser = archive.read("planner/native/optimiser.abi3.so")
    assert b"$ORIGIN/../../casadi\0" in optimiser
    assert str(Path(casadi.__file__).parent).encode() not in optimiser


def test_without_a_compiler_building_from_source_says_so(checkout: Path, tmp_path: Path):
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(checkout)]
    environment = {**os.environ, "PATH": str(tmp_path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "building Fling from source needs a C compiler" in done.stdout + done.stderr

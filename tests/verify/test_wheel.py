"""The wheel holds what runs, and nothing else."""

from __future__ import annotations

import zipfile
from pathlib import Path


def test_the_wheel_holds_every_module_and_data_file(wheel: Path, checkout: Path):
    packages = ("fling", "planner", "store", "learning", "jobs", "api", "executor", "simulator")
    kinds = (".py", ".toml", ".c", ".html", ".css", ".js", ".svg", ".txt")
    expected = {
        str(file.relative_to(checkout)) for p in packages for file in (checkout / p).rglob("*") if file.suffix in kinds
    }
    held = {
        name for name in zipfile.ZipFile(wheel).namelist() if not name.split("/")[0].endswith((".dist-info", ".data"))
    }
    assert expected - held == set()
    assert {name.split("/")[0] for name in held} == set(packages)

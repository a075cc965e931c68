"""What can be checked of docker/ without an engine: linter, schema, the rules of the files, the health checks."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

BIN = Path(sys.executable).parent
TARGETS = ("service", "executor", "simulator")


@pytest.fixture(scope="module")
def dockerfile(root: Path) -> str:
    return (root / "docker" / "Dockerfile").read_text()


@pytest.fixture(scope="module")
def services(root: Path) -> dict[str, Any]:
    return yaml.safe_load((root / "docker" / "compose.yaml").read_text())["services"]


def own(services: dict[str, Any]) -> dict[str, Any]:
    """The services that run Fling."""
    return {name: entry for name, entry in services.items() if entry["image"].startswith("fling-")}


@pytest.mark.slow  # these two come with the documentation's requirements
@pytest.mark.parametrize(
    "command",
    [
        ["hadolint", "docker/Dockerfile"],
        ["check-jsonschema", "--builtin-schema", "vendor.compose-spec", "docker/compose.yaml"],
    ],
    ids=lambda command: command[0],
)
def test_linter_and_schema(root: Path, command: list[str]):
    done = subprocess.run([str(BIN / command[0]), *command[1:]], cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_base_is_pinned_and_the_same_everywhere(dockerfile: str):
    bases = re.findall(r"^FROM (\S+)", dockerfile, re.M)
    outside = {base for base in bases if base != "runtime"}
    assert len(outside) == 1
    assert re.fullmatch(r"python:3\.1\d-slim-\w+@sha256:[0-9a-f]{64}", outside.pop())


def test_every_target_is_unprivileged_and_has_a_health_check(dockerfile: str):
    stages = dict(re.findall(r"^FROM \S+ AS (\w+)\n(.*?)(?=^FROM|\Z)", dockerfile, re.M | re.S))
    assert set(TARGETS) < set(stages)
    assert re.search(r"^USER 10001:10001$", stages["runtime"], re.M)
    for target in TARGETS:
        assert "HEALTHCHECK --interval=10s" in stages[target]
        assert f'["python", "/healthy.py", "{target}"]' in stages[target]
        assert "USER" not in stages[target]


def test_what_is_copied_exists_and_is_not_ignored(root: Path, dockerfile: str):
    allowed = set((root / "docker" / "Dockerfile.dockerignore").read_text().splitlines())
    for line in re.findall(r"^COPY (?!--from)(.*)$", dockerfile, re.M):
        *sources, _ = line.split()
        for source in sources:
            assert (root / source).exists(), source
            assert f"!{source}" in allowed, source
    packages = {path.parent.name for path in root.glob("*/__init__.py")} - {"benchmarks", "tests"}
    assert {name for name in packages if f"COPY {name} {name}" not in dockerfile} == set()


def test_roots_are_read_only_and_capabilities_are_the_executors(services: dict[str, Any]):
    for name, entry in own(services).items():
        assert entry["read_only"] is True, name
        assert entry["cap_drop"] == ["ALL"], name
        assert entry["security_opt"] == ["no-new-privileges:true"], name
        assert ("cap_add" in entry) == name.endswith("executor"), name


def test_every_container_is_bounded_and_every_image_pinned(services: dict[str, Any]):
    for name, entry in services.items():
        assert re.fullmatch(r"(\$\{\w+:-)?\d+g\}?", entry["mem_limit"]), name
        assert 0 < entry["pids_limit"] <= 1024, name
        if name not in own(services):
            assert re.fullmatch(r"[\w/-]+:\d+(\.\d+)+(-\w+)?(@sha256:[0-9a-f]{64})?", entry["image"]), name


def test_the_database_runs_as_its_own_user_without_a_capability(services: dict[str, Any]):
    database = services["database"]
    assert (database["user"], database["read_only"], database["cap_drop"]) == ("postgres", True, ["ALL"])
    assert database["security_opt"] == ["no-new-privileges:true"]
    assert "cap_add" not in database


def test_profiles(services: dict[str, Any], root: Path):
    by_profile: dict[str, set[str]] = {}
    for name, entry in services.items():
        for profile in entry.get("profiles", ["always"]):
            by_profile.setdefault(profile, set()).add(name)
    assert by_profile == {
        "always": {"service"}, "sim": {"simulator", "executor"}, "ursim": {"ursim", "ursim-executor"},
        "robot": {"robot-executor"}, "postgres": {"database", "migrate"},
    }  # fmt: skip
    assert "\nCOMPOSE_PROFILES=sim\n" in (root / "docker" / ".env").read_text()


def test_only_the_service_sees_the_tokens_and_nothing_is_writable_by_all(services: dict[str, Any], root: Path):
    seeing = [name for name, entry in services.items() if any("tokens" in v for v in entry.get("volumes", []))]
    assert seeing == ["service"]
    for file in (root / "docker").iterdir():
        assert file.is_dir() or not re.search(r"\b(666|777|a\+w|o\+w)\b", file.read_text()), file


def test_the_ursim_cell_is_good(root: Path):
    from fling import open_cell

    assert open_cell(root / "docker" / "cells" / "ursim.toml").link.kind == "ur"


@pytest.mark.slow
@pytest.mark.parametrize("target", TARGETS)
def test_health_checks(target: str, root: Path, place: Path, environment: dict[str, str]):
    """Beside running processes each is healthy; where nobody is at work each is not."""
    own = {**environment, "FLING_DEFAULT_CELL": "ur5e-sim", "FLING_CELLS": str(place / "cells")}
    nobody = {
        **own,
        "FLING_PORT": "9",
        "FLING_DATABASE_URL": f"sqlite:///{place / 'empty.db'}",
        "FLING_CELLS": str(root / "docker" / "cells"),
        "FLING_DEFAULT_CELL": "ursim",
    }
    command = [sys.executable, str(root / "docker" / "healthy.py"), target]
    done = subprocess.run(command, cwd=place, env=own, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert subprocess.run(command, cwd=place, env=nobody, capture_output=True, check=False).returncode != 0

"""Child processes never import from the folder that they are started in."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

INSTALLED = ("fling", "planner", "store", "learning", "api", "executor", "simulator")


def interpreters(code: str) -> Iterator[tuple[int, str]]:
    """Yields line and first argument of every command that starts with `sys.executable`."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.List | ast.Tuple) and node.elts and ast.unparse(node.elts[0]) == "sys.executable":
            yield node.lineno, ast.unparse(node.elts[1])


@pytest.mark.parametrize("package", INSTALLED)
def test_every_python_that_is_started_has_a_safe_path(root: Path, package: str):
    for file in (root / package).rglob("*.py"):
        for line, flag in interpreters(file.read_text()):
            assert flag in ("'-P'", "'-I'"), f"{file}:{line}"


@pytest.mark.slow
def test_there_are_such_commands_and_an_unsafe_one_is_seen(root: Path):
    found = [
        flag for package in INSTALLED for f in (root / package).rglob("*.py") for _, flag in interpreters(f.read_text())
    ]
    assert len(found) >= 6
    assert list(interpreters("run([sys.executable, '-m', 'planner'])")) == [(1, "'-m'")]

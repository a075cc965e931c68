"""Fixtures for every room: nothing a test writes lands in the user's folders."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--controller HOST`: the contract suite of the simulator runs against that controller instead."""
    parser.addoption("--controller", metavar="HOST", help="URSim or a real controller for tests of its contract")


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture
def database_url(tmp_path: Path) -> str:
    """Address of an empty SQLite file of this test's own."""
    return f"sqlite:///{tmp_path / 'fling.db'}"

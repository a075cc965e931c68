"""What belongs to this machine, as service, executor, library and command line see it."""

from __future__ import annotations

from pathlib import Path

import pytest

from fling import this_machine


def test_files_are_in_the_users_folder_unless_the_environment_says_otherwise() -> None:
    home = {"XDG_DATA_HOME": "/data"}
    assert this_machine.executors_folder(home) == Path("/data/fling")
    assert this_machine.database_url(home) == "sqlite:////data/fling/fling.db"
    named = {**home, "FLING_DATA": "/else", "FLING_DATABASE_URL": "postgresql+psycopg://there/fling"}
    assert this_machine.executors_folder(named) == Path("/else")
    assert this_machine.database_url(named) == "postgresql+psycopg://there/fling"
    assert this_machine.user_folder({}) == Path.home() / ".local" / "share" / "fling"


@pytest.mark.parametrize(
    ("host", "is_loopback"),
    [("localhost", True), ("LocalHost", True), ("127.0.0.1", True), ("127.3.2.1", True), ("::1", True), ("[::1]", True),
     ("10.0.0.1", False), ("0.0.0.0", False), ("localhost.example", False), ("", False)],
)  # fmt: skip
def test_loopback_is_a_network(host: str, is_loopback: bool) -> None:
    assert this_machine.is_loopback_host(host) == is_loopback

"""Settings come from the environment; values out of range are refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from executor.settings import ExecutorSettings

HOME = {"XDG_DATA_HOME": "/data"}


def test_defaults() -> None:
    settings = ExecutorSettings.from_environment(HOME, None, False)
    assert settings.cell == "ur5e-sim"
    assert settings.data == Path("/data/fling/executor/ur5e-sim")
    assert settings.database_url == "sqlite:////data/fling/fling.db"
    assert settings.cell_path.is_file()
    assert settings.keep_awake


def test_the_environment_and_the_command_line(tmp_path: Path) -> None:
    environment = {**HOME, "FLING_DEFAULT_CELL": "a", "FLING_CELLS": str(tmp_path), "FLING_DATABASE_URL": "sqlite:///x",
                   "FLING_DATA": str(tmp_path), "FLING_WATCHDOG_HZ": "25", "FLING_STREAM_CORE": "-1"}  # fmt: skip
    settings = ExecutorSettings.from_environment(environment, "b", True)
    assert (settings.cell, settings.read_only, settings.watchdog_hz, settings.core) == ("b", True, 25.0, -1)
    assert settings.cell_path == tmp_path / "b.toml"
    assert settings.data == tmp_path / "executor" / "b"


def test_plans_have_to_be_proven_where_that_is_asked_for() -> None:
    assert not ExecutorSettings.from_environment(HOME, None, False).must_be_proven
    assert ExecutorSettings.from_environment({**HOME, "FLING_VERIFY": "on"}, None, False).must_be_proven
    with pytest.raises(ValueError, match="FLING_VERIFY"):
        ExecutorSettings.from_environment({**HOME, "FLING_VERIFY": "yes"}, None, False)


@pytest.mark.parametrize("hz", ["5", "100", "nan"])
def test_a_watchdog_that_guards_nothing_or_trips_by_itself_is_refused(hz: str) -> None:
    with pytest.raises(ValueError, match="FLING_WATCHDOG_HZ"):
        ExecutorSettings.from_environment({**HOME, "FLING_WATCHDOG_HZ": hz}, None, False)


@pytest.mark.parametrize("pace", ["0.05", "3", "nan"])
def test_a_pace_that_is_no_approach_is_refused(pace: str) -> None:
    with pytest.raises(ValueError, match="FLING_APPROACH_PACE"):
        ExecutorSettings.from_environment({**HOME, "FLING_APPROACH_PACE": pace}, None, False)


@pytest.mark.parametrize("name", ["WATCHDOG_HZ", "DEAD_MAN_S", "APPROACH_PACE", "STREAM_CORE"])
def test_what_is_no_number_is_refused_by_its_name(name: str) -> None:
    with pytest.raises(ValueError, match=f"FLING_{name} 'fast' is n"):
        ExecutorSettings.from_environment({**HOME, f"FLING_{name}": "fast"}, None, False)


def test_a_processor_that_is_not_there_is_refused() -> None:
    with pytest.raises(ValueError, match=r"STREAM_CORE '4096' is neither a processor of this machine, 0 to \d+"):
        ExecutorSettings.from_environment({**HOME, "FLING_STREAM_CORE": "4096"}, None, False)


@pytest.mark.parametrize("name", ["DEAD_MAN_S", "APPROACH_PACE"])
def test_nought_is_no_default(name: str) -> None:
    with pytest.raises(ValueError, match=f"FLING_{name} 0 is not within"):
        ExecutorSettings.from_environment({**HOME, f"FLING_{name}": "0"}, None, False)


def test_the_processor_may_be_left_to_sleep() -> None:
    assert not ExecutorSettings.from_environment({**HOME, "FLING_KEEP_AWAKE": "off"}, None, False).keep_awake
    with pytest.raises(ValueError, match="FLING_KEEP_AWAKE"):
        ExecutorSettings.from_environment({**HOME, "FLING_KEEP_AWAKE": "sometimes"}, None, False)

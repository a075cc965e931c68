"""Settings of the service: `FLING_*` environment variables, overridden by command line flags."""

from __future__ import annotations

import os
from collections.abc import Mapping
from ipaddress import ip_network
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from api.field_errors import reason
from fling import this_machine
from planner.cell_folder import default_cells_folder
from planner.fields import shown
from store import Retention


class ServiceSettings(BaseSettings):
    """Settings of one service. Built once at the start of the process and passed down.

    Attributes:
        database_url: SQLite or PostgreSQL; `FLING_DATABASE_URL`.
        cells: Folder of the cell files.
        data: Folder of the executors' files, with their stop sockets; `FLING_DATA`.
        default_cell: Cell of requests that name none.
        tokens_file: File of the bearer tokens; without one the service is local only.
        host: Address to listen on.
        port: Port to listen on.
        trusted_proxies: Addresses and networks of reverse proxies, separated by commas: their `X-Forwarded-For` says
            whom they ask for. Nobody else's is believed.
        planner_workers: Number of planner processes.
        planner_queue: Number of requests that may wait for a worker before further ones are answered 429.
        batch_workers: Number of planner processes of a batch; None: see `driver_workers`; 0: batches, maps and
            jobs of picks are left to another service on the same database.
        ray_address: Address of the Ray cluster that plans batches; None: processes of this machine.
        request_log: Whether each request is a line in the log.
        keep_plans, keep_plans_days: Number and age of the plans without executions that are kept; None: all.
        keep_executions, keep_executions_days: Number and age of the finished executions that are kept; None: all.
        keep_batches, keep_batches_days: Number and age of the finished batches that are kept; None: all.
    """

    model_config = SettingsConfigDict(env_prefix="FLING_", frozen=True)

    database_url: str = Field(default_factory=lambda: this_machine.database_url(os.environ))
    cells: Path = Field(default_factory=default_cells_folder)
    data: Path = Field(default_factory=lambda: this_machine.executors_folder(os.environ))
    default_cell: str = "ur5e-sim"
    tokens_file: Path | None = None
    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65535)
    trusted_proxies: str = ""
    planner_workers: int = Field(default_factory=lambda: max(1, (os.cpu_count() or 2) - 1), ge=1)  # one core streams
    batch_workers: int | None = Field(default=None, ge=0)
    ray_address: str | None = None
    planner_queue: int = Field(default=16, ge=0)
    request_log: bool = True
    keep_plans: int | None = Field(default=None, ge=1)
    keep_plans_days: float | None = Field(default=None, gt=0.0)
    keep_executions: int | None = Field(default=None, ge=1)
    keep_executions_days: float | None = Field(default=None, gt=0.0)
    keep_batches: int | None = Field(default=None, ge=1)
    keep_batches_days: float | None = Field(default=None, gt=0.0)

    @field_validator("trusted_proxies")
    @classmethod
    def _networks(cls, value: str) -> str:
        for name in _listed(value):
            try:
                ip_network(name)
            except ValueError as error:
                raise ValueError(f"{name!r} is no address or network, such as 10.0.0.1 or 10.0.0.0/24") from error
        return value

    @property
    def proxies(self) -> list[str]:
        """The trusted proxies, one by one."""
        return _listed(self.trusted_proxies)

    @property
    def driver_workers(self) -> int | None:
        """Number of planner processes of a batch: all cores of this machine but one, which streams."""
        return self.batch_workers or (None if self.ray_address else max(1, (os.cpu_count() or 2) - 1))

    @property
    def retention(self) -> Retention:
        """What is kept of plans and executions."""
        plans = (self.keep_plans, self.keep_plans_days)
        runs = (self.keep_executions, self.keep_executions_days)
        return Retention(*plans, *runs, self.keep_batches, self.keep_batches_days)


def _listed(value: str) -> list[str]:
    return [name.strip() for name in value.split(",") if name.strip()]


class SettingsError(ValueError):
    """A setting is wrong: which, its value, and what is allowed, in one sentence."""


def parse_settings(**flags: object) -> ServiceSettings:
    """Returns the settings: flags before the environment before the defaults; flags that are None do not count.

    Raises:
        SettingsError: One is wrong.
    """
    given = _given(flags)
    try:
        return ServiceSettings(**given)  # type: ignore[arg-type]
    except ValidationError as error:
        wrong = [f"{_source(found['loc'], given)}: {_reason(found)}" for found in error.errors()]
        raise SettingsError("; ".join(wrong)) from error


def read_settings(**flags: object) -> ServiceSettings:
    """Returns the settings as `parse_settings` does, for a process that serves the cells.

    Raises:
        SettingsError: One is wrong, or the folder of cells or the default cell is not there.
    """
    given = _given(flags)
    settings = parse_settings(**flags)
    if not settings.cells.is_dir():
        raise SettingsError(f"{_source(('cells',), given)} = '{settings.cells}': there is no such folder")
    if not (settings.cells / f"{settings.default_cell}.toml").is_file():
        name = _source(("default_cell",), given)
        where = f"{settings.cells}, the folder of cell files (FLING_CELLS)"
        raise SettingsError(f"{name}: no cell {settings.default_cell!r} in {where}")
    return settings


def _given(flags: Mapping[str, object]) -> dict[str, object]:
    return {name: value for name, value in flags.items() if value is not None}


def _reason(error: Mapping[str, Any]) -> str:
    """Returns why a setting is refused; a switch is asked for in the words of the help."""
    if error["type"] == "bool_parsing":
        return f"must be on or off; it is {shown(error['input'])}"
    return reason(error)


def _source(location: tuple[int | str, ...], given: Mapping[str, object]) -> str:
    """Returns the flag or the variable that a setting came from."""
    name = str(location[0]).lower()
    flag = "cell" if name == "default_cell" else name.replace("_", "-")
    return f"--{flag}" if name in given else f"FLING_{name.upper()}"

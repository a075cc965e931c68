"""Settings of the service: `FLING_*` environment variables, overridden by flags of the command line."""

from __future__ import annotations

import os
from ipaddress import ip_address
from pathlib import Path

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from planner.cell_folder import default_cells_folder
from store import default_database_url

BODY_LIMIT_BYTES = 1_000_000  # the contract's 1 MB; a request is a few hundred bytes
HEARTBEAT_FRESH_S = 2.0  # [s] an executor beats several times a second; older than this it is gone


def default_workers() -> int:
    """Returns one planner process for each core but one, which the executor streams on; at least one."""
    return max(1, (os.cpu_count() or 2) - 1)


class Settings(BaseSettings):
    """What a service is started with. Built once, in `main`, and passed down."""

    model_config = SettingsConfigDict(env_prefix="FLING_", frozen=True)

    database_url: str = Field(default_factory=default_database_url)
    cells: Path = Field(default_factory=default_cells_folder)
    default_cell: str = "ur5e-sim"
    tokens_file: Path | None = None
    host: str = "127.0.0.1"
    port: int = 8000
    planner_workers: int = Field(default_factory=default_workers, ge=1)
    planner_queue: int = Field(default=16, ge=0)  # requests that may wait for a worker before 429

    @property
    def is_loopback(self) -> bool:
        """Whether only this machine can reach the service."""
        return is_loopback_host(self.host)


def is_loopback_host(host: str) -> bool:
    """Returns whether `host` names this machine's loopback."""
    if host.lower() == "localhost":
        return True
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False

"""What belongs to this machine: the folder of the user's data, with its database, and its loopback addresses."""

from __future__ import annotations

from collections.abc import Mapping
from ipaddress import ip_address
from pathlib import Path


def user_folder(environment: Mapping[str, str]) -> Path:
    """Returns `fling` in the user's data folder (XDG base directories)."""
    data = environment.get("XDG_DATA_HOME") or str(Path.home() / ".local" / "share")
    return Path(data) / "fling"


def executors_folder(environment: Mapping[str, str]) -> Path:
    """Returns the folder of the executors' files: FLING_DATA, or the user's."""
    return Path(environment.get("FLING_DATA") or user_folder(environment))


def database_url(environment: Mapping[str, str]) -> str:
    """Returns the address of the database: FLING_DATABASE_URL, or an SQLite file in the user's folder."""
    return environment.get("FLING_DATABASE_URL") or f"sqlite:///{user_folder(environment) / 'fling.db'}"


def is_loopback_host(host: str) -> bool:
    """Returns whether `host` is a loopback name or address."""
    if host.lower() == "localhost":
        return True
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False

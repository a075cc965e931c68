"""Hash of what a cell says, whatever it was made from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

NOT_CONTENT = ("name", "sha256", "document", "content")  # of a cell: what it is called, and what it was read from


def content_sha256(cell: Any) -> str:
    """Returns the hash of a cell's content: of every number that plans are made with."""
    return hashlib.sha256(json.dumps(plain(cell, NOT_CONTENT), sort_keys=True).encode()).hexdigest()


def plain(value: Any, left_out: tuple[str, ...] = ()) -> Any:
    """Returns a value as JSON and cell files have it; of a dataclass without the fields that are `left_out`."""
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value) if field.name not in left_out}
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value

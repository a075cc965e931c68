"""Hash of what a cell says, whatever it was made from."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from planner.arrays import plain

# Fields of a cell that say what it is called, what it was read from and how it is checked.
NOT_CONTENT = ("name", "sha256", "document", "meshes", "content", "check")


def content_sha256(cell: Any) -> str:
    """Returns the hash of a cell's content: of every number that plans are made with."""
    return hashlib.sha256(json.dumps(plain(cell, NOT_CONTENT), sort_keys=True).encode()).hexdigest()

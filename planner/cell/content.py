"""Hash of what a cell says, whatever it was made from."""

from __future__ import annotations

import hashlib
import json
from typing import Any

from planner.arrays import plain

# Fields of a cell that say what it is called, what it was read from and how it is checked.
NOT_CONTENT = ("name", "sha256", "document", "meshes", "content", "check")
OF_SEVERAL = ("grippers", "mounted", "carried")  # say nothing of a cell with one gripper


def content_sha256(cell: Any) -> str:
    """Returns the hash of a cell's content: of every number that plans are made with."""
    left_out = NOT_CONTENT if cell.grippers else (*NOT_CONTENT, *OF_SEVERAL)
    return hashlib.sha256(json.dumps(plain(cell, left_out), sort_keys=True).encode()).hexdigest()

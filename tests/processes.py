"""Child processes by their command lines."""

from __future__ import annotations

import psutil


def children_with(text: str, parent: int | None = None) -> list[psutil.Process]:
    """Returns the children, by default of this process, in whose command line a text occurs; none that has ended."""
    found = []
    for child in psutil.Process(parent).children():
        try:
            if text in " ".join(child.cmdline()):
                found.append(child)
        except psutil.Error:  # it has just ended, or nobody has waited for it yet
            continue
    return found

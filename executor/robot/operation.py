"""Words that every interface for the operation of an arm shares."""

from __future__ import annotations

from typing import Literal

ControlMode = Literal["remote", "local", "unknown"]  # unknown: this version does not tell


class ActionRefused(Exception):
    """The controller does not do what it was asked to; the text says why."""

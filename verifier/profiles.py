"""A cell as a profile has learnt it: lag, delays and jitter of its outputs, speed and drag of its object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from planner.cell import Cell, DigitalOutput
from verifier.request_checks import WRONG_SHAPE, NotAPlan, is_number

# Least and greatest of what a profile tells: what no cell has is a mistake, and a motion lasts 10 s.
BOUNDS = {
    "lag_s": (-10.0, 10.0),
    "delay_s": (-10.0, 10.0),
    "jitter_s": (0.0, 10.0),
    "drag_coefficient": (0.0, 100.0),
    "speed_factor": (0.1, 10.0),
}


def learnt_cell(document: Mapping[str, Any], cell: Cell, profile: Mapping[str, Any] | None) -> Cell:
    """Returns a plan's cell with the numbers of its profile.

    Args:
        document: of the plan.
        cell: as its file says.
        profile: as `GET /profiles/{id}` answers it; None: not given.

    Raises:
        NotAPlan: the profile is none, or another one than the plan's.
    """
    if profile is None:
        return cell
    try:
        if document.get("profile") is None or profile["id"] != document["profile"]:
            raise NotAPlan(f"profile: the plan was made with {document.get('profile')}, not with {profile['id']}")
        if profile["cell_sha256"] != cell.sha256:
            raise NotAPlan("profile.cell_sha256: the profile is of another cell file")
        return _learnt(cell, profile)
    except WRONG_SHAPE as error:
        if isinstance(error, NotAPlan):
            raise
        raise NotAPlan(f"profile: {error!r}") from error


def _learnt(cell: Cell, profile: Mapping[str, Any]) -> Cell:
    told = {"speed_factor": 1.0, **profile}  # the oldest profiles tell none
    lag_s, delay_s, jitter_s, drag, factor = (_number(told, name, "profile") for name in BOUNDS)
    gripper = replace(cell.gripper, delay_s=delay_s, jitter_s=jitter_s, release_speed_factor=factor)
    shown = profile.get("outputs") or {}
    return cell.as_learnt(
        timing=replace(cell.timing, lag_s=lag_s),
        gripper=gripper,
        object=replace(cell.object, drag_coefficient=drag),
        outputs={name: _output(each, shown.get(name)) for name, each in cell.outputs.items()},
    )


def _output(own: DigitalOutput, shown: Mapping[str, Any] | None) -> DigitalOutput:
    if shown is None:
        return own
    delay_s, jitter_s = (_number(shown, name, "profile.outputs") for name in ("delay_s", "jitter_s"))
    return replace(own, delay_s=delay_s, jitter_s=jitter_s)


def _number(table: Mapping[str, Any], name: str, where: str) -> float:
    least, greatest = BOUNDS[name]
    value = table[name]
    if not is_number(value) or not least <= value <= greatest:
        raise NotAPlan(f"{where}.{name}: {value!r} is no number within {least:g} and {greatest:g}")
    return float(value)

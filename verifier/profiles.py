"""A cell as a profile has learnt it: lag, delays and jitter of its outputs, speed and drag of its object."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from planner.cell import Cell, DigitalOutput
from verifier.request_checks import GREATEST, WRONG_SHAPE, NotAPlan

LEAST = {"lag_s": -GREATEST, "delay_s": -GREATEST, "jitter_s": 0.0, "drag_coefficient": 0.0}  # of what a profile tells


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
    lag_s, delay_s, jitter_s, drag = (_number(profile, name, least) for name, least in LEAST.items())
    factor = _number({"speed_factor": 1.0, **profile}, "speed_factor", 0.0)  # the oldest profiles tell none
    if factor == 0.0:
        raise NotAPlan("profile.speed_factor: 0")
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
    return replace(
        own, delay_s=_number(shown, "delay_s", LEAST["delay_s"]), jitter_s=_number(shown, "jitter_s", LEAST["jitter_s"])
    )


def _number(table: Mapping[str, Any], name: str, least: float) -> float:
    value = float(table[name])
    if not least <= value <= GREATEST:
        raise NotAPlan(f"profile.{name}: {value}")
    return value

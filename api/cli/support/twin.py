"""The timing twin of a real cell: a truth file for the simulated controller, from what a profile says."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from planner.documents import read_file

PROFILE_BYTES = 10_000_000  # [byte] of a profile with all its evidence
NEEDED = ("lag_s", "delay_s", "jitter_s", "speed_factor", "drag_coefficient", "landing_offset_m", "base_turn_rad")
CLING_SPEED_FACTOR = 0.95  # [-] of an object that clings; source: the estimator's model of it, learning/release.py


def read_profile(text: str, client: Any) -> dict[str, Any]:
    """Returns a profile, from a file (as of GET /profiles/{id}) or by its id from the service.

    Args:
        text: path of the file, or the id.
        client: makes a client of the service.

    Raises:
        FileRefused: it is no file, or too large.
        click.ClickException: the file is no profile.
    """
    if not Path(text).exists():
        with client() as service:
            return dict(service.get(f"/profiles/{text}"))
    try:
        profile = json.loads(read_file(text, PROFILE_BYTES))
        truth_of_profile(profile)
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError) as error:
        raise click.ClickException(f"{text} is not a profile: {error!r}") from error
    return dict(profile)


def truth_of_profile(profile: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the truth, in the keys of a truth file, of a cell that is as its profile says.

    The outputs change one lag after their command, as the planner assumes: lag and delay are the profile's lead. Only
    their sum is learnt, so that a delay may be negative: then all outputs change that much sooner, and what they switch
    follows later.

    Raises:
        KeyError: the profile lacks numbers.
        ValueError: its object would leave before it is told to.
    """
    missing = [name for name in NEEDED if name not in profile]
    if missing:
        raise KeyError(", ".join(missing))
    timing = profile.get("timing") or {}
    lag = float(profile["lag_s"])
    delay = float(profile["delay_s"])
    if lag + delay < 0.0:
        raise ValueError(
            f"lag_s and delay_s sum to {1e3 * (lag + delay):.1f} ms: the gripper opens before it is told to"
        )
    outputs = profile.get("outputs", {})
    earliest = min(0.0, delay, *(float(each["delay_s"]) for each in outputs.values()))
    own = {
        f"outputs.{json.dumps(name)}": {"delay_s": each["delay_s"] - earliest, "jitter_s": each["jitter_s"]}
        for name, each in outputs.items()
    }
    first_order = [x or 0.0 for x in timing.get("first_order_s") or [0.0] * 6]
    x, y = profile["landing_offset_m"]
    return {
        "timing": {
            "lag_s": lag,
            "first_order_s": [min(max(float(value), 0.0), 0.5 * lag) for value in first_order],
            "gain": [1.0 if gain is None else float(gain) for gain in profile.get("gain") or [None] * 6],
            "output_delay_s": lag + earliest,
        },
        "gripper": {"delay_s": delay - earliest, "jitter_s": float(profile["jitter_s"])},
        "release": {
            "speed_factor": float(profile["speed_factor"]),
            "cling_share": float(profile.get("cling_share") or 0.0),
            "cling_speed_factor": CLING_SPEED_FACTOR,
        },
        "object": {"drag_coefficient": float(profile["drag_coefficient"])},
        "arm": {
            "base_offset_m": [float(x), float(y), 0.0],
            "base_rotation_vector_rad": [0.0, 0.0, float(profile["base_turn_rad"])],
        },
        **own,
    }


def truth_text(truth: Mapping[str, Mapping[str, Any]]) -> str:
    """Returns a truth as TOML; its values are numbers and lists of numbers, which JSON writes alike."""
    tables = ["\n".join([f"[{name}]", *(f"{k} = {json.dumps(v)}" for k, v in t.items())]) for name, t in truth.items()]
    return "\n\n".join(tables) + "\n"


def twin_file(profile: Mapping[str, Any]) -> str:
    """Returns the path of an anonymous truth file, for a program that is started in place of this one."""
    descriptor = os.memfd_create("fling-twin", 0)
    os.write(descriptor, truth_text(truth_of_profile(profile)).encode())
    return f"/proc/self/fd/{descriptor}"

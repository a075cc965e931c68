"""What a thrown object is to hit: a place, perhaps a bin about it, which may move."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from planner.cell import Cell, ThrownBody
from verifier.elementary import Array
from verifier.request_checks import NotAPlan, check_vector
from verifier.taylor import TaylorModel

JITTERS = 3.0  # [-] standard deviations of the opening that a throw stands. source: contract, section 8
LEAST_WINDOW_S = 0.005  # [s] half of the window of a target without one. source: contract, section 8
LEAST_TOLERANCE_M = 0.01  # [m] of a target without an opening and a tolerance. source: contract, section 8
# [s] before and after the landing for which the arm keeps out of a moving bin's path. source: docs/how-to/bins.md
BEFORE_S = 10.0
AFTER_S = 2.0
LEVEL_M_S = 1e-9  # [m/s] of a level velocity in a frame that is turned


@dataclass(frozen=True, eq=False)
class Aim:
    """What a thrown object is to hit.

    Of a target that moves the place is that at a time of the motion, about the landing: any serves, as it moves evenly.

    Attributes:
        p_W: the place (3,) [m].
        window_s, tolerance_m: by which a release may be early or late, and the landing then off [s, m].
        bin: inner radius, and height of the rim above the place [m]; None without a bin.
        shift: what it lies off the target (3,) [m], as a profile says of the cell.
        moves: whether the target moves.
        v_W: its velocity (3,) [m/s].
        met_s: time of the motion at which it is at the place [s].
        slack_m: how far it may be off as the start is on the nearest tick: half a tick's way [m].
        waits_s: how long after the earliest start asked for the motion begins [s].
        after_s: how long after the landing the arm keeps out of the path of a bin that moves [s].
    """

    p_W: Array
    window_s: float
    tolerance_m: float
    bin: tuple[float, float] | None
    shift: Array
    moves: bool
    v_W: Array
    met_s: float
    slack_m: float
    waits_s: float
    after_s: float

    @property
    def stands(self) -> Array:
        """Where the target is (3,) [m], which the aim may lie off."""
        return self.p_W - self.shift

    @property
    def is_robust(self) -> bool:
        """Whether the tolerance holds for a window of releases."""
        return self.window_s > 0.0 and self.tolerance_m > 0.0

    def beside(self, x: TaylorModel, t: TaylorModel) -> TaylorModel:
        """Returns places (3, n) [m] at times (n,) of the motion [s] as they are beside the target: where it is met."""
        return x - (t - self.met_s) * self.v_W[:, None] if self.v_W.any() else x

    def met_at(self, time_s: float) -> Aim:
        """Returns the same with its place at another time of the motion [s]."""
        return replace(self, p_W=self.p_W + (time_s - self.met_s) * self.v_W, met_s=time_s)


def read_aim(
    document: Mapping[str, Any], asked: Mapping[str, Any], release: Mapping[str, Any], cell: Cell, X_WR: Array
) -> Aim:
    """Returns the aim of a target, with the window and the tolerance that the contract gives one without them.

    Raises:
        NotAPlan: the document tells of an aim or a start that no plan can have.
    """
    opening = release.get("opening")
    radius = cell.object.radius_m
    room_m = max(float(opening["radius_m"]) - radius, 0.0) if opening else max(radius, LEAST_TOLERANCE_M)
    window_s = max(JITTERS * cell.gripper.jitter_s, LEAST_WINDOW_S)
    if asked.get("min_hit_probability"):
        window_s = 0.0  # nobody tells here which one the odds take
    asked_s, asked_m = asked.get("release_window_s"), asked.get("landing_tolerance_m")
    shift = _shift(document)
    moves = any(release.get("velocity") or []) or release.get("uncertainty") is not None
    v_W = X_WR[:3, :3] @ np.asarray(release.get("velocity") or np.zeros(3), np.float64)
    if moves and isinstance(cell.object, ThrownBody):
        raise NotAPlan("release: a target that moves, or is known within an uncertainty, is one for a ball")
    begin_s = _begin(document, release, v_W) if moves else 0.0
    passages = asked.get("passages") or []
    goes_on = bool(passages) and (asked.get("end") is not None or not passages[-1].get("releases"))
    return Aim(
        p_W=X_WR[:3, :3] @ np.asarray(release["position"], np.float64) + X_WR[:3, 3] + shift + begin_s * v_W,
        window_s=window_s if asked_s is None else float(asked_s),
        tolerance_m=room_m if asked_m is None else float(asked_m),
        bin=(float(opening["radius_m"]), float(opening["rim_height_m"])) if opening else None,
        shift=shift,
        moves=moves,
        v_W=v_W,
        met_s=0.0,
        slack_m=0.5 * float(np.linalg.norm(v_W)) / cell.robot.sample_rate_hz,
        waits_s=float(document["starts_at_s"]) - float(asked.get("starts_not_before_s") or 0.0) if moves else 0.0,
        after_s=BEFORE_S if goes_on else AFTER_S,
    )


def _shift(document: Mapping[str, Any]) -> Array:
    """Returns what a plan's aim lies off its target (3,) [m]: none of one that was made without a profile."""
    aim = document.get("aim")
    shift = [0.0] * 3 if aim is None else aim["shift_m"]
    check_vector(shift, 3, "aim.shift_m")
    if any(shift) and document.get("profile") is None:
        raise NotAPlan("aim.shift_m: of a plan that was made without a profile")
    if shift[2] != 0.0:
        raise NotAPlan(f"aim.shift_m: {shift[2]} m up, and an aim is beside its target")
    return np.asarray(shift, np.float64)


def _begin(document: Mapping[str, Any], release: Mapping[str, Any], v_W: Array) -> float:
    """Returns how long after a moving target was at its position a motion starts [s]."""
    check_vector([document.get("starts_at_s"), release.get("observed_at_s")], 2, "starts_at_s, observed_at_s")
    if abs(v_W[2]) > LEVEL_M_S:
        raise NotAPlan(f"release.velocity: rises by {v_W[2]} m/s")
    return float(document["starts_at_s"]) - float(release["observed_at_s"])

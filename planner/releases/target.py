"""Kind `target`: hit a point by free flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from math import atan2, hypot, inf, isfinite, pi
from typing import Any, ClassVar, Self

import numpy as np

from planner.arrays import Array
from planner.cell import Cell, ThrownBody
from planner.errors import FieldError, figures
from planner.fields import Field, ListOr, Number, Record, Text, Vector, required
from planner.releases.release import Bound, LandingAxis, Opening, Release, ReleaseSample, Target, move, turn
from planner.tracking import DRIFT_M_S, MotionUncertainty

SPEED_MIN_M_S = 1e-3  # [m/s] lowest bound on the release speed
TARGET_SPEED_MAX_M_S = 5.0  # [m/s] of a target that moves; belts run at up to 3; catches typing errors
UPTIME_MAX_S = 1e9  # [s] of a controller: thirty years
LEVEL_M_S = 1e-9  # [m/s] of a velocity in a turned frame
DRIFT_MAX_M_S = 1.0  # [m/s] that the velocity of a target gains in a second; more than that is no motion to meet
TARGET_ID_MAX = 64  # characters of a tracked target's id
OPENING_MAX_M = 10.0  # [m] largest radius and rim height of a bin; catches typing errors

OPENING = Record(
    "OpeningRequest",
    "Mouth of a round bin that is open upwards; the target is the centre of its bottom.",
    {
        "radius_m": required(
            Number(above=0.0, most=OPENING_MAX_M), "Inner radius of the bin [m]; above the object's radius."
        ),
        "rim_height_m": required(Number(0.0, OPENING_MAX_M), "Height of the rim above the target [m]."),
    },
)
ORIENTATION = Record(
    "OrientationRequest",
    "How an object that is no ball lands: its z axis lies along `axis`, either way round.",
    {
        "axis": required(Vector(3), "Direction of the object's z axis as it lands, of any length, in `frame`."),
        "tolerance_rad": required(Number(above=0.0, most=pi / 2), "Largest angle from it [rad]."),
    },
)
UNCERTAINTY = Record(
    "TargetUncertainty",
    "How well place and velocity of a target that moves are known at `observed_at_s`, along each horizontal axis.",
    {
        "position_std_m": required(Number(0.0), "Standard deviation of the place [m]."),
        "velocity_std_m_s": required(Number(0.0), "Standard deviation of the velocity [m/s]."),
        "correlation": Field(Number(0.0, 1.0), "Of the two [-].", default=0.0),
        "drift_m_s": Field(
            Number(0.0, DRIFT_MAX_M_S),
            "Standard deviation that the velocity gains in a second [m/s].",
            default=DRIFT_M_S,
        ),
    },
)
TRACKED = Record(
    "TrackedTargetName",
    "A tracked target of the cell, in place of numbers: position, velocity and their uncertainty as last observed.",
    {
        "target": required(Text(TARGET_ID_MAX), "Its id, from `POST /cells/{name}/targets`; or `latest`."),
        "height_m": Field(Number(), "Its height, in the world [m]; absent: as observed."),
    },
)
KNOWN_OF_TRACKED = ("velocity", "observed_at_s", "uncertainty", "tracked_target")


def _check_velocity(given: dict[str, Any], path: str, errors: list[FieldError]) -> None:
    """Refuses a velocity without the instant at which the target was at its position, and the other way round."""
    if isinstance(given["position"], dict):
        reason = "is known of a tracked target: leave it out"
        errors += [FieldError(f"{path}.{name}", reason) for name in KNOWN_OF_TRACKED if name in given]
        return
    if "uncertainty" in given and "observed_at_s" not in given:
        errors.append(FieldError(f"{path}.uncertainty", "is for a target with velocity and observed_at_s"))
    if ("velocity" in given) != ("observed_at_s" in given):
        errors.append(FieldError(f"{path}.observed_at_s", "and velocity belong together"))
    speed = float(np.linalg.norm(given.get("velocity", 0.0)))
    if speed > TARGET_SPEED_MAX_M_S:
        reason = f"{speed:g} m/s is above {TARGET_SPEED_MAX_M_S:g} m/s"
        errors.append(FieldError(f"{path}.velocity", reason))


@dataclass(frozen=True, eq=False)
class TargetRelease(Target, Release):
    """Hit a target by free flight; its attributes are those of `Target`."""

    name: ClassVar[str] = "target"
    aims: ClassVar[bool] = True
    record: ClassVar[Record] = Record(
        "TargetReleaseRequest",
        "Hit a point by free flight; the planner chooses the release.",
        {
            "position": required(
                ListOr(Vector(3), TRACKED), "The point to hit, in `frame` [m]; or a tracked target, of `POST /plan`."
            ),
            "max_release_speed_m_s": Field(Number(SPEED_MIN_M_S), "Maximum speed of the object at the release [m/s]."),
            "min_elevation_rad": Field(
                Number(-pi / 2, pi / 2), "Minimum elevation of the release velocity above the horizon [rad]."
            ),
            "max_elevation_rad": Field(
                Number(-pi / 2, pi / 2), "Maximum elevation of the release velocity above the horizon [rad]."
            ),
            "min_horizontal_distance_m": Field(
                Number(0.0), "Minimum horizontal distance from the release to the target [m]."
            ),
            "release_position": Field(Vector(3), "Position of the release, in `frame` [m]; absent: free."),
            "opening": Field(
                OPENING, "The bin around the target: the object enters through its mouth, clear of rim and wall."
            ),
            "orientation": Field(
                ORIENTATION, "How the object is to land; absent: anyhow. For a cell whose object is no ball."
            ),
            "velocity": Field(
                Vector(3), "Velocity of the target and its bin, in `frame` [m/s]; level. Absent: it stands still."
            ),
            "observed_at_s": Field(
                Number(0.0, UPTIME_MAX_S),
                "When it was at `position`, on the controller's clock (RTDE `timestamp`) [s].",
            ),
            "uncertainty": Field(
                UNCERTAINTY,
                "How well place and velocity are known; absent: exactly. A target that three standard deviations may "
                "take farther off at the landing than counts as a hit is refused.",
            ),
            "tracked_target": Field(
                Text(TARGET_ID_MAX), "Id of the tracked target whose numbers these are, as the service found them."
            ),
        },
        _check_velocity,
    )

    @property
    def target(self) -> Target:
        """The target."""
        return self

    @property
    def fixes_joints(self) -> bool:
        """Whether joint states are reached as they are: their spin brings about how the object lands."""
        return self.orientation is not None

    def with_target(self, target: Target) -> Self:
        """Returns this release with another target."""
        return replace(self, **{each.name: getattr(target, each.name) for each in fields(Target)})

    def errors(self, cell: Cell) -> list[FieldError]:
        """Returns the fields that contradict each other, and a bin that is too narrow for the cell's object."""
        found = []
        if self.min_elevation_rad > self.max_elevation_rad:
            least, most = figures(self.min_elevation_rad, self.max_elevation_rad)
            found.append(FieldError("release.min_elevation_rad", f"is {least}, above max_elevation_rad, {most}"))
        if abs(self.v_W[2]) > LEVEL_M_S:
            found.append(FieldError("release.velocity", f"rises by {self.v_W[2]:g} m/s: a target moves on a level"))
        if self.moves and isinstance(cell.object, ThrownBody):
            found.append(FieldError("release.velocity", "is for balls: a body first touches what stands still"))
        if self.opening is not None and self.opening.radius_m <= cell.object.inner_radius_m:
            sizes = f"radius {self.opening.radius_m:g} m, object {cell.object.inner_radius_m:g} m"
            reason = f"the bin is too narrow for the object: {sizes}"
            found.append(FieldError("release.opening.radius_m", reason))
        if self.orientation is not None:
            if not isinstance(cell.object, ThrownBody):
                found.append(FieldError("release.orientation", "the cell's object is a ball: it has no axis"))
            if not np.isfinite(self.orientation.axis_W).all():
                found.append(FieldError("release.orientation.axis", "has no direction"))
        return found

    def position_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns the distance from a requested place, or a requested distance from the target."""
        p = at.tool.p_WT
        if self.release_position is not None:
            return [Bound(float(np.linalg.norm(p - self.release_position)), 0.0, "m")]
        least = self.min_horizontal_distance_m
        if least <= 0.0:
            return []
        distance = float(np.linalg.norm((p - self.p_W)[:2]))
        return [Bound(distance, least, "m", "horizontal distance to the target", is_least=True, is_exact=True)]

    def velocity_bounds(self, at: ReleaseSample) -> list[Bound]:
        """Returns speed and elevation, as far as they are bounded."""
        v = at.tool.v_WT
        elevation = atan2(float(v[2]), hypot(float(v[0]), float(v[1])))
        found = []
        if isfinite(self.max_speed_m_s):
            found.append(Bound(float(np.linalg.norm(v)), self.max_speed_m_s, "m/s", "speed"))
        if self.min_elevation_rad > -pi / 2:
            found.append(Bound(elevation, self.min_elevation_rad, "rad", "elevation", is_least=True))
        if self.max_elevation_rad < pi / 2:
            found.append(Bound(elevation, self.max_elevation_rad, "rad", "elevation"))
        return found

    @classmethod
    def from_json(cls, given: Mapping[str, Any], X_WR: Array) -> Self:
        """Returns the release in the world."""
        return cls(
            p_W=move(X_WR, given["position"]),
            max_speed_m_s=given.get("max_release_speed_m_s", inf),
            min_elevation_rad=given.get("min_elevation_rad", -pi / 2),
            max_elevation_rad=given.get("max_elevation_rad", pi / 2),
            min_horizontal_distance_m=given.get("min_horizontal_distance_m", 0.0),
            release_position=move(X_WR, given["release_position"]) if "release_position" in given else None,
            opening=Opening(**given["opening"]) if "opening" in given else None,
            orientation=_orientation(given["orientation"], X_WR) if "orientation" in given else None,
            v_W=turn(X_WR, given["velocity"]) if "velocity" in given else np.zeros(3),
            at_s=given.get("observed_at_s", 0.0),
            uncertainty=MotionUncertainty(**given["uncertainty"]) if "uncertainty" in given else None,
            tracked_target=given.get("tracked_target"),
        )

    def to_json(self) -> dict[str, Any]:
        """Returns the target and its bounds in the world."""
        document: dict[str, Any] = {
            "position": self.p_W.tolist(),
            "min_elevation_rad": self.min_elevation_rad,
            "max_elevation_rad": self.max_elevation_rad,
            "min_horizontal_distance_m": self.min_horizontal_distance_m,
        }
        if isfinite(self.max_speed_m_s):
            document["max_release_speed_m_s"] = self.max_speed_m_s
        if self.release_position is not None:
            document["release_position"] = self.release_position.tolist()
        if self.opening is not None:
            document["opening"] = asdict(self.opening)
        if self.orientation is not None:
            asked = self.orientation
            document["orientation"] = {"axis": asked.axis_W.tolist(), "tolerance_rad": asked.tolerance_rad}
        if self.moves:
            document |= {"velocity": self.v_W.tolist(), "observed_at_s": self.at_s}
        if self.uncertainty is not None:
            document["uncertainty"] = asdict(self.uncertainty)
        if self.tracked_target is not None:
            document["tracked_target"] = self.tracked_target
        return document


def _orientation(given: Mapping[str, Any], X_WR: Array) -> LandingAxis:
    """Returns the landing axis in the world; not a number where it has no direction."""
    along = turn(X_WR, given["axis"])
    length = float(np.linalg.norm(along))
    return LandingAxis(along / length if length > 0.0 else np.full(3, np.nan), given["tolerance_rad"])

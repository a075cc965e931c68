"""A target that is observed again and again: a Kalman filter of constant velocity.

The state is the target's place and its level velocity. Between two observations the velocity wanders as a random walk
(white noise of the acceleration), so that its variance grows evenly with time. Both horizontal axes are observed and
wander alike and apart from each other: they have one covariance of place and velocity, two by two. The height stays
as it is, and is the mean of what was observed, weighted by certainty.

Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, sections 5.2 and 6.2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

DRIFT_M_S = 0.005  # [m/s] standard deviation that a belt's speed gains in a second: 1 % of 0.5 m/s, as a drive holds it
SPEED_STD_M_S = 5.0  # [m/s] of a target that was seen once: as fast as targets may be, so as good as unknown
# [-] chi-square that an innovation stays below with the probability of five standard deviations (6e-7 of those of a
# target that moves as assumed are beyond), for the three numbers of a place, and with two more of a velocity.
# source: scipy.stats.chi2.isf(chi2.sf(25, 1), (3, 5))
INNOVATION_MAX = {3: 31.812, 5: 37.095}


@dataclass(frozen=True)
class MotionUncertainty:
    """How well place and velocity of a target are known at an instant, along each horizontal axis.

    Attributes:
        position_std_m: standard deviation of the place [m].
        velocity_std_m_s: of the velocity [m/s].
        correlation: of the two [-], 0 to 1: what was seen too far ahead is believed to be too fast.
        drift_m_s: standard deviation that the velocity gains in a second [m/s].
    """

    position_std_m: float
    velocity_std_m_s: float
    correlation: float = 0.0
    drift_m_s: float = DRIFT_M_S

    @property
    def covariance(self) -> tuple[float, float, float]:
        """Variance of the place [m^2], covariance with the velocity [m^2/s], variance of the velocity [m^2/s^2]."""
        both = self.correlation * self.position_std_m * self.velocity_std_m_s
        return self.position_std_m**2, both, self.velocity_std_m_s**2

    @classmethod
    def of(cls, place: float, both: float, velocity: float, drift_m_s: float) -> Self:
        """Returns the uncertainty with a covariance as of `covariance`; what rounding made negative is 0."""
        stds = math.sqrt(max(place, 0.0)), math.sqrt(max(velocity, 0.0))
        size = stds[0] * stds[1]
        return cls(*stds, min(max(both / size, 0.0), 1.0) if size > 0.0 else 0.0, drift_m_s)

    def after(self, s: float) -> Self:
        """Returns the uncertainty `s` [s] later, without an observation meanwhile; `s` is not negative."""
        place, both, velocity = self.covariance
        noise = self.drift_m_s**2
        return self.of(
            place + 2.0 * s * both + s**2 * velocity + noise * s**3 / 3.0,
            both + s * velocity + noise * s**2 / 2.0,
            velocity + noise * s,
            self.drift_m_s,
        )


@dataclass(frozen=True)
class TargetObservation:
    """Where a target was seen, and how fast where an encoder tells that.

    Attributes:
        position: in the world (3,) [m].
        std_m: standard deviation along each axis, above 0 [m].
        observed_at_s: when, on the controller's clock [s].
        velocity: level (3,) [m/s]; None: not measured.
        velocity_std_m_s: standard deviation along each horizontal axis, above 0 [m/s].
    """

    position: tuple[float, float, float]
    std_m: float
    observed_at_s: float
    velocity: tuple[float, float, float] | None = None
    velocity_std_m_s: float | None = None


class ObservationRefused(Exception):
    """An observation does not fit the track, which stays as it was.

    Attributes:
        field: of the observation.
    """

    def __init__(self, field: str, reason: str) -> None:
        super().__init__(reason)
        self.field = field

    @property
    def contradicts(self) -> bool:
        """Whether the target was seen elsewhere than expected; otherwise the observation comes too late."""
        return self.field != "observed_at_s"


@dataclass(frozen=True)
class TargetTrack:
    """What is known of a target at its last observation.

    Attributes:
        position: (3,) [m].
        velocity: (3,) [m/s]; level.
        uncertainty: of both along each horizontal axis.
        height_std_m: standard deviation of the height [m].
        observed_at_s: time of the last observation, on the controller's clock [s].
        observations: their number.
        chi_square: of the last innovation, the difference from what was predicted [-]; None of the first observation.
        chi_square_max: the largest that would have been taken [-].
    """

    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    uncertainty: MotionUncertainty
    height_std_m: float
    observed_at_s: float
    observations: int = 1
    chi_square: float | None = None
    chi_square_max: float | None = None

    @classmethod
    def begun(cls, seen: TargetObservation, drift_m_s: float = DRIFT_M_S) -> Self:
        """Returns the track after a first observation."""
        known = MotionUncertainty(seen.std_m, SPEED_STD_M_S, 0.0, drift_m_s)
        track = cls(seen.position, (0.0, 0.0, 0.0), known, seen.std_m, seen.observed_at_s)
        return track._with_velocity(seen)[0]

    def after(self, s: float) -> Self:
        """Returns the track `s` [s] later, without an observation meanwhile."""
        x, y, z = self.position
        place = (x + s * self.velocity[0], y + s * self.velocity[1], z)
        uncertainty = self.uncertainty.after(s)
        return replace(self, position=place, uncertainty=uncertainty, observed_at_s=self.observed_at_s + s)

    def observed(self, seen: TargetObservation) -> Self:
        """Returns the track after a further observation.

        Raises:
            ObservationRefused: it is no later than the last one, or farther from what was predicted than five standard
                deviations.
        """
        later_s = seen.observed_at_s - self.observed_at_s
        if later_s <= 0.0:
            reason = f"{seen.observed_at_s:.12g} s is not after the last observation, at {self.observed_at_s:.12g} s"
            raise ObservationRefused("observed_at_s", reason)
        predicted = self.after(later_s)
        track, place = predicted._with_place(seen)
        track, speed = track._with_velocity(seen)
        most = INNOVATION_MAX[3 if seen.velocity is None else 5]
        if place + speed > most:
            raise _unexpected(predicted, seen, place + speed, most)
        return replace(
            track,
            observed_at_s=seen.observed_at_s,
            observations=self.observations + 1,
            chi_square=place + speed,
            chi_square_max=most,
        )

    def _with_place(self, seen: TargetObservation) -> tuple[Self, float]:
        """Returns the track with an observed place, and the chi-square of its three numbers."""
        place, both, velocity = self.uncertainty.covariance
        noise = seen.std_m**2
        total = place + noise
        off = [a - b for a, b in zip(seen.position, self.position, strict=True)]
        height = self.height_std_m**2
        gain = height / (height + noise)
        x, y, z = self.position
        vx, vy, _ = self.velocity
        a, b = place / total, both / total
        changed = replace(
            self,
            position=(x + a * off[0], y + a * off[1], z + gain * off[2]),
            velocity=(vx + b * off[0], vy + b * off[1], 0.0),
            uncertainty=MotionUncertainty.of(a * noise, b * noise, velocity - b * both, self.uncertainty.drift_m_s),
            height_std_m=math.sqrt(gain * noise),
        )
        return changed, (off[0] ** 2 + off[1] ** 2) / total + off[2] ** 2 / (height + noise)

    def _with_velocity(self, seen: TargetObservation) -> tuple[Self, float]:
        """Returns the track with a measured velocity, if there is one, and the chi-square of its two numbers."""
        if seen.velocity is None or seen.velocity_std_m_s is None:
            return self, 0.0
        place, both, velocity = self.uncertainty.covariance
        noise = seen.velocity_std_m_s**2
        total = velocity + noise
        off = [a - b for a, b in zip(seen.velocity, self.velocity, strict=True)]
        x, y, z = self.position
        vx, vy, _ = self.velocity
        a, b = velocity / total, both / total
        changed = replace(
            self,
            position=(x + b * off[0], y + b * off[1], z),
            velocity=(vx + a * off[0], vy + a * off[1], 0.0),
            uncertainty=MotionUncertainty.of(place - b * both, b * noise, a * noise, self.uncertainty.drift_m_s),
        )
        return changed, (off[0] ** 2 + off[1] ** 2) / total

    def as_document(self) -> dict[str, Any]:
        """Returns the track as JSON."""
        return asdict(self)

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """Returns the track of `as_document`."""
        known = MotionUncertainty(**document["uncertainty"])
        vectors = {name: tuple(document[name]) for name in ("position", "velocity")}
        return cls(**{**document, **vectors, "uncertainty": known})


def _unexpected(predicted: TargetTrack, seen: TargetObservation, size: float, most: float) -> ObservationRefused:
    """Returns the refusal of an observation far from the prediction, by its field that is farthest."""
    off_m = math.dist(seen.position, predicted.position)
    std_m = math.hypot(predicted.uncertainty.position_std_m, seen.std_m)
    words = f"{off_m:.3g} m from where the target was expected, which is known to {std_m:.2g} m along each axis"
    field = "position"
    if seen.velocity is not None and predicted._with_place(seen)[1] <= INNOVATION_MAX[3]:
        field = "velocity"
        off_m_s = math.dist(seen.velocity, predicted.velocity)
        words = f"{off_m_s:.3g} m/s from the velocity that was expected"
    reason = f"is {words} (chi-square {size:.3g}, limit {most:.3g}); a target that was moved is a new one"
    return ObservationRefused(field, reason)

"""The feeder: places on which objects lie until the gripper closes on them."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from simulator.physics.camera import ObservingCamera
from simulator.physics.outputs import TIME_TOLERANCE_S
from simulator.truth import CameraNoise, ObjectFeed

NO_NOISE = CameraNoise()


@dataclass(frozen=True)
class FedObject:
    """An object on a place.

    Attributes:
        number: its own.
        position_m: of its centre in the world (3,) [m].
    """

    number: int
    position_m: tuple[float, float, float]


class Feeder:
    """Every place has an object at first; one that is taken is replaced some time later, or never.

    Attributes:
        on_places: objects that lie there, by the number of their place.
    """

    def __init__(self, feed: ObjectFeed, seed: int, noise: CameraNoise = NO_NOISE) -> None:
        """Fills every place.

        Args:
            feed: where its objects lie, and when they come.
            seed: of where they lie, of which grips miss, and of what its camera sees.
            noise: of that camera.
        """
        self.feed = feed
        self._camera = ObservingCamera(noise, f"{seed} feeder")
        self.on_places: dict[int, FedObject] = {}
        self._count = 0
        self._due: dict[int, float] = {}  # controller's time [s] at which a place is filled again
        self._lies = random.Random(f"{seed} feeder")
        self._misses = random.Random(f"{seed} missed grips")
        for place in range(len(feed.places)):
            self._fill(place)

    def cycle(self, t: float) -> None:
        """Fills the places that are due up to `t` [s]."""
        for place in [place for place, at in self._due.items() if at <= t + TIME_TOLERANCE_S]:
            del self._due[place]
            self._fill(place)

    def take(self, t: float, tcp: Sequence[float]) -> int | None:
        """Takes the object nearest to the tool centre point (3,) [m] at `t` [s].

        Returns:
            Its number; None where none is within reach, or the grip misses it.
        """
        if not self.on_places:
            return None
        apart = {place: math.dist(each.position_m, tcp) for place, each in self.on_places.items()}
        nearest = min(apart, key=lambda place: apart[place])
        if apart[nearest] > self.feed.reach_m or self._misses.random() < self.feed.missed:
            return None
        if self.feed.refill_s is not None:
            self._due[nearest] = t + self.feed.refill_s
        return self.on_places.pop(nearest).number

    def look(self) -> list[dict[str, Any]]:
        """Returns what a camera sees on the places: positions, without numbers, and their standard deviation."""
        return self._camera.look([each.position_m for each in self.on_places.values()])

    def _fill(self, place: int) -> None:
        x, y, z = self.feed.places[place]
        gauss = self._lies.gauss
        self._count += 1
        position = (x + gauss(0.0, self.feed.scatter_m), y + gauss(0.0, self.feed.scatter_m), z)
        self.on_places[place] = FedObject(self._count, position)

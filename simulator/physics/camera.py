"""The camera that observes where an object landed, or lies: what it reports, as opposed to where that is."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Any

from simulator.truth import CameraNoise


class ObservingCamera:
    """Reports landings with its errors along x and y; without noise it reports exactly where the object landed."""

    def __init__(self, noise: CameraNoise, seed: int | str) -> None:
        self.noise = noise
        self.draw = random.Random(f"{seed} camera")

    def observe(self, landing: Mapping[str, Any]) -> dict[str, Any]:
        """Returns the observation of a landing: object, on what, position and its standard deviation, z axis."""
        x, y, z = landing["position_m"]
        dx, dy = self._error()
        position = [x + dx, y + dy, z]
        seen = {"axis": landing["axis"]} if "axis" in landing else {}
        return {
            **seen,
            "object": landing["object"],
            "surface": landing["surface"],
            "position_m": position,
            "std_m": self.noise.std_m,
        }

    def look(self, positions: Sequence[Sequence[float]]) -> list[dict[str, Any]]:
        """Returns where objects that lie at positions (n, 3) [m] are seen, in another order each time."""
        seen = []
        for x, y, z in positions:
            dx, dy = self._error()
            seen.append({"position_m": [x + dx, y + dy, z], "std_m": self.noise.std_m})
        self.draw.shuffle(seen)
        return seen

    def _error(self) -> tuple[float, float]:
        noise = self.noise
        gauss = self.draw.gauss
        dx = gauss(0.0, noise.std_m)
        dy = gauss(0.0, noise.std_m)
        if self.draw.random() < noise.outlier_share:
            return dx + gauss(0.0, noise.outlier_std_m), dy + gauss(0.0, noise.outlier_std_m)
        return dx, dy

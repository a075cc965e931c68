"""The camera that observes where an object landed: what it reports, as opposed to where that was."""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Any

from simulator.truth import CameraNoise


class ObservingCamera:
    """Reports landings with its errors along x and y; without noise it reports exactly where the object landed."""

    def __init__(self, noise: CameraNoise, seed: int) -> None:
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

    def _error(self) -> tuple[float, float]:
        noise = self.noise
        gauss = self.draw.gauss
        dx = gauss(0.0, noise.std_m)
        dy = gauss(0.0, noise.std_m)
        if self.draw.random() < noise.outlier_share:
            return dx + gauss(0.0, noise.outlier_std_m), dy + gauss(0.0, noise.outlier_std_m)
        return dx, dy

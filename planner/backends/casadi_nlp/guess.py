"""What the optimiser begins from: anything that says where the joints are when."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


class Guess(Protocol):
    """A motion through a release, such as a `Trajectory`, or Ruckig's before it is brought onto ticks."""

    @property
    def release_time_s(self) -> float:
        """When it releases [s]."""
        ...

    @property
    def duration_s(self) -> float:
        """When it is at rest [s]."""
        ...

    def at(self, t: Vector, /) -> tuple[Vector, Vector, Vector]:
        """Returns q, qd, qdd (n, 6) at times `t` (n,) [s]."""
        ...

"""A camera whose pose is known: what it sees, as places in the world."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner.errors import FileRefused
from planner.rotations import matrix_to_rotation_vector, pose, rotation_vector_to_matrix

Vector = NDArray[np.float64]

NO_CAMERA = "is no camera, as fling calibrate camera --out writes it"


@dataclass(frozen=True, eq=False)
class Camera:
    """A camera that stands still.

    Attributes:
        X_WC: pose of its frame in the world (4, 4).
        std_m: standard deviation of a point that it sees, along each axis [m].
    """

    X_WC: Vector
    std_m: float = 0.0

    @classmethod
    def load(cls, file: Path | str) -> Camera:
        """Returns the camera of a file that `fling calibrate camera --out` has written.

        Raises:
            FileRefused: it is no such file.
        """
        try:
            document = json.loads(Path(file).read_text())
            R = rotation_vector_to_matrix(_vector(document, "rotation_vector_rad"))
            return cls(pose(_vector(document, "position_m"), R), float(document["std_m"]))
        except KeyError as error:
            raise FileRefused(file, f"{NO_CAMERA}: it lacks {error}") from error
        except (OSError, ValueError, TypeError) as error:
            raise FileRefused(file, f"{NO_CAMERA}: {error}") from error

    def save(self, file: Path | str) -> None:
        """Writes it as JSON."""
        Path(file).write_text(json.dumps(self.document(), indent=2) + "\n")

    def document(self) -> dict[str, Any]:
        """Returns its pose as JSON: `position_m`, `rotation_vector_rad`, `std_m`."""
        turn = matrix_to_rotation_vector(self.X_WC[:3, :3])
        return {"position_m": self.X_WC[:3, 3].tolist(), "rotation_vector_rad": turn.tolist(), "std_m": self.std_m}

    def in_world(self, points: ArrayLike | Sequence[Sequence[float]]) -> Vector:
        """Returns seen points (n, 3) or (3,) [m, camera] as places in the world [m]; none of none.

        Raises:
            ValueError: the points have other than three coordinates, or one is no number.
        """
        seen = np.asarray(points, float)
        if seen.size == 0:
            return np.zeros((0, 3))
        if seen.shape[-1] != 3 or not np.isfinite(seen).all():
            raise ValueError(f"a point has three coordinates in metres; given are {seen.tolist()}")
        return seen @ self.X_WC[:3, :3].T + self.X_WC[:3, 3]


def _vector(document: dict[str, Any], name: str) -> Vector:
    try:
        found = np.array(document[name], float)
    except ValueError:
        found = np.empty(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise ValueError(f"{name} = {document[name]} is not three numbers")
    return found

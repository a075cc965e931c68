"""Points that a camera has seen and the tool's tip has touched: read from CSV, and what they say of the camera."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import click
import numpy as np

import fling
from learning import CameraFit, TouchedPointsRefused, fit_camera, slip
from planner.rotations import rotation_vector_to_matrix

COLUMNS = tuple(f"{kind}_{axis}_m" for kind in ("seen", "touched") for axis in "xyz")
FREE = 6  # numbers that the points decide: the camera's pose


@dataclass(frozen=True, eq=False)
class TouchedPoints:
    """The camera that points decide."""

    fit: CameraFit
    camera: fling.Camera

    @classmethod
    def read(cls, file: Path, base_in_world: Mapping[str, Sequence[float]] | None) -> Self:
        """Returns the camera of a CSV file; touched points are in the world, or in a base with this pose.

        Raises:
            click.ClickException: with the line and field, or why the points decide no camera.
        """
        points = np.array(_rows(file)).reshape(-1, 2, 3)
        seen, touched = points[:, 0], points[:, 1]
        if base_in_world is not None:
            R = rotation_vector_to_matrix(base_in_world["rotation_vector_rad"])
            touched = touched @ R.T + np.array(base_in_world["position_m"])
        try:
            fit = fit_camera(seen, touched)
        except TouchedPointsRefused as refused:
            raise click.ClickException(f"{file}: {refused}") from refused
        free = 3 * len(seen) - FREE
        return cls(fit, fling.Camera(fit.X_WC, math.sqrt(float(np.sum(fit.residuals_m**2)) / free)))

    def document(self) -> dict[str, Any]:
        """Returns the camera and the points' residuals as JSON."""
        off = {name: getattr(self.fit, name).tolist() for name in ("residuals_m", "left_out_m")}
        return {**self.camera.document(), **off, "slip": slip(self.fit)}

    def text(self) -> str:
        """Returns it in words."""
        told = self.camera.document()
        where = ", ".join(f"{1e3 * x:.1f}" for x in told["position_m"])
        turn = ", ".join(f"{x:.4f}" for x in told["rotation_vector_rad"])
        residuals, left_out = 1e3 * self.fit.residuals_m, 1e3 * self.fit.left_out_m
        lines = [
            f"camera at ({where}) mm in the world, rotation vector ({turn}) rad",
            f"a point that it sees is off by {1e3 * self.camera.std_m:.1f} mm (standard deviation along each axis)",
            "point  residual  under the pose that the others give",
            *(f"{i + 1:5}  {r:5.1f} mm  {o:5.1f} mm" for i, (r, o) in enumerate(zip(residuals, left_out, strict=True))),
        ]
        off = slip(self.fit)
        if off is not None:
            which = f"point {off + 1} is far off while the others agree: was another one touched, or seen?"
            lines.append(f"{which} The camera above includes it; take its line out of the file and calibrate again")
        return "\n".join(lines)


def _rows(file: Path) -> list[list[float]]:
    """Returns the numbers of each line.

    Raises:
        click.ClickException: a column is missing, or a field is no number.
    """
    with file.open(newline="") as stream:
        reader = csv.DictReader(stream)
        missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise click.ClickException(f"{file}: the first line lacks {', '.join(missing)}")
        return [[_number(file, reader.line_num, name, row[name]) for name in COLUMNS] for row in reader]


def _number(file: Path, line: int, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise click.ClickException(f"{file}, line {line}: {name} = {text!r} is not a number")
    return value

"""Where a camera stands, from points that it has seen and that the tool's tip has touched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

POINTS_MIN = 4  # with three, every point decides the pose, and the residuals show no slip
SPREAD_MIN_M = 0.02  # [m] of the points across their longest line: else they leave a turn about it open
SLIP = 4.0  # times the median of the points: beyond chance also of a point at the edge, which the others decide less
MIRRORED = 10.0  # times better that mirrored points fit: points in a plane fit either way alike
SCALE_TOLERANCE = 0.05  # [-] of a camera's distances: beyond, its unit is another or it is not calibrated itself


class TouchedPointsRefused(ValueError):
    """The points do not say where the camera stands; the text says why."""


@dataclass(frozen=True, eq=False)
class CameraFit:
    """A camera's pose, and how well the points agree on it.

    Attributes:
        X_WC: pose of the camera's frame in the world (4, 4).
        residuals_m: distance of each touched point from where the camera saw it (n,) [m].
        left_out_m: the same under the pose that the other points give (n,) [m]: what the camera is off at a point that
            it was not calibrated with.
        scale: distances between the points as the camera sees them, over those touched [-].
    """

    X_WC: Vector
    residuals_m: Vector
    left_out_m: Vector
    scale: float


def fit_camera(seen: Vector, touched: Vector) -> CameraFit:
    """Returns the pose that brings seen points closest to touched ones, by least squares.

    Source: W. Kabsch, A solution for the best rotation to relate two sets of vectors, 1976; with the sign of
    S. Umeyama, 1991, which keeps it a rotation.

    Args:
        seen: points in the camera's frame (n, 3) [m].
        touched: the same points in the world (n, 3) [m].

    Raises:
        TouchedPointsRefused: fewer than four, nearly on a line, of another scale, or mirrored.
    """
    if len(seen) < POINTS_MIN:
        raise TouchedPointsRefused(f"{len(seen)} points: at least {POINTS_MIN} are needed, so that a slip shows")
    for name, points in (("seen", seen), ("touched", touched)):
        across_m = _across_m(points)
        if across_m < SPREAD_MIN_M:
            what = f"the {name} points lie within {1e3 * across_m:.1f} mm of a line"
            raise TouchedPointsRefused(f"{what}: at least {1e3 * SPREAD_MIN_M:g} mm across it are needed")
    scale = _size(seen) / _size(touched)
    if abs(scale - 1.0) > SCALE_TOLERANCE:
        what = f"distances between the points as seen are {scale:.4g} times those touched"
        raise TouchedPointsRefused(f"{what}: both are in metres, and a point has one line")
    X_WC = _closest_pose(seen, touched)
    mirrored = seen * [1.0, 1.0, -1.0]
    off_m = float(np.linalg.norm(_off_m(X_WC, seen, touched)))
    off_mirrored_m = float(np.linalg.norm(_off_m(_closest_pose(mirrored, touched), mirrored, touched)))
    if off_m > MIRRORED * off_mirrored_m:
        what = f"mirrored, the seen points fit {off_m / off_mirrored_m:.0f} times better"
        raise TouchedPointsRefused(f"{what}: the axes of the camera's frame are not right-handed")
    kept = [np.delete(np.arange(len(seen)), i) for i in range(len(seen))]
    without = [_closest_pose(seen[rows], touched[rows]) for rows in kept]
    left_out = [_off_m(X, seen[i : i + 1], touched[i : i + 1])[0] for i, X in enumerate(without)]
    return CameraFit(X_WC, _off_m(X_WC, seen, touched), np.array(left_out), scale)


def slip(fit: CameraFit) -> int | None:
    """Returns the number of the point that is far off while the others agree: touched, or seen, elsewhere.

    One at a time: it pulls at the others, too.
    """
    worst = int(np.argmax(fit.left_out_m))
    return worst if fit.left_out_m[worst] > SLIP * np.median(fit.left_out_m) else None


def _closest_pose(seen: Vector, touched: Vector) -> Vector:
    middle_seen, middle_touched = seen.mean(0), touched.mean(0)
    U, _, Vt = np.linalg.svd((touched - middle_touched).T @ (seen - middle_seen))
    X = np.eye(4)
    X[:3, :3] = U @ np.diag([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)]) @ Vt
    X[:3, 3] = middle_touched - X[:3, :3] @ middle_seen
    return X


def _off_m(X_WC: Vector, seen: Vector, touched: Vector) -> Vector:
    return np.linalg.norm(seen @ X_WC[:3, :3].T + X_WC[:3, 3] - touched, axis=1)


def _across_m(points: Vector) -> float:
    """Returns the root mean square distance of points from the line that fits them best [m]."""
    spread = np.linalg.svd(points - points.mean(0), compute_uv=False)
    return float(np.linalg.norm(spread[1:]) / np.sqrt(len(points)))


def _size(points: Vector) -> float:
    return float(np.linalg.norm(points - points.mean(0)))

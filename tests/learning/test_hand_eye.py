"""The pose of a camera from touched points: SciPy's rotation, hidden poses, and points that decide none."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from learning import TouchedPointsRefused, fit_camera, slip

NOISE_M = 0.001


def drawn(seed: int, count: int, noise_m: float = NOISE_M) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns a hidden pose (4, 4), points as the camera sees them, and the same as touched (n, 3)."""
    rng = np.random.default_rng(seed)
    X_WC = np.eye(4)
    X_WC[:3, :3] = Rotation.random(random_state=rng.integers(2**31)).as_matrix()
    X_WC[:3, 3] = rng.uniform(-2.0, 2.0, 3)
    touched = rng.uniform([0.3, -0.4, 0.0], [0.8, 0.4, 0.3], (count, 3))
    seen = (touched - X_WC[:3, 3]) @ X_WC[:3, :3] + noise_m * rng.standard_normal((count, 3))
    return X_WC, seen, touched


@pytest.mark.parametrize("seed", range(20))
def test_the_pose_is_that_of_scipy(seed: int) -> None:
    _, seen, touched = drawn(seed, 8)
    fit = fit_camera(seen, touched)
    R, _ = Rotation.align_vectors(touched - touched.mean(0), seen - seen.mean(0))
    assert fit.X_WC[:3, :3] == pytest.approx(R.as_matrix(), abs=1e-9)
    off = np.linalg.norm(seen @ R.as_matrix().T - (seen.mean(0) @ R.as_matrix().T) + touched.mean(0) - touched, axis=1)
    assert fit.residuals_m == pytest.approx(off, abs=1e-9)


def test_a_hidden_pose_is_found() -> None:
    X_WC, seen, touched = drawn(7, 12, noise_m=0.0)
    assert pytest.approx(X_WC, abs=1e-9) == fit_camera(seen, touched).X_WC


def test_points_left_out_tell_what_the_camera_is_off_elsewhere() -> None:
    off, told = [], []
    for seed in range(200):
        _, seen, touched = drawn(seed, 9)
        fit = fit_camera(seen[:8], touched[:8])
        off.append(np.linalg.norm(seen[8] @ fit.X_WC[:3, :3].T + fit.X_WC[:3, 3] - touched[8]))
        told.append(fit.left_out_m)
    assert np.sqrt(np.mean(np.square(told))) == pytest.approx(np.sqrt(np.mean(np.square(off))), rel=0.15)


def test_a_point_that_was_touched_elsewhere_is_named() -> None:
    _, seen, touched = drawn(3, 10)
    assert slip(fit_camera(seen, touched)) is None
    touched[6] += [0.03, 0.0, 0.0]
    assert slip(fit_camera(seen, touched)) == 6


def test_points_that_decide_no_pose_are_refused() -> None:
    _, seen, touched = drawn(1, 6)
    with pytest.raises(TouchedPointsRefused, match="3 points: at least 4"):
        fit_camera(seen[:3], touched[:3])
    line = np.linspace(0.0, 1.0, 6)[:, None] * [0.3, 0.2, 0.1]
    with pytest.raises(TouchedPointsRefused, match=r"the seen points lie within 0\.0 mm of a line"):
        fit_camera(line, touched)
    with pytest.raises(TouchedPointsRefused, match="are 1000 times those touched"):
        fit_camera(1e3 * touched, touched)


def test_a_frame_that_is_not_right_handed_is_refused() -> None:
    _, seen, touched = drawn(2, 10)
    with pytest.raises(TouchedPointsRefused, match="axes of the camera's frame are not right-handed"):
        fit_camera(seen * [1.0, -1.0, 1.0], touched)

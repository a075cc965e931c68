"""The least distance along a motion against every distance of it."""

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh

from audit.judge import coal_mesh
from audit.judge.least_gap import MovingSolid, least_gap

BESIDE = trimesh.creation.box((0.3, 0.2, 0.4), transform=pin.SE3(np.eye(3), np.array([0.9, 0.0, 0.0])).homogeneous)
SOLIDS = {
    "box": lambda: coal.Box(0.4, 0.3, 0.2),
    "ball": lambda: coal.Sphere(0.1),
    "mesh away from its origin": lambda: coal_mesh(BESIDE),
}


def _moved(solid: coal.CollisionGeometry, seed: int, away_m: float, count: int = 300) -> MovingSolid:
    """Returns a solid that swings about, its origin at a distance."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, count)
    turns = np.outer(np.sin(3.0 * t), rng.normal(size=3)) + np.outer(t, rng.normal(size=3))
    p = np.array([away_m, 0.0, 0.0]) + np.outer(np.cos(4.0 * t), rng.uniform(-0.4, 0.4, 3))
    return MovingSolid.at(solid, np.array([pin.exp3(turn) for turn in turns]), p)


@pytest.mark.parametrize("name", SOLIDS)
@pytest.mark.parametrize("away_m", [0.3, 0.8, 1.5])
def test_least_gap_is_the_least_of_all(name, away_m):
    for seed in range(4):
        one = _moved(SOLIDS[name](), 2 * seed, 0.0)
        other = _moved(coal.Capsule(0.05, 0.3), 2 * seed + 1, away_m)
        every = [
            coal.distance(
                one.solid,
                one.transform(k),
                other.solid,
                other.transform(k),
                coal.DistanceRequest(),
                coal.DistanceResult(),
            )
            for k in range(len(one.p))
        ]
        least = min(every)
        found = least_gap(one, other, np.inf)
        if name.startswith("mesh") and least < 0.0:  # of faces: the depth is none of the solid's
            assert found < 0.0
        else:
            assert found == pytest.approx(least, abs=2e-6)
        assert least_gap(one, other, least - 0.01) == least - 0.01

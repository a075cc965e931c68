"""The least distance of two solids along a motion, by coal: of all instants, but asked for few of them.

Where a solid moves by no more than d in the axes of another, which is to say none of its points by more, their distance
changes by no more than d: by the triangle inequality where they are apart, and where two convex solids overlap their
depth is a maximum over directions of what moves by d at most. From one instant to the next a point y of the solid moves
by |dp + dR y| <= |dp| + |dR| |y|, with the Frobenius norm of the change of its axes. Those steps are summed to a way s:
between two instants whose distances are known, no distance is less than the half of (one + other - way between them).
An instant is passed over only where that, or the distance of the balls about the solids, is no less than a distance
which was found already. Coal's tolerance of 1e-6 m is a tenth of what the judge grants to distances.

A mesh is its faces alone, and where one is met coal tells how deep one of the faces met is, which may be far less than
the solid must move to be free of it: of a ball 5 cm deep in a wall 2 cm. So where a solid meets a mesh, that it does is
found, and the depth that is told is too small; what is wholly within a mesh is apart from it.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import coal
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

REQUEST = coal.DistanceRequest()


class MovingSolid(NamedTuple):
    """A solid of coal; its axes (n, 3, 3), its origins and the middles of its box (n, 3) [m] at n instants."""

    solid: coal.CollisionGeometry
    R: Vector
    p: Vector
    middle: Vector

    @classmethod
    def at(cls, solid: coal.CollisionGeometry, R: Vector, p: Vector) -> MovingSolid:
        """Returns a solid with axes (n, 3, 3) at origins (n, 3) [m]."""
        solid.computeLocalAABB()
        return cls(solid, R, p, p + R @ solid.aabb_center)

    @classmethod
    def at_rest(cls, solid: coal.CollisionGeometry, place: coal.Transform3s, p: Vector) -> MovingSolid:
        """Returns a solid that keeps the axes of a place, at origins (n, 3) [m]."""
        return cls.at(solid, np.broadcast_to(place.getRotation(), (len(p), 3, 3)), p)

    def first(self, count: int) -> MovingSolid:
        """Returns its first instants."""
        return MovingSolid(self.solid, self.R[:count], self.p[:count], self.middle[:count])

    def transform(self, k: int) -> coal.Transform3s:
        """Returns its place at an instant."""
        return coal.Transform3s(self.R[k], self.p[k])


def ball_gaps(one: MovingSolid, other: MovingSolid) -> Vector:
    """Returns the distances (n,) [m] of the balls about two solids, no more than those of the solids."""
    return np.linalg.norm(one.middle - other.middle, axis=1) - one.solid.aabb_radius - other.solid.aabb_radius


def least_gap(one: MovingSolid, other: MovingSolid, least: float) -> float:
    """Returns the least distance of two solids [m], negative where they overlap; or `least`, where that is smaller.

    By how much they overlap is told of convex solids alone, see the module.

    Args:
        one: a solid; the bounds are tight where it is the larger one.
        other: another, at the same n instants.
        least: distance that is known already [m].
    """
    away = ball_gaps(one, other)
    if len(away) == 0 or away.min() >= least:
        return least
    s = _way(one, other)
    found: dict[int, float] = {}
    for k in sorted({0, int(away.argmin()), len(away) - 1}):
        found[k] = _gap(one, other, k)
        least = min(least, found[k])
    between = list(pairwise(sorted(found)))
    while between:
        i, j = between.pop()
        if j - i < 2 or 0.5 * (found[i] + found[j] - s[j] + s[i]) >= least or away[i + 1 : j].min() >= least:
            continue
        lowest = 0.5 * (s[i] + s[j] + found[i] - found[j])  # where the two bounds meet
        k = min(max(int(np.searchsorted(s, lowest)), i + 1), j - 1)
        found[k] = _gap(one, other, k)
        least = min(least, found[k])
        between += [(i, k), (k, j)]
    return least


def _way(one: MovingSolid, other: MovingSolid) -> Vector:
    """Returns by how much the points of a solid have moved at most (n,) [m] in the axes of the first one."""
    turned = np.swapaxes(one.R, 1, 2)
    p = (turned @ (other.p - one.p)[..., None])[..., 0]
    R = turned @ other.R
    reach = float(np.linalg.norm(other.solid.aabb_center)) + other.solid.aabb_radius
    steps = np.linalg.norm(np.diff(p, axis=0), axis=1) + reach * np.linalg.norm(np.diff(R, axis=0), axis=(1, 2))
    return np.concatenate([[0.0], np.cumsum(steps)])


def _gap(one: MovingSolid, other: MovingSolid, k: int) -> float:
    result = coal.DistanceResult()
    return float(coal.distance(one.solid, one.transform(k), other.solid, other.transform(k), REQUEST, result))

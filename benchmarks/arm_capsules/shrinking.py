"""Capsules around the surface of an arm: begun too long, and shortened step by step for as long as they contain it.

Each capsule is about an axis of the table below. Those around housings, which have lids, are an eighth wider than
these: one as wide as a lid would reach beyond it by its whole radius, these do by about half of it. The capsules
take turns in drawing in one of their ends by a step, as long as every point of the surface stays in some capsule;
where none can any more, the step is halved. Then each radius is made exactly as large as the triangles need it that
lie deepest in that capsule, and rounded up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.arm_capsules.meshes import LINKS
from planner.kinematics import link_poses
from planner.robots import Robot

Vector = NDArray[np.float64]

FIRST_STEP_M = 0.004
LAST_STEP_M = 0.00025
SPACING_M = 0.006  # longest edge of the triangles whose corners are the points of the surface
MERGED_M = 0.003  # points of one cell of a grid that is so wide count once
ROUNDED_M = 0.0001  # radii are rounded up to it
WIDER = 1.12  # [-] radius of a capsule over that of the housing in it
WIDER_AT_ELBOW = 1.18  # [-] the same where both tubes leave the housing, with fillets
FOOT_M = 0.01  # height of the foot's capsule: its plate is about twice as thick
ROOM_M = 0.002  # by which the capsules of a tube and of its collars are wider than these
LONGER_M = 0.08  # by which both ends are beyond the part at first
COLLAR_AT = 1.25  # [-] place of a collar, from the axis of the joint, over the housing's half width
COLLAR = 1.5  # [-] length of a tube's collar over its half width, from the axis of the joint


class FirstCapsule(NamedTuple):
    """Where a capsule begins: its name, the links it is around, and its axis.

    Attributes:
        name: of the part of the arm.
        links: whose surface it may contain.
        frame: DH frame it is fixed in.
        origin, direction: of its axis in that frame (3,), where it begins, and the unit vector along it.
        length: [m].
        radius: [m].
    """

    name: str
    links: tuple[str, ...]
    frame: int
    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    length: float
    radius: float


@dataclass(frozen=True)
class FittedCapsule:
    """A capsule about the axis of a `FirstCapsule`, from one distance along it to another [m]."""

    first: FirstCapsule
    low: float
    high: float
    radius: float

    def ends(self) -> tuple[Vector, Vector]:
        """Returns its ends (3,) in its frame [m], as they are written."""
        at = [np.add(self.first.origin, along * np.array(self.first.direction)) for along in (self.low, self.high)]
        return at[0].round(4) + 0.0, at[1].round(4) + 0.0


def first_capsules(robot: Robot, surface: Mapping[str, Vector]) -> tuple[FirstCapsule, ...]:
    """Returns the axes of an arm's capsules: those of the joints, and those of the two tubes."""
    upper = -float(robot.a[1])
    fore = -float(robot.a[2])
    d1, d4, d5, d6 = (float(robot.d[i]) for i in (0, 3, 4, 5))
    upper_arm = _Tube(surface["upper_arm"], upper, has_collar_at_end=True)
    forearm = _Tube(surface["forearm"], fore, has_collar_at_end=False)
    foot, turret, first, second = (
        float(np.abs(surface[link][..., 0]).max()) for link in ("base", "shoulder", "wrist_1", "wrist_2")
    )
    base = surface["base"].reshape(-1, 3)
    above = base[base[:, 2] > 0.75 * foot]  # the foot's capsule
    cone = float(np.abs(above[:, 0]).max(initial=0.0))
    flange = float(np.linalg.norm(surface["wrist_3"][..., :2], axis=-1).max())  # with the socket at its side
    has_socket = bool(surface["base"][..., 1].max() > foot + 2.0 * ROOM_M)  # of the cable, as on CB3
    up = upper_arm.z
    out = forearm.z
    at_shoulder = WIDER * max(turret, upper_arm.start)
    at_elbow = WIDER_AT_ELBOW * max(upper_arm.end, forearm.start)
    at_wrist = WIDER * max(forearm.end, first, second)
    collars = [COLLAR * half_width for half_width in (upper_arm.start, upper_arm.end, forearm.start)]
    thick = [ROOM_M + half_width for half_width in (*upper_arm.collars, forearm.collars[0])]
    z = (0.0, 0.0, 1.0)
    x = (1.0, 0.0, 0.0)
    y = (0.0, 1.0, 0.0)
    return (
        FirstCapsule("foot", ("base",), 0, (0.0, 0.0, FOOT_M), y if has_socket else z, 0.0, foot + ROOM_M),
        FirstCapsule("base", ("base", "shoulder"), 0, (0.0, 0.0, 0.0), z, d1, max(WIDER * turret, cone + ROOM_M)),
        FirstCapsule("shoulder", ("shoulder", "upper_arm"), 1, (0.0, 0.0, 0.0), z, up, at_shoulder),
        FirstCapsule("upper_arm", ("upper_arm",), 2, (0.0, 0.0, up), x, upper, upper_arm.middle + ROOM_M),
        FirstCapsule("upper_arm_start", ("upper_arm",), 2, (upper - collars[0], 0.0, up), x, collars[0], thick[0]),
        FirstCapsule("upper_arm_end", ("upper_arm",), 2, (0.0, 0.0, up), x, collars[1], thick[1]),
        FirstCapsule("elbow", ("upper_arm", "forearm"), 2, (0.0, 0.0, out), z, up - out, at_elbow),
        FirstCapsule("forearm", ("forearm",), 3, (0.0, 0.0, out), x, fore, forearm.middle + ROOM_M),
        FirstCapsule("forearm_start", ("forearm",), 3, (fore - collars[2], 0.0, out), x, collars[2], thick[2]),
        FirstCapsule("wrist_1", ("forearm", "wrist_1"), 3, (0.0, 0.0, out), z, d4 - out, at_wrist),
        FirstCapsule("wrist_2", ("wrist_1", "wrist_2"), 4, (0.0, 0.0, 0.0), z, d5, at_wrist),
        FirstCapsule("wrist_3", ("wrist_2", "wrist_3"), 5, (0.0, 0.0, 0.0), z, d6, max(at_wrist, flange + ROOM_M)),
    )


class _Tube:
    """Dimensions of a long link, which runs along x from its end, at 0, to its start [m].

    Attributes:
        z: of its axis.
        start, end: half widths there, of the housings.
        collars: half widths where the tube leaves them.
        middle: half width of the tube, of all that no collar's capsule is around.
    """

    def __init__(self, triangles: Vector, length: float, has_collar_at_end: bool) -> None:
        points = _points(triangles)
        x = points[:, 0]
        middle = points[np.abs(x - 0.5 * length) < 0.1 * length]
        self.z = float(0.5 * (middle[:, 2].min() + middle[:, 2].max()))
        self.start = float(np.abs(points[x > 0.9 * length, 1]).max())
        self.end = float(np.abs(points[x < 0.1 * length, 1]).max())
        self.collars = [
            float(np.abs(points[np.abs(away - COLLAR_AT * width) < 0.1 * width, 1]).max())
            for away, width in ((length - x, self.start), (x, self.end))
        ]
        tube = middle if has_collar_at_end else points[(x > self.end) & (x < 0.6 * length)]
        self.middle = float(np.abs(tube[:, 1]).max())


def shrunk(robot: Robot, surface: Mapping[str, Vector]) -> tuple[FittedCapsule, ...]:
    """Returns the capsules of an arm around its surface.

    Args:
        robot: the arm.
        surface: triangles (n, 3, 3) [m] of its links in their DH frames.

    Raises:
        ValueError: the capsules with which it begins do not contain the arm.
    """
    begun = [
        FittedCapsule(first, -LONGER_M, first.length + LONGER_M, first.radius)
        for first in first_capsules(robot, surface)
    ]
    cover = _Cover(robot, begun, {link: _points(triangles) for link, triangles in surface.items()})
    step = FIRST_STEP_M
    while step >= LAST_STEP_M:
        if not any([cover.shorten(i, step) for i in range(len(begun))]):
            step /= 2.0
    fine = {link: split(triangles, SPACING_M) for link, triangles in surface.items()}
    return tuple(_exact(robot, cover.capsules, fine))


class _Cover:
    """Which points of the surface are in which capsules."""

    def __init__(self, robot: Robot, capsules: list[FittedCapsule], points: Mapping[str, Vector]) -> None:
        self.capsules = capsules
        self._places = [
            {link: along_and_across(robot, capsule.first, link, points[link]) for link in capsule.first.links}
            for capsule in capsules
        ]
        self._within = [self._points_within(i, capsule) for i, capsule in enumerate(capsules)]
        self._count = {
            link: sum(within[link].astype(int) for within in self._within if link in within) for link in points
        }
        lost = [link for link, count in self._count.items() if np.min(count) == 0]
        if lost:
            raise ValueError(f"{robot.name}: the first capsules do not contain {', '.join(lost)}")

    def _points_within(self, i: int, capsule: FittedCapsule) -> dict[str, NDArray[np.bool_]]:
        return {link: _outside(capsule, *place) <= 0.0 for link, place in self._places[i].items()}

    def shorten(self, i: int, step: float) -> bool:
        """Draws in the ends of a capsule by a step each, if the others allow it. Returns whether one of them was."""
        drawn = [self._replace(i, replace(self.capsules[i], low=self.capsules[i].low + step))]
        drawn.append(self._replace(i, replace(self.capsules[i], high=self.capsules[i].high - step)))
        return any(drawn)

    def _replace(self, i: int, capsule: FittedCapsule) -> bool:
        """Puts a capsule in the place of one, if all points stay within some capsule. Returns whether it did."""
        within = self._points_within(i, capsule)
        count = {link: self._count[link] - self._within[i][link] + inside for link, inside in within.items()}
        if capsule.high < capsule.low or any(np.min(each) == 0 for each in count.values()):
            return False
        self.capsules[i] = capsule
        self._within[i] = within
        self._count |= count
        return True


def _outside(capsule: FittedCapsule, along: Vector, across: Vector) -> Vector:
    """Returns how far points are outside of a capsule [m]; negative inside."""
    return np.hypot(along - np.clip(along, capsule.low, capsule.high), across) - capsule.radius


def along_and_across(robot: Robot, first: FirstCapsule, link: str, x: Vector) -> tuple[Vector, Vector]:
    """Returns the places of points (..., 3) of a link along a capsule's axis, and their distances from it [m].

    The capsule of a joint's housing is fixed in the frame before the joint, but round about its axis: any position of
    the joint will do, here 0.
    """
    X = link_poses(robot, np.zeros(6))
    X_CL = np.linalg.inv(X[first.frame]) @ X[LINKS.index(link)]
    apart = x @ X_CL[:3, :3].T + X_CL[:3, 3] - first.origin
    along = apart @ first.direction
    return along, np.linalg.norm(apart - along[..., None] * first.direction, axis=-1)


def _exact(robot: Robot, capsules: list[FittedCapsule], fine: Mapping[str, Vector]) -> list[FittedCapsule]:
    """Returns the capsules with rounded ends, and radii that contain every triangle that is assigned to each."""
    rounded = [replace(each, low=round(each.low, 4), high=round(each.high, 4)) for each in capsules]
    assigned = parts(robot, rounded, fine)
    exact = []
    for capsule, part in zip(rounded, assigned, strict=True):
        beyond = [
            _outside(capsule, *along_and_across(robot, capsule.first, link, triangles)).max(initial=-capsule.radius)
            for link, triangles in part.items()
        ]
        exact.append(replace(capsule, radius=np.ceil((capsule.radius + max(beyond)) / ROUNDED_M) * ROUNDED_M))
    return exact


def parts(robot: Robot, capsules: list[FittedCapsule], fine: Mapping[str, Vector]) -> list[dict[str, Vector]]:
    """Returns the triangles (n, 3, 3) of each link that are deepest in each capsule, or least outside of it."""
    found: list[dict[str, Vector]] = [{} for _ in capsules]
    for link, triangles in fine.items():
        beside = [i for i, capsule in enumerate(capsules) if link in capsule.first.links]
        own = [capsules[i] for i in beside]
        depth = [_outside(each, *along_and_across(robot, each.first, link, triangles)).max(axis=1) for each in own]
        nearest = np.argmin(depth, axis=0)
        for k, i in enumerate(beside):
            found[i][link] = triangles[nearest == k]
    return found


def _points(triangles: Vector) -> Vector:
    """Returns corners (n, 3) of the triangles after `split`, one a cell of a grid."""
    corners = split(triangles, SPACING_M).reshape(-1, 3)
    cells = np.round(corners / MERGED_M).astype(int)
    return corners[np.unique(cells, axis=0, return_index=True)[1]]


def split(triangles: Vector, spacing_m: float) -> Vector:
    """Returns the triangles (n, 3, 3), halved across their longest edge until none is longer than the spacing."""
    done = []
    while len(triangles):
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        long = edges.max(axis=1) > spacing_m
        done.append(triangles[~long])
        first = edges[long].argmax(axis=1)
        rows = np.arange(len(first))
        a, b, c = (triangles[long][rows, (first + i) % 3] for i in range(3))
        middle = 0.5 * (a + b)
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done)

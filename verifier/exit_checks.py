"""Check of the way on which the object leaves the gripper: within the cone that it opens.

The object's displacement d from its place in the tool bends by no more than |g - a| while the tool's acceleration is a.
With u the axis of the cone in the world, the way is within it where f = d . u - cos(angle) |d| is not negative. Over a
part of a tick d and u are near their chords, and f of chords is least at the ends: for a cone of no more than a half
space it is concave in d; for a wider one |d| is replaced by d . m with a unit vector m, which is no more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from planner.cell import Cell
from verifier.arm import ArmPieces
from verifier.arm_in_flight import AT_REST_M, ArmAfter, largest
from verifier.drag import releases_of
from verifier.elementary import Array, Mask
from verifier.finding import Finding, Status, not_covered
from verifier.flights import OutsideMotion, Releases, release_pieces
from verifier.pieces import Index, all_pieces
from verifier.plan_document import Demands, SampledMotion
from verifier.solids import lengths_up, toward
from verifier.taylor import TaylorModel, dot, turned

NAME = "opening_direction"
FREE_M = 1e-3  # [m] displacements below it do not count. source: docs/conventions.md
OUT_M = 0.01  # [m] at least, at which the object is out of the grip. source: docs/conventions.md
OUT_MAX_S = 0.5  # [s] an object that is with the tool for longer is not proven to leave it
FIRST_S = 0.1  # [s] that is looked at first; an object leaves in less
SHARE = 1e-4  # [-] of the displacement by which f may be negative: an angle of about as many radians
FINER = (1, 2, 4, 8)  # [-] times as fine grids that are tried: what bends in a part of a tick falls with its square


def exit_findings(cell: Cell, motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Returns the finding about the way out of the gripper; none where nothing limits it."""
    gripper = cell.gripper
    if not demands.throws or gripper.opening_direction is None or gripper.opening_cone_rad is None:
        return
    watch = _ExitWatch(cell, ArmPieces(cell, all_pieces(motion)))
    at_s = 0.0
    for finer in FINER:
        try:
            releases = releases_of(cell, release_pieces(motion, demands.spread_s, finer), finer)
        except OutsideMotion as error:
            yield not_covered(NAME, str(error))
            return
        piece = watch.stays_or_strays(releases)
        if piece is None:
            yield Finding(NAME, Status.PROVEN)
            return
        at_s = float(releases.pieces.middle_s[piece])
    yield Finding(NAME, Status.NOT_PROVEN, at_s, "the way out of the gripper")


class _ExitWatch:
    """The cone of a cell's gripper, and how the tool moves in the ticks of a motion.

    Attributes:
        direction: axis of the cone in the tool (3,).
        cosine: of its half angle.
        out_m: displacement at which the object is out [m].
        bending: bounds on the tool's acceleration by ticks, at last 0 [m/s^2].
        turning: likewise on the second derivative of directions that turn with it [rad/s^2].
    """

    def __init__(self, cell: Cell, whole: ArmPieces) -> None:
        gripper = cell.gripper
        assert gripper.opening_direction is not None and gripper.opening_cone_rad is not None
        self.direction = gripper.opening_direction
        self.cosine = math.cos(gripper.opening_cone_rad)
        self.out_m = max(cell.object.radius_m, OUT_M)
        w, wd = whole.turning[6]
        a = whole.a_WT
        turning = dot(w, w).upper + np.sqrt(dot(wd, wd).upper)
        self.bending = np.append(np.sqrt(dot(a, a).upper), 0.0) * (1.0 + 1e-12)
        self.turning = np.append(turning, 0.0) * (1.0 + 1e-12)

    def stays_or_strays(self, releases: Releases) -> int | None:
        """Returns a piece of releases from which the object may leave outside the cone, or not at all; None: none."""
        count = math.ceil(FIRST_S * releases.grid_hz)
        while True:
            room, is_out = self._rooms(releases, count)
            if is_out[:, -1].all() or count >= OUT_MAX_S * releases.grid_hz:
                break
            count *= 2
        before = ~np.logical_or.accumulate(is_out, axis=1)[:, :-1]  # it has not been out at the patch's begin
        wrong = (before & ~(room >= 0.0)).any(axis=1) | ~is_out.any(axis=1)
        return int(np.flatnonzero(wrong)[0]) if wrong.any() else None

    def _rooms(self, releases: Releases, count: int) -> tuple[Array, Mask]:
        """Returns f in patches (n, count) [m], infinite where the object is still in its place, and where it is out.

        The latter at the patches' ends (n, count + 1).
        """
        n = len(releases.pieces.tick)
        rows, later = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(count + 1), indexing="ij"))
        after = ArmAfter(releases.cell, releases)
        arm, where = after.at(rows, later)
        # It begins with the tool's own velocity: what the opening gripper makes of that is on the way judged here.
        d = releases.at(rows, later / releases.grid_hz) - arm.p_WT[:, where]
        axis = turned(arm.R_WT, self.direction)[:, where]
        squares = dot(d, d)
        size_up = np.sqrt(np.maximum(squares.upper, 0.0)).reshape(n, -1) * (1.0 + 1e-12)
        size_low = np.sqrt(np.maximum(squares.lower, 0.0)).reshape(n, -1) * (1.0 - 1e-12)
        ends = np.arange(n * (count + 1)).reshape(n, count + 1)
        one, two = ends[:, :-1].ravel(), ends[:, 1:].ravel()
        f = _least(d, axis, (one, two), self.cosine)
        begins = np.tile(np.arange(count), n)
        ticks = (
            after.ticks(np.repeat(np.arange(n), count), begins),
            after.ticks(np.repeat(np.arange(n), count), begins + 1),
        )
        square = 1.0 / releases.grid_hz**2 / 8.0 * (1.0 + 1e-12)
        bend = (releases.bending + largest(self.bending, *ticks)) * square + AT_REST_M
        turn = largest(self.turning, *ticks) * square + AT_REST_M
        most = np.maximum(size_up[:, :-1], size_up[:, 1:]) + bend.reshape(n, -1)
        room = f.reshape(n, -1) - 2.0 * bend.reshape(n, -1) - most * turn.reshape(n, -1) + SHARE * most
        return np.where(most < FREE_M, np.inf, room), size_low >= self.out_m


def _least(d: TaylorModel, axis: TaylorModel, ends: tuple[Index, Index], cosine: float) -> Array:
    """Returns lower bounds (m,) [m] on f between the ends of patches, of chords of d and of the axis."""
    found = []
    m = toward(0.5 * (d.c0[:, ends[0]] + d.c0[:, ends[1]]))
    m = m / lengths_up(m)
    for i in ends:
        for j in ends:
            along = dot(d[:, i], axis[:, j])
            if cosine < 0.0:
                found.append((along + dot(m, d[:, i]) * -cosine).lower)
            else:
                size = np.sqrt(np.maximum(dot(d[:, i], d[:, i]).upper, 0.0)) * (1.0 + 1e-12)
                found.append(along.lower - cosine * size)
    return np.min(found, axis=0)

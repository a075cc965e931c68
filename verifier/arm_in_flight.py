"""The arm while the object flies: it goes on moving, and the object keeps clear of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from planner.cell import Cell
from verifier.arm import ArmPieces
from verifier.capsules import MovingCapsule
from verifier.elementary import Array, Mask
from verifier.finding import Finding, Status
from verifier.flights import STEPS, FlightPatches, Releases
from verifier.landing_place import LandingPlace
from verifier.pieces import Index, Pieces
from verifier.solids import lengths_up, shortened, toward
from verifier.taylor import TaylorModel, dot

CLEAR_M = 2e-4  # [m] from what gripped it, beyond which the object has left: more than rounding, less than any play
AT_REST_M = 1e-8  # [m] by which an arm that ends at no more than 2e-6 rad/s moves on in 8 ms; and rounding of times
ARM_ROUNDS = 8  # [-] of halving pieces of releases


class ArmAfter:
    """An arm at instants after pieces of releases, by parts of ticks; after its end it rests."""

    def __init__(self, cell: Cell, releases: Releases, like: ArmAfter | None = None) -> None:
        """Takes the releases, and the same arm after the same pieces of them, whose poses are known."""
        self.cell, self.releases = cell, releases
        self._parts = releases.parts
        pieces = releases.pieces
        self._part = np.minimum((pieces.begin * self._parts).astype(np.intp), self._parts - 1)
        self._kept: dict[bytes, tuple[ArmPieces, Index]] = {} if like is None else like._kept

    def at(self, rows: Index, later: Index) -> tuple[ArmPieces, Index]:
        """Returns the arm, and which of its pieces are those that follow pieces `rows` (m,) by parts of ticks (m,)."""
        key = rows.tobytes() + later.tobytes()
        if key not in self._kept:
            pieces = self.releases.pieces.chosen(rows)
            part = self._part[rows]
            place = pieces.tick * self._parts + part + later
            tick = place // self._parts
            moved = (place % self._parts - part) / self._parts
            last = len(pieces.motion.q) - 2
            rests = tick > last
            begin, end = (np.where(rests, 1.0, np.clip(x + moved, 0.0, 1.0)) for x in (pieces.begin, pieces.end))
            every = np.stack([np.minimum(tick, last), begin, end])
            distinct, where = np.unique(every, axis=1, return_inverse=True)
            found = Pieces(pieces.motion, distinct[0].astype(np.intp), distinct[1], distinct[2])
            self._kept[key] = ArmPieces(self.cell, found), where.ravel()
        return self._kept[key]

    def ends(self, capsule: MovingCapsule, rows: Index, later: Index) -> list[TaylorModel]:
        """Returns the ends (3, m) [m] of a capsule there."""
        arm, where = self.at(rows, later)
        return [arm.point(capsule.frame, end)[:, where] for end in capsule.ends]

    def ticks(self, rows: Index, later: Index) -> Index:
        """Returns the ticks (m,) that follow pieces `rows` (m,) by parts of ticks (m,)."""
        return (self.releases.pieces.tick[rows] * self._parts + self._part[rows] + later) // self._parts


def accelerations(arm: ArmPieces, capsule: MovingCapsule) -> Array:
    """Returns bounds (N,) [m/s^2] on the accelerations of a capsule's ends in the ticks of a motion; at last 0."""
    found = np.zeros(len(arm.pieces.tick) + 1)
    for end in capsule.ends:
        a = arm.acceleration(capsule.frame, end)
        found[:-1] = np.maximum(found[:-1], np.sqrt(dot(a, a).upper) * (1.0 + 1e-12))
    return found


def largest(values: Array, first: Index, last: Index) -> Array:
    """Returns the largest (m,) of values from places `first` to `last` (m,); beyond the last one they go on."""
    most = np.zeros(len(first))
    for k in range(int((last - first).max(initial=0)) + 1):
        most = np.maximum(most, values[np.minimum(np.minimum(first + k, last), len(values) - 1)])
    return most


class CapsuleWatch:
    """Whether flights keep clear of a capsule of the arm: from the release on, or once they have left it.

    Over a time h the distance along a fixed direction bends by no more than what flight and capsule accelerate, times
    h^2 / 8. Where patches of several parts of ticks do not decide, single ones do, of ever smaller pieces of releases.

    Attributes:
        capsule: the capsule.
        thick: distance of the object's centre from its axis at which the two are as near as they may be [m].
        grips: whether the object is gripped in it, or beside it.
        place: where flights end.
        bending: bounds on the accelerations of its ends, by ticks [m/s^2].
    """

    def __init__(self, watched: tuple[MovingCapsule, float, bool], place: LandingPlace, bending: Array) -> None:
        """Takes the capsule, the distance from its axis that is kept and whether it grips; then the rest."""
        self.capsule, self.thick, self.grips = watched
        self.place, self.bending = place, bending

    def findings(self, name: str, balls: Sequence[ArmAfter], lasts_s: float) -> Iterator[Finding]:
        """Yields the findings of a name about flights of some releases, until a time after these [s].

        Args:
            name: of the check.
            balls: the arm after the releases of each ball of the object: it has left what grips it with the last one.
            lasts_s: as above.
        """
        count = int(np.ceil(lasts_s * balls[0].releases.grid_hz))
        clear = None
        if self.grips:
            clear = np.logical_and.reduce([self._clear(after, count) for after in balls])
        yield from (self._finding(name, after, count, clear) for after in balls)

    def _finding(self, name: str, after: ArmAfter, count: int, clear: Mask | None) -> Finding:
        """Returns the finding about one ball.

        Args:
            name: of the check.
            after: the arm after its releases.
            count: parts of ticks until the flights are over.
            clear: where the object is clear of what grips it, at the begin of every part (n, count + 1).
        """
        releases = after.releases
        pieces = np.arange(len(releases.pieces.tick))
        rows, first = (x.ravel() for x in np.meshgrid(pieces, np.arange(0, count, STEPS), indexing="ij"))
        begins = np.zeros(len(pieces), np.intp)
        if clear is not None:
            begins = np.where(clear.any(axis=1), clear.argmax(axis=1), -1)
        if (begins < 0).any():
            at_s = float(releases.pieces.middle_s[np.flatnonzero(begins < 0)[0]])
            return Finding(name, Status.NOT_PROVEN, at_s, f"{self.capsule.name}: stays in it")
        step = STEPS
        at_s = releases.pieces.middle_s
        for _ in range(ARM_ROUNDS):
            lower, upper, counts = self._gaps(after, rows, first, step)
            counts &= first + step > begins[rows]
            decided = (lower >= self.thick) & (first >= begins[rows])
            at_s = after.releases.pieces.middle_s[rows] + first / releases.grid_hz
            broken = np.flatnonzero(counts & (first >= begins[rows]) & (upper < self.thick))
            if len(broken) and not self.grips:
                left = f"{self.capsule.name}, left: {upper[broken[0]] - self.thick:.3g} at most"
                return Finding(name, Status.VIOLATED, float(at_s[broken[0]]), left)
            is_open = counts & ~decided
            if not is_open.any():
                return Finding(name, Status.PROVEN)
            rows, first, at_s = rows[is_open], first[is_open], at_s[is_open]
            if step > 1:
                rows, first = np.repeat(rows, step), (first[:, None] + np.arange(step)).ravel()
                step = 1
            else:
                used, where = np.unique(rows, return_inverse=True)
                halved = after.releases.of(after.releases.pieces.chosen(used).halves())
                after = ArmAfter(after.cell, halved)
                rows, first = np.concatenate([where, where + len(used)]), np.tile(first, 2)
                begins = np.tile(begins[used], 2)
        return Finding(name, Status.NOT_PROVEN, float(at_s[0]), self.capsule.name)

    def is_far(self, after: ArmAfter, lasts_s: float) -> bool:
        """Returns whether flights keep clear of the capsule at the first look."""
        count = int(np.ceil(lasts_s * after.releases.grid_hz))
        pieces = np.arange(len(after.releases.pieces.tick))
        rows, first = (x.ravel() for x in np.meshgrid(pieces, np.arange(0, count, STEPS), indexing="ij"))
        lower, _, counts = self._gaps(after, rows, first, STEPS)
        return bool(((lower >= self.thick) | ~counts).all())

    def _gaps(self, after: ArmAfter, rows: Index, first: Index, step: int) -> tuple[Array, Array, Mask]:
        """Returns bounds (m,) [m] on the distance of flights from the axis, and which patches count.

        Args:
            after: the arm after the releases.
            rows: pieces of releases (m,).
            first: parts of ticks after them at which patches begin (m,).
            step: parts of ticks that each lasts.
        """
        releases = after.releases
        flown = FlightPatches(releases, rows, first / releases.grid_hz, (first + step) / releases.grid_hz)
        x, y = flown.ends
        before, later = after.ends(self.capsule, rows, first), after.ends(self.capsule, rows, first + step)
        middle = 0.5 * (x.c0 + y.c0)
        n = toward(middle - _nearest(middle, [0.5 * (a.c0 + b.c0) for a, b in zip(before, later, strict=True)]))
        ticks = after.ticks(rows, first), after.ticks(rows, first + step)
        bending = releases.bending + largest(self.bending, *ticks)
        bend = bending * (step / releases.grid_hz) ** 2 / 8.0 * (1.0 + 1e-12) + AT_REST_M
        least = np.min([dot(n, x - a).lower for a in before] + [dot(n, y - b).lower for b in later], axis=0)
        apart = x.c0 - _nearest(x.c0, [a.c0 for a in before])
        unsure = x.r.sum(axis=0) + np.sum([a.r.sum(axis=0) for a in before], axis=0) + AT_REST_M
        upper = np.sqrt((apart * apart).sum(axis=0)) * (1.0 + 1e-12) + unsure
        flying = x[2].lower > self.place.ends_z
        counts = flown.counts(self.place.ends_z)
        return shortened(least - bend * lengths_up(n), n), np.where(flying, upper, np.inf), counts

    def _clear(self, after: ArmAfter, count: int) -> Mask:
        """Returns where a ball is clear of what gripped it, at the begin of every part of a tick (n, count + 1)."""
        releases = after.releases
        n = len(releases.pieces.tick)
        rows, later = (x.ravel() for x in np.meshgrid(np.arange(n), np.arange(count + 1), indexing="ij"))
        x = releases.at(rows, later / releases.grid_hz)
        ends = after.ends(self.capsule, rows, later)
        direction = toward(x.c0 - _nearest(x.c0, [end.c0 for end in ends]))
        gap = shortened(np.min([dot(direction, x - end).lower for end in ends], axis=0), direction)
        return (gap - self.thick >= CLEAR_M).reshape(n, count + 1)


def _nearest(x: Array, ends: list[Array]) -> Array:
    """Returns the points (3, m) of segments nearest to points (3, m), to rounding."""
    along = ends[1] - ends[0]
    share = ((x - ends[0]) * along).sum(axis=0) / np.maximum((along * along).sum(axis=0), 1e-30)
    return ends[0] + np.clip(share, 0.0, 1.0) * along

"""The flights of the object: one for every instant at which it may leave, as Taylor models over pieces of these."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self, TypeVar

import numpy as np

from planner.cell import Cell
from verifier.arm import ArmPieces
from verifier.elementary import ROUNDING, Array, Mask
from verifier.finding import Finding, Status
from verifier.pieces import Index, Pieces, instant
from verifier.plan_document import SampledMotion
from verifier.taylor import TaylorModel, stacked

ROUNDS = 9  # [-] of halving patches in time; every second one halves their releases too
PATCHES_MAX = 20_000  # [-] that are looked at again at once
STEPS = 4  # [-] of a grid in the first patches of flights: 8 ms, in which a fall bends by 0.1 mm
GRID_S = 0.002  # [s] parts of a tick by which flights are followed beside the arm are no longer
BEYOND = 1e-9  # [-] of a tick, by which a spread is taken longer than it is: rounding


class OutsideMotion(ValueError):
    """The object may leave before the motion begins, or after its end."""


def tick_parts(motion: SampledMotion) -> int:
    """Returns the parts of a tick, a power of two, that are no longer than `GRID_S`: one on an e-Series."""
    parts = 1
    while 1.0 / (motion.rate_hz * parts) > GRID_S * (1.0 + 1e-9):
        parts *= 2
    return parts


def release_pieces(motion: SampledMotion, spread_s: float, finer: int = 1) -> Pieces:
    """Returns the pieces of a motion in which the object may leave: the release alone without a spread.

    Args:
        motion: the motion.
        spread_s: how early or late it may leave [s].
        finer: each piece is within one of so many times `tick_parts` parts of a tick; a power of two.

    Raises:
        OutsideMotion: that is outside the motion.
    """
    index = motion.release
    assert index is not None
    last = len(motion.q) - 1
    if spread_s == 0.0:
        return instant(motion, index)
    ticks = spread_s * motion.rate_hz + BEYOND
    begin, end = index - ticks, index + ticks
    if begin < 0.0 or end > last:
        raise OutsideMotion("the window of the release is not within the motion")
    parts = tick_parts(motion) * finer
    place = np.arange(int(np.floor(begin * parts)), int(np.ceil(end * parts)))
    tick = place // parts
    first = (place % parts) / parts
    return Pieces(motion, tick, np.maximum(begin - tick, first), np.minimum(end - tick, first + 1.0 / parts))


@dataclass(frozen=True, eq=False)
class Releases:
    """n pieces of the instants at which the object may leave, and its flights from there.

    Attributes:
        cell: the cell.
        pieces: the pieces.
        finer: the flights are followed on a grid of so many times `tick_parts` parts of a tick.
    """

    cell: Cell
    pieces: Pieces
    finer: int = 1

    @cached_property
    def states(self) -> tuple[TaylorModel, TaylorModel]:
        """Places and velocities (3, n) of the object as it leaves [m, m/s]."""
        arm = ArmPieces(self.cell, self.pieces)
        factor = self.cell.gripper.release_speed_factor
        v = arm.v_WT
        return arm.p_WT, v if factor == 1.0 else v * factor

    @property
    def parts(self) -> int:
        """Parts of a tick in the grid on which flights are followed."""
        return tick_parts(self.pieces.motion) * self.finer

    @property
    def grid_hz(self) -> float:
        """The same, a second."""
        return self.pieces.motion.rate_hz * self.parts

    @property
    def bending(self) -> float:
        """Bound on the object's acceleration in flight [m/s^2]."""
        return self.cell.surroundings.gravity_m_s2

    @property
    def slowing(self) -> float:
        """Bound on the rate at which an upward speed shrinks [m/s^2]."""
        return self.bending

    def at(self, rows: Index, s: Array) -> TaylorModel:
        """Returns places (3, m) [m] of flights of some pieces (m,), each at a time (m,) [s] after the release."""
        p, v = (x[:, rows] for x in self.states)
        down = 0.5 * self.cell.surroundings.gravity_m_s2 * s * s
        x = p + v * s
        return stacked([x[0], x[1], (x[2] - down).widened(4.0 * ROUNDING * down)])

    def states_at(self, rows: Index, s: Array) -> tuple[TaylorModel, TaylorModel]:
        """Returns places and velocities (3, m) [m, m/s] of flights, as `at`."""
        v = self.states[1][:, rows]
        slower = self.cell.surroundings.gravity_m_s2 * s
        return self.at(rows, s), stacked([v[0], v[1], (v[2] - slower).widened(2.0 * ROUNDING * slower)])

    def falls_to(self, z: float) -> TaylorModel:
        """Returns when (n,) the centre falls through a height [m], after the release [s]; NaN where it may not."""
        p, v = self.states
        gravity = self.cell.surroundings.gravity_m_s2
        root = (v[2].square() + (p[2] - z) * (2.0 * gravity)).square_root()
        # The exact 2 g, and 1 / g to rounding.
        return ((v[2] + root) * (1.0 / gravity)).widened(4.0 * ROUNDING * (v[2].size + root.size) / gravity)

    def falls_through(self, z: float) -> TaylorModel:
        """Returns where (3, n) [m] the centre falls through a height."""
        p, v = self.states
        return p + v * self.falls_to(z)

    @property
    def bends_down(self) -> bool:
        """Whether flights bend downwards at any time."""
        return True

    def counts(self, patches: FlightPatches, ends_z: float) -> Mask:
        """Returns which patches (m,) of these flights count, see `FlightPatches.counts`."""
        return (patches.highest >= ends_z) | ~patches.falls

    def of(self, pieces: Pieces) -> Releases:
        """Returns other pieces of the same."""
        return Releases(self.cell, pieces, self.finer)

    def halves(self) -> Releases:
        """Returns both halves of every piece."""
        return self.of(self.pieces.halves())


@dataclass(frozen=True, eq=False)
class FlightPatches:
    """m patches of flights: some releases, from one time to another.

    Attributes:
        releases: the releases.
        rows: piece of each patch (m,).
        s0, s1: times after the release [s] (m,).
    """

    releases: Releases
    rows: Index
    s0: Array
    s1: Array

    @cached_property
    def ends(self) -> tuple[TaylorModel, TaylorModel]:
        """Places (3, m) [m] at both times."""
        return self.releases.at(self.rows, self.s0), self.releases.at(self.rows, self.s1)

    @property
    def times(self) -> tuple[TaylorModel, TaylorModel]:
        """The same in the motion (m,) [s]."""
        released = self.releases.pieces.times[self.rows]
        return released + self.s0, released + self.s1

    @cached_property
    def bend(self) -> Array:
        """How far (m,) a flight is from its chord between the two times, at most [m]: a h^2 / 8."""
        h = self.s1 - self.s0
        return self.releases.bending * h * h / 8.0 * (1.0 + 8.0 * ROUNDING)

    @property
    def lowest(self) -> Array:
        """Bounds (m,) on the height of the centre from below [m]: a flight that bends downwards is above its chord."""
        first, last = self.ends
        return np.minimum(first[2].lower, last[2].lower) - (0.0 if self.releases.bends_down else self.bend)

    @property
    def highest(self) -> Array:
        """Bounds (m,) on the height of the centre from above [m]."""
        first, last = self.ends
        return np.maximum(first[2].upper, last[2].upper) + self.bend

    @property
    def middle_s(self) -> Array:
        """Times (m,) in the motion of the middles [s]."""
        return self.releases.pieces.middle_s[self.rows] + 0.5 * (self.s0 + self.s1)

    @property
    def falls(self) -> Mask:
        """Whether the flights fall all along (m,): upward speeds shrink by gravity at least, air only helps."""
        return self._rise.upper < self.releases.cell.surroundings.gravity_m_s2 * self.s0 * (1.0 - 1e-12)

    @property
    def rises(self) -> Mask:
        """Whether the flights rise all along (m,): upward speeds shrink by no more than gravity and air can take."""
        return self._rise.lower > self.releases.slowing * self.s1 * (1.0 + 1e-12)

    def counts(self, ends_z: float) -> Mask:
        """Returns which patches (m,) count: where the centre may be above a height [m], or has not fallen yet."""
        return self.releases.counts(self, ends_z)

    @property
    def _rise(self) -> TaylorModel:
        return self.releases.states[1][2, self.rows]

    def chosen(self, which: Mask) -> FlightPatches:
        """Returns some of the patches."""
        return FlightPatches(self.releases, self.rows[which], self.s0[which], self.s1[which])

    def halves(self, of_releases: bool) -> FlightPatches:
        """Returns both halves of every patch in time, and of its releases too."""
        middle = 0.5 * (self.s0 + self.s1)
        rows = np.tile(self.rows, 2)
        s0, s1 = np.concatenate([self.s0, middle]), np.concatenate([middle, self.s1])
        if not of_releases:
            return FlightPatches(self.releases, rows, s0, s1)
        used, where = np.unique(rows, return_inverse=True)
        halved = self.releases.of(self.releases.pieces.chosen(used).halves())
        rows = np.concatenate([where, where + len(used)])
        return FlightPatches(halved, rows, np.tile(s0, 2), np.tile(s1, 2))


def first_patches(releases: Releases, until_s: float) -> FlightPatches:
    """Returns patches of all releases from each until a time after it [s]."""
    step = STEPS / releases.grid_hz
    times = np.float64(step) * np.arange(int(np.ceil(until_s / step)) + 1, dtype=np.float64)
    count = len(releases.pieces.tick)
    rows = np.repeat(np.arange(count), len(times) - 1)
    return FlightPatches(releases, rows, np.tile(times[:-1], count), np.tile(times[1:], count))


class DivisiblePatches(Protocol):
    """m patches of flights, of one object or of two."""

    @property
    def middle_s(self) -> Array:
        """Times (m,) in the motion of the middles [s]."""
        ...

    def chosen(self, which: Mask) -> Self:
        """Returns some of the patches."""
        ...

    def halves(self, of_releases: bool) -> Self:
        """Returns both halves of every patch in time, and of its releases too."""
        ...


PatchRooms = Callable[[FlightPatches], tuple[Array, Array]]  # bounds on what is left of k limits in m patches (k, m)


P = TypeVar("P", bound=DivisiblePatches)


def prove_patches(name: str, patches: P, rooms: Callable[[P], tuple[Array, Array]], items: list[str]) -> Finding:
    """Returns whether nothing of k limits is exceeded in patches of flights; as `verifier.finding.prove`."""
    for turn in range(ROUNDS + 1):
        lower, upper = rooms(patches)
        broken = np.argwhere(upper < 0.0)
        if len(broken):
            item, patch = min(broken.tolist(), key=lambda at: upper[at[0], at[1]])
            left = f"{items[item]}, left: {upper[item, patch]:.3g} at most"
            return Finding(name, Status.VIOLATED, float(patches.middle_s[patch]), left)
        is_open = ~(lower >= 0.0)
        again = np.asarray(is_open.any(axis=0))
        if not again.any():
            break
        if turn == ROUNDS or again.sum() > PATCHES_MAX:
            item, patch = np.argwhere(is_open)[0]
            left = f"{items[item]}, left: {lower[item, patch]:.3g} to {upper[item, patch]:.3g}"
            return Finding(name, Status.NOT_PROVEN, float(patches.middle_s[patch]), left)
        patches = patches.chosen(again).halves(turn % 2 == 1)
    return Finding(name, Status.PROVEN)

"""Flights with drag: x'' = F(x') with F(w) = -k |w| w - g, in steps of Taylor's series with proven remainders.

F' is symmetric, with eigenvalues -k |w| and -2 k |w|, and |F''| <= 2 k. So the third derivative of x is at most
2 k |w| |a|, and the fourth at most 2 k |w| (2 k |w| |a|) + 2 k |a|^2: the remainders of a step of h are that times
h^3 / 6 in velocity and h^4 / 24 in place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.cell import Cell
from verifier.elementary import ROUNDING, Array
from verifier.flights import Releases
from verifier.pieces import Index, Pieces
from verifier.taylor import TaylorModel, dot, stacked

AIR_KG_M3 = 1.204  # source: ISO 2533, dry air at 20 degC and 101,325 Pa
STEP_S = 0.008  # [s] of a step: its remainder is below 1e-6 m/s for balls of sports
FLIGHT_MAX_S = 10.0  # [s] no throw of an arm flies for longer


def drag_of(cell: Cell) -> float:
    """Returns k of the deceleration k |w|^2 of a cell's object [1/m], to rounding."""
    thing = cell.object
    return AIR_KG_M3 * thing.drag_coefficient * math.pi * thing.drag_radius_m**2 / (2.0 * thing.mass_kg)


@dataclass(frozen=True, eq=False)
class DragReleases(Releases):
    """Releases of an object that air slows down."""

    @cached_property
    def drag(self) -> float:
        """k of the deceleration [1/m]."""
        return drag_of(self.cell)

    @cached_property
    def fastest(self) -> float:
        """Bound on the object's speed while it flies [m/s]: air only slows it down, gravity adds no more than g s."""
        _, v = self.states
        fall = self.cell.surroundings.gravity_m_s2 * FLIGHT_MAX_S
        start = float(np.sqrt(dot(v, v).upper.max()))
        # Falling, it is no faster than the larger of the speed at which drag outweighs gravity and that at its begin.
        terminal = math.sqrt(self.cell.surroundings.gravity_m_s2 / self.drag)
        return min(start + fall, math.hypot(start, terminal)) * (1.0 + 1e-12)

    @property
    def bending(self) -> float:
        """Bound on the object's acceleration in flight [m/s^2]."""
        return (self.cell.surroundings.gravity_m_s2 + self.drag * self.fastest**2) * (1.0 + 1e-12)

    @property
    def bends_down(self) -> bool:
        """Whether gravity outweighs drag at any time."""
        return self.drag * self.fastest**2 < self.cell.surroundings.gravity_m_s2

    def of(self, pieces: Pieces) -> Releases:
        """Returns other pieces of the same."""
        return DragReleases(self.cell, pieces, self.finer)

    def at(self, rows: Index, s: Array) -> TaylorModel:
        """Returns places (3, m) [m] of flights of some pieces (m,), each at a time (m,) [s] after the release."""
        return self.states_at(rows, s)[0]

    def states_at(self, rows: Index, s: Array) -> tuple[TaylorModel, TaylorModel]:
        """Returns places and velocities (3, m) [m, m/s] of flights, as `at`."""
        node = np.floor(s / STEP_S).astype(np.intp)
        nodes = self._nodes(int(node.max(initial=0)))
        x, w = (each[:, node, rows] for each in nodes)
        return self._step(x, w, s - node * STEP_S)

    @cached_property
    def _kept(self) -> list[tuple[TaylorModel, TaylorModel]]:
        """Places and velocities (3, n) a step apart, from the release on, as many as were asked for."""
        return [self.states]

    def _nodes(self, count: int) -> tuple[TaylorModel, TaylorModel]:
        """Returns places and velocities (3, k, n) a step apart: `count` of them after the release, or more."""
        while len(self._kept) <= count:
            x, w = self._kept[-1]
            self._kept.append(self._step(x, w, np.full(len(self.pieces.tick), STEP_S)))
        places, velocities = zip(*self._kept, strict=True)
        return _second(stacked(places)), _second(stacked(velocities))

    def _step(self, x: TaylorModel, w: TaylorModel, h: Array) -> tuple[TaylorModel, TaylorModel]:
        """Returns place and velocity (3, m) a time (m,) [s] later, no more than a step."""
        up = np.array([0.0, 0.0, self.cell.surroundings.gravity_m_s2])[:, None]
        k = self.drag
        # k is rounded, and in the bounds on every product with it: that is a few units of the last place.
        speed = dot(w, w).square_root()
        a = -(w * (speed * k)) - up
        change = -(a * speed + w * (dot(w, a) * speed.reciprocal())) * k
        fastest = np.sqrt(dot(w, w).upper) * (1.0 + 1e-12) + self.bending * STEP_S
        size = self.cell.surroundings.gravity_m_s2 + k * fastest * fastest
        fourth = (4.0 * k * k * fastest * fastest * size + 2.0 * k * size * size) * (1.0 + 1e-12)
        velocity = w + a * h + change * (0.5 * h * h)
        place = x + w * h + a * (0.5 * h * h) + change * (h * h * h / 6.0)
        rounded = 16.0 * ROUNDING * (h * w.size.max(axis=0) + h * h * size)
        return (
            place.widened(fourth * h**4 / 24.0 + rounded),
            velocity.widened(fourth * h**3 / 6.0 + 16.0 * ROUNDING * h * size),
        )

    def falls_to(self, z: float) -> TaylorModel:
        """Returns when (n,) the centre falls through a height [m], after the release [s]; NaN where it may not."""
        return self._falls(z)[0]

    def falls_through(self, z: float) -> TaylorModel:
        """Returns where (3, n) [m] the centre falls through a height."""
        return self._falls(z)[1]

    def _falls(self, z: float) -> tuple[TaylorModel, TaylorModel]:
        """Returns time and place: about a guess, z = A + V d + a d^2 / 2 with |a| bounded gives the time d from it.

        With |d| <= D the root is within a D^2 / (2 |V|) of -A / V; D is proven where that is no larger than D.
        """
        rows = np.arange(len(self.pieces.tick))
        guess = self._guess(z)
        x, w = self.states_at(rows, np.nan_to_num(guess))
        missed = x[2] - z
        first = -(missed * w[2].reciprocal())
        slowest = -w[2].upper
        size = first.size
        most = 1.5 * size + 1e-12
        fastest = np.sqrt(dot(w, w).upper) + self.bending * most
        bending = (self.cell.surroundings.gravity_m_s2 + self.drag * fastest * fastest) * (1.0 + 1e-12)
        beyond = 0.5 * bending * most * most / np.maximum(slowest, 1e-300) * (1.0 + 1e-12)
        proven = (size + beyond <= most) & (slowest > bending * most) & np.isfinite(guess)
        nan = np.where(proven, 0.0, np.nan)
        later = first.widened(beyond + nan)
        place = (x + w * later).widened(0.5 * bending * most * most * (1.0 + 1e-12) + nan)
        return (later + np.nan_to_num(guess)).widened(nan), place

    def _guess(self, z: float) -> Array:
        """Returns when (n,) the middles of the pieces fall through a height, to rounding; NaN where they do not."""
        n = len(self.pieces.tick)
        found = np.full(n, np.nan)
        count = 32
        while np.isnan(found).any() and count * STEP_S <= FLIGHT_MAX_S:
            x, w = self._nodes(count)
            heights, speeds = x.c0[2], w.c0[2]
            for i in np.flatnonzero(np.isnan(found)):
                passed = np.flatnonzero((heights[:-1, i] >= z) & (heights[1:, i] < z))
                if len(passed):
                    j = passed[-1]
                    drop = heights[j, i] - z
                    g = (speeds[j, i] - speeds[j + 1, i]) / STEP_S
                    v = speeds[j, i]
                    found[i] = j * STEP_S + (v + math.sqrt(max(v * v + 2.0 * g * drop, 0.0))) / g
            count *= 2
        return found


def _second(x: TaylorModel) -> TaylorModel:
    """Returns a model (k, 3, n) as (3, k, n)."""
    return TaylorModel(*(getattr(x, name).swapaxes(0, 1) for name in TaylorModel.__slots__))


def releases_of(cell: Cell, pieces: Pieces, finer: int = 1) -> Releases:
    """Returns the releases of a cell's object: with drag where it has any."""
    kind = DragReleases if drag_of(cell) > 0.0 else Releases
    return kind(cell, pieces, finer)

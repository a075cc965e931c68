"""How a body turns in flight, free of torque, as Taylor models over pieces of its release.

A body that is round about an axis u, with the moments I about it and J across, turns about its angular momentum at the
constant rate P = w + (I / J - 1) (w . u) u, and in itself about u at the rate (1 - I / J) (w . u). Source: Goldstein,
Classical Mechanics (2002), sections 5.6 and 5.7. The rotation by a vector x is the quaternion of cos |x|/2 and of
(x / |x|) sin |x|/2: series in |x|^2 of a small part of x, then doubled by (a, v) -> (2 a^2 - 1, 2 a v), which nowhere
divides by |x|.

Any other body obeys Euler's equations w' = B(w, w), in its own axes, and q' = q w / 2 for the quaternion q of its turn
since the release. These are followed in steps of Taylor's series, whose coefficients the equations give one by one. As
|B(a, b)| <= c |a| |b|, the n-th one of w is no larger than c^n W^(n + 1) at any time, with W the fastest that the
conserved energy and angular momentum let the body turn; that of q is bounded likewise: this bounds what a step leaves
out.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from planner.cell import Cell, ThrownBody
from verifier.arm import ArmPieces
from verifier.elementary import ROUNDING, Array
from verifier.pieces import Index, Pieces
from verifier.taylor import TaylorModel, constant, cross, dot, stacked, total, turned

SMALL_RAD = 0.25  # [rad] half of the rotations that are summed: seven terms of the series leave out 1e-18
TERMS = 7
SERIES = 4.0 * ROUNDING  # [-] by which the sums are off: terms left out, and rounding of the terms' factors
UP = 1.0 + 1e-12
ORDER = 7  # [-] of the series of a step
STEP_S = 0.016  # [s] of a step: it leaves out less than 1e-6 rad/s at 10 rad/s
NEXT, LAST = [1, 2, 0], [2, 0, 1]
HALF_ROOT = 0.70711  # [-] |a_j b_k + a_k b_j| / 2 in all three is no more than that of |a| |b|: Cauchy-Schwarz


class Spin:
    """The rotation of a body after releases in n pieces.

    Attributes:
        thing: the body.
    """

    def __init__(self, cell: Cell, pieces: Pieces) -> None:
        """Takes the cell, whose object is the body, and the pieces."""
        thing = cell.object
        assert isinstance(thing, ThrownBody)
        arm = ArmPieces(cell, pieces)
        self.thing = thing
        self._own = [turned(arm.R_WT, thing.R_TO[:, k]) for k in range(3)]
        self._w = arm.turning[6][0]

    @property
    def turn_rate(self) -> Array:
        """Bounds (n,) on the angular velocity at any time [rad/s]."""
        raise NotImplementedError

    @property
    def bending(self) -> Array:
        """Bounds (n,) on the second derivative of any direction that turns with it [rad/s^2]."""
        raise NotImplementedError

    def axes(self, rows: Index, s: Array, which: tuple[int, ...]) -> list[TaylorModel]:
        """Returns some of its own axes, each (3, m), of releases in pieces (m,) at times (m,) [s] after them."""
        raise NotImplementedError


class RoundSpin(Spin):
    """The same of a round body."""

    def __init__(self, cell: Cell, pieces: Pieces) -> None:
        """Takes the cell, whose object is the body, and the pieces."""
        super().__init__(cell, pieces)
        axis = round_axis(self.thing)
        assert axis is not None
        moments = self.thing.inertia_kg_m2
        self.axis = axis
        self._ratio = float(moments[axis] / moments[axis - 1])
        self._along = dot(self._w, self._own[axis])
        self._rate = self._w + self._own[axis] * (self._along * (self._ratio - 1.0))

    @cached_property
    def _precession(self) -> Array:
        """Bounds (n,) on the rate at which its axis turns [rad/s]."""
        return np.sqrt(dot(self._rate, self._rate).upper) * UP

    @property
    def turn_rate(self) -> Array:
        """Bounds (n,) on the angular velocity at any time, whose size stays [rad/s]."""
        return np.sqrt(dot(self._w, self._w).upper) * UP

    @property
    def bending(self) -> Array:
        """Bounds (n,) on the second derivative of any direction that turns with it [rad/s^2]."""
        return (self.turn_rate**2 + self._precession * self.turn_rate) * UP

    def axes(self, rows: Index, s: Array, which: tuple[int, ...]) -> list[TaylorModel]:
        """Returns some of its own axes, each (3, m), of releases in pieces (m,) at times (m,) [s] after them."""
        a, v = half_turn(self._rate[:, rows] * (0.5 * s))
        found = []
        for k in which:
            u = self._own[k][:, rows]
            if k != self.axis:
                # About its own axis k goes towards the next of the three, if it is the first after the axis.
                sine, cosine = (self._along[rows] * ((1.0 - self._ratio) * s)).sine_cosine()
                after = (self.axis + 1) % 3 == k
                other = self._own[(self.axis + 2) % 3 if after else (self.axis + 1) % 3][:, rows]
                u = u * cosine + other * (sine if after else -sine)
            t = cross(v, u) * 2.0
            found.append(u + t * a + cross(v, t))
        return found


class FreeSpin(Spin):
    """The same of any body."""

    def __init__(self, cell: Cell, pieces: Pieces) -> None:
        """Takes the cell, whose object is the body, and the pieces."""
        super().__init__(cell, pieces)
        moments = self.thing.inertia_kg_m2
        own = stacked([dot(self._w, u) for u in self._own])
        # Rounded, and so is every product with it, of which a model allows for more.
        self._couples = (moments[NEXT] - moments[LAST]) / moments
        self._growth = float(np.abs(self._couples).max()) * HALF_ROOT
        squares = own * own
        energy, momentum = (total(squares * m[:, None]).upper for m in (moments, moments * moments))
        least = float(moments.min())
        self._fastest = np.sqrt(np.minimum(energy / least, momentum / least**2)) * UP
        unturned = constant(np.array([[1.0], [0.0], [0.0], [0.0]]), own[0])
        self._kept = [(unturned, own)]

    @property
    def turn_rate(self) -> Array:
        """Bounds (n,) on the angular velocity at any time [rad/s]."""
        return self._fastest

    @property
    def bending(self) -> Array:
        """Bounds (n,) on the second derivative of any direction that turns with it [rad/s^2]."""
        return self._fastest**2 * (1.0 + self._growth) * UP

    def axes(self, rows: Index, s: Array, which: tuple[int, ...]) -> list[TaylorModel]:
        """Returns some of its own axes, each (3, m), of releases in pieces (m,) at times (m,) [s] after them."""
        node = np.floor(s / STEP_S).astype(np.intp)
        while len(self._kept) <= int(node.max(initial=0)):
            every = np.arange(len(self._fastest))
            self._kept.append(self._step(*self._kept[-1], every, np.full(len(every), STEP_S)))
        q, w = (stacked([kept[i] for kept in self._kept])[node, :, rows] for i in (0, 1))
        q, w = (TaylorModel(*(getattr(x, name).T for name in TaylorModel.__slots__)) for x in (q, w))
        q, _ = self._step(q, w, rows, s - node * STEP_S)
        found = []
        for k in which:
            u = stacked(_columns(q)[k])
            found.append(sum((self._own[i][:, rows] * u[i] for i in (1, 2)), self._own[0][:, rows] * u[0]))
        return found

    @np.errstate(over="ignore", invalid="ignore")  # what overflows is no bound, and proves nothing
    def _step(self, q: TaylorModel, w: TaylorModel, rows: Index, h: Array) -> tuple[TaylorModel, TaylorModel]:
        """Returns turn (4, m) and angular velocity (3, m) of pieces (m,) a time (m,) [s] later, no more than a step."""
        rates = [w]
        turns = [stacked([w[0] * 0.0, *(w * 0.5)])]  # from the second on: the first is no turn
        for n in range(1, ORDER):
            rates.append(self._next_rate(rates) * (1.0 / n))
            found = turns[0][1:] * 0.0
            scalar = found[0]
            for i in range(1, n + 1):
                a, u = turns[i - 1][0], turns[i - 1][1:]
                scalar = scalar - dot(u, rates[n - i])
                found = found + rates[n - i] * a + cross(u, rates[n - i])
            found = found + rates[n]
            turns.append(stacked([scalar, *found]) * (0.5 / (n + 1)))
        fastest = self._fastest[rows] * h
        left = self._growth**ORDER * fastest**ORDER * self._fastest[rows] * UP
        later = _sum(rates, h).widened(left)
        turn = _sum(turns, h) * h
        bound = _turn_bounds(self._growth)
        turn = turn.widened(bound[ORDER + 1] * fastest ** (ORDER + 1) * UP)
        a, u = turn[0] + 1.0, turn[1:]
        b, v = q[0], q[1:]
        vector = u * b + v * a + cross(v, u)
        return stacked([a * b - dot(v, u), *vector]), later

    def _next_rate(self, rates: list[TaylorModel]) -> TaylorModel:
        """Returns the sum of B over pairs of coefficients whose orders add up to the last one's."""
        n = len(rates) - 1
        found = [a[NEXT] * b[LAST] for a, b in zip(rates, rates[::-1], strict=True)]
        return sum(found[1 : n + 1], found[0]) * self._couples[:, None]


def _sum(terms: list[TaylorModel], h: Array) -> TaylorModel:
    """Returns the sum of coefficients times powers of h (m,), lowest first."""
    value = terms[-1]
    for term in terms[-2::-1]:
        value = value * h + term
    return value


def _turn_bounds(growth: float) -> list[float]:
    """Returns bounds on the coefficients of a quaternion, for a body that turns no faster than 1 rad/s."""
    found = [1.0]
    for n in range(ORDER + 1):
        found.append(sum(found[i] * growth ** (n - i) for i in range(n + 1)) / (2.0 * (n + 1)))
    return found


def _columns(q: TaylorModel) -> list[list[TaylorModel]]:
    """Returns the columns of the matrix of a unit quaternion (4, m)."""
    a, x, y, z = q[0], q[1], q[2], q[3]
    return [
        [1.0 - (y * y + z * z) * 2.0, (x * y + a * z) * 2.0, (x * z - a * y) * 2.0],
        [(x * y - a * z) * 2.0, 1.0 - (x * x + z * z) * 2.0, (y * z + a * x) * 2.0],
        [(x * z + a * y) * 2.0, (y * z - a * x) * 2.0, 1.0 - (x * x + y * y) * 2.0],
    ]


def spin_of(cell: Cell, pieces: Pieces) -> Spin:
    """Returns the rotation of a cell's body after releases in pieces."""
    assert isinstance(cell.object, ThrownBody)
    return (FreeSpin if round_axis(cell.object) is None else RoundSpin)(cell, pieces)


def round_axis(thing: ThrownBody) -> int | None:
    """Returns the axis about which a body turns as a round one: that across which its moments are equal; or None."""
    moments = thing.inertia_kg_m2
    return next((k for k in (2, 0, 1) if moments[k - 1] == moments[k - 2]), None)


def half_turn(x: TaylorModel) -> tuple[TaylorModel, TaylorModel]:
    """Returns the quaternion of rotations by 2 x, half rotation vectors (3, m) [rad]: scalar (m,) and vector (3, m)."""
    largest = float(np.sqrt(max(float(np.nanmax(dot(x, x).upper, initial=0.0)), 0.0)))
    doublings = max(0, math.ceil(math.log2(max(largest, 1e-300) / SMALL_RAD)))
    x = x * 0.5**doublings
    y = dot(x, x)
    a = _series(y, 0).widened(SERIES)
    v = x * _series(y, 1).widened(SERIES)
    for _ in range(doublings):
        v = v * a * 2.0
        a = a * a * 2.0 - 1.0
    return a, v


def _series(y: TaylorModel, first: int) -> TaylorModel:
    """Returns cos sqrt(y), or with `first` 1 sin sqrt(y) / sqrt(y): the sum of (-y)^n / (2 n + first)!."""
    terms = [(-1.0) ** n / math.factorial(2 * n + first) for n in range(TERMS)]
    value = y * terms[-1] + terms[-2]
    for term in terms[-3::-1]:
        value = value * y + term
    return value

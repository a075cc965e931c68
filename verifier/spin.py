"""How a body turns in flight, free of torque, as Taylor models over pieces of its release.

A body that is round about an axis u, with the moments I about it and J across, turns about its angular momentum at the
constant rate P = w + (I / J - 1) (w . u) u, and in itself about u at the rate (1 - I / J) (w . u). Source: Goldstein,
Classical Mechanics (2002), sections 5.6 and 5.7. The rotation by a vector x is the quaternion of cos |x|/2 and of
(x / |x|) sin |x|/2: series in |x|^2 of a small part of x, then doubled by (a, v) -> (2 a^2 - 1, 2 a v), which nowhere
divides by |x|.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from planner.cell import Cell, ThrownBody
from verifier.arm import ArmPieces
from verifier.elementary import ROUNDING, Array
from verifier.pieces import Index, Pieces
from verifier.plan_document import round_axis
from verifier.taylor import TaylorModel, cross, dot, turned

SMALL_RAD = 0.25  # [rad] half of the rotations that are summed: seven terms of the series leave out 1e-18
TERMS = 7
SERIES = 4.0 * ROUNDING  # [-] by which the sums are off: terms left out, and rounding of the terms' factors
UP = 1.0 + 1e-12


class RoundSpin:
    """The rotation of a round body after releases in n pieces."""

    def __init__(self, cell: Cell, pieces: Pieces) -> None:
        """Takes the cell, whose object is the body, and the pieces."""
        thing = cell.object
        assert isinstance(thing, ThrownBody)
        axis = round_axis(thing)
        assert axis is not None
        arm = ArmPieces(cell, pieces)
        self.thing = thing
        self.axis = axis
        self._ratio = float(thing.inertia_kg_m2[axis] / thing.inertia_kg_m2[axis - 1])
        self._own = [turned(arm.R_WT, thing.R_TO[:, k]) for k in range(3)]
        self._w = arm.turning[6][0]
        self._along = dot(self._w, self._own[axis])
        self._rate = self._w + self._own[axis] * (self._along * (self._ratio - 1.0))

    @cached_property
    def axis_rate(self) -> Array:
        """Bounds (n,) on the rate at which its axis turns [rad/s]."""
        return np.sqrt(dot(self._rate, self._rate).upper) * UP

    @cached_property
    def turn_rate(self) -> Array:
        """Bounds (n,) on its angular velocity, whose size stays [rad/s]."""
        return np.sqrt(dot(self._w, self._w).upper) * UP

    @property
    def bending(self) -> Array:
        """Bounds (n,) on the second derivative of any direction that turns with it [rad/s^2]."""
        return (self.turn_rate**2 + self.axis_rate * self.turn_rate) * UP

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

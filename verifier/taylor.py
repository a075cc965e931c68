"""Taylor models: functions of one variable s in [-1, 1], each a parabola and a bound on what it deviates from that.

f(s) is within r of c0 + c1 s + c2 s^2 for every s. What an operation leaves out (higher powers, and the rounding of
its floating point numbers) goes into r, which is always rounded up. Source: Makino and Berz, Taylor models and other
validated functional inclusion methods (2003). All arrays have the n pieces of a motion on their last axis.

Rounding: no coefficient below takes more than eight operations on numbers whose sizes add up to no more than the
product (or the sum) of the operands' sizes, so that it is off by less than `COEFFICIENT` of that. Bounds themselves
are sums and products of numbers that are not negative, of fewer than forty operations: `UP` rounds them upwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from verifier.elementary import ROUNDING, SINE_ERROR, Array, sine_cosine

COEFFICIENT = 16.0 * ROUNDING  # [-] see the module
UP = 1.0 + 128.0 * ROUNDING  # [-] likewise
TINY = 1e-290  # [-] added to bounds: what underflows is smaller


class TaylorModel:
    """A parabola c0 + c1 s + c2 s^2 over s in [-1, 1] and the bound r on the deviation from it; arrays (..., n)."""

    __slots__ = ("c0", "c1", "c2", "r")
    __array_ufunc__ = None  # so that an array times a model is the model's affair

    def __init__(self, c0: Array, c1: Array, c2: Array, r: Array) -> None:
        """Takes the coefficients and the bound, all of one shape."""
        self.c0, self.c1, self.c2, self.r = c0, c1, c2, r

    @property
    def size(self) -> Array:
        """Bounds (..., n) on the absolute value."""
        return (np.abs(self.c0) + np.abs(self.c1) + np.abs(self.c2) + self.r) * UP

    def __getitem__(self, key: Any) -> TaylorModel:
        """Returns a part of all arrays."""
        return TaylorModel(self.c0[key], self.c1[key], self.c2[key], self.r[key])

    def __neg__(self) -> TaylorModel:
        """Returns the negative, which is exact."""
        return TaylorModel(-self.c0, -self.c1, -self.c2, self.r)

    def __add__(self, other: TaylorModel | Array | float) -> TaylorModel:
        """Returns the sum with a model, or with numbers that are exact."""
        if not isinstance(other, TaylorModel):
            c0 = self.c0 + other
            r = self.r + COEFFICIENT * np.abs(c0) + TINY
            return TaylorModel(c0, self.c1 + 0.0 * c0, self.c2 + 0.0 * c0, r * UP)
        c0, c1, c2 = self.c0 + other.c0, self.c1 + other.c1, self.c2 + other.c2
        rounded = COEFFICIENT * (np.abs(c0) + np.abs(c1) + np.abs(c2))
        return TaylorModel(c0, c1, c2, (self.r + other.r + rounded + TINY) * UP)

    __radd__ = __add__

    def __sub__(self, other: TaylorModel | Array | float) -> TaylorModel:
        """Returns the difference from a model, or from numbers that are exact."""
        return self + (-other)

    def __rsub__(self, other: Array | float) -> TaylorModel:
        """Returns numbers less the model."""
        return (-self) + other

    def __mul__(self, other: TaylorModel | Array | float) -> TaylorModel:
        """Returns the product with a model, or with numbers that are exact."""
        if not isinstance(other, TaylorModel):
            by = np.abs(other)
            r = (self.r * by + COEFFICIENT * (self.size * by) + TINY) * UP
            return TaylorModel(self.c0 * other, self.c1 * other, self.c2 * other, r)
        a0, a1, a2 = self.c0, self.c1, self.c2
        b0, b1, b2 = other.c0, other.c1, other.c2
        x1, x2 = np.abs(a1), np.abs(a2)
        y1, y2 = np.abs(b1), np.abs(b2)
        x, y = np.abs(a0) + x1 + x2, np.abs(b0) + y1 + y2
        r = x1 * y2 + x2 * (y1 + y2) + x * other.r + self.r * (y + other.r)
        r = (r + COEFFICIENT * ((x + self.r) * (y + other.r)) + TINY) * UP
        return TaylorModel(a0 * b0, a0 * b1 + a1 * b0, a0 * b2 + a1 * b1 + a2 * b0, r)

    __rmul__ = __mul__

    def square(self) -> TaylorModel:
        """Returns the square."""
        return self * self

    def widened(self, by: Array | float) -> TaylorModel:
        """Returns the model with a bound on the deviation that is larger by `by` (..., n)."""
        return TaylorModel(self.c0, self.c1, self.c2, (self.r + by) * UP)

    @property
    def upper(self) -> Array:
        """Upper bounds (..., n): the parabola is highest at an end, or at its vertex."""
        ends = self.c0 + np.abs(self.c1) + self.c2
        with np.errstate(divide="ignore", invalid="ignore"):
            vertex = self.c0 - self.c1 * self.c1 / (4.0 * self.c2)
        inside = (self.c2 < 0.0) & (np.abs(self.c1) < -2.0 * self.c2)
        # The comparison is exact, so that the vertex counts where it is inside, and only there.
        return np.where(inside, vertex, ends) + (self.r + COEFFICIENT * self.size + TINY) * UP

    @property
    def lower(self) -> Array:
        """Lower bounds (..., n)."""
        return -(-self).upper

    def sine_cosine(self) -> tuple[TaylorModel, TaylorModel]:
        """Returns sine and cosine: their Taylor series about c0, whose third derivatives are at most 1."""
        s, c = sine_cosine(self.c0)
        a1, a2 = np.abs(self.c1), np.abs(self.c2)
        off = a1 + a2 + self.r
        second = 0.5 * (2.0 * a1 * a2 + a2 * a2 + self.r * (2.0 * (a1 + a2) + self.r))
        beyond = off * off * off / 6.0 + self.r + second
        r = (beyond + (SINE_ERROR + COEFFICIENT) * (1.0 + off + off * off) + TINY) * UP
        half = 0.5 * self.c1 * self.c1
        sine = TaylorModel(s, c * self.c1, c * self.c2 - s * half, r)
        return sine, TaylorModel(c, -s * self.c1, -s * self.c2 - c * half, r)

    def reciprocal(self) -> TaylorModel:
        """Returns 1 / f; NaN where f may be 0: the geometric series 1/c0 (1 - e + e^2 - ...), e = f/c0 - 1."""
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / self.c0
            e = self * inverse - 1.0
            off = np.where(e.size < 1.0, e.size, np.nan)
            beyond = off * off * off / (1.0 - off) * (1.0 + 8.0 * ROUNDING)
        # `inverse` is rounded, and e is about the exact quotient by it: 1 / f = inverse / (1 + e) is exact.
        return (1.0 - e + e * e).widened(beyond) * inverse

    def square_root(self) -> TaylorModel:
        """Returns the square root; NaN where f may not be positive: w (1 + e/2 - e^2/8 + ...), e = f/w^2 - 1.

        The third derivative of the root of 1 + e is at most 3/8 (1 - |e|)^(-5/2).
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(self.c0)
            e = self * (TaylorModel(*_constant(root)).square().reciprocal()) - 1.0
            off = np.where(e.size < 1.0, e.size, np.nan)
            left = (1.0 - off) * (1.0 - 8.0 * ROUNDING)
            beyond = off * off * off / (16.0 * left * left * left) * (1.0 + 16.0 * ROUNDING)
        return (1.0 + e * 0.5 - e * e * 0.125).widened(beyond) * root


def _constant(x: Array) -> tuple[Array, Array, Array, Array]:
    zero = np.zeros_like(x)
    return x, zero, zero, zero


def constant(x: Array | float, like: TaylorModel) -> TaylorModel:
    """Returns exact numbers (..., 1) or (..., n) as a model of as many pieces as another has."""
    shape = np.broadcast_shapes(np.shape(x), like.c0.shape[-1:])
    return TaylorModel(*_constant(np.broadcast_to(np.asarray(x, np.float64), shape)))


def stacked(models: Sequence[TaylorModel]) -> TaylorModel:
    """Returns models of one shape as the rows of one."""
    return TaylorModel(*(np.stack([getattr(m, name) for m in models]) for name in TaylorModel.__slots__))


def total(models: TaylorModel) -> TaylorModel:
    """Returns the sum of the rows of a model (k, ..., n)."""
    found = models[0]
    for i in range(1, len(models.c0)):
        found = found + models[i]
    return found


def dot(a: TaylorModel | Array, b: TaylorModel) -> TaylorModel:
    """Returns the scalar products (..., n) of vectors (3, ..., n); the first may be numbers that are exact."""
    return total(b * a)


def cross(a: TaylorModel, b: TaylorModel) -> TaylorModel:
    """Returns the vector products (3, ..., n) of vectors (3, ..., n)."""
    next_, last = [1, 2, 0], [2, 0, 1]
    return a[next_] * b[last] - a[last] * b[next_]


def turned(R: TaylorModel, x: TaylorModel | Array) -> TaylorModel:
    """Returns the vectors R x (3, n) of matrices (3, 3, n) and vectors (3, n), or of one (3,) that is exact."""
    by = x if isinstance(x, TaylorModel) else np.asarray(x, np.float64).reshape(3, 1)
    return R[:, 0] * by[0] + R[:, 1] * by[1] + R[:, 2] * by[2]


def turned_back(R: TaylorModel, x: TaylorModel) -> TaylorModel:
    """Returns the vectors R^T x (3, n)."""
    return R[0] * x[0] + R[1] * x[1] + R[2] * x[2]

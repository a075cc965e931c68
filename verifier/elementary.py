"""Sine and cosine of numbers with a proven error, from additions and multiplications alone.

IEEE 754 states the rounding of + - * / and of the square root, and of nothing else: how far a library's sine is off
depends on its version and on the processor. So the angle is reduced by the nearest multiple of pi/2, and a Taylor
polynomial evaluated.

Reduction: pi/2 = HIGH + LOW + rest, where HIGH has 33 bits, so that k HIGH is exact for |k| < 2^20, and x - k HIGH is
exact too (Sterbenz) or rounded once at a size below 2. With LOW to 53 bits, what is left of pi/2 is below 1e-26. The
reduced angle is off by at most 3 u. Polynomials: up to |r| <= pi/4 + 1e-15 the first terms left out are below
(0.79)^19/19! < 1e-19 and (0.79)^18/18! < 3e-18; Horner's rule adds less than 6 u to values of at most 1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]

ROUNDING = 2.0**-53  # [-] u: the relative error of one operation, IEEE 754
LARGEST_RAD = 1e5  # [rad] of an angle: the reduction is exact far beyond it
SINE_ERROR = 16.0 * ROUNDING  # [-] see the module: 3 u + 6 u + 1e-17, and as much again
HIGH = 1.57079632673412561417e00  # first 33 bits of pi/2. source: FreeBSD msun, e_rem_pio2.c, pio2_1
LOW = 6.07710050650619224932e-11  # pi/2 - HIGH, to 53 bits. source: the same, pio2_1t
SINE = tuple(1.0 / f for f in (1.0, -6.0, 120.0, -5040.0, 362880.0, -39916800.0, 6227020800.0, -1307674368000.0))
SINE_TERMS = (*SINE, 1.0 / 355687428096000.0)
COSINE = tuple(1.0 / f for f in (1.0, -2.0, 24.0, -720.0, 40320.0, -3628800.0, 479001600.0, -87178291200.0))
COSINE_TERMS = (*COSINE, 1.0 / 20922789888000.0)


def sine_cosine(x: Array) -> tuple[Array, Array]:
    """Returns sines and cosines (...), off by at most `SINE_ERROR`, of angles (...) [rad]; NaN beyond `LARGEST_RAD`."""
    x = np.where(np.abs(x) <= LARGEST_RAD, x, np.nan)
    k = np.rint(x * (2.0 / np.pi))
    r = (x - k * HIGH) - k * LOW
    square = r * r
    s = r * _horner(SINE_TERMS, square)
    c = _horner(COSINE_TERMS, square)
    quarter = np.mod(k, 4.0)
    swapped = (quarter == 1.0) | (quarter == 3.0)
    sine = np.where(swapped, c, s) * np.where(quarter >= 2.0, -1.0, 1.0)
    cosine = np.where(swapped, s, c) * np.where((quarter == 1.0) | (quarter == 2.0), -1.0, 1.0)
    return sine, cosine


def _horner(terms: tuple[float, ...], x: Array) -> Array:
    value = np.full_like(x, terms[-1])
    for term in reversed(terms[:-1]):
        value = value * x + term
    return value

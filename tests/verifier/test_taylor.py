"""Taylor models hold what they enclose: against exact fractions, and sines against decimals of fifty digits."""

from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np
import pytest

from verifier.elementary import SINE_ERROR, sine_cosine
from verifier.taylor import TaylorModel

COUNT = 12
SHARES = [Fraction(k, 7) for k in (-7, -3, 0, 2, 7)]  # of s in [-1, 1]


def model(rng: np.random.Generator, about: float = 0.0, size: float = 1.0) -> TaylorModel:
    """Parabolas with coefficients of very different sizes, and bounds that are 0 or not."""
    scale = 10.0 ** rng.uniform(-9.0, 0.0, (3, COUNT))
    c0, c1, c2 = size * scale * rng.uniform(-1.0, 1.0, (3, COUNT))
    r = np.where(rng.random(COUNT) < 0.5, 0.0, 10.0 ** rng.uniform(-12.0, -3.0, COUNT))
    return TaylorModel(about + c0, c1, c2, size * r)


def members(x: TaylorModel, piece: int, s: Fraction) -> list[Fraction]:
    """The least, the middle and the largest value that a model allows, exactly."""
    c0, c1, c2, r = (Fraction(float(values[piece])) for values in (x.c0, x.c1, x.c2, x.r))
    middle = c0 + c1 * s + c2 * s * s
    return [middle - r, middle, middle + r]


def holds(x: TaylorModel, piece: int, s: Fraction, value: Fraction) -> bool:
    least, _, most = members(x, piece, s)
    lower, upper = Fraction(float(x.lower[piece])), Fraction(float(x.upper[piece]))
    return least <= value <= most and lower <= value <= upper


OPERATIONS: dict[str, tuple[Callable, Callable]] = {
    "sum": (lambda a, b: a + b, lambda a, b: a + b),
    "difference": (lambda a, b: a - b, lambda a, b: a - b),
    "product": (lambda a, b: a * b, lambda a, b: a * b),
    "square": (lambda a, b: a.square(), lambda a, b: a * a),
    "number": (lambda a, b: 0.1 * a - 0.7, lambda a, b: Fraction(0.1) * a - Fraction(0.7)),
    "reciprocal": (lambda a, b: (a + 3.0).reciprocal(), lambda a, b: 1 / (a + 3)),
}


@pytest.mark.parametrize("operation", OPERATIONS)
def test_an_operation_encloses_every_exact_result(operation: str):
    rng = np.random.default_rng(1)
    of_models, of_fractions = OPERATIONS[operation]
    a, b = model(rng, size=0.3), model(rng)
    found = of_models(a, b)
    for piece in range(COUNT):
        for s in SHARES:
            for x in members(a, piece, s):
                for y in members(b, piece, s):
                    assert holds(found, piece, s, of_fractions(x, y)), (piece, s)


def test_a_square_root_encloses_every_exact_one():
    rng = np.random.default_rng(2)
    a = model(rng, about=2.0, size=0.3)
    found = a.square_root()
    for piece in range(COUNT):
        for s in SHARES:
            for x in members(a, piece, s):
                least, _, most = members(found, piece, s)
                assert least >= 0 and least * least <= x <= most * most


def test_a_root_or_a_quotient_of_what_may_be_zero_is_no_number():
    x = TaylorModel(*np.array([[0.5], [1.0], [0.0], [0.0]]))
    assert np.isnan(x.square_root().upper).all()
    assert np.isnan(x.reciprocal().lower).all()


def decimal_sine(x: Decimal) -> Decimal:
    """The Taylor series, to fifty digits."""
    term = total = x
    k = 1
    while abs(term) > Decimal(10) ** -48:
        term *= -x * x / ((2 * k) * (2 * k + 1))
        total += term
        k += 1
    return total


HALF_PI = Decimal("1.57079632679489661923132169163975144209858469968755291")


def test_sine_and_cosine_are_off_by_no_more_than_they_say():
    rng = np.random.default_rng(3)
    quarters = np.arange(-9, 10) * (np.pi / 4.0)
    x = np.concatenate([rng.uniform(-7.0, 7.0, 400), quarters, np.nextafter(quarters, 9.0), [0.0, 1e-300, 700.0]])
    sine, cosine = sine_cosine(x)
    with localcontext() as context:
        context.prec = 60
        for at, s, c in zip(x.tolist(), sine.tolist(), cosine.tolist(), strict=True):
            exact = Decimal(at)
            turned = exact - (exact / (4 * HALF_PI)).to_integral_value() * 4 * HALF_PI
            assert abs(Decimal(s) - decimal_sine(turned)) <= Decimal(SINE_ERROR)
            assert abs(Decimal(c) - decimal_sine(turned + HALF_PI)) <= Decimal(SINE_ERROR)


def test_sine_and_cosine_of_a_model_enclose_every_exact_one():
    rng = np.random.default_rng(4)
    a = model(rng, about=1.0, size=0.3)
    sine, cosine = a.sine_cosine()
    with localcontext() as context:
        context.prec = 60
        for piece in range(COUNT):
            for s in SHARES[::2]:
                for x in members(a, piece, s):
                    at = Decimal(x.numerator) / Decimal(x.denominator)
                    # Fifty digits of an exact value: what they round is far below any bound.
                    assert holds(sine, piece, s, Fraction(decimal_sine(at)))
                    assert holds(cosine, piece, s, Fraction(decimal_sine(at + HALF_PI)))


def test_the_bounds_of_a_parabola_are_its_vertex_or_an_end():
    x = TaylorModel(*np.array([[0.0, 0.0], [1.0, 0.1], [-1.0, -0.01], [0.0, 0.0]]))
    np.testing.assert_allclose(x.upper, [0.25, 0.09], atol=1e-12)
    np.testing.assert_allclose(x.lower, [-2.0, -0.11], atol=1e-12)

"""The curves of a plan against their limits, computed by the certificate's own functions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from planner.answer import plan_from_document
from planner.arrays import Array
from planner.cell import Cell
from planner.certificate import Curve, Series, motion_curves

DIGITS = 9  # of a value: below every rounding that a limit allows, and half the size of all sixteen


def plan_curves(document: Mapping[str, Any], cell: Cell) -> dict[str, Any]:
    """Returns the document of `GET /plans/{id}/curves`.

    Args:
        document: the plan with its trajectory.
        cell: the cell that it was made for.
    """
    problem, trajectory = plan_from_document(document, cell)
    curves = motion_curves(problem, trajectory)
    clocks = {"motion": curves[0].t, "flight": next((c.t for c in curves if c.name == "flight_clearance"), None)}
    return {
        "plan_id": document.get("id"),
        "release_time_s": trajectory.release_time_s,
        "duration_s": trajectory.duration_s,
        "time_from_start": {name: None if t is None else _numbers(t) for name, t in clocks.items()},
        "curves": [_curve(curve) for curve in curves],
    }


def _curve(curve: Curve) -> dict[str, Any]:
    return {
        "name": curve.name,
        "unit": curve.unit,
        "clock": "flight" if curve.name == "flight_clearance" else "motion",
        "holds_until_next": curve.holds_until_next,
        "limited_s": None if curve.limited is None else [float(t) for t in curve.limited],
        "series": [_series(series) for series in curve.series],
    }


def _series(series: Series) -> dict[str, Any]:
    return {
        "name": series.name,
        "lower": series.lower,
        "upper": series.upper,
        "values": _numbers(series.values),
    }


def _numbers(values: Array) -> list[float | None]:
    """Returns values (k,) with nine digits; null where there is none."""
    return [float(f"{x:.{DIGITS}g}") if math.isfinite(x) else None for x in values.tolist()]

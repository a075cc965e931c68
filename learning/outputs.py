"""Delay and jitter of the outputs whose edges an input shows, from the runs of a cell.

The state stream tells an edge once a tick: each is known to lie between two states. The delays are taken as normal;
mean and deviation are those of the posterior on a grid, with flat priors of the mean and of the deviation's logarithm.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.arrays import Array
from planner.cell import Cell

RUNS_MAX = 50  # newest runs that count: a valve wears
SEPARATE_S = 0.2  # [s] from an edge's command to the next one's: a shorter pulse may be another's
JITTER_RANGE_S = 2e-5, 0.05  # [s] of the grid of the deviation
MEANS = 150  # points of the grid of the mean
JITTERS = 40  # of the deviation
NEGLIGIBLE = 1e-6  # [-] probability of a point that a finer grid leaves out
IMPOSSIBLE = 1e-300  # [-] least probability of an interval, for its logarithm
ROUNDING_S = 1e-6  # [s] of a sum of times: equal intervals are counted
DELAY_KEYS = ("delay_s", "delay_std_s", "jitter_s", "jitter_std_s")


def learnt_outputs(
    cell: Cell, runs: Iterable[Sequence[Mapping[str, Any]]], lag_s: float
) -> dict[str, dict[str, float | int]]:
    """Returns delay and jitter of each output that an input showed, by its name in the cell.

    Args:
        cell: the robot station.
        runs: `metrics.outputs` of executions, newest first.
        lag_s: lag that plans are made with [s]: a delay counts from one lag after the command.
    """
    shown = [run for run in runs if any(each.get("sense_input") is not None for each in run)][:RUNS_MAX]
    found: dict[str, dict[str, float | int]] = {}
    for name, output in cell.outputs.items():
        line = (output.output, output.index, output.sense_input)
        spans = [span for run in shown for span in _spans(run, line)] if output.sense_input is not None else []
        if spans:
            mean_s, *others = delay_between(np.array(spans))
            numbers = dict(zip(DELAY_KEYS, (mean_s - lag_s, *others), strict=True))
            found[name] = {**numbers, "edges": len(spans)}
    return found


def _spans(run: Sequence[Mapping[str, Any]], line: tuple[str, int, int | None]) -> list[tuple[float, float]]:
    """Returns between which times after its command each edge of one output happened in a run [s].

    What a stop switched, of no passage, counts only as what is near an edge: when it was sent is not exact.
    """
    sent = [each for each in run if each["command_time_s"] is not None and line == _line(each)]
    times = np.array([each["command_time_s"] for each in sent])
    gaps = np.diff(times, prepend=-math.inf, append=math.inf)
    return [
        (max(each["edge_after_s"] - at_s, 0.0), each["edge_time_s"] - at_s)
        for each, at_s, gap in zip(sent, times.tolist(), np.minimum(gaps[:-1], gaps[1:]), strict=True)
        if each["passage"] is not None and each["edge_time_s"] is not None and gap >= SEPARATE_S
    ]


def _line(each: Mapping[str, Any]) -> tuple[str, int, int | None]:
    return each["output"], each["index"], each["sense_input"]


def delay_between(spans: Array) -> tuple[float, float, float, float]:
    """Returns the mean of a delay and its standard error, its standard deviation and the error of that [s].

    Args:
        spans: between which times each delay lies (n, 2) [s].
    """
    bounds, counts = np.unique(np.round(spans / ROUNDING_S) * ROUNDING_S, axis=0, return_counts=True)
    means = np.linspace(bounds.min(), bounds.max(), MEANS)
    jitters = np.geomspace(*JITTER_RANGE_S, JITTERS)
    coarse = _posterior(bounds, counts, means, jitters)
    means = np.linspace(*_likely(means, coarse[0]), MEANS)
    jitters = np.geomspace(*_likely(jitters, coarse[1]), JITTERS)
    fine = _posterior(bounds, counts, means, jitters)
    return (*_moments(means, fine[0]), *_moments(jitters, fine[1]))


def _posterior(bounds: Array, counts: NDArray[np.intp], means: Array, jitters: Array) -> tuple[Array, Array]:
    """Returns the probabilities of means (m,) and of deviations (j,), from how often delays lie in intervals (n, 2)."""
    below = 0.5 * np.vectorize(math.erf)((bounds[..., None, None] - means[:, None]) / (math.sqrt(2.0) * jitters))
    log = np.tensordot(counts, np.log(np.maximum(below[:, 1] - below[:, 0], IMPOSSIBLE)), axes=1)
    weights = np.exp(log - log.max())
    weights /= weights.sum()
    return weights.sum(axis=1), weights.sum(axis=0)


def _likely(values: Array, weights: Array) -> tuple[float, float]:
    """Returns the ends of a grid over the values that are not negligible."""
    likely = np.flatnonzero(weights > NEGLIGIBLE)
    return float(values[max(likely[0] - 1, 0)]), float(values[min(likely[-1] + 1, len(values) - 1)])


def _moments(values: Array, weights: Array) -> tuple[float, float]:
    """Returns mean and standard deviation of values with these probabilities."""
    mean = float(weights @ values)
    return mean, math.sqrt(float(weights @ (values - mean) ** 2))

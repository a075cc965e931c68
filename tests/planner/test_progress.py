"""Progress of a search: what an observer is told, that it decides nothing, and that it can end the search."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import fling
from fling import Progress

THROW = fling.Target([1.2, 0.3, 0.0])
TOO_FAR = fling.Point([2.5, 0.0, 0.5], [1.0, 0.0, 1.0])


class Ended(Exception):
    """Raised by an observer."""


def test_the_answer_is_the_same_to_the_bit_with_an_observer():
    told: list[Progress] = []
    silent = fling.plan(THROW, "ur5e-sim")
    observed = fling.plan(THROW, "ur5e-sim", progress=told.append)
    assert np.array_equal(silent.trajectory.q, observed.trajectory.q)
    assert told[-1].best_release_time_s == observed.release_time_s
    assert told[-1].candidates > 0


def test_what_is_told_only_grows():
    told: list[Progress] = []
    fling.plan(THROW, "ur5e-sim", progress=told.append)
    assert told[0].candidates == 0 and told[0].best_release_time_s is None
    for before, after in pairwise(told):
        assert after.candidates >= before.candidates
        assert after.elapsed_s >= before.elapsed_s
        assert (after.best_release_time_s or 9.0) <= (before.best_release_time_s or 9.0)


def test_a_refusal_tells_of_the_search_for_something_near_it():
    told: list[Progress] = []
    with pytest.raises(fling.Infeasible) as refused:
        fling.plan(TOO_FAR, "ur5e-sim", progress=told.append)
    assert refused.value.nearest is not None
    stages = [progress.stage for progress in told]
    assert stages == sorted(stages, reverse=True) and {*stages} == {"search", "nearest"}
    assert {progress.best_release_time_s for progress in told} == {None}
    assert told[-1].candidates > 0


@pytest.mark.parametrize("step", range(4))
def test_what_an_observer_raises_ends_the_search(step: int):
    calls = 0

    def end(progress: Progress) -> None:
        nonlocal calls
        calls += 1
        if calls > step:
            raise Ended

    with pytest.raises(Ended):
        fling.plan(THROW, "ur5e-sim", progress=end)
    assert calls == step + 1

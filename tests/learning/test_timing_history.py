from __future__ import annotations

import numpy as np
import pytest

from learning import lag_change, pool_timing


def run(lag_s: float, lag_std_s: float, gain: float = 1.0) -> dict:
    lists = {f"{name}{end}": [value] * 6 for name, value, spread in (("gain", gain, 0.01), ("overshoot", None, None))
             for end, value in (("", value), ("_std", spread))}  # fmt: skip
    seconds = {"first_order_s": [0.002] * 6, "first_order_std_s": [0.001] * 6,
               "joint_lag_s": [lag_s] * 5 + [None], "joint_lag_std_s": [lag_std_s] * 5 + [None]}  # fmt: skip
    return {"lag_s": lag_s, "lag_std_s": lag_std_s, **lists, **seconds}


def test_pooled_runs_are_as_good_as_their_scatter() -> None:
    rng = np.random.default_rng(1)
    scores = []
    for _ in range(200):
        pooled = pool_timing([run(0.02 + rng.normal(0.0, 0.001), 0.0001) for _ in range(20)])
        assert pooled is not None
        scores.append((pooled.lag_s - 0.02) / pooled.lag_std_s)
    assert np.std(scores) == pytest.approx(1.0, abs=0.2)  # the runs scatter ten times as much as they claim


def test_a_joint_that_never_moved_stays_unknown() -> None:
    pooled = pool_timing([run(0.02, 0.0001), run(0.021, 0.0001)])
    assert pooled is not None
    assert pooled.joints["joint_lag_s"][5] is None
    assert pooled.joints["joint_lag_s"][0] == pytest.approx(0.0205)
    assert pool_timing([]) is None


@pytest.mark.parametrize(
    ("lag_s", "std_s", "change"), [(0.0205, 1e-5, None), (0.0225, 0.002, None), (0.026, 0.0002, 0.006)]
)
def test_only_a_change_that_matters_and_is_certain_is_said(lag_s: float, std_s: float, change: float | None) -> None:
    assert lag_change(lag_s, std_s, 0.020) == (None if change is None else pytest.approx(change))

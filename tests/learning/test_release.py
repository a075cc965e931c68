"""The release estimator on hidden cells whose truth is integrated apart from it: quick versions of the benchmark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.learning.gripper_calibration import calibrated_cells
from benchmarks.learning.hidden_cells import HiddenCell, throw
from benchmarks.learning.plans import PlannedThrow
from learning import ObservedThrow, ReleasePosterior, learn_release, prior_state, throw_table
from learning.hit_evidence import TargetOutcome, weighed_by_outcomes
from learning.release import PRIOR_STD, told_by_reports

SPEEDS_KNOWN = np.full(6, 0.005**2)
SEED = 20261122


def cell(**truth) -> HiddenCell:
    known = {"delay_s": 0.055, "jitter_s": 0.001, "shape": "gaussian", "assumed_delay_s": 0.040, "factor": 0.98,
             "gain": np.ones(6), "noise_rad_s": 0.01, "offset": np.array([0.005, -0.006]), "turn_rad": 0.0,
             "drag": 0.2, "cling_share": 0.0, "outlier_share": 0.0}  # fmt: skip
    return HiddenCell(**{**known, **truth})


def learnt(hidden: HiddenCell, plans: list[PlannedThrow], count: int, seed: int = SEED) -> ReleasePosterior:
    return learn_release(observed(hidden, plans, count, seed), prior_state(hidden.assumed_delay_s, 0.0))


def observed(hidden: HiddenCell, plans: list[PlannedThrow], count: int, seed: int = SEED) -> list[ObservedThrow]:
    rng = np.random.default_rng(seed)
    seen = []
    for _ in range(count):
        planned = plans[rng.integers(len(plans))]
        true = throw(rng, hidden, planned, hidden.openings(rng, 1)[0] - hidden.assumed_delay_s, np.zeros(2))
        table = throw_table(planned.problem, planned.trajectory).deviated(true.deviation)
        seen.append(ObservedThrow(table, hidden.assumed_delay_s, true.seen, 0.003, SPEEDS_KNOWN))
    return seen


def test_nothing_seen_is_the_prior():
    posterior = learn_release([], prior_state(0.060, 0.3))
    assert posterior.state == pytest.approx([0.060, 1.0, 0.0, 0.0, 0.3, 0.0])
    assert np.sqrt(np.diag(posterior.state_covariance)) == pytest.approx(PRIOR_STD)
    assert posterior.weight.sum() == pytest.approx(1.0)


def test_delay_and_jitter_of_hidden_grippers(soonest: list[PlannedThrow]):
    """Every tenth prior is 80 ms off, every tenth camera wrong in a fifth of the throws."""
    results = calibrated_cells(soonest, SEED, 10)
    for n in (6, 10):
        some = [result for result in results if result.throws == n]
        assert sum(abs(r.delay_error_s) <= r.tolerance_s for r in some) >= 8
        assert sum(r.is_covered for r in some) >= 6
    assert np.sqrt(np.mean([r.jitter_error_s**2 for r in results if r.throws == 10])) < 0.0025


def test_the_whole_state_comes_out_of_many_throws(soonest: list[PlannedThrow]):
    posterior = learnt(cell(turn_rad=0.006), soonest, 30)
    truth = np.array([0.055, 0.98, 0.005, -0.006, 0.2, 0.006])
    std = np.sqrt(np.diag(posterior.state_covariance))
    assert np.abs((posterior.state - truth) / std).max() < 3.5
    assert std[0] < 0.0005
    assert std[1] < 0.004
    assert std[5] < 0.002


def test_what_a_gripper_reports_brings_the_delay_nearer(soonest: list[PlannedThrow]):
    """Reports every 6 ms of a register that changes every 10: beside two landings, and alone."""
    distances = []
    prior = learn_release([], prior_state(0.040, 0.0))
    for seed in range(12):
        rng = np.random.default_rng(seed)
        seen_s = 0.055 + rng.uniform(0.0, 0.006) + 0.001 * rng.standard_normal(2)
        opened = [(by - 0.016, by) for by in seen_s]
        landed = learnt(cell(), soonest, 2, seed)
        for before in (landed, prior):
            after = told_by_reports(before, opened)
            assert after.state_covariance[0, 0] < before.state_covariance[0, 0]
            distances.append([abs(posterior.state[0] - 0.055) for posterior in (before, after)])
    without, reported = np.mean(distances, axis=0)
    assert reported < 0.8 * without
    assert after.weight.sum() == pytest.approx(1.0)
    assert np.sqrt(after.state_covariance[0, 0]) == pytest.approx(0.0078, abs=0.001)  # of half the 16 ms, and a prior
    assert told_by_reports(prior, []) is prior


def test_reports_that_lie_far_apart_tell_less():
    prior = learn_release([], prior_state(0.042, 0.0))
    alike = told_by_reports(prior, [(0.050, 0.058)] * 8)
    apart = told_by_reports(prior, [(0.030, 0.038), (0.070, 0.078)] * 4)
    assert apart.state_covariance[0, 0] > 1.5 * alike.state_covariance[0, 0]
    creeps = told_by_reports(prior, [*[(0.050, 0.058)] * 7, (0.0, 0.004)])
    assert creeps.state[0] == pytest.approx(alike.state[0], abs=0.002)


def test_wrong_observations_and_clinging_objects_do_not_pass_for_jitter(soonest: list[PlannedThrow]):
    posterior = learnt(cell(outlier_share=0.2, cling_share=0.1), soonest, 20)
    assert posterior.state[0] == pytest.approx(0.055, abs=0.0015)
    assert posterior.jitter < 0.003
    clean = learnt(cell(), soonest, 20)
    clings, none = (p.cling_alpha / (p.cling_alpha + p.cling_beta) for p in (posterior, clean))
    assert clings > none


def test_the_throw_whose_landing_is_a_mistake_is_known(soonest: list[PlannedThrow]):
    hidden = cell()
    seen = observed(hidden, soonest, 12)
    seen[7] = replace(seen[7], landing=np.array([9.0, 9.0]))
    mistaken = learn_release(seen, prior_state(hidden.assumed_delay_s, 0.0)).mistaken
    assert mistaken[7] > 0.99
    assert np.delete(mistaken, 7).max() < 0.5
    assert learn_release([], prior_state(hidden.assumed_delay_s, 0.0)).mistaken.shape == (0,)


def test_states_are_drawn_as_the_mixture_says(soonest: list[PlannedThrow]):
    posterior = learnt(cell(), soonest, 3)
    states, jitters, _ = posterior.drawn(np.random.default_rng(1), 20_000)
    std = np.sqrt(np.diag(posterior.state_covariance))
    assert (states.mean(axis=0) - posterior.state) / std == pytest.approx(np.zeros(6), abs=0.05)
    assert states.std(axis=0) / std == pytest.approx(np.ones(6), abs=0.05)
    assert jitters.mean() == pytest.approx(posterior.jitter, rel=0.03)


def test_hits_and_misses_alone_move_the_delay_towards_the_truth(soonest: list[PlannedThrow]):
    """15 ms off: soonest throws miss, the same ones released 15 ms sooner hit."""
    hidden = cell(noise_rad_s=0.0, drag=0.0, factor=1.0, offset=np.zeros(2))
    rng = np.random.default_rng(SEED)
    outcomes = []
    for k in range(24):
        planned = soonest[k % len(soonest)]
        lead = 0.040 + 0.005 * (k % 6)
        true = throw(rng, hidden, planned, hidden.openings(rng, 1)[0] - lead, np.zeros(2))
        target = planned.problem.release.p_W[:2]  # type: ignore[union-attr]
        result = "hit" if np.linalg.norm(true.landing - target) < 0.1 else "miss"
        table = throw_table(planned.problem, planned.trajectory)
        outcomes.append(TargetOutcome(table, lead, target, 0.1, result, 0.005))
    assert {x.result for x in outcomes} == {"hit", "miss"}
    before = learn_release([], prior_state(0.040, 0.0))
    after = weighed_by_outcomes(before, outcomes)
    assert after.state[0] == pytest.approx(0.055, abs=0.004)
    assert after.state_covariance[0, 0] < 0.2 * before.state_covariance[0, 0]
    assert after.weight.sum() == pytest.approx(1.0)
    assert weighed_by_outcomes(before, []) is before

"""Order of candidates: postures out of the object's way come before those in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from planner.errors import Infeasible
from planner.geometry import arm_capsules, capsule_endpoints
from planner.planning import plan
from planner.problem import TargetRelease
from planner.search.ranking import GENTLE_LONGER, GENTLE_RAMP_S, LATE_AT_POINT, TIMED_MAX, RankedCandidate, Ranking
from planner.seeds import aspects, candidates
from tests.planner.problems import cell, joint_problem, point_problem, random_state


def depth(problem, q: np.ndarray) -> float:
    """How deep the object gets into the arm that stays as it is at the release [m], sampled every 2 ms."""
    capsules = arm_capsules(problem.cell.robot)
    ends = capsule_endpoints(problem.cell.robot, capsules, q, problem.cell.X_WB)
    t = np.arange(0.002, 2.0, 0.002)[:, None]
    x = problem.release.p_WT + problem.release.v_WT * t - 0.5 * 9.81 * t**2 * np.array([0.0, 0.0, 1.0])
    x = x[: int(np.argmax((x[:, 2] < problem.cell.object.radius_m) & (np.gradient(x[:, 2]) < 0.0)))]
    gaps = []
    for (p0, p1), capsule in zip(ends, capsules, strict=True):
        share = np.clip((x - p0) @ (p1 - p0) / max((p1 - p0) @ (p1 - p0), 1e-12), 0.0, 1.0)
        gap = np.linalg.norm(x - p0 - share[:, None] * (p1 - p0), axis=1)
        gaps.append(gap.min(initial=np.inf) - capsule.radius_m - problem.cell.object.radius_m)
    return -min(gaps)


def test_a_points_postures_out_of_the_flights_way_come_first() -> None:
    rng = np.random.default_rng(8)
    here = cell()
    moved = 0
    for _ in range(40):
        problem = point_problem(here, *random_state(here, rng))
        try:
            found = candidates(problem)
        except Infeasible:
            continue
        ranking = Ranking(problem, found)[:TIMED_MAX]
        depths = [depth(problem, ranked.candidate.q) for ranked in ranking]
        if depths[0] > 0.01:
            assert min(depths) > -0.005
        moved += min(depths) < -0.005 and max(depths) > 0.01
    assert moved >= 3


def test_the_first_of_every_aspect_come_first_and_settled_ones_not_again() -> None:
    problem = joint_problem(release=TargetRelease(np.array([1.0, 0.3, 0.0])))
    ranking = Ranking(problem, candidates(problem))
    tried = []
    for ranked in ranking.by_aspect():
        aspect = int(aspects(problem.cell.robot, ranked.candidate.q[None])[0])
        tried.append(aspect)
        if len(tried) == 1:
            assert ranked is ranking[0]
            ranking.settle(ranked, np.inf)
            assert not ranking.may_be_sooner(ranked, 10.0)
    first = tried[: len(set(tried))]
    assert len(first) == len(set(first))
    assert tried.count(first[0]) == 1
    assert all(tried.count(aspect) <= 2 for aspect in tried)


def test_a_throw_that_hardly_improves_on_its_candidate_settles_nothing() -> None:
    problem = joint_problem(release=TargetRelease(np.array([1.0, 0.3, 0.0])))
    ranking = Ranking(problem, candidates(problem))
    first = ranking.by_bound()[0]
    bound_s = first.candidate.bound_s
    ramp_s = float((problem.limits.qdd_max / problem.limits.jerk_max).max())
    ranking.settle(first, 1.1 * bound_s + ramp_s)
    assert ranking.may_be_sooner(first, 1.1 * bound_s + ramp_s)
    ranking.settle(first, bound_s + ramp_s)
    assert not ranking.may_be_sooner(first, bound_s + ramp_s)


def test_a_gentle_guess_is_the_same_for_every_jerk_and_not_much_longer_than_the_soonest() -> None:
    problem = joint_problem(release=TargetRelease(np.array([1.0, 0.3, 0.0])))
    candidate = max(candidates(problem), key=lambda each: each.bound_s)

    def ranked(factor: float, start: np.ndarray) -> RankedCandidate:
        limits = replace(problem.limits, jerk_max=factor * problem.limits.jerk_max)
        return RankedCandidate(replace(problem, limits=limits, start=start), candidate)

    far = [ranked(factor, problem.start) for factor in (1.0, 4.0)]
    gentle = [each.gentle_seed.initial_guess.release_time_s for each in far]
    assert gentle[0] == gentle[1]
    for each, released in zip(far, gentle, strict=True):
        assert each.seed.initial_guess.release_time_s < released < GENTLE_LONGER * each.arrival_s
    close = ranked(1.0, candidate.q - 0.1 * candidate.qd)
    gentler = ranked(0.2, candidate.q - 0.1 * candidate.qd)
    assert gentler.seed.initial_guess.release_time_s > GENTLE_LONGER * close.arrival_s  # as a gentle motion would
    assert close.gentle_seed is close.seed


def test_a_guess_that_is_given_or_of_little_jerk_is_kept() -> None:
    problem = joint_problem(release=TargetRelease(np.array([1.0, 0.3, 0.0])))
    candidate = max(candidates(problem), key=lambda each: each.bound_s)
    slow = replace(problem, limits=replace(problem.limits, jerk_max=problem.limits.qdd_max / GENTLE_RAMP_S))
    given = RankedCandidate(problem, candidate, given=plan(problem).trajectory)
    for kept in (RankedCandidate(slow, candidate), given):
        assert kept.gentle_seed is kept.seed
    ordinary = RankedCandidate(problem, candidate)
    assert ordinary.gentle_seed is not ordinary.seed


def test_what_is_least_like_an_answer_is_of_its_aspect_untried_and_has_a_joint_that_turns_another_way() -> None:
    problem = joint_problem(release=TargetRelease(np.array([1.0, 0.3, 0.0])))
    ranking = Ranking(problem, candidates(problem))
    made = plan(problem).trajectory
    q = made.q[made.release_index]
    qd = made.qd[made.release_index]
    own = [
        each
        for each in ranking
        if aspects(problem.cell.robot, each.candidate.q[None]) == aspects(problem.cell.robot, q[None])
    ]
    apart = {each: np.abs(each.candidate.qd - qd).max() for each in own}
    first = ranking.unlike(made)[0]
    assert apart[first] == max(apart.values())
    assert apart[first] > 0.5 * problem.limits.qd_max[0]
    first.first_try("fatrop")
    assert ranking.unlike(made)[0] is sorted(own, key=lambda each: -apart[each])[1]


def test_of_a_point_what_is_late_beside_the_answer_is_not_tried_though_it_is_unlike_it() -> None:
    problem = point_problem(cell(), *random_state(cell(), np.random.default_rng(3)))
    found = candidates(problem)
    ranking = Ranking(problem, found)
    made = plan(problem).trajectory
    aspect = aspects(problem.cell.robot, made.q[made.release_index][None])
    own = [each for each in found if aspects(problem.cell.robot, each.q[None]) == aspect]
    soon = {each.label for each in own if each.bound_s <= LATE_AT_POINT * made.release_time_s}
    assert {each.candidate.label for each in ranking.unlike(made)} == soon
    assert 0 < len(soon) < len(own)

"""Launches with a stop: the last resort where no motion from the start itself is certified."""

import time
from dataclasses import replace

import numpy as np
import pytest

from planner import planning
from planner.cell import Box
from planner.certificate import certify
from planner.geometry import body_model, tool_pose
from planner.problem import JointRelease, ThrowProblem
from planner.search import PlanningSearch, search_with_stop
from planner.seeds import Candidate, candidates
from tests.planner.problems import cell


def walled(release: JointRelease) -> ThrowProblem:
    """Returns the release from a start behind a box that stands in the straight way."""
    here = cell()
    start = release.q + np.array([1.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    middle = tool_pose(here, (start + release.q) / 2.0)[:3, 3]
    box = Box(middle - 0.12, middle + 0.12)
    here = replace(here, surroundings=replace(here.surroundings, keep_out=(box,)))
    assert (body_model(here).clearances(np.array([start, release.q])).least > 0.0).all()
    return ThrowProblem(here, start, release, here.limits)


@pytest.mark.parametrize("speed", [np.array([-0.8, 0.3, -0.3, 0.6, 0.0, 0.0]), np.zeros(6)], ids=["throw", "move"])
def test_a_release_behind_a_box_is_reached_with_a_stop(speed: np.ndarray) -> None:
    problem = walled(JointRelease(np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0]), speed))
    search = PlanningSearch(problem, time.perf_counter() + 60.0)
    search_with_stop(search, candidates(problem))
    assert search.best is not None
    motion = search.best.solution.trajectory
    assert certify(problem, motion).valid
    slow = np.abs(motion.qd[1 : motion.release_index]).max(axis=1)
    is_throw = bool(speed.any())
    assert (slow.min() < 1e-6) == is_throw, "only a throw stops on the way, where it is launched"
    assert ("stop" if is_throw else "path") in search.best.solution.status
    assert search.attempts[-1].backend == "approach"


def test_without_time_nothing_is_tried() -> None:
    problem = walled(JointRelease(np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0]), np.full(6, 0.3)))
    search = PlanningSearch(problem, time.perf_counter() - 1.0)
    search_with_stop(search, candidates(problem))
    assert search.best is None
    assert search.attempts[-1].result == "with a stop: no posture was found to throw from in time"


def test_a_last_resort_that_takes_longer_than_the_time_limit_does_not_cut_the_plan_short(monkeypatch) -> None:
    clock = [0.0]
    find = planning.search_with_stop

    def finds_late(search: PlanningSearch, found: list[Candidate]) -> None:
        find(search, found)
        clock[0] = 1e6

    monkeypatch.setattr(time, "perf_counter", lambda: clock[0])
    monkeypatch.setattr(planning, "search_candidates", lambda *_asked: None)
    monkeypatch.setattr(planning, "search_with_stop", finds_late)
    made = planning.plan(walled(JointRelease(np.array([-0.8, -1.2, 1.6, -1.9, -1.57, 0.0]), np.zeros(6))))
    assert clock[0] > 0.0
    assert not made.was_cut_short

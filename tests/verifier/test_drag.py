"""Flights with drag hold what the planner's integration comes to, and are proven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.proofs import document_of
from planner.certificate import window_landing_points
from planner.flight import path
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.trajectory import Trajectory
from tests.planner import problems
from verifier import Status, verify
from verifier.drag import DragReleases, releases_of
from verifier.flights import release_pieces
from verifier.plan_document import read_motion

INTEGRATED_M = 1e-7  # [m] by which the planner's fourth-order method may be off


@pytest.fixture(scope="module")
def thrown():
    here = problems.cell()
    light = replace(here, object=replace(here.object, drag_coefficient=0.47, mass_kg=0.01))
    problem = ThrowProblem(light, light.home, TargetRelease(np.array([1.0, 0.3, 0.0])), light.limits, 0.005, 0.02)
    return problem, plan(problem).trajectory


def test_a_throw_with_drag_is_proven(thrown):
    verdict = verify(*document_of(*thrown))
    assert verdict.status is Status.PROVEN, list(map(str, verdict.open))


def test_flights_and_landings_hold_what_an_integration_comes_to(thrown):
    problem, trajectory = thrown
    document, cell = document_of(problem, trajectory)
    releases = releases_of(cell, release_pieces(read_motion(document), problem.release_window_s))
    assert isinstance(releases, DragReleases)
    landed = releases.falls_through(0.0)
    pieces = releases.pieces
    p, v = releases.states
    for s in (-1.0, 0.3, 1.0):
        shares = 0.5 * (pieces.begin + pieces.end) + 0.5 * s * (pieces.end - pieces.begin)
        delays = (pieces.tick + shares) / pieces.motion.rate_hz - trajectory.release_time_s
        there = window_landing_points(problem, trajectory, delays).T
        off = np.abs(landed.c0 + landed.c1 * s + landed.c2 * s * s - there)[:2]
        assert (off <= landed.r[:2] + INTEGRATED_M).all()
        assert landed.r[:2].max() < 5e-4
    middle = len(pieces.tick) // 2
    times = np.array([0.0, 0.05, 0.1234, 0.4])
    flown = path(p.c0[:, middle], v.c0[:, middle], times, problem.gravity, problem.drag)
    found = releases.at(np.full(len(times), middle), times)
    assert (np.abs(found.c0.T - flown) <= found.r.T + INTEGRATED_M).all()


def test_a_point_has_no_drag():
    here = problems.cell()
    point = replace(here, object=replace(here.object, drag_coefficient=0.47, radius_m=0.0))
    document, _ = document_of(*_still(point))
    releases = releases_of(point, release_pieces(read_motion(document), 0.0))
    assert not isinstance(releases, DragReleases)


def _still(cell):
    """A problem and a motion of which only its samples matter."""
    rows = [np.tile(cell.home, (3, 1)), np.zeros((3, 6)), np.zeros((3, 6))]
    return problems.joint_problem(cell=cell), Trajectory(cell.robot.sample_rate_hz, *rows, release_index=1)

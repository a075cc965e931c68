"""The landing cells of a map and the levels in which they are planned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from jobs.maps import MapRequest, definition_from, landing_grid, map_definition
from planner.errors import InvalidProblem
from planner.problem import TargetRelease
from planner.refusal import proofs
from tests.jobs.maps.planners import definition
from tests.planner.problems import cell, joint_problem


@pytest.mark.parametrize("shape", [(60, 60), (1, 1), (3, 250)])
@pytest.mark.parametrize("planes", [(0.0,), (0.0, 0.1, 0.2, 0.3, 0.4)])
def test_the_levels_share_out_all_landing_cells_and_each_halves_the_distance(shape, planes):
    of = definition(shape, planes=planes)
    levels = [of.level(index) for index in range(len(of.strides))]
    assert sorted(number for level in levels for number in level) == list(range(of.count))
    assert len(levels[0]) <= 100
    assert [a / b for a, b in zip(of.strides, of.strides[1:], strict=False)] == [2] * (len(levels) - 1)
    for index, stride in enumerate(of.strides):  # a level with those before it is a lattice of its own
        places = {of.place(number) for level in levels[: index + 1] for number in level}
        assert places == {p for p in map(of.place, range(of.count)) if all(n % stride == 0 for n in p)}


def test_the_proof_of_the_issue_begins_with_a_picture_of_64_points():
    planes, origin, shape = landing_grid((-1.5, 1.5, -1.5, 1.5), 0.05, (0.0,))
    of = definition(shape, 0.05, planes, origin_m=origin)
    assert (of.count, [s * 0.05 for s in of.strides], len(of.level(0))) == (3600, [0.4, 0.2, 0.1, 0.05], 64)
    assert (of.target(0), of.target(3599)) == ([-1.475, -1.475, 0.0], [1.475, 1.475, 0.0])
    assert of.target(61) == [-1.425, -1.425, 0.0]


def test_neighbours_are_those_around_the_nearest_first():
    of = definition((3, 3), planes=(0.0, 0.1))
    around = of.neighbours(4)
    assert sorted(around) == [n for n in range(18) if n != 4]
    distances = [sum((a - b) ** 2 for a, b in zip(of.place(n), of.place(4), strict=True)) for n in around]
    assert distances == sorted(distances)
    assert definition((1, 1)).neighbours(0) == []


def test_a_definition_comes_back_from_its_document_and_each_field_is_in_its_hash():
    of = definition()
    assert definition_from(of.document()) == of
    changes = {"cell": "d", "cell_sha256": "6", "profile": "p", "planner_version": "2", "robust": True}
    changes |= {"planes_z_m": (0.1,), "origin_m": (0.0, 0.0), "shape": (7, 8), "resolution_m": 0.2}
    assert changes.keys() == of.document().keys()
    hashes = {replace(of, **{name: value}).sha256 for name, value in changes.items()}
    assert len(hashes | {of.sha256}) == len(changes) + 1


def test_a_landing_cell_asks_for_the_soonest_or_for_a_targets_default():
    assert definition().request(0)["release_window_s"] == 0.0
    assert "release_window_s" not in definition(robust=True).request(0)


@pytest.mark.parametrize(
    ("extent", "resolution", "heights", "field"),
    [
        ((0, 1, 0, 1), 0.001, (0,), "resolution_m"),
        ((0, 1, 0, 1), float("nan"), (0,), "resolution_m"),
        ((1, 0, 0, 1), 0.1, (0,), "extent_m"),
        ((0, 1, 0, 101), 0.1, (0,), "extent_m"),
        ((0, 1, float("-inf"), 1), 0.1, (0,), "extent_m"),
        ((0, 1, 0, 1), 0.1, (1, 0), "volume_m"),
        ((0, 1, 0, 1), 0.1, (float("nan"),), "plane_z_m"),
        ((-50, 50, -50, 50), 0.05, (0,), "resolution_m"),
    ],
)
def test_what_makes_no_map_is_refused_by_field(extent, resolution, heights, field):
    with pytest.raises(InvalidProblem) as refused:
        landing_grid(extent, resolution, heights)
    assert [error.field for error in refused.value.errors] == [field]


def test_by_default_a_map_ends_where_every_throw_is_out_of_range_by_proof():
    here = cell()
    of = map_definition(here, SHA := "0", None, MapRequest(resolution_m=0.1), "1")
    assert (of.cell_sha256, of.planes_z_m) == (SHA, (0.0,))
    first = np.array(of.target(0))
    last = np.array(of.target(of.count - 1))
    for place, aside in [(first, (-0.06, 1.4)), (last, (0.06, -1.4)), (first, (1.4, -0.06))]:
        beyond = np.array([place[0] + aside[0], place[1] + aside[1], 0.0])
        problem = joint_problem(release=TargetRelease(beyond))
        assert proofs.proven_violations(problem)
    rim = joint_problem(release=TargetRelease(np.array([last[0] - 0.15, 0.0, 0.0])))
    assert not proofs.proven_violations(rim)


def test_a_plane_out_of_range_and_a_plane_beside_a_volume_are_refused():
    with pytest.raises(InvalidProblem, match="out of the arm's range"):
        map_definition(cell(), "0", None, MapRequest(plane_z_m=9.0), "1")
    with pytest.raises(InvalidProblem, match="not both"):
        map_definition(cell(), "0", None, MapRequest(plane_z_m=0.0, volume_m=(0.0, 1.0)), "1")

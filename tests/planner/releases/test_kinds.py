"""A kind of release is one module: what each says of itself, and a new one that plans with its file and its line."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from planner.answer import plan_document, plan_from_document
from planner.cell import Cell
from planner.errors import Infeasible, InvalidProblem
from planner.planning import plan
from planner.releases import KINDS, JointRelease, PointRelease, PoseRelease, Release, TargetRelease, release_document
from planner.request import PLAN_REQUEST, problem_from_request
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import cell
from tests.planner.releases.belt import BeltRelease

ONE_OF_EACH = (
    JointRelease(np.linspace(-1.0, 1.0, 6), np.linspace(0.5, -0.5, 6)),
    PoseRelease(pose([0.4, 0.2, 0.6], rotation_vector_to_matrix([0.3, -0.2, 0.9])), np.linspace(-0.5, 0.5, 6)),
    PointRelease(np.array([0.5, 0.2, 0.6]), np.array([0.8, 0.3, 0.8])),
    TargetRelease(np.array([1.2, 0.3, 0.0]), max_speed_m_s=3.0, release_position=np.array([0.5, 0.2, 0.6])),
)
BELT = {"kind": "belt", "position": [1.2, -0.5, 0.0], "belt_velocity": [0.0, 0.4, 0.0], "meets_after_s": 2.0}
SCHEMA = """
from planner import releases
from tests.planner.releases.belt import BeltRelease
releases.KINDS["belt"] = BeltRelease
from api.schemas.requests import PlanRequest
assert "meets_after_s" in PlanRequest.model_json_schema()["$defs"]["BeltReleaseRequest"]["properties"]
"""


@pytest.fixture
def with_belt(monkeypatch) -> Cell:
    """A cell, and the sketch among the kinds: the one line, twice as `PLAN_REQUEST` has read the table already."""
    monkeypatch.setitem(KINDS, BeltRelease.name, BeltRelease)
    monkeypatch.setitem(PLAN_REQUEST.fields["release"].shape.records, BeltRelease.name, BeltRelease.record)
    return cell()


@pytest.mark.parametrize("release", ONE_OF_EACH, ids=lambda each: each.name)
def test_each_kind_makes_one_demand_and_is_read_as_it_is_written(release: Release):
    assert KINDS[release.name] is type(release)
    demands = (release.joint_state, release.tool_state, release.point_state, release.target)
    assert sum(demand is not None for demand in demands) == 1
    assert release.aims == (release.target is not None)
    given = release_document(release)
    asked = PLAN_REQUEST.fields["release"].shape.read(given, "release", errors := [])
    assert not errors
    again = type(release).from_json(asked, np.eye(4))
    for name, value in vars(release).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(getattr(again, name), value, atol=1e-12)
        else:
            assert getattr(again, name) == value


@pytest.mark.parametrize("release", ONE_OF_EACH[:3], ids=lambda each: each.name)
def test_only_a_state_that_stands_still_is_at_rest(release: Release):
    assert not release.is_at_rest
    velocity = list(vars(release))[1]
    assert replace(release, **{velocity: np.zeros(len(vars(release)[velocity]))}).is_at_rest
    assert not ONE_OF_EACH[3].is_at_rest
    with pytest.raises(NotImplementedError, match=release.name):
        release.with_target(ONE_OF_EACH[3])


def test_a_new_kind_plans_with_one_file_and_one_line(with_belt: Cell):
    request = {"release": BELT, "release_window_s": 0.0}
    found = plan(problem_from_request(request, with_belt))
    assert found.certificate.valid
    document = plan_document(found, request, "", "")
    there = np.array(BELT["position"]) + BELT["meets_after_s"] * np.array(BELT["belt_velocity"])
    np.testing.assert_allclose(document["flight"]["landing_point"], there, atol=5e-4)
    problem, _ = plan_from_document(document, with_belt)
    assert isinstance(problem.release, BeltRelease)
    assert release_document(problem.release)["belt_velocity"] == BELT["belt_velocity"]


def test_a_new_kind_is_refused_like_any_other(with_belt: Cell):
    with pytest.raises(InvalidProblem, match=r"release\.belt_velocity: has 2 entries"):
        problem_from_request({"release": {**BELT, "belt_velocity": [0.0, 0.4]}}, with_belt)
    far = {"release": {**BELT, "belt_velocity": [0.0, 3.0, 0.0]}, "release_window_s": 0.0}
    with pytest.raises(Infeasible) as refusal:
        plan(problem_from_request(far, with_belt))
    assert refusal.value.violations[0].constraint == "tcp_speed"
    nearest = refusal.value.nearest
    assert nearest["release"]["kind"] == "belt"
    assert plan(problem_from_request(nearest, with_belt)).certificate.valid


def test_the_service_describes_a_new_kind():
    subprocess.run([sys.executable, "-c", SCHEMA], check=True)

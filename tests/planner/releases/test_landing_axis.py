"""Targets that ask how the object lands: their JSON, what is refused, and the spin of their candidates."""

import numpy as np
import pytest

from planner.cell import ThrownBody, cell_of_keys
from planner.errors import InvalidProblem
from planner.flight import fly
from planner.geometry import tool_state
from planner.request import problem_from_request, release_document, request_document
from planner.rotations import pose, rotation_vector_to_matrix
from planner.seeds import candidates
from planner.spin import turned
from tests.planner.problems import cell

BODIES = {
    "rod": {"shape": "cylinder", "radius_m": 0.01, "length_m": 0.12, "drag_coefficient": 0.8},
    "brick": {"shape": "box", "size_m": [0.03, 0.05, 0.08]},
}


def _cell(name):
    return cell_of_keys({**cell().document, "object": {"mass_kg": 0.1, **BODIES[name]}})


def _request(**orientation):
    asked = {"axis": [1.0, 2.0, -1.0], "tolerance_rad": 0.3, **orientation}
    return {"release": {"kind": "target", "position": [1.1, 0.3, 0.1], "orientation": asked}}


@pytest.mark.slow
@pytest.mark.parametrize("name", BODIES)
def test_candidates_land_along_the_axis_and_on_the_target(name):
    here = _cell(name)
    thing = here.object
    assert isinstance(thing, ThrownBody)
    problem = problem_from_request(_request(), here)
    wanted = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    found = candidates(problem)
    assert len(found) > 3
    for candidate in found:
        tool = tool_state(here, candidate.q, candidate.qd)
        flight = fly(tool.p_WT, tool.v_WT, 0.1, problem.gravity, problem.drag)
        assert flight is not None
        assert flight.landing_point == pytest.approx([1.1, 0.3, 0.1], abs=1e-4)
        R_WO = tool.X_WT[:3, :3] @ thing.R_TO
        times = np.array([flight.time_of_flight_s])
        axis = turned(R_WO[None], tool.V_WT[None, 3:], thing.inertia_kg_m2, times)[0, :, 2]
        assert np.arccos(min(abs(axis @ wanted), 1.0)) < 0.2


def test_axis_has_any_length_and_turns_with_the_frame():
    here = _cell("rod")
    problem = problem_from_request(_request(), here)
    assert problem.target is not None
    assert problem.target.orientation is not None
    assert problem.target.orientation.axis_W == pytest.approx(np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0))
    assert problem.fixes_joints
    again = problem_from_request(request_document(problem, problem.release), here)
    documents = [release_document(each.release)["orientation"] for each in (again, problem)]
    assert documents[0]["axis"] == pytest.approx(documents[1]["axis"], rel=1e-12)
    assert documents[0]["tolerance_rad"] == documents[1]["tolerance_rad"] == 0.3
    X_WR = pose(np.zeros(3), rotation_vector_to_matrix([0.0, 0.0, 0.5 * np.pi]))
    turned_release = type(problem.release).from_json(_request()["release"], X_WR)
    assert turned_release.orientation.axis_W == pytest.approx(np.array([-2.0, 1.0, -1.0]) / np.sqrt(6.0))


def test_both_ends_count_alike():
    problem = problem_from_request(_request(axis=[0.0, 0.0, 1.0]), _cell("rod"))
    assert problem.target is not None
    asked = problem.target.orientation
    assert asked is not None
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [0.0, np.sin(0.1), -np.cos(0.1)]])
    assert asked.angles(axes) == pytest.approx([0.0, 0.0, 0.5 * np.pi, 0.1])


@pytest.mark.parametrize(
    ("here", "orientation", "field"),
    [
        (cell(), {}, "release.orientation"),
        (_cell("rod"), {"axis": [0.0, 0.0, 0.0]}, "release.orientation.axis"),
        (_cell("rod"), {"tolerance_rad": 0.0}, "release.orientation.tolerance_rad"),
        (_cell("rod"), {"tolerance_rad": 2.0}, "release.orientation.tolerance_rad"),
        (_cell("rod"), {"axes": [0.0, 0.0, 1.0]}, "release.orientation.axes"),
    ],
)
def test_what_cannot_be_asked_is_refused(here, orientation, field):
    with pytest.raises(InvalidProblem) as refused:
        problem_from_request(_request(**orientation), here)
    assert field in [each.field for each in refused.value.errors]

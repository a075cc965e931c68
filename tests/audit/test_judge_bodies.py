"""The audit of bodies: it finds what is wrong with flights that are judged by another place, floor, shape or axis."""

from dataclasses import replace

import numpy as np
import pytest

from audit.judge import find_faults, landing_errors
from audit.judge.body_flights import body_flight_faults, flown
from audit.judge.flights import MovingArm, ball_landing_errors
from planner import certificate
from planner.cell import Cell, cell_of_keys
from planner.planning import Plan, plan
from planner.request import problem_from_request
from tests.planner.problems import cell

ROD = {
    "shape": "cylinder",
    "mass_kg": 0.1,
    "radius_m": 0.01,
    "length_m": 0.3,
    "in_tool": {"rotation_vector_rad": [0.0, 0.5 * np.pi, 0.0]},
}
PLACE = [1.1, 0.35, 0.0]


def _cell(**surroundings) -> Cell:
    document = cell().document
    around = {**document["surroundings"], **surroundings}
    return cell_of_keys({**document, "surroundings": around, "object": ROD})


@pytest.fixture(scope="module")
def made() -> Plan:
    request = {"release": {"kind": "target", "position": PLACE}, "landing_tolerance_m": 0.05}
    return plan(problem_from_request(request, _cell()))


def _rules(made: Plan, **changed) -> set[str]:
    return {fault.rule for fault in body_flight_faults(replace(made.problem, **changed), made.trajectory)}


def test_a_certified_throw_is_faultless(made):
    assert find_faults(made.problem, made.trajectory) == []


def test_a_target_elsewhere_is_named(made):
    beside = replace(made.problem.release, p_W=np.array([1.2, 0.35, 0.0]))
    assert _rules(made, release=beside) == {"landing_window"}


def test_a_height_at_which_the_centre_would_land_is_named(made):
    """What was certified once: the centre passes a plane while the rod is far in the floor."""
    up = replace(made.problem.release, p_W=np.array([1.1, 0.35, 0.012]))
    assert "flight_clearance" in _rules(made, release=up)


def test_a_shape_that_the_end_of_the_rod_meets_is_named(made):
    post = {"shape": "cylinder", "radius_m": 0.01, "length_m": 0.1, "pose": {"position_m": [1.1, 0.35, 0.05]}}
    assert "flight_clearance" in _rules(made, cell=_cell(keep_out=[post]))


def test_a_landing_is_where_the_turned_shape_first_touches(made):
    """As the certificate tells by other means; the centre of a ball would come down centimetres farther."""
    delays = np.linspace(-0.01, 0.01, 5)
    errors = landing_errors(made.problem, made.trajectory, delays)
    assert errors == pytest.approx(certificate.landing_errors(made.problem, made.trajectory, delays), abs=6e-4)
    assert np.abs(errors - ball_landing_errors(made.problem, made.trajectory, delays)).max() > 0.01


@pytest.mark.slow
def test_a_rod_that_lands_with_one_end_over_the_edge_is_named():
    """The table is cut down to what is about the target and the rod's lowest point."""
    top_m = 0.1
    wide = {"name": "table", "lower_m": [0.7, -0.1, 0.0], "upper_m": [1.5, 0.8, top_m]}
    request = {"release": {"kind": "target", "position": [*PLACE[:2], top_m]}, "landing_tolerance_m": 0.05}
    made = plan(problem_from_request(request, _cell(keep_out=[wide])))
    assert find_faults(made.problem, made.trajectory) == []
    path = flown(made.problem, MovingArm(made.problem, made.trajectory), 0.0)
    lowest = path.outline[path.outline[:, 2].argmin()]
    ends = np.array([lowest[:2], made.problem.release.p_W[:2]])
    narrow = {
        "name": "table",
        "lower_m": [*(ends.min(axis=0) - 0.02).tolist(), 0.0],
        "upper_m": [*(ends.max(axis=0) + 0.02).tolist(), top_m],
    }
    cut = replace(made.problem, cell=_cell(keep_out=[narrow]), release_window_s=0.0)
    texts = [fault.text for fault in body_flight_faults(cut, made.trajectory)]
    assert any("what it is to land on" in text for text in texts)

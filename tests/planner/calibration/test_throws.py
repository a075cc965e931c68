"""Throws planned with arms that are 5 mm off the published table: certified, and exact by plain products."""

from __future__ import annotations

import numpy as np
import pytest

from planner.planning import plan
from planner.request import problem_from_request
from tests.planner.calibration.arms import deviated_table, measured_cell, product_of

STEP_S = 1e-6  # [s] of the differences that give the velocity of the tool
LANDED_M = 1e-6  # [m] a five-hundredth of the certificate's tolerance on the landing
RELEASED = 1e-7  # [m] a hundredth of that on the release position
RELEASED_M_S = 1e-6  # [m/s] a hundredth of that on the release velocity


def released(cell, table, q, qd):
    """Position and velocity of the tool in the world, by plain products of the table."""
    places = [(cell.X_WB @ product_of(table, q + t * qd) @ cell.tool.X_FT)[:3, 3] for t in (0.0, -STEP_S, STEP_S)]
    return places[0], (places[2] - places[1]) / (2.0 * STEP_S)


def planned(cell, request):
    found = plan(problem_from_request({"release": request}, cell))
    assert found.certificate.valid
    k = found.trajectory.release_index
    return found, found.trajectory.q[k], found.trajectory.qd[k]


@pytest.mark.parametrize("name", ["ur3e-sim", "ur5e-sim", "ur10e-sim"])
def test_a_throw_lands_on_its_target(name):
    rng = np.random.default_rng([20, len(name)])
    table = deviated_table(name.removesuffix("-sim"), rng)
    cell = measured_cell(name, table)
    target = np.array([0.7 if name == "ur3e-sim" else 1.2, 0.3, 0.0])
    found, q, qd = planned(cell, {"kind": "target", "position": target.tolist()})
    p, v = released(cell, table, q, qd)
    g = cell.surroundings.gravity_m_s2
    time = (v[2] + np.sqrt(v[2] ** 2 + 2.0 * g * (p[2] - target[2]))) / g
    assert np.abs(p[:2] + time * v[:2] - target[:2]).max() < LANDED_M
    assert found.backend == "casadi"


def test_a_requested_release_is_that_of_the_measured_arm():
    rng = np.random.default_rng(21)
    table = deviated_table("ur5e", rng)
    cell = measured_cell("ur5e-sim", table)
    q = cell.home + rng.uniform(-0.3, 0.3, 6)
    qd = rng.uniform(-1.0, 1.0, 6)
    p_WT, v_WT = released(cell, table, q, qd)
    _, *state = planned(cell, {"kind": "point", "position": p_WT.tolist(), "velocity": v_WT.tolist()})
    p, v = released(cell, table, *state)
    assert np.abs(p - p_WT).max() < RELEASED
    assert np.abs(v - v_WT).max() < RELEASED_M_S
    _, *at_rest = planned(cell, {"kind": "point", "position": p_WT.tolist(), "velocity": [0.0, 0.0, 0.0]})
    assert np.abs(released(cell, table, *at_rest)[0] - p_WT).max() < RELEASED

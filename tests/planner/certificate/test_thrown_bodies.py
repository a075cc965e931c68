"""Checks of objects that are no balls, against places and axes found by an integrator of their own."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from planner.cell import ThrownBody, cell_of_keys
from planner.certificate import certify
from planner.geometry import tool_state
from planner.planning import plan
from planner.request import problem_from_request
from tests.planner.problems import cell

ROD = {"shape": "cylinder", "mass_kg": 0.1, "radius_m": 0.01, "length_m": 0.16}
BRICK = {"shape": "box", "mass_kg": 0.1, "size_m": [0.03, 0.05, 0.08]}
ACROSS = {"in_tool": {"rotation_vector_rad": [0.0, 0.5 * np.pi, 0.0]}}
TARGET = [1.1, 0.35, 0.1]
POST = {"shape": "cylinder", "radius_m": 0.03, "length_m": 0.5, "pose": {"position_m": [1.02, 0.18, 0.25]}}
TABLE = {"lower_m": [0.95, 0.2, 0.0], "upper_m": [1.25, 0.5, 0.1]}


def _cell(keys, *shapes):
    document = cell().document
    around = {**document["surroundings"], "keep_out": list(shapes)}
    return cell_of_keys({**document, "surroundings": around, "object": keys})


def _planned(keys, *shapes, **release):
    request = {"release": {"kind": "target", "position": TARGET, **release}}
    return plan(problem_from_request(request, _cell(keys, *shapes)))


def _flown(made, at_s, until_s):
    """Returns centres (n, 3) and axes (n, 3, 3) of the body every millisecond after a release at `at_s` [s]."""
    here = made.problem.cell
    thing = here.object
    assert isinstance(thing, ThrownBody)
    q, qd, _ = (each[0] for each in made.trajectory.at(np.array([at_s])))
    tool = tool_state(here, q, qd)
    R_WO = tool.X_WT[:3, :3] @ thing.R_TO
    inertia = thing.inertia_kg_m2

    def rates(_, state):
        R = state[:9].reshape(3, 3)
        w = state[9:]
        turn = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
        return np.concatenate([(R @ turn).ravel(), np.cross(inertia * w, w) / inertia])

    s = np.arange(0.0, until_s, 1e-3)
    begin = np.concatenate([R_WO.ravel(), R_WO.T @ tool.V_WT[3:]])
    turned = solve_ivp(rates, (0.0, until_s), begin, t_eval=s, rtol=1e-9, atol=1e-9).y[:9].T.reshape(-1, 3, 3)
    centres = tool.p_WT + tool.v_WT * s[:, None] - 0.5 * 9.81 * s[:, None] ** 2 * np.array([0.0, 0.0, 1.0])
    return s, centres, turned


def _surface(keys):
    rng = np.random.default_rng(1)
    x = rng.uniform(-1.0, 1.0, (400, 3))
    if keys["shape"] == "box":
        return 0.5 * np.sign(x) * keys["size_m"]
    around = keys["radius_m"] * x[:, :2] / np.linalg.norm(x[:, :2], axis=1, keepdims=True)
    return np.column_stack(
        [around, 0.5 * keys["length_m"] * np.where(x[:, 2] > 0.5, 1.0, np.where(x[:, 2] < -0.5, -1.0, x[:, 2]))]
    )


@pytest.mark.parametrize(
    ("keys", "shapes"), [(ROD, [POST]), ({**ROD, **ACROSS}, [POST]), (ROD, [TABLE]), (BRICK, [POST])]
)
def test_flight_clearance_is_a_bound_on_that_of_the_body(keys, shapes):
    made = _planned(keys, *shapes)
    check = next(each for each in made.certificate.checks if each.name == "flight_clearance")
    (shape,) = made.problem.cell.surroundings.keep_out
    spread = made.problem.opening_spread_s
    released = made.trajectory.release_time_s
    least = np.inf
    for at_s in released + np.linspace(-spread, spread, 7):
        _, centres, axes = _flown(made, at_s, 2.0)
        x = centres[:, None] + np.einsum("nij,pj->npi", axes, _surface(keys))
        lands = int(np.argmax((x[..., 2].min(axis=1) < made.problem.carrier_z) & (centres[:, 2] < centres[0, 2])))
        if shapes == [TABLE]:  # on which it lands
            assert shape.depth(x[: lands - 1]).max() <= 0.0
        else:
            least = min(least, -float(shape.depth(x[:lands]).max()))
    assert check.ok
    assert check.value - check.limit <= least - made.problem.cell.surroundings.flight_clearance_m


@pytest.mark.parametrize("keys", [{**ROD, **ACROSS}, BRICK])
def test_landing_axis_is_that_of_the_body_at_any_instant_of_the_window(keys):
    wanted = np.array([0.0, 1.0, 1.0])
    made = _planned(keys, orientation={"axis": wanted.tolist(), "tolerance_rad": 0.35})
    check = next(each for each in made.certificate.checks if each.name == "landing_axis")
    window = made.problem.release_window_s
    worst = 0.0
    for delay in np.linspace(-window, window, 5):
        s, centres, axes = _flown(made, made.trajectory.release_time_s + delay, 2.0)
        lands = int(np.argmax((centres[:, 2] < TARGET[2]) & (s > 0.1)))
        cosine = abs(axes[lands, :, 2] @ wanted) / np.linalg.norm(wanted)
        worst = max(worst, float(np.arccos(min(cosine, 1.0))))
    assert worst - 0.02 <= check.value <= 0.35
    assert check.limit == 0.35


def test_landing_axis_off_by_more_is_no_plan():
    made = _planned(ROD)
    attitude = made.problem.with_release(
        problem_from_request(
            {
                "release": {
                    "kind": "target",
                    "position": TARGET,
                    "orientation": {"axis": _axis_beside(made), "tolerance_rad": 0.2},
                }
            },
            made.problem.cell,
        ).release
    )
    failed = [each.name for each in certify(attitude, made.trajectory).checks if not each.ok]
    assert failed == ["landing_axis"]


def _axis_beside(made):
    s, centres, axes = _flown(made, made.trajectory.release_time_s, 2.0)
    lands = int(np.argmax((centres[:, 2] < TARGET[2]) & (s > 0.1)))
    return np.cross(axes[lands, :, 2], [0.3, 0.5, 0.7]).tolist()

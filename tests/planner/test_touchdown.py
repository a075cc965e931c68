"""Where bodies first touch, against points on their surface that another integrator turns."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from planner.cell import ThrownBody, cell_of_keys
from planner.rotations import quaternion_to_matrix
from planner.touchdown import Leaving, Touchdowns
from tests.planner.problems import cell

BODIES = {
    "rod": {"shape": "cylinder", "radius_m": 0.01, "length_m": 0.4},
    "disc": {"shape": "cylinder", "radius_m": 0.08, "length_m": 0.02},
    "capsule": {"shape": "capsule", "radius_m": 0.02, "length_m": 0.1},
    "brick": {"shape": "box", "size_m": [0.03, 0.05, 0.16]},
}
GRAVITY = 9.81


def _thing(name) -> ThrownBody:
    thing = cell_of_keys({**cell().document, "object": {"mass_kg": 0.2, **BODIES[name]}}).object
    assert isinstance(thing, ThrownBody)
    return thing


def surface_points(thing: ThrownBody) -> np.ndarray:
    """Returns points on a body, its lowest among them within a twentieth of a millimetre."""
    x, y, z = 0.5 * thing.size_m
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    if thing.kind == "box":
        return np.array(np.meshgrid([-x, x], [-y, y], [-z, z])).reshape(3, -1).T
    if thing.kind == "cylinder":
        rim = np.column_stack([x * np.cos(angle), x * np.sin(angle), np.full_like(angle, z)])
        return np.concatenate([rim, rim * [1.0, 1.0, -1.0]])
    around, up = (each.ravel() for each in np.meshgrid(angle, np.linspace(0.0, 0.5 * np.pi, 46)))
    cap = x * np.column_stack([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
    cap[:, 2] += z - x
    return np.concatenate([cap, cap * [1.0, 1.0, -1.0]])


def _lowest(thing, p, v, R, w, times):
    """Returns the height of the lowest point of a body at times (n,) [m], and its axes (n, 3, 3)."""
    inertia = thing.inertia_kg_m2

    def rates(_, state):
        axes = state[:9].reshape(3, 3)
        own = state[9:]
        skew = np.array([[0.0, -own[2], own[1]], [own[2], 0.0, -own[0]], [-own[1], own[0], 0.0]])
        return np.concatenate([(axes @ skew).ravel(), np.cross(inertia * own, own) / inertia])

    begin = np.concatenate([R.ravel(), R.T @ w])
    found = solve_ivp(rates, (0.0, times[-1]), begin, t_eval=times, rtol=1e-10, atol=1e-10)
    axes = found.y[:9].T.reshape(-1, 3, 3)
    z = p[2] + v[2] * times - 0.5 * GRAVITY * times**2
    return z + (surface_points(thing) @ axes.transpose(0, 2, 1))[..., 2].min(axis=1), axes


@pytest.mark.parametrize("name", BODIES)
def test_touch_is_the_first_of_the_turned_shape(name):
    thing = _thing(name)
    rng = np.random.default_rng(7)
    count = 6
    leaving = Leaving(
        rng.uniform([-0.5, -0.5, 0.6], [0.5, 0.5, 1.2], (count, 3)),
        rng.uniform([-2.0, -2.0, -1.0], [2.0, 2.0, 3.0], (count, 3)),
        quaternion_to_matrix(rng.normal(size=(count, 4))),
        8.0 * rng.normal(size=(count, 3)),
    )
    flights = Touchdowns(thing, leaving, 0.1, False, GRAVITY, 0.0)
    for row, time_s in enumerate(flights.time_s):
        each = [part[row] for part in leaving]
        times = np.linspace(max(each[1][2], 0.0) / GRAVITY, time_s + 0.01, 600)
        lowest, axes = _lowest(thing, *each, times)
        first = times[int(np.argmax(lowest < 0.1))]
        assert time_s == pytest.approx(first, abs=4e-3)
        assert lowest[times < time_s - 1e-6].min() > 0.1 - 1e-6
        assert flights.axes_at(flights.time_s)[row] == pytest.approx(axes[int(np.argmax(times >= time_s))], abs=0.02)


def test_a_body_that_is_not_wholly_above_at_its_apex_does_not_land():
    thing = _thing("rod")
    upright = Leaving(np.array([[0.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 2.0]]), np.eye(3)[None], np.zeros((1, 3)))
    flights = Touchdowns(thing, upright, 0.1, False, GRAVITY, 0.0)  # its apex is 0.204 m up, its lower end 0.004 m
    assert np.isnan(flights.time_s[0])
    lower = Touchdowns(thing, upright, -0.1, False, GRAVITY, 0.0)
    assert lower.lowest(np.array([0]), lower.time_s)[0] == pytest.approx(-0.1, abs=1e-6)


def test_in_the_air_the_centre_passes():
    thing = _thing("rod")
    upright = Leaving(np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]]), np.eye(3)[None], np.zeros((1, 3)))
    flights = Touchdowns(thing, upright, 0.5, True, GRAVITY, 0.0)
    assert flights.time_s[0] == pytest.approx(np.sqrt(1.0 / GRAVITY))

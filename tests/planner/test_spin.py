"""Free rotation against independent integrators, and against what it conserves."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from planner.rotations import quaternion_to_matrix
from planner.spin import FASTEST, STEP_RAD, Rotation, growth, precession, round_axis, turned

BODIES = {
    "rod": [1.2, 1.2, 0.05],
    "rod along x": [0.05, 1.2, 1.2],
    "disc": [1.0, 1.0, 1.9],
    "ball": [1.0, 1.0, 1.0],
    "brick": [1.0, 2.0, 2.5],
    "brick about its middle axis": [2.0, 1.0, 2.8],
}


def _states(seed: int, count: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    turned_by = quaternion_to_matrix(rng.normal(size=(count, 4)))
    return turned_by, 5.0 * rng.normal(size=(count, 3)), rng.uniform(0.2, 1.0, count)


@pytest.mark.parametrize("name", BODIES)
def test_rotation_is_that_of_an_integrator_of_high_order(name):
    inertia = np.array(BODIES[name])
    R_WO, w_W, times = _states(1)

    def rates(_, state):
        R = state[:9].reshape(3, 3)
        w = state[9:]
        return np.concatenate([(R @ _skew(w)).ravel(), np.cross(inertia * w, w) / inertia])

    found = turned(R_WO, w_W, inertia, times)
    for row, R in enumerate(R_WO):
        begin = np.concatenate([R.ravel(), R.T @ w_W[row]])
        state = solve_ivp(rates, (0.0, times[row]), begin, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        assert np.abs(state[:9].reshape(3, 3) - found[row]).max() < 1e-7


def _skew(w):
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


@pytest.mark.parametrize("name", ["rod", "brick"])
def test_rotation_is_that_of_mujoco(name):
    inertia = np.array(BODIES[name])
    R_WO, w_W, _ = _states(2, 1)
    moments = " ".join(map(str, inertia))
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><option gravity="0 0 0" timestep="0.0002" integrator="RK4"/><worldbody><body><freejoint/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="{moments}"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mju_mat2Quat(data.qpos[3:7], R_WO[0].ravel())
    data.qvel[3:6] = R_WO[0].T @ w_W[0]
    while data.time < 0.5 - 1e-9:
        mujoco.mj_step(model, data)
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, data.qpos[3:7])
    found = turned(R_WO, w_W, inertia, np.array([data.time]))[0]
    assert np.abs(R.reshape(3, 3) - found).max() < 1e-6


@pytest.mark.parametrize("name", ["rod", "rod along x", "disc"])
def test_axis_of_a_round_body_turns_about_its_angular_momentum(name):
    inertia = np.array(BODIES[name])
    axis = round_axis(inertia)
    assert axis is not None
    R_WO, w_W, times = _states(3)
    u = R_WO[:, :, axis]
    across = np.delete(inertia, axis)[0]
    momentum = np.einsum("nij,j,nkj,nk->ni", R_WO, inertia, R_WO, w_W)
    assert precession(u, w_W, inertia[axis] / across) == pytest.approx(momentum / across)
    later = turned(R_WO, w_W, inertia, times)[:, :, axis]
    assert (later * momentum).sum(axis=1) == pytest.approx((u * momentum).sum(axis=1))


ODD = {
    "nearly a rod": [1.2, 1.2 * (1.0 + 1e-6), 0.05],
    "nearly a needle": [1.0, 1.0 + 1e-8, 1e-8],
    "a needle with a twist": [1.0, 1.0 + 9e-7, 1e-6],
    "a plate": [1.0, 2.0, 3.0],
    "nearly a ball": [1.0, 1.0 + 1e-7, 1.0 + 2e-7],
}


@pytest.mark.parametrize("name", [*BODIES, *ODD])
def test_no_body_turns_much_faster_than_it_began_nor_takes_more_steps(name):
    inertia = np.array((BODIES | ODD)[name])
    R_WO, w_W, _ = _states(5, 12)
    rotation = Rotation(R_WO, w_W, inertia, 1.0)
    most = FASTEST * float(np.linalg.norm(w_W, axis=1).max())
    if round_axis(inertia) is None:
        rates = np.linalg.norm(rotation._states[:, 4:], axis=1)
        assert (rates <= FASTEST * rates[0] + 1e-9).all()
        assert len(rotation._states) <= most / STEP_RAD + 2


@pytest.mark.parametrize("name", ["nearly a rod", "nearly a ball"])
def test_nearly_round_bodies_turn_as_round_ones(name):
    inertia = np.array(ODD[name])
    even = np.array([inertia[0], inertia[0], inertia[2] if name == "nearly a rod" else inertia[0]])
    R_WO, w_W, times = _states(6)
    assert turned(R_WO, w_W, inertia, times) == pytest.approx(turned(R_WO, w_W, even, times), abs=1e-3)


@pytest.mark.parametrize("name", [*BODIES, *ODD])
def test_growth_bounds_what_a_change_of_spin_does(name):
    inertia = np.array((BODIES | ODD)[name])
    R_WO, w_W, _ = _states(8, 24)
    times = np.full(24, 0.4)
    rng = np.random.default_rng(9)
    change = rng.normal(size=w_W.shape)
    change *= 1e-6 / np.linalg.norm(change, axis=1, keepdims=True)
    apart = turned(R_WO, w_W + change, inertia, times) - turned(R_WO, w_W, inertia, times)
    angle = np.linalg.norm(apart, axis=(1, 2)) / np.sqrt(2.0)
    most = float(np.linalg.norm(w_W, axis=1).max())
    assert angle.max() <= 1e-6 * growth(inertia, most, 0.4) * (1.0 + 1e-3)


def test_growth_of_nearly_round_bodies_is_nearly_theirs():
    round_one = growth(np.array([1.2, 1.2, 0.05]), 8.0, 0.5)
    assert growth(np.array(ODD["nearly a rod"]), 8.0, 0.5) < 12.0 * round_one


def test_growth_over_an_endless_flight_is_no_fault():
    """Its bound passes the greatest float: first by the ratio of the scales, at some of these times."""
    inertia = np.array([1.0, 1.5, 2.0])
    with np.errstate(over="raise"):
        bounds = [growth(inertia, 0.5, s) for s in np.linspace(500.0, 5000.0, 1000)]
    assert bounds == sorted(bounds)
    assert bounds[-1] == np.inf

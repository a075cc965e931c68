"""Symbolic formulas against the numerical ones, which have their own tests, and derivatives against differences."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner import flight
from planner.backends.casadi_nlp import Margins, functions, layout, transcription
from planner.backends.casadi_nlp.flight_rows import edge_across, edge_at
from planner.backends.casadi_nlp.instance import stage_layout
from planner.backends.casadi_nlp.margins import LINKS
from planner.backends.casadi_nlp.parameters import (
    arm_parameters,
    nearest_shapes,
    room_parameters,
    scale_parameters,
    shape_parameters,
    variable_scales,
)
from planner.backends.casadi_nlp.symbols import FLIGHT_ROWS, LEAVING_ROWS, RELEASE_ROWS, passing
from planner.backends.casadi_nlp.symbols.distances import WIDTH
from planner.backends.casadi_nlp.symbols.rows import LEAVING_SHARES
from planner.cell import AllowedContact, Box, Cell, Solid, load_cell, shape_of
from planner.certificate.certificate import at_least
from planner.dynamics import Payload, joint_torques
from planner.geometry import (
    SELF_CLEARANCE_M,
    body_capsules,
    capsule_endpoints,
    segment_segment_distance,
    segment_shape_distance,
    self_collision_pairs,
    tool_state,
)
from planner.kinematics import forward, jacobian, tcp_acceleration
from planner.request import problem_from_request
from planner.robots import ROBOT_NAMES, robot
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.backends import whole_problem

CELLS = Path(__file__).parents[3] / "cells"
NO_MARGINS = Margins(torque=1.0, tcp_speed=1.0, floor_m=0.0, self_m=0.0, keep_in_m=0.0, shape_m=0.0, singularity=1.0)
SCALES = scale_parameters(load_cell(CELLS / "ur10e-sim.toml").limits, 0.02)  # differ from joint to joint
LANDING_S = 0.6  # [s] when a flight past the arm ends
SPREAD_S = 0.004  # [s] that the gripper may open early or late
EXPECTED_SPEED = 1.5  # [m/s] across an edge's plane
TURNED = np.array([[0.0, -0.6, 0.8, 0.3], [1.0, 0.0, 0.0, -0.2], [0.0, 0.8, 0.6, 0.5], [0.0, 0.0, 0.0, 1.0]])


@pytest.fixture(params=ROBOT_NAMES)
def cell(request: pytest.FixtureRequest) -> Cell:
    """Each arm, on a tilted base."""
    plain = load_cell(CELLS / "ur5e-sim.toml")
    arm = robot(request.param)
    limits = replace(plain.limits, qd_max=np.minimum(plain.limits.qd_max, arm.qd_max), tau_max=arm.tau_max)
    return replace(plain, robot=arm, limits=limits, X_WB=TURNED)


def _state(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-3, 3, 6)
    qd = rng.uniform(-2, 2, 6)
    qdd = rng.uniform(-10, 10, 6)
    z = np.concatenate([q, qd, qdd, np.zeros(8)]) / variable_scales(SCALES)
    return q, qd, qdd, z


def _blocks() -> dict[str, functions.Block]:
    """Returns what requests are solved with."""
    return functions.all_blocks()


def _rows(block: str, z: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.array(_blocks()[block].value(z, np.concatenate([SCALES, p]))).ravel()


def test_torques_of_every_arm(cell: Cell) -> None:
    q, qd, qdd, z = _state(1)
    p_FT = cell.tool.X_FT[:3, 3]
    tool = cell.tool.mass_kg
    thing = cell.object.mass_kg
    apart = tool * thing / (tool + thing) / 4.0
    payload = Payload(
        tool + thing,
        (tool / 2 + thing) / (tool + thing) * p_FT,
        apart * (p_FT @ p_FT * np.eye(3) - np.outer(p_FT, p_FT)),
    )
    gravity_B = cell.X_WB[:3, :3].T @ [0.0, 0.0, -cell.surroundings.gravity_m_s2]
    expected = joint_torques(cell.robot, q, qd, qdd, gravity_B, payload)
    rows = _rows("effort", z, arm_parameters(cell, cell.limits, NO_MARGINS))
    assert rows[:6] * cell.limits.tau_max == pytest.approx(expected, abs=1e-9)


def test_tool_speed_and_clearances(cell: Cell) -> None:
    q, qd, _, z = _state(2)
    p = arm_parameters(cell, cell.limits, NO_MARGINS)
    v = jacobian(cell.robot, q, cell.tool.X_FT)[:3] @ qd
    assert _rows("effort", z, p)[6] * cell.limits.tcp_speed_max**2 == pytest.approx(v @ v)
    assert _rows("clearance", z, p)[0] == pytest.approx(_self_distance(cell, q) - SELF_CLEARANCE_M, abs=0.006)


def _self_distance(cell: Cell, q: np.ndarray) -> float:
    """Least distance of the pairs in the optimiser's formula: all but the foot's and the elbow's with the base."""
    capsules = body_capsules(cell.robot, cell.tool.capsules)
    ends = capsule_endpoints(cell.robot, capsules, q)
    slots = {(i + 1, j + 1) for i, j in layout.PAIRS}
    gaps = [
        float(segment_segment_distance(ends[i, 0], ends[i, 1], ends[j, 0], ends[j, 1]))
        - capsules[i].radius_m
        - capsules[j].radius_m
        for i, j in self_collision_pairs(cell.robot, cell.tool.capsules)
        if (i, j) in slots
    ]
    return min(gaps)


def test_soft_distances_are_never_larger_than_the_true_ones() -> None:
    cell = load_cell(CELLS / "ur5e-sim.toml")
    p = arm_parameters(cell, cell.limits, NO_MARGINS)
    for seed in range(40):
        q, _, _, z = _state(seed)
        assert _rows("clearance", z, p)[0] <= _self_distance(cell, q) - SELF_CLEARANCE_M + 1e-6


def test_release_rows(cell: Cell) -> None:
    q, qd, qdd, z = _state(3)
    target = np.array([1.0, 0.5, -3.0])
    release = layout.RELEASE.pack({"target": target, "gravity_z": 9.81, "tan_elevation": 0.0})
    p = np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), release])
    rows = RELEASE_ROWS.split(_rows("release", z, p))
    R_WB = cell.X_WB[:3, :3]
    place = (cell.X_WB @ forward(cell.robot, q, cell.tool.X_FT))[:3, 3]
    v = R_WB @ (jacobian(cell.robot, q, cell.tool.X_FT) @ qd)[:3]
    a = R_WB @ tcp_acceleration(cell.robot, q, qd, qdd, cell.tool.X_FT)[:3]
    assert rows["position"] == pytest.approx(place)
    assert rows["velocity"] == pytest.approx(v)
    flown = flight.fly(place, v, target[2], 9.81)
    assert flown is not None
    assert rows["landing"] == pytest.approx((flown.landing_point - target)[:2], abs=1e-5)
    drift = flight.landing_per_release_delay(place, v, a, target[2], 9.81)
    assert rows["drift"] == pytest.approx(drift[:2], abs=1e-4)


LAYOUTS = (
    layout.StageLayout(),
    layout.StageLayout(9, 5, window=1, groups=layout.LAZY_GROUPS, shapes=4),
    layout.StageLayout(8, 3, groups=("flight", "passing"), aims=True),
    layout.StageLayout(8, 3, groups=("leaving",), aims=True),
    layout.StageLayout(10, 5, window=2, groups=("leaving", "passing"), aims=True),
    layout.StageLayout(8, 3, groups=("standing",), aims=True),
    layout.StageLayout(8, 3, groups=("keep_out",), shapes=1),
    layout.StageLayout(8, 0, groups=("effort",)),
)


@pytest.mark.parametrize("stages", LAYOUTS)
def test_derivatives_of_the_whole_problem(stages: layout.StageLayout) -> None:
    cell = load_cell(CELLS / "ur5e-sim.toml")
    index = transcription.RowIndex(stages, _blocks())
    assembled = whole_problem.assemble(index)
    rng = np.random.default_rng(5)
    x = rng.normal(size=(stages.stages + 1, layout.NZ)) * 0.4
    x[:, layout.STEP] = rng.uniform(0.2, 0.6, stages.stages + 1)
    x = np.append(x.ravel()[: index.core], rng.normal(size=index.variables - index.core) * 0.4)
    release = layout.RELEASE.pack({"target": [1, 0, -2], "gravity_z": 9.81, "tan_elevation": [0.1, 1.0]})
    costs = np.tile([1.0, 1e-3, 1e-2, 0.4], stages.stages)
    arm = arm_parameters(cell, cell.limits, NO_MARGINS)
    path = _object_path()[1]
    p = np.concatenate(
        [SCALES, arm, release, shape_parameters(cell, ()), _flight_parameters(), path, _standing(), _rooms(), costs]
    )
    along = rng.normal(size=x.size)
    step = 1e-6

    def difference(name: str) -> np.ndarray:
        ahead, behind = (np.array(assembled[name](x + s * along, p)) for s in (step, -step))
        return (ahead - behind).ravel() / (2 * step)

    jac = assembled["jac_g"](x, p)[1]
    assert np.array(jac @ along).ravel() == pytest.approx(difference("g"), abs=1e-5)
    slope = np.array(assembled["grad_f"](x, p)).ravel()
    assert slope @ along == pytest.approx(float(difference("f")[0]), rel=1e-6)
    lam = _smooth_multipliers(index, rng)
    gradient, hessian = assembled["hess_l"](x, p, 1.0, lam)
    assert np.array(gradient).ravel() == pytest.approx(slope + np.array(jac.T @ lam).ravel())
    ends = [np.array(assembled["hess_l"](x + s * along, p, 1.0, lam)[0]).ravel() for s in (step, -step)]
    assert np.array(hessian @ along).ravel() == pytest.approx((ends[0] - ends[1]) / (2 * step), abs=1e-5, rel=1e-8)


def _flight_parameters() -> np.ndarray:
    """An edge that crosses x = 0.9 above 0.5, one at a fixed time, a bin's mouth and an opening along y."""
    edges = np.tile(edge_at(0.0, (0.0, 0.0, 0.0), -1.0), (layout.FLIGHT_EDGES, 1))
    edges[0] = edge_across(0, 0.9, EXPECTED_SPEED, (0.0, 0.0, 1.0), 0.5)
    edges[3] = edge_at(0.2, (0.6, 0.0, 0.8), 0.2)
    mouth = [1.5, 0.5, -1.0, 0.1, 0.03]
    opening = [0.0, 1.0, 0.0, 0.3, 0.02]
    return layout.FLIGHT.pack({"edges": edges, "mouth": mouth, "spread": [SPREAD_S], "opening": opening})


def test_flight_rows(cell: Cell) -> None:
    q, qd, qdd, z = _state(6)
    release = layout.RELEASE.pack({"target": [1.0, 0.5, -3.0], "gravity_z": 9.81, "tan_elevation": 0.0})
    p = np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), release, _flight_parameters()])
    rows = FLIGHT_ROWS.split(_rows("flight", z, p))
    X_WF = cell.X_WB @ forward(cell.robot, q)
    place = (X_WF @ cell.tool.X_FT)[:3, 3]
    R_WB = cell.X_WB[:3, :3]
    v = R_WB @ (jacobian(cell.robot, q, cell.tool.X_FT) @ qd)[:3]
    a = R_WB @ tcp_acceleration(cell.robot, q, qd, qdd, cell.tool.X_FT)[:3]
    for which, late_s in enumerate((-SPREAD_S, SPREAD_S)):
        at = place + late_s * v + late_s**2 / 2 * a
        speed = v + late_s * a
        edges = rows["edges"].reshape(2, -1)[which]
        crossing = max((0.9 - at[0]) / speed[0], 0.0)
        times = sorted([crossing, 0.2])
        over, later = flight.path(at, speed, times, 9.81)[[int(crossing > 0.2), int(crossing <= 0.2)]]
        scale = (speed[0] / EXPECTED_SPEED) ** 2
        assert edges[0] == pytest.approx(scale * (over[2] - 0.5), abs=0.03)  # its time is rounded near the release
        assert edges[3] == pytest.approx(later @ [0.6, 0.0, 0.8] - 0.2, abs=1e-3)
        assert edges[[1, 2, 4, 5, 6, 7]] == pytest.approx(1.0)
        flown = flight.fly(at, speed, -1.0, 9.81)
        assert flown is not None
        w = flown.landing_velocity
        thick = 0.03 * np.linalg.norm(w) / -w[2]
        off = float(np.linalg.norm(flown.landing_point[:2] - [1.5, 0.5]))
        assert rows["mouth"][which] == pytest.approx(0.1 - thick - off, abs=1e-4)
    leaving = -a - [0.0, 0.0, 9.81]
    assert rows["opening"] == pytest.approx(leaving @ X_WF[:3, 1] / np.linalg.norm(leaving) - 0.3, abs=0.01)


def _object_path() -> tuple[np.ndarray, np.ndarray]:
    """A flight past the arm, as release position and velocity (2, 3), and as parameters."""
    p = np.array([0.2, 0.1, 0.4])
    v = np.array([-0.8, 0.3, 2.0])
    path = [*p, *v, 0.0, 0.0, -9.81 / 2.0, *np.zeros(6)]
    numbers = {"path": path, "landing": LANDING_S, "lands": 0.0, "ground": 0.0, "gravity": 9.81}
    numbers |= {"fall": 9.81, "reach": 0.05, "share": 0.9}
    return np.stack([p, v]), layout.OBJECT_PATH.pack(numbers)


def _standing() -> np.ndarray:
    """The parameters of an upright and a leaning capsule that objects keep off."""
    capsules = [0.1, -0.2, 0.0, 0.1, -0.2, 0.3, 0.08, 0.4, 0.1, 0.1, 0.6, 0.3, 0.5, 0.05]
    return layout.STANDING.pack({"capsules": capsules, "reach": 0.02, "ground": -3.0, "gravity": 9.81, "share": 0.9})


def _distance_from_links(cell: Cell, q: np.ndarray, x: np.ndarray) -> float:
    """Least distance [m] of points (n, 3) in the world from the links that joints move."""
    capsules = body_capsules(cell.robot, cell.tool.capsules)
    ends = cell.X_WB[:3, :3] @ capsule_endpoints(cell.robot, capsules, q)[..., None] + cell.X_WB[:3, 3:]
    moving = slice(2, 2 + len(LINKS))
    assert {c.name for c in capsules[moving]} == LINKS
    pairs = zip(ends[moving, ..., 0], capsules[moving], strict=True)
    return min(
        float(segment_segment_distance(at, at, start, end)) - capsule.radius_m
        for (start, end), capsule in pairs
        for at in x
    )


@pytest.mark.slow
@pytest.mark.parametrize("with_states", [False, True])
@pytest.mark.parametrize(("block", "share"), [("passing", 0.0), ("passing_middle", 0.5), ("passing_at_rest", 0.0)])
def test_room_between_a_flight_and_the_braking_arm(cell: Cell, block: str, share: float, with_states: bool) -> None:
    """The object's position and velocity at the release are variables, or part of the path."""
    (p, v), parameters = _object_path()
    c = layout.SCALES.split(SCALES)
    step = 0.004
    since_release = 0.15
    if with_states:
        parameters[layout.OBJECT_PATH.slices["path"]][:6] = 0.0
    for seed in range(8):
        q, qd, qdd, z = _state(seed)
        z[layout.TIME] = since_release / c["time"][0]
        z[layout.STEP] = step / c["time"][0]
        z = np.concatenate([z, p, v] if with_states else [z, np.zeros(layout.N_THROWN)])
        h = share * step
        at_rest = np.arange(since_release - passing.AT_REST_S, 0.6, 0.004)
        flown = flight.path(p, v, at_rest if block == "passing_at_rest" else [since_release + h], 9.81)
        expected = _distance_from_links(cell, q + h * qd + h**2 / 2.0 * qdd, flown) - 0.05
        row = _rows(block, z, np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), parameters]))
        assert expected - 0.008 < row < expected + 0.004


def test_the_object_is_released_with_its_share_of_the_tool_s_speed(cell: Cell) -> None:
    q, qd, qdd, z = _state(4)
    c = layout.SCALES.split(SCALES)
    step = 0.02
    jerk = np.array([60.0, -40.0, 30.0, 50.0, -20.0, 10.0])
    z[layout.JERK] = jerk / c["jerk"]
    z[layout.STEP] = step / c["time"][0]
    rows = _rows("thrown", z, np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), _object_path()[1]]))
    q = q + step * (qd + step * (qdd / 2.0 + step * jerk / 6.0))
    qd = qd + step * (qdd + step * jerk / 2.0)
    tool = tool_state(cell, q, qd)
    assert rows[:3] == pytest.approx(tool.p_WT)
    assert rows[3:] == pytest.approx(0.9 * tool.v_WT)


@pytest.mark.parametrize("factor", [1.0, 0.8])
def test_the_way_out_of_the_grip(cell: Cell, factor: float) -> None:
    """It has the tool's own speed, however much faster the object flies then: see `gravity_at_tool_speed`."""
    q, qd, qdd, z = _state(6)
    flights = {"target": [1.0, 0.5, -3.0], "gravity_z": 9.81 / factor**2, "tan_elevation": 0.0}
    release = layout.RELEASE.pack(flights)
    p = np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), release, _flight_parameters()])
    row = FLIGHT_ROWS.split(_rows("flight", z, p))["out"]
    R_WB = cell.X_WB[:3, :3]
    g = np.array([0.0, 0.0, -9.81])
    felt = g - R_WB @ tcp_acceleration(cell.robot, q, qd, qdd, cell.tool.X_FT)[:3]
    s = np.sqrt(2.0 * 0.02 / np.hypot(np.linalg.norm(felt), 9.81))
    arm = cell.X_WB @ forward(cell.robot, np.stack([q, q + s * qd + s**2 / 2.0 * qdd]), cell.tool.X_FT)
    v = R_WB @ (jacobian(cell.robot, q, cell.tool.X_FT) @ qd)[:3]
    moved = arm[0, :3, 3] + s * v + s**2 / 2.0 * g - arm[1, :3, 3]
    opening = (arm[1, :3, :3] @ cell.tool.X_FT[:3, :3].T)[:, 1]
    assert np.linalg.norm(moved) == pytest.approx(0.015, abs=0.005)
    assert row == pytest.approx(moved @ opening / np.linalg.norm(moved) - 0.3, abs=0.02)


@pytest.mark.parametrize("with_states", [False, True])
@pytest.mark.parametrize("ago_s", [0.0, 0.012])
def test_an_object_is_followed_out_of_the_grip(cell: Cell, with_states: bool, ago_s: float) -> None:
    """Its place against the tool at shares of the step, by the motion of both; it has the tool's own speed."""
    q, qd, qdd, z = _state(6)
    step = 0.03
    jerk = np.array([60.0, -40.0, 30.0, 50.0, -20.0, 10.0])
    c = layout.SCALES.split(SCALES)
    z[layout.TIME] = ago_s / c["time"][0]  # since the release
    z[layout.JERK] = jerk / c["jerk"]
    z[layout.STEP] = step / c["time"][0]

    def moved_by(s: float) -> np.ndarray:
        return q + s * (qd + s * (qdd / 2.0 + s * jerk / 6.0))

    then = moved_by(-ago_s), qd - ago_s * (qdd - ago_s * jerk / 2.0)
    place = forward(cell.robot, then[0], cell.tool.X_FT)
    v = jacobian(cell.robot, then[0], cell.tool.X_FT) @ then[1]
    place = (cell.X_WB @ place)[:3, 3]
    v = cell.X_WB[:3, :3] @ v[:3]
    thrown = np.concatenate([place, 0.9 * v])
    parameters = _object_path()[1]
    parameters[layout.OBJECT_PATH.slices["path"]][:6] = 0.0 if with_states else thrown
    p = np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), _flight_parameters(), parameters])
    rows = LEAVING_ROWS.split(_rows("leaving", np.append(z, thrown if with_states else np.zeros(6)), p))
    for row, share in zip(rows["ways"], LEAVING_SHARES, strict=True):
        s = share * step
        tool = cell.X_WB @ forward(cell.robot, moved_by(s), cell.tool.X_FT)
        since = s + ago_s
        apart = place + since * v - since**2 / 2.0 * np.array([0.0, 0.0, 9.81]) - tool[:3, 3]
        opening = (tool[:3, :3] @ cell.tool.X_FT[:3, :3].T)[:, 1]
        size = np.linalg.norm(apart)
        cosine = apart @ opening / size - 0.3
        if 0.001 <= size <= 0.02:
            assert row == pytest.approx(cosine, abs=0.05)
        else:  # at its place, or out
            assert row > cosine - 1e-6
        if size < 0.0004 or size > 0.03:
            assert row > 0.0
    assert rows["is_out"] == pytest.approx(size / 0.02 - 1.0, abs=1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_room_between_a_flight_and_what_never_moves(cell: Cell, seed: int) -> None:
    q, qd, _, z = _state(seed)
    row = _rows("standing", z, np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), _standing()]))
    tool = tool_state(cell, q, qd)
    flown = flight.fly(tool.p_WT, 0.9 * tool.v_WT, -3.0, 9.81)
    assert flown is not None
    x = flight.path(tool.p_WT, 0.9 * tool.v_WT, np.linspace(0.0, flown.time_of_flight_s, 400), 9.81)
    capsules = layout.STANDING.split(_standing())["capsules"].reshape(-1, 7)
    gap = min(float(segment_segment_distance(at, at, c[:3], c[3:6])) - c[6] for c in capsules for at in x)
    sagitta = 9.81 * (flown.time_of_flight_s / layout.CHORDS) ** 2 / 8.0
    assert row == pytest.approx(gap - 0.02, abs=sagitta + 0.005)


def test_a_jerk_of_one_moves_a_joint_less_than_once_around_in_the_longest_initial_step() -> None:
    limits = replace(load_cell(CELLS / "ur5-sim.toml").limits, jerk_max=np.full(6, 8e3))
    for step in (0.01, 0.1, 0.6):
        scale = layout.SCALES.split(scale_parameters(limits, step))["jerk"]
        assert np.all(scale <= limits.jerk_max)
        assert np.all(scale * step**3 / 6.0 < 2.0 * np.pi)
    assert layout.SCALES.split(scale_parameters(limits, 1e-3))["jerk"] == pytest.approx(limits.jerk_max)


def test_grip_rows(cell: Cell) -> None:
    held = replace(cell, gripper=replace(cell.gripper, hold_acceleration_m_s2=np.array([40.0, 30.0, 50.0])))
    q, qd, qdd, z = _state(7)
    rows = _rows("grip", z, arm_parameters(held, held.limits, NO_MARGINS))
    R_BT = (forward(cell.robot, q) @ cell.tool.X_FT)[:3, :3]
    a_B = tcp_acceleration(cell.robot, q, qd, qdd, cell.tool.X_FT)[:3]
    expected = R_BT.T @ (a_B + cell.X_WB[:3, :3].T @ [0.0, 0.0, 9.81])
    assert rows[:3] * [40.0, 30.0, 50.0] == pytest.approx(expected, abs=1e-9)
    assert rows[3] < 1e-3
    every_way = replace(cell, gripper=replace(cell.gripper, hold_acceleration_m_s2=np.array([40.0])))
    rows = _rows("grip", z, arm_parameters(every_way, held.limits, NO_MARGINS))
    assert rows[3] * 40.0**2 == pytest.approx(expected @ expected)


@pytest.mark.parametrize("boxes", layout.SHAPE_SLOTS)
def test_fewer_slots_for_boxes_give_the_same_distance(boxes: int) -> None:
    plain = load_cell(CELLS / "ur5e-sim.toml")
    near = [Box(np.array([0.3, -0.2 + k, 0.1]), np.array([0.5, 0.3 + k, 0.6])) for k in range(boxes)]
    placed = tuple(reversed(near))  # the nearest takes the last slot
    cell = replace(plain, surroundings=replace(plain.surroundings, keep_out=placed))
    every = shape_parameters(cell, tuple(range(boxes)))
    p = np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), every])
    name = layout.StageLayout(groups=("keep_out",), shapes=boxes).function("keep_out")
    assert name == ("keep_out" if boxes == layout.KEEP_OUT_SHAPES else f"keep_out_{boxes}")
    for seed in range(5):
        *_, z = _state(seed)
        assert _rows(name, z, p) == pytest.approx(_rows("keep_out", z, p), abs=1e-12)


def _placed(p: list[float], turn: list[float]) -> np.ndarray:
    return pose(np.array(p), rotation_vector_to_matrix(turn))


NEAR_SHAPES = {
    "table": Box(np.array([-1.0, -1.0, -0.5]), np.array([1.0, 1.0, 0.02])),
    "wall": Box(np.array([0.35, -1.0, 0.0]), np.array([0.45, 1.0, 0.8])),
    "post": Box(np.array([0.3, 0.1, 0.0]), np.array([0.34, 0.14, 0.6])),
    "turned wall": shape_of("box", _placed([0.4, 0.1, 0.4], [0.2, 0.1, 0.6]), np.array([0.1, 0.9, 0.6])),
    "cylinder": shape_of("cylinder", _placed([0.35, 0.1, 0.3], [0.0, 0.0, 0.0]), np.array([0.05, 0.6])),
    "turned cylinder": shape_of("cylinder", _placed([0.4, 0.2, 0.3], [0.6, 0.3, 0.0]), np.array([0.15, 0.3])),
    "disc": shape_of("cylinder", _placed([0.6, 0.2, 0.3], [0.3, 0.0, 0.0]), np.array([0.35, 0.02])),
    "sphere": shape_of("sphere", _placed([0.4, 0.1, 0.4], [0.0, 0.0, 0.0]), np.array([0.15, 0.0])),
    "capsule": shape_of("capsule", _placed([0.4, 0.1, 0.4], [0.5, 0.9, 0.0]), np.array([0.08, 0.5])),
}


@pytest.mark.parametrize("name", NEAR_SHAPES)
def test_the_room_beside_a_shape_is_never_more_than_there_is(name: str) -> None:
    """Where links are nearly parallel to its faces, too: their nearest points are hard to find."""
    plain = load_cell(CELLS / "ur5e-sim.toml")
    shape = NEAR_SHAPES[name]
    cell = replace(plain, surroundings=replace(plain.surroundings, keep_out=(shape,), clearance_m=0.0))
    p = np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), shape_parameters(cell, (0,))])
    rng = np.random.default_rng(1)
    near = 0
    while near < 60:
        q = rng.uniform(-3.0, 3.0, 6)
        q[[1, 3]] = rng.choice([-np.pi, -np.pi / 2, 0.0, np.pi / 2], 2) + rng.normal(0.0, 0.03, 2)
        room = _distance_from(cell, q, shape)
        if 0.0 < room < 0.1:
            near += 1
            assert _rows("keep_out_1", np.concatenate([q, np.zeros(layout.NZ - 6)]), p) < room + 5e-4


def test_what_may_touch_a_shape_has_no_part_in_its_row() -> None:
    """The row of all parts is the soft minimum of those of each alone, without the ones that may touch."""
    plain = load_cell(CELLS / "ur5e-sim.toml")
    plain = replace(plain, surroundings=replace(plain.surroundings, keep_out=(NEAR_SHAPES["wall"],), clearance_m=0.0))
    parts = [*(name for name in layout.ARM_CAPSULES if name != "base"), "tool_0", "object"]

    def row(free: set[str], z: np.ndarray) -> float:
        contacts = tuple(AllowedContact(name, "box 0", ("box 0",)) for name in sorted(free))
        cell = replace(plain, surroundings=replace(plain.surroundings, may_touch=contacts))
        p = np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), shape_parameters(cell, (0,))])
        return float(_rows("keep_out_1", z, p)[0])

    for seed in range(3):
        *_, z = _state(seed)
        alone = {name: row(set(parts) - {name}, z) for name in parts}
        nearest = min(alone, key=lambda name: alone[name])
        for free in (set(), {nearest}, {nearest, "object", "elbow"}):
            kept = np.array([alone[name] for name in parts if name not in free])
            least = float(kept.min())
            soft = least - WIDTH * np.log(np.exp((least - kept) / WIDTH).sum())
            assert row(free, z) == pytest.approx(soft, abs=1e-9)


ROOM_SHAPES = (
    shape_of("box", _placed([0.1, 0.0, 0.4], [0.4, 0.2, 0.5]), np.array([1.5, 1.4, 1.3])),
    shape_of("cylinder", _placed([0.0, 0.1, 0.4], [0.3, 0.1, 0.0]), np.array([0.75, 1.4]), "", 0.03),
    shape_of("sphere", _placed([0.0, 0.0, 0.3], [0.0, 0.0, 0.0]), np.array([0.8, 0.0])),
    shape_of("capsule", _placed([0.0, 0.0, 0.4], [0.2, 0.9, 0.0]), np.array([0.65, 0.5]), "", 0.01),
    shape_of("sphere", _placed([0.0, 0.0, 0.3], [0.0, 0.0, 0.0]), np.array([9.0, 0.0])),  # too wide to be met
)


def _rooms() -> np.ndarray:
    plain = load_cell(CELLS / "ur5e-sim.toml")
    cell = replace(plain, surroundings=replace(plain.surroundings, keep_in=ROOM_SHAPES))
    return room_parameters(cell, plain.home[None], 0.0)


@pytest.mark.parametrize("chosen", [(0,), (1,), (2,), (3,), (0, 1, 2, 3, 4)])
def test_the_room_within_walls_is_never_more_than_there_is(chosen: tuple[int, ...]) -> None:
    plain = load_cell(CELLS / "ur5e-sim.toml")
    shapes = tuple(ROOM_SHAPES[i] for i in chosen)
    cell = replace(plain, X_WB=TURNED, surroundings=replace(plain.surroundings, keep_in=shapes))
    p = np.concatenate([arm_parameters(cell, cell.limits, NO_MARGINS), room_parameters(cell, plain.home[None], 0.01)])
    for seed in range(40):
        q, _, _, z = _state(seed)
        p_WT = tool_state(cell, q, np.zeros(6)).p_WT
        room = min(float(shape.depth(p_WT)) - (shape.clearance_m or 0.0) for shape in shapes) - 0.01
        row = _rows("rooms", z, p)[0]
        assert row < room + 1e-6
        assert row > room - 0.008  # four soft minima of two to seven walls


def _distance_from(cell: Cell, q: np.ndarray, shape: Solid) -> float:
    """Least distance [m] of arm, tool and object from a shape in the base frame, the foot and the base excepted."""
    capsules = body_capsules(cell.robot, cell.tool.capsules)[2:]
    ends = capsule_endpoints(cell.robot, capsules, q)
    held = (forward(cell.robot, q) @ cell.tool.X_FT)[:3, 3]
    starts, stops = np.concatenate([ends, [[held, held]]]).swapaxes(0, 1)
    radii = [*(c.radius_m for c in capsules), cell.object.radius_m]
    return float((segment_shape_distance(starts, stops, shape) - radii).min())


@pytest.mark.parametrize(("boxes", "slots"), [(0, 0), (1, 1), (2, 2), (3, 4), (4, 4), (5, 4)])
def test_a_room_has_slots_for_its_boxes(boxes: int, slots: int) -> None:
    plain = load_cell(CELLS / "ur5e-sim.toml")
    placed = tuple(Box(np.array([1.0 + k, 1.0, 0.0]), np.array([1.5 + k, 2.0, 0.5])) for k in range(boxes))
    cell = replace(plain, surroundings=replace(plain.surroundings, keep_out=placed))
    request = {"cell": "ur5e-sim", "release": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "release_window_s": 0.0}
    stages = stage_layout(problem_from_request(request, cell), Margins())
    assert (stages.shapes, "keep_out" in stages.groups) == (slots, slots > 0)
    assert stages.with_groups({"effort"}).shapes == 0


def test_of_many_shapes_the_optimiser_takes_the_nearest_to_a_motion() -> None:
    """Whatever their order; one with a clearance of its own is as near as what it leaves."""
    plain = load_cell(CELLS / "ur5e-sim.toml")
    rng = np.random.default_rng(7)
    centres = rng.uniform([-1.5, -1.5, 0.2], [1.5, 1.5, 1.5], (30, 3))
    own = [None, 0.3, 0.0]
    placed = tuple(
        shape_of("sphere", pose(p, np.eye(3)), np.array([0.05, 0.0]), "", own[i % 3]) for i, p in enumerate(centres)
    )
    cell = replace(plain, surroundings=replace(plain.surroundings, keep_out=placed))
    q = plain.home + rng.uniform(-0.5, 0.5, (6, 6))
    further = cell.surroundings.further_clearances
    left = [
        min(_distance_from(cell, each, shape) for each in q) - more for shape, more in zip(placed, further, strict=True)
    ]
    assert nearest_shapes(cell, q) == tuple(sorted(np.argsort(left)[:4].tolist()))
    request = {"cell": "ur5e-sim", "release": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "release_window_s": 0.0}
    problem = problem_from_request(request, cell)
    unheeding = Margins(heeds_shapes=False)
    assert "keep_out" not in stage_layout(problem, unheeding).groups
    met = at_least("keep_out", -0.3, 0.02, "m", 0.1, "forearm, box 7")  # however deep
    heeding = unheeding.widened([met], lambda _: 1.0)
    assert heeding == Margins()
    assert "keep_out" in stage_layout(problem, heeding).groups
    few = replace(plain, surroundings=replace(plain.surroundings, keep_out=placed[:4]))
    assert nearest_shapes(few, q) == (0, 1, 2, 3)


def _smooth_multipliers(index: transcription.RowIndex, rng: np.random.Generator) -> np.ndarray:
    """Multipliers that leave out the rows whose curvature is left out."""
    lam = rng.normal(size=index.size)
    without = ("clearance", "clearance_middle", "keep_out", "keep_out_middle", "passing_at_rest", "standing")
    for (name, _), rows in index.rows.items():
        if index.blocks[name].name in without:
            lam[rows] = 0.0
    return lam


@pytest.mark.parametrize("name", NEAR_SHAPES)
def test_derivatives_of_the_distance_from_a_shape(name: str) -> None:
    plain = load_cell(CELLS / "ur5e-sim.toml")
    cell = replace(plain, surroundings=replace(plain.surroundings, keep_out=(NEAR_SHAPES[name],)))
    p = np.concatenate([SCALES, arm_parameters(cell, cell.limits, NO_MARGINS), shape_parameters(cell, (0,))])
    block = _blocks()["keep_out_1"]
    rng = np.random.default_rng(4)
    errors = []
    for _ in range(40):
        z = np.concatenate([rng.uniform(-1.5, 1.5, 6), np.zeros(layout.NZ - 6)])
        along = np.concatenate([rng.normal(size=6), np.zeros(layout.NZ - 6)])
        ahead, behind = (float(block.value(z + s * along, p)) for s in (1e-6, -1e-6))
        slope = float((np.array(block.slope(z, p)[1]) @ along)[0])
        errors.append(abs(slope - (ahead - behind) / 2e-6))
    assert np.quantile(errors, 0.8) < 1e-4  # where the nearest points are found to the last digit
    assert max(errors) < 0.05

"""Objects that are no balls: their inertia, their hull, and how they lie in the gripper."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from planner.cell import ThrownBody, ThrownObject, cell_of_keys
from planner.cell_folder import home_faults
from planner.errors import CellError
from planner.geometry import body_model, held_object
from planner.rotations import rotation_vector_to_matrix
from tests.planner.problems import cell

BODIES = {
    "rod": {"shape": "cylinder", "radius_m": 0.01, "length_m": 0.12},
    "disc": {"shape": "cylinder", "radius_m": 0.05, "length_m": 0.02},
    "capsule": {"shape": "capsule", "radius_m": 0.015, "length_m": 0.1},
    "pill": {"shape": "capsule", "radius_m": 0.015, "length_m": 0.01},
    "long box": {"shape": "box", "size_m": [0.02, 0.16, 0.02]},
    "brick": {"shape": "box", "size_m": [0.03, 0.05, 0.08]},
    "thin": {"shape": "cylinder", "radius_m": 0.004, "length_m": 0.4},
}


def _cell(**keys):
    document = cell().document
    return cell_of_keys({**document, "object": {"mass_kg": 0.2, **keys}})


def _thing(name) -> ThrownBody:
    thing = _cell(**BODIES[name]).object
    assert isinstance(thing, ThrownBody)
    return thing


@pytest.mark.parametrize("name", BODIES)
def test_inertia_is_that_of_mujoco(name):
    given = BODIES[name]
    sizes = (
        [0.5 * size for size in given["size_m"]] if "size_m" in given else [given["radius_m"], 0.5 * given["length_m"]]
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body><freejoint/><geom type="{given["shape"]}" mass="0.2" '
        f'size="{" ".join(map(str, sizes))}"/></body></worldbody></mujoco>'
    )
    assert np.sort(_thing(name).inertia_kg_m2) == pytest.approx(np.sort(model.body_inertia[1]), rel=1e-9)


@pytest.mark.parametrize("name", BODIES)
def test_hull_contains_the_body(name):
    thing = _thing(name)
    x = _surface_points(BODIES[name])
    axis = thing.R_TO.T @ thing.hull_axis
    balls = np.outer(thing.balls_m, axis)
    apart = np.linalg.norm(x[:, None] - balls, axis=2).min(axis=1)
    assert apart.max() <= thing.radius_m * (1.0 + 1e-9)
    along = np.clip(x @ axis, -thing.reach_m, thing.reach_m)
    assert np.linalg.norm(x - np.outer(along, axis), axis=1).max() <= thing.radius_m * (1.0 + 1e-9)


def _surface_points(given):
    rng = np.random.default_rng(4)
    x = rng.uniform(-1.0, 1.0, (4000, 3))
    if given["shape"] == "box":
        x[np.arange(4000), rng.integers(0, 3, 4000)] = rng.choice([-1.0, 1.0], 4000)
        return np.concatenate([0.5 * x * given["size_m"], 0.5 * np.sign(x) * given["size_m"]])
    radius = given["radius_m"]
    half = 0.5 * given["length_m"]
    around = x[:, :2] / np.linalg.norm(x[:, :2], axis=1, keepdims=True) * radius
    side = np.column_stack([around, half * x[:, 2]])
    rims = np.column_stack([around, half * np.sign(x[:, 2])])
    if given["shape"] == "cylinder":
        return np.concatenate([side, rims])
    ends = radius * x / np.linalg.norm(x, axis=1, keepdims=True)
    return np.concatenate([side, ends + half * np.sign(ends[:, 2:]) * [0.0, 0.0, 1.0]])


def test_long_bodies_have_thin_hulls():
    assert _thing("rod").radius_m < 0.0126
    assert len(_thing("rod").balls_m) == 9
    assert _thing("long box").radius_m < 0.018
    assert len(_thing("brick").balls_m) == 3
    assert _thing("brick").radius_m < _thing("brick").outer_radius_m == 0.5 * np.linalg.norm([0.03, 0.05, 0.08])
    assert _thing("disc").balls_m == (0.0,)


def test_a_sphere_is_the_ball_of_before():
    assert _cell().object == ThrownObject(0.2, 0.02, 0.0)
    assert _cell(shape="sphere", radius_m=0.03).object == ThrownObject(0.2, 0.03, 0.0)


def test_drag_acts_on_the_mean_shadow():
    ball = _cell(shape="capsule", radius_m=0.02, length_m=1e-4).object
    assert ball.drag_radius_m == pytest.approx(0.02, rel=2e-3)
    assert np.pi * _thing("brick").drag_radius_m ** 2 == pytest.approx((0.03 * 0.05 + 0.05 * 0.08 + 0.03 * 0.08) / 2.0)


def test_held_rod_lies_as_the_cell_file_says():
    turn = [0.3, -0.4, 1.1]
    there = [0.01, -0.02, 0.06]
    here = _cell(**BODIES["rod"], in_tool={"position_m": there, "rotation_vector_rad": turn})
    bare = _cell(**BODIES["rod"])
    X_FT = bare.tool.X_FT
    centre = X_FT[:3, :3] @ there + X_FT[:3, 3]
    assert here.tool.X_FT[:3, 3] == pytest.approx(centre)
    held = held_object(here)
    along = X_FT[:3, :3] @ rotation_vector_to_matrix(turn)[:, 2]
    assert held.p1 - held.p0 == pytest.approx(2.0 * here.object.reach_m * along)
    assert 0.5 * (held.p0 + held.p1) == pytest.approx(centre)
    assert body_model(here).names[body_model(here).object] == "object"


def test_held_rod_counts_with_its_length():
    home = _cell().home
    long = {"shape": "cylinder", "radius_m": 0.01, "length_m": 0.8, "in_tool": {"rotation_vector_rad": [0.0, 0.0, 0.0]}}
    assert (
        body_model(_cell(**long)).clearances(home[None]).least[0] < body_model(_cell()).clearances(home[None]).least[0]
    )


@pytest.mark.parametrize(
    ("keys", "field"),
    [
        ({"shape": "cone"}, "object.shape"),
        ({"shape": "box"}, "object.size_m"),
        ({"shape": "box", "size_m": [0.1, 0.1, 0.1], "radius_m": 0.1}, "object.radius_m"),
        ({"shape": "cylinder", "radius_m": 0.1}, "object.length_m"),
        ({"shape": "cylinder", "radius_m": 0.1, "length_m": 120.0}, "object.length_m"),
        ({"length_m": 0.1}, "object.length_m"),
        ({"inertia_kg_m2": [1e-4] * 3}, "object.inertia_kg_m2"),
        ({**BODIES["rod"], "inertia_kg_m2": [1e-4, 1e-4, 3e-4]}, "object.inertia_kg_m2[2]"),
        ({**BODIES["rod"], "inertia_kg_m2": [1e-4, 1e-4, 0.0]}, "object.inertia_kg_m2[2]"),
        ({**BODIES["rod"], "inertia_kg_m2": [1e-4, 2.1e-4, 1e-4]}, "object.inertia_kg_m2[1]"),
        ({**BODIES["rod"], "in_tool": {"position": [0, 0, 0]}}, "object.in_tool.position"),
    ],
)
def test_objects_that_cannot_be_are_refused(keys, field):
    with pytest.raises(CellError) as refused:
        _cell(**keys)
    assert refused.value.field == field


def test_given_inertia_counts():
    given = [2e-4, 2e-4, 1e-5]
    thing = _cell(**BODIES["rod"], inertia_kg_m2=given).object
    assert isinstance(thing, ThrownBody)
    assert thing.inertia_kg_m2.tolist() == given
    assert replace(thing, drag_coefficient=0.4).inertia_kg_m2.tolist() == given


def test_a_long_rod_does_not_shorten_an_assumed_gripper():
    document = cell().document
    bare = {**document, "tool": {**document["tool"], "capsules": []}}
    ball, rod = (
        cell_of_keys({**bare, "object": {"mass_kg": 0.2, **keys}})
        for keys in ({"radius_m": 0.02}, {**BODIES["brick"], "size_m": [0.02, 0.3, 0.02]})
    )
    reach = float(np.linalg.norm(document["tool"]["tcp_position_m"]))
    assert np.linalg.norm(ball.tool.capsules[0].to_m) == pytest.approx(reach - 0.02)
    assert np.linalg.norm(rod.tool.capsules[0].to_m) == pytest.approx(reach)


def test_a_place_in_the_hand_moves_neither_the_hand_nor_its_mass():
    document = cell().document
    bare = {**document, "tool": {**document["tool"], "capsules": []}}
    there = {"in_tool": {"position_m": [0.0, 0.0, 0.05]}}
    here = cell_of_keys({**bare, "object": {"mass_kg": 0.2, **BODIES["rod"], **there}})
    assert here.tool.end_F == pytest.approx(document["tool"]["tcp_position_m"])
    assert here.tool.capsules[0].to_m == pytest.approx(document["tool"]["tcp_position_m"])
    assert here.tool.X_FT[2, 3] == pytest.approx(document["tool"]["tcp_position_m"][2] + 0.05)


def test_a_rod_in_the_wrist_is_told():
    along = {"shape": "cylinder", "radius_m": 0.01, "length_m": 0.6}
    across = {**along, "in_tool": {"rotation_vector_rad": [0.0, 0.5 * np.pi, 0.0]}}
    beyond = {**along, "in_tool": {"position_m": [0.0, 0.0, 0.3]}}
    faults = home_faults(_cell(**along))
    assert {fault.field for fault in faults} == {"object.in_tool"}
    assert "wrist_3 in every posture" in str(faults[-1])
    for clear in (across, beyond):
        assert not any(fault.field == "object.in_tool" for fault in home_faults(_cell(**clear)))
    here = _cell(**along)
    body = body_model(here)
    posture = here.home[None]
    assert body.clearances(posture).self_collision[0] < -0.05
    assert body.clearances(posture, with_object=False).self_collision[0] > 0.0
    told = body.violations_at(here.home)
    assert any("wrist_3, object" in violation.detail for violation in told)

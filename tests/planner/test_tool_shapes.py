"""Shapes of the tool: the capsules in their place contain them, and reach no farther beyond them than is told."""

from dataclasses import replace

import coal
import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from api.cli import main
from audit.judge.distances import coal_mesh, coal_solid
from planner.cell import CellSource, load_cell, mended_cell, parse_cell, shape_of, tool_shapes
from planner.cell.capsule_cover import MOST
from planner.cell_folder import check_home
from planner.errors import CellError
from planner.geometry import body_model, tool_state
from planner.kinematics import link_poses
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.rotations import pose, rotation_vector_to_matrix
from tests.planner.problems import CELLS, steady_cell, with_shapes

LEAST = 'robot = "ur5e"\n[link]\nkind = "sim"\n[tool]\n'
ROUNDING_M = 1e-12
SAMPLED_M = 5e-4  # [m] between the farthest of the samples and the farthest point
TURN = [0.3, -0.8, 0.5]
SIZES = {
    "box": [[0.1, 0.1, 0.1], [0.2, 0.1, 0.01], [0.03, 0.04, 0.2], [0.25, 0.2, 0.004], [0.02, 0.02, 0.02]],
    "cylinder": [[0.05, 0.1], [0.03, 0.2], [0.06, 0.02], [0.0315, 0.012], [0.01, 0.1], [0.09, 0.05]],
    "sphere": [[0.04]],
    "capsule": [[0.03, 0.1]],
}
KEYS = {"box": ("size_m",), "cylinder": ("radius_m", "length_m"), "sphere": ("radius_m",)}
KEYS["capsule"] = KEYS["cylinder"]
CASES = [(kind, sizes) for kind, every in SIZES.items() for sizes in every]


def entry_of(kind, sizes):
    values = [sizes] if kind == "box" else sizes
    place = {"position_m": [0.02, -0.03, 0.08], "rotation_vector_rad": TURN}
    return {"shape": kind, "pose": place, **dict(zip(KEYS[kind], values, strict=True))}


def solid_of(kind, sizes):
    X = pose([0.02, -0.03, 0.08], rotation_vector_to_matrix(np.array(TURN)))
    return shape_of(kind, X, np.array([*sizes, 0.0][: 3 if kind == "box" else 2]))


def outside(capsules, p):
    """How far points (n, 3) are outside of all capsules (n,), negative inside."""
    gaps = []
    for capsule in capsules:
        along = capsule.to_m - capsule.from_m
        share = np.clip((p - capsule.from_m) @ along / max(along @ along, 1e-18), 0.0, 1.0)
        gaps.append(np.linalg.norm(p - capsule.from_m - share[:, None] * along, axis=1) - capsule.radius_m)
    return np.min(gaps, axis=0)


def placed(R, p):
    return coal.Transform3s(R, p)


def gap(one, at, other, there):
    """The distance of two solids, or how deep they are in each other, negative [m]."""
    return coal.distance(one, at, other, there, coal.DistanceRequest(), coal.DistanceResult())


def gaps_from(solid, place, p, radius):
    """The distances of a solid from balls of a radius about points (n, 3), as `gap` (n,)."""
    ball = coal.Sphere(radius)
    return [gap(solid, place, ball, placed(np.eye(3), at)) for at in p]


def surfaces(capsules, rng):
    """Points on the capsules (n, 3)."""
    out = rng.normal(size=(len(capsules), 1500, 3))
    out /= np.linalg.norm(out, axis=2, keepdims=True)
    shares = rng.choice([0.0, 1.0, 0.3, 0.5], (len(capsules), 1500, 1))
    ends = np.array([[c.from_m, c.to_m] for c in capsules])[:, :, None]
    radii = np.array([c.radius_m for c in capsules])[:, None, None]
    return (ends[:, 0] + shares * (ends[:, 1] - ends[:, 0]) + radii * out).reshape(-1, 3)


def mesh_of(kind, sizes):
    made = {
        "box": lambda: trimesh.creation.box(sizes),
        "cylinder": lambda: trimesh.creation.cylinder(sizes[0], sizes[1], sections=96),
        "sphere": lambda: trimesh.creation.icosphere(4, sizes[0]),
        "capsule": lambda: trimesh.creation.capsule(sizes[1], sizes[0], count=[48, 48]),
    }[kind]()
    return made.apply_transform(solid_of(kind, sizes).X_WC)


@pytest.mark.parametrize(("kind", "sizes"), CASES)
def test_the_capsules_contain_the_shape_and_reach_as_far_beyond_it_as_is_told(kind, sizes):
    rng = np.random.default_rng(2)
    (shape,) = tool_shapes({"shapes": [entry_of(kind, sizes)]})
    assert shape.kind == kind
    assert len(shape.capsules) <= MOST
    mesh = mesh_of(kind, sizes)
    p, _ = trimesh.sample.sample_surface(mesh, 20_000, seed=1)
    assert outside(shape.capsules, np.concatenate([p, mesh.vertices])).max() <= ROUNDING_M
    inner = mesh.centroid + rng.uniform(size=(len(p), 1)) * (p - mesh.centroid)
    assert outside(shape.capsules, inner).max() <= ROUNDING_M
    solid = coal_solid(solid_of(kind, sizes))
    X = solid_of(kind, sizes).X_WC
    place = placed(X[:3, :3], X[:3, 3])
    gaps = gaps_from(solid, place, surfaces(shape.capsules, rng), 1e-6)
    assert max(gaps) <= shape.beyond_m + SAMPLED_M
    assert max(gaps) >= shape.beyond_m - 2.0 * SAMPLED_M
    if kind in ("sphere", "capsule"):
        assert shape.beyond_m == 0.0


def test_a_mesh_is_contained_and_told_by_the_command(tmp_path):
    jaws = [trimesh.creation.box([0.02, 0.02, 0.08]).apply_translation([x, 0.0, 0.09]) for x in (-0.04, 0.04)]
    mesh = trimesh.util.concatenate([trimesh.creation.box([0.12, 0.05, 0.05]).apply_translation([0, 0, 0.025]), *jaws])
    mesh.apply_transform(pose(np.zeros(3), rotation_vector_to_matrix(np.array([0.0, 0.0, 0.4]))))
    mesh.vertices *= 1000.0
    mesh.export(tmp_path / "hand.stl")
    text = (CELLS / "ur5e-sim.toml").read_text()
    own = next(line for line in text.splitlines() if line.startswith("capsules"))
    shapes = 'shapes = [{ shape = "mesh", file = "hand.stl", scale = 0.001, pose = { position_m = [0, 0, 0.02] } }]'
    (tmp_path / "c.toml").write_text(text.replace(own, f"{own}\n{shapes}"))
    here = load_cell(tmp_path / "c.toml")
    (shape,) = tool_shapes(here.document["tool"], here.meshes)
    assert here.tool.capsules[0].radius_m == 0.05
    assert [c.radius_m for c in here.tool.capsules[1:]] == [c.radius_m for c in shape.capsules]
    p, _ = trimesh.sample.sample_surface(mesh, 5_000, seed=1)
    assert outside(shape.capsules, 0.001 * p + [0.0, 0.0, 0.02]).max() <= ROUNDING_M
    tree = coal_mesh(mesh)
    at = 1000.0 * (surfaces(shape.capsules, np.random.default_rng(3))[::20] - [0.0, 0.0, 0.02])
    gaps = gaps_from(tree, placed(np.eye(3), np.zeros(3)), at, 1e-3)
    assert 0.001 * max(gaps) <= shape.beyond_m + SAMPLED_M
    told = CliRunner().invoke(main, ["cell", "check", str(tmp_path / "c.toml")])
    assert f"tool.shapes[0]: a mesh, as tool_1 to tool_{len(shape.capsules)}" in told.output
    assert f"up to {1e3 * shape.beyond_m:.3g} mm beyond it" in told.output
    before = here.sha256
    mesh.apply_translation([1.0, 0.0, 0.0]).export(tmp_path / "hand.stl")
    assert load_cell(tmp_path / "c.toml").sha256 != before


@pytest.mark.parametrize(
    ("entry", "field", "reason"),
    [
        ('{ shape = "points", file = "a.ply" }', "[0].shape", "box, cylinder, sphere, capsule, mesh"),
        ('{ shape = "sphere", pose = { position_m = [0, 0, 0] }, radius_m = 0.1, name = "a" }', "[0].name", "tool_0"),
        ('{ shape = "sphere", pose = { position_m = [0, 0, 80] }, radius_m = 0.1 }', "[0].pose", "more than 3 m"),
        ('{ shape = "sphere", pose = { position_m = [0, 0, 0] } }', "[0].radius_m", "missing"),
        ('{ shape = "mesh", file = "gone.stl", pose = { position_m = [0, 0, 0] } }', "[0].file", "beside"),
    ],
)
def test_a_shape_that_cannot_be_is_refused_by_its_field(entry, field, reason):
    text = f"{LEAST}shapes = [{entry}]\n[timing]\nlag_s = 9\n"
    with pytest.raises(CellError, match=reason) as refusal:
        parse_cell(text, "c")
    assert refusal.value.field == f"tool.shapes{field}"
    faults, _ = mended_cell(CellSource("c", text.encode()))
    assert [fault.field for fault in faults] == [f"tool.shapes{field}", "timing.lag_s"]


def test_a_tool_with_shapes_alone_is_not_assumed_and_follows_its_capsules():
    here = steady_cell()
    plate = {"shape": "box", "pose": {"position_m": [0, 0, 0.05]}, "size_m": [0.1, 0.04, 0.1]}
    bare = here.with_tool(capsules=[], shapes=[plate])
    assert not bare.tool.is_assumed
    assert body_model(bare).names[-1 - len(bare.tool.capsules) : -1] == tuple(
        f"tool_{i}" for i in range(len(bare.tool.capsules))
    )
    free = parse_cell(
        f"{LEAST}shapes = [{{ pose = {{ position_m = [0, 0, 0.05] }}, size_m = [0.1, 0.04, 0.1] }}]\n"
        'mass_kg = 1.0\n[surroundings]\nkeep_out = [{ name = "post", lower_m = [2, 2, 0], upper_m = [2.1, 2.1, 1] }]\n'
        'may_touch = [{ a = "tool_1", b = "post" }]\n',
        "c",
    )
    assert free.surroundings.is_free_to_touch("tool_1", "post")


def test_a_shape_in_the_arm_s_way_is_told_by_its_place():
    here = steady_cell()
    small = {"shape": "sphere", "pose": {"position_m": [0, 0, 0.1]}, "radius_m": 0.03}
    wide = {"shape": "box", "pose": {"position_m": [0, 0, 0.0]}, "size_m": [0.6, 0.6, 0.5]}
    with pytest.raises(CellError) as refusal:
        check_home(here.with_tool(capsules=[], shapes=[small, wide]))
    assert refusal.value.field == "tool.shapes[1]"


def test_a_motion_keeps_the_shape_itself_off_what_is_beside_it():
    """By coal, between the box of the tool and a ball beside its way in an empty cell, at every tick."""
    here = steady_cell()
    size = [0.12, 0.05, 0.12]
    hand = {"shape": "box", "pose": {"position_m": [0, 0, 0.06]}, "size_m": size}
    here = here.with_tool(capsules=[], shapes=[hand])
    problem = ThrowProblem(here, here.home, TargetRelease(np.array([1.0, -0.5, 0.0])), here.limits)
    first = plan(problem).trajectory

    def least(motion, ball):
        gaps = []
        for X in link_poses(here.robot, motion.q, here.X_WB)[:, 6]:
            at = placed(X[:3, :3], X[:3, :3] @ [0.0, 0.0, 0.06] + X[:3, 3])
            gaps.append(gap(coal.Sphere(ball.radius_m), placed(np.eye(3), ball.X_WC[:3, 3]), coal.Box(*size), at))
        return min(gaps)

    q, qd, _ = first.at(np.array([0.8 * first.release_time_s]))
    X = link_poses(here.robot, q, here.X_WB)[0, 6]
    v = tool_state(here, q[0], qd[0]).v_WT
    aside = np.cross(v, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(v, [0.0, 0.0, 1.0]))
    centre = X[:3, :3] @ [0.0, 0.0, 0.06] + X[:3, 3]
    balls = (
        shape_of("sphere", pose(centre + m * aside, np.eye(3)), np.array([0.04, 0.0]))
        for m in np.arange(0.3, 0.0, -0.002)
    )
    ball = next(ball for ball in balls if least(first, ball) < 0.5 * here.surroundings.clearance_m)
    found = plan(replace(problem, cell=with_shapes(here, ball)))
    assert found.certificate.valid
    assert here.surroundings.clearance_m <= least(found.trajectory, ball) < 0.1

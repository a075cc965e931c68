"""Objects and rooms that are meshes: the shape about one contains it, the walls of the other are its faces."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache as kept
from pathlib import Path

import coal
import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from scipy.optimize import minimize
from scipy.spatial import ConvexHull

from api.cli import main
from audit.judge import coal_mesh, find_faults
from planner.arrays import Array
from planner.cell import Cell, CellSource, ThrownBody, cell_of, load_cell, mended_cell, read_source
from planner.cell.meshes.enclosing import EnclosingShape, enclosing, smallest_ball
from planner.cell.meshes.walls import EVEN, walls
from planner.certificate import certify
from planner.errors import CellError
from planner.geometry import tool_pose
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.request import problem_from_request
from planner.rotations import pose, rotation_vector_to_matrix
from store import Store

CELLS = Path(__file__).parents[2] / "cells"
TURNED = pose(np.array([0.3, -0.2, 1.0]), rotation_vector_to_matrix(np.array([0.4, -0.7, 0.3])))
BESIDE = pose(np.array([0.0, 0.0, 0.012]), np.eye(3))


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """One cache for all tests: what encloses a mesh is found once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def random_mesh(seed: int) -> trimesh.Trimesh:
    """A convex one of a size between millimetres and metres, or one with dents, anywhere."""
    rng = np.random.default_rng(seed)
    mesh = trimesh.convex.convex_hull(rng.normal(size=(rng.integers(4, 60), 3)) * rng.uniform(0.05, 1.0, 3))
    if seed % 2:
        mesh.vertices *= rng.uniform(0.3, 1.0, (len(mesh.vertices), 1))
    mesh.apply_scale(10.0 ** rng.uniform(-3.0, 1.0))
    return mesh.apply_translation(rng.normal(size=3) * mesh.scale)


def outside(shape: EnclosingShape, p: Array) -> float:
    """How far the outermost of points (n, 3) is outside of a shape, negative inside: its closed form."""
    x = np.abs((p - shape.centre) @ shape.axes)
    half = 0.5 * shape.size
    if shape.kind == "box":
        return float((x - half).max())
    if shape.kind == "cylinder":
        return float(max((np.hypot(x[:, 0], x[:, 1]) - half[0]).max(), (x[:, 2] - half[2]).max()))
    beyond = np.maximum(x - [0.0, 0.0, half[2] - half[0]], [0.0, 0.0, 0.0])
    return float((np.linalg.norm(np.column_stack([x[:, :2], beyond[:, 2]]), axis=1) - half[0]).max())


@kept
def shape_about(seed: int) -> EnclosingShape:
    return enclosing(np.array(random_mesh(seed).triangles))


@pytest.mark.parametrize("seed", range(4))
def test_every_corner_of_a_mesh_is_in_the_shape_about_it(seed: int) -> None:
    mesh = random_mesh(seed)
    shape = shape_about(seed)
    assert outside(shape, mesh.vertices) <= 1e-9 * mesh.scale
    assert shape.axes.T @ shape.axes == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(shape.axes) == pytest.approx(1.0)
    # trimesh searches its own box, cylinder and ball; 1 % is what a rounder shape may be larger
    assert shape.volume <= 1.01 * mesh.bounding_primitive.volume


SIMPLE = {
    "box": (trimesh.creation.box((0.3, 0.2, 0.1)), [0.1, 0.2, 0.3]),
    "sphere": (trimesh.creation.icosphere(2, 0.15), [0.3, 0.3, 0.3]),
    "cylinder": (trimesh.creation.cylinder(0.05, 0.3, sections=24), [0.1, 0.1, 0.3]),
    "capsule": (trimesh.creation.capsule(0.2, 0.05, count=[12, 12]), [0.1, 0.1, 0.3]),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SIMPLE)
def test_a_simple_part_is_its_own_shape(kind: str) -> None:
    mesh, size = SIMPLE[kind]
    shape = enclosing(np.array(mesh.copy().apply_transform(TURNED).triangles))
    assert shape.kind == kind
    assert shape.size == pytest.approx(size, rel=2e-4)
    assert shape.centre == pytest.approx(TURNED[:3, 3] + TURNED[:3, :3] @ mesh.bounds.mean(axis=0), abs=1e-4)
    if kind in ("cylinder", "capsule"):
        assert abs(shape.axes[:, 2] @ TURNED[:3, 2]) == pytest.approx(1.0, abs=1e-6)
    if kind == "box":
        assert abs(shape.axes[:, 2] @ TURNED[:3, 0]) == pytest.approx(1.0, abs=1e-9)
    assert shape.beyond < 0.05 * 0.3


@pytest.mark.parametrize("seed", [0, 1])
def test_no_point_of_the_shape_is_farther_from_the_mesh_than_is_told(seed: int) -> None:
    """By coal's distances from the faces; the bound is 2 % of the size and the facets' off the farthest."""
    mesh = random_mesh(seed)
    shape = shape_about(seed)
    x = np.random.default_rng(seed).uniform(-1.0, 1.0, (3000, 3))
    x /= np.abs(x).max(axis=1, keepdims=True)
    x = np.concatenate([x, np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T])
    if shape.kind != "box":
        x[:, :2] /= np.maximum(1.0, np.linalg.norm(x[:, :2], axis=1, keepdims=True))
    if shape.kind in ("capsule", "sphere"):
        pytest.fail("take another seed: the points are a box's or a cylinder's")
    p = shape.centre + 0.5 * x * shape.size @ shape.axes.T
    model = coal_mesh(mesh)
    still = coal.Transform3s(np.eye(3), np.zeros(3))
    tiny = 1e-6 * mesh.scale
    ask = coal.DistanceRequest()
    away = [
        coal.distance(model, still, coal.Sphere(tiny), coal.Transform3s(np.eye(3), at), ask, coal.DistanceResult())
        for at in p
    ]
    assert max(away) + tiny < shape.beyond < max(away) + 0.06 * mesh.extents.max()


def room_beside(ball: Array, x: Array) -> Array:
    """By how much points (n, 3) are within a ball of a centre and radius (4,), in squares (n,)."""
    return ball[3] ** 2 - ((x - ball[:3]) ** 2).sum(axis=1)


def test_the_smallest_ball_is_that_of_a_general_search() -> None:
    for seed in range(5):
        x = np.random.default_rng(seed).normal(size=(80, 3))
        centre, radius = smallest_ball(x)
        within = {"type": "ineq", "fun": room_beside, "args": (x,)}
        known = minimize(lambda u: u[3], [0.0, 0.0, 0.0, 9.0], method="SLSQP", constraints=within, tol=1e-12)
        assert known.success
        assert radius == pytest.approx(known.fun, rel=1e-6)
        assert np.linalg.norm(x - centre, axis=1).max() <= radius


def bolt() -> trimesh.Trimesh:
    """A rod with a collar, along x of its file, in millimetres."""
    rod = trimesh.creation.cylinder(10.0, 120.0, sections=48)
    collar = trimesh.creation.cylinder(14.0, 20.0, sections=48).apply_translation([0.0, 0.0, 50.0])
    turn = pose(np.array([5.0, 6.0, 7.0]), rotation_vector_to_matrix(np.array([0.0, 0.5 * np.pi, 0.0])))
    return trimesh.util.concatenate([rod, collar]).apply_transform(turn)


IN_TOOL = "in_tool = { position_m = [0.0, 0.0, 0.02], rotation_vector_rad = [0.0, 0.0, 0.3] }"


def written(folder: Path, keys: str, room: str = "") -> Path:
    """A cell whose object has keys, with a room that the tool stays in."""
    text = (CELLS / "ur5e-sim.toml").read_text()
    begin = text.index("[object]")
    text = f"{text[:begin]}[object]\nmass_kg = 0.1\n{keys}\n{text[text.index('[', begin + 1) :]}"
    if room:
        own = next(line for line in text.splitlines() if line.startswith("keep_in"))
        text = text.replace(own, f"keep_in = [{room}]")
    path = folder / "lab.toml"
    path.write_text(text)
    return path


def with_bolt(folder: Path, more: str = IN_TOOL) -> Path:
    bolt().export(folder / "bolt.stl")
    return written(folder, f'shape = "mesh"\nfile = "bolt.stl"\nscale = 0.001\n{more}')


def test_the_shape_lies_in_the_tool_as_the_file_does(tmp_path: Path) -> None:
    cell = load_cell(with_bolt(tmp_path))
    thing = cell.object
    assert isinstance(thing, ThrownBody)
    assert thing.kind in ("capsule", "cylinder")
    X_TM = pose(np.array([0.0, 0.0, 0.02]), rotation_vector_to_matrix(np.array([0.0, 0.0, 0.3])))
    assert abs(thing.R_TO[:, 2] @ X_TM[:3, 0]) == pytest.approx(1.0, abs=1e-6)
    bare = load_cell(CELLS / "ur5e-sim.toml").tool
    p_TO = bare.X_FT[:3, :3].T @ (cell.tool.X_FT[:3, 3] - bare.X_FT[:3, 3])
    corners = np.column_stack([0.001 * bolt().vertices, np.ones(len(bolt().vertices))]) @ X_TM.T
    own = EnclosingShape(thing.kind, thing.R_TO, p_TO, thing.size_m, 0.0, 0.0)
    assert outside(own, corners[:, :3]) < 1e-6  # the file has single precision
    assert outside(own, corners[:, :3]) > -1e-4


def test_mass_and_inertia_are_those_given_or_of_the_shape(tmp_path: Path) -> None:
    thing = load_cell(with_bolt(tmp_path)).object
    assert isinstance(thing, ThrownBody)
    simple = {"mass_kg": thing.mass_kg, "shape": thing.kind, "radius_m": 0.5 * thing.size_m[0]}
    simple["length_m"] = thing.size_m[2] - (thing.size_m[0] if thing.kind == "capsule" else 0.0)
    lines = "\n".join(f"{key} = {value!r}" for key, value in simple.items() if key != "mass_kg")
    (tmp_path / "same").mkdir()
    same = load_cell(written(tmp_path / "same", lines.replace("np.float64(", "").replace(")", ""))).object
    assert isinstance(same, ThrownBody)
    assert thing.inertia_kg_m2 == pytest.approx(same.inertia_kg_m2)
    given = load_cell(with_bolt(tmp_path, "inertia_kg_m2 = [1e-4, 1e-4, 1e-5]")).object
    assert isinstance(given, ThrownBody)
    assert given.inertia_kg_m2.tolist() == [1e-4, 1e-4, 1e-5]


@pytest.mark.slow
def test_a_ball_of_a_mesh_is_a_ball(tmp_path: Path) -> None:
    trimesh.creation.icosphere(2, 30.0).export(tmp_path / "ball.ply")
    keys = 'shape = "mesh"\nfile = "ball.ply"\nscale = 0.001'
    thing = load_cell(written(tmp_path, keys)).object
    assert not isinstance(thing, ThrownBody)
    assert thing.radius_m == pytest.approx(0.03, rel=1e-6)
    with pytest.raises(CellError, match="encloses the mesh best") as refused:
        load_cell(written(tmp_path, f"{keys}\ninertia_kg_m2 = [1e-5, 1e-5, 1e-5]"))
    assert refused.value.field == "object.inertia_kg_m2"


@pytest.mark.slow
def test_a_throw_of_a_mesh_is_planned_and_faultless(tmp_path: Path) -> None:
    cell = load_cell(with_bolt(tmp_path))
    request = {"release": {"kind": "target", "position": [1.0, 0.3, 0.0]}, "landing_tolerance_m": 0.05}
    made = plan(problem_from_request(request, cell))
    assert made.certificate.valid
    assert find_faults(made.problem, made.trajectory) == []


@pytest.mark.parametrize(
    ("keys", "field", "words"),
    [
        ('shape = "mesh"', "file", "is missing"),
        ('shape = "mesh"\nfile = "gone.stl"', "file", "cannot be read"),
        ('shape = "mesh"\nfile = "bolt.step"', "file", "beside the cell file"),
        ('shape = "mesh"\nfile = "bolt.stl"', "scale", "0.001"),
        ('shape = "mesh"\nfile = "bolt.stl"\nscale = 1e-7', "scale", "must lie in"),
        ('shape = "mesh"\nfile = "bolt.stl"\nscale = 0.001\nradius_m = 0.1', "radius_m", "does not belong to a mesh"),
        ('shape = "box"\nsize_m = [0.1, 0.1, 0.1]\nfile = "bolt.stl"', "file", "does not belong to a box"),
        ("radius_m = 0.02\nscale = 0.001", "scale", "does not belong to a sphere"),
        ('shape = "mesh"\nfile = "empty.ply"', "file", "is no mesh in PLY format"),
    ],
)
def test_a_mesh_that_cannot_be_thrown_is_refused_by_its_field(
    tmp_path: Path, keys: str, field: str, words: str
) -> None:
    bolt().export(tmp_path / "bolt.stl")
    (tmp_path / "empty.ply").write_bytes(b"nothing")
    path = written(tmp_path, keys)
    with pytest.raises(CellError, match=words) as refused:
        load_cell(path)
    assert refused.value.field == f"object.{field}"
    faults, _ = mended_cell(read_source(path))
    assert [fault.field for fault in faults] == [f"object.{field}"]


def test_a_version_in_the_store_needs_no_file(tmp_path: Path) -> None:
    source = read_source(with_bolt(tmp_path))
    cell = cell_of(source)
    url = f"sqlite:///{tmp_path / 'fling.db'}"
    Store.upgrade(url)
    store = Store.open(url)
    store.note_cell_version("lab", source.sha256, source.text, None, "test", source.meshes)
    (row,) = store.cell_versions("lab")
    store.close()
    (tmp_path / "bolt.stl").unlink()
    again = cell_of(CellSource("lab", row.text, None, row.meshes))
    assert (again.sha256, again.content) == (cell.sha256, cell.content)
    bolt().apply_scale(0.9).export(tmp_path / "bolt.stl")
    assert read_source(tmp_path / "lab.toml").sha256 != source.sha256
    assert cell.with_tool(mass_kg=0.3).object.radius_m == cell.object.radius_m


def test_the_command_tells_by_how_much_the_shape_is_larger(tmp_path: Path) -> None:
    told = CliRunner().invoke(main, ["cell", "check", str(with_bolt(tmp_path))])
    assert told.exit_code == 0, told.output
    assert "object: bolt.stl, as a c" in told.output
    assert "times its volume" in told.output
    assert "mm beyond it" in told.output


ROOMS = {
    "cuboid": (trimesh.creation.box((1.6, 1.5, 1.4)), 1),
    "tetrahedron": (trimesh.convex.convex_hull(np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2.0]])), 4),
    "prism": (trimesh.creation.cylinder(0.9, 1.2, sections=6), 3),
    "facets": (trimesh.convex.convex_hull(np.random.default_rng(5).normal(size=(24, 3))), 64),
}


def depth(boxes: list, p: Array) -> Array:
    """How deep points (n, 3) are in the common part of boxes along their own axes (n,)."""
    every = [np.minimum(p @ each.axes - each.lower, each.upper - p @ each.axes).min(axis=1) for each in boxes]
    return np.min(every, axis=0)


@pytest.mark.parametrize("name", ROOMS)
def test_the_depth_in_a_room_is_coal_s_distance_from_its_faces(name: str) -> None:
    mesh, most = ROOMS[name]
    mesh = mesh.copy().apply_transform(TURNED)
    if name == "prism":
        mesh.invert()  # as some programs wind faces
    boxes = walls(np.array(mesh.triangles))
    assert len(boxes) <= most
    hull = ConvexHull(mesh.vertices).equations
    rng = np.random.default_rng(3)
    p = mesh.bounds[0] + rng.uniform(-0.1, 1.1, (400, 3)) * mesh.extents
    beyond = (p @ hull[:, :3].T + hull[:, 3]).max(axis=1)
    found = depth(boxes, p)
    size = mesh.extents.max()
    assert (found[beyond > 0.0] <= 1e-9).all()
    model = coal_mesh(mesh)
    still = coal.Transform3s(np.eye(3), np.zeros(3))
    inside = p[beyond < -1e-3]
    assert len(inside) > 30
    away = [
        1e-6
        + coal.distance(
            model,
            still,
            coal.Sphere(1e-6),
            coal.Transform3s(np.eye(3), at),
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        for at in inside
    ]
    np.testing.assert_allclose(found[beyond < -1e-3], away, atol=EVEN * size)


def with_room(folder: Path, mesh: trimesh.Trimesh, file: str = "room.stl", more: str = "") -> Path:
    mesh.export(folder / file)
    place = "pose = { position_m = [0.0, 0.0, 0.0] }"
    return written(folder, "radius_m = 0.02", f'{{ shape = "mesh", name = "hall", file = "{file}", {place}{more} }}')


BOX = trimesh.creation.box((2.0, 2.0, 2.0))


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (trimesh.creation.annulus(1.0, 1.5, 2.0, sections=12), "is not convex"),
        (trimesh.creation.icosphere(3, 2.0), "has more sides than 64"),
        (trimesh.Trimesh(BOX.vertices, BOX.faces[:11]), "is not closed"),
    ],
)
def test_what_is_no_room_is_refused_with_the_reason(tmp_path: Path, mesh: trimesh.Trimesh, words: str) -> None:
    path = with_room(tmp_path, mesh)
    with pytest.raises(CellError, match=words) as refused:
        load_cell(path)
    assert refused.value.field == "surroundings.keep_in[0].file"
    faults, _ = mended_cell(read_source(path))
    assert [fault.field for fault in faults] == ["surroundings.keep_in[0].file"]


def test_points_are_no_room(tmp_path: Path) -> None:
    room = '{ shape = "points", file = "a.ply", pose = { position_m = [0, 0, 0] } }'
    with pytest.raises(CellError, match="must be one of box, cylinder, sphere, capsule, mesh") as refused:
        load_cell(written(tmp_path, "radius_m = 0.02", room))
    assert refused.value.field == "surroundings.keep_in[0].shape"


def roofed(cell: Cell, ridge_m: float) -> trimesh.Trimesh:
    """A house about the arm whose roof falls from a ridge along x at a height."""
    outline = [[-2.0, -0.1], [2.0, -0.1], [2.0, ridge_m - 0.6], [0.0, ridge_m], [-2.0, ridge_m - 0.6]]
    corners = np.array([[x, y, z] for x in (-2.0, 2.0) for y, z in outline])
    return trimesh.convex.convex_hull(corners).apply_translation(cell.X_WB[:3, 3])


def test_a_throw_stays_under_a_roof_that_it_would_go_through(tmp_path: Path) -> None:
    bare = load_cell(written(tmp_path, "radius_m = 0.02", " "))
    asked = ThrowProblem(bare, bare.home, TargetRelease(np.array([1.0, 0.5, 0.0])), bare.limits)
    motion = plan(asked).trajectory
    p = tool_pose(bare, motion.at(np.linspace(0.0, motion.duration_s, 2000))[0])[:, :3, 3]
    home = tool_pose(bare, bare.home[None])[0, :3, 3]
    heights = np.arange(p[:, 2].max() + 0.2, home[2], -0.01)
    mesh = next(
        each
        for each in (roofed(bare, height) for height in heights)
        if beyond_hull(each, p).max() > 0.02 and beyond_hull(each, home[None]).max() < -0.03
    )
    cell = load_cell(with_room(tmp_path, mesh))
    assert all(name.startswith("hall") for name in cell.surroundings.keep_in_names)
    asked = ThrowProblem(cell, cell.home, asked.release, cell.limits)
    told = certify(asked, motion).check("keep_in")
    assert told is not None
    assert not told.ok
    assert told.value == pytest.approx(-beyond_hull(mesh, p).max(), abs=2e-3)
    assert "hall" in told.detail
    made = plan(asked)
    assert made.certificate.valid
    q, _, _ = made.trajectory.at(np.linspace(0.0, made.trajectory.duration_s, 2000))
    assert beyond_hull(mesh, tool_pose(cell, q)[:, :3, 3]).max() < 1e-6


def beyond_hull(mesh: trimesh.Trimesh, p: Array) -> Array:
    """How far points (n, 3) are outside of a convex mesh, negative inside (n,): Qhull's planes."""
    planes = ConvexHull(mesh.vertices).equations
    return (p @ planes[:, :3].T + planes[:, 3]).max(axis=1)

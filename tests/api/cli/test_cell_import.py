"""`fling cell import`: shapes of other programs' scenes, where MuJoCo, Pinocchio and the formats put them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
import trimesh
from click.testing import CliRunner

from api.cli import main
from planner.cell import Solid, load_cell
from planner.rotations import pose
from planner.scenes import urdf_of


def taken(cell: Path, name: str, text: str, *options: str) -> tuple[dict[str, Solid], dict[str, object]]:
    """Shapes of the cell after an import, by name, and what the command told."""
    (cell.parent / name).write_text(text)
    command = ["cell", "import", str(cell.parent / name), "--into", str(cell), "--json", *options]
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 0, done.output
    around = load_cell(cell).surroundings
    return dict(zip(around.keep_out_names, around.keep_out, strict=True)), json.loads(done.stdout)


MJCF = """
<mujoco>
  <compiler angle="degree" eulerseq="zyx"/>
  <default>
    <geom size="0.1 0.2 0.3"/>
    <default class="post"><geom type="cylinder" size="0.05 0.4"/></default>
  </default>
  <worldbody>
    <geom name="ground" type="plane" size="5 5 0.1"/>
    <body name="rack" pos="1.2 0.4 0.5" euler="30 20 10" childclass="post">
      <geom name="upright"/>
      <body pos="0.1 0 0.2" quat="0.9 0.1 0.3 0.2">
        <geom name="board" type="box" size="0.3 0.2 0.02" axisangle="1 2 0 40"/>
        <geom name="rod" type="capsule" size="0.03" fromto="0 0 0 0.2 0.1 0.4"/>
        <geom name="knob" type="sphere" size="0.06" pos="0 0.3 0.1" xyaxes="1 1 0 0 1 1"/>
        <geom name="drum" zaxis="0 1 1"/>
      </body>
    </body>
    <body name="cart" pos="2 0 1"><freejoint/><geom name="load" type="box"/></body>
    <geom name="blob" type="ellipsoid" pos="-1 0 1"/>
    <geom name="sign" type="box" pos="-1 1 1" contype="0" conaffinity="0"/>
  </worldbody>
</mujoco>
"""


def test_geoms_are_where_mujoco_has_them(cell: Path) -> None:
    shapes, told = taken(cell, "world.xml", MJCF)
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert set(shapes) == {"upright", "board", "rod", "knob", "drum"}
    for name, shape in shapes.items():
        i = model.geom(name).id
        assert np.abs(shape.X_WC[:3, 3] - data.geom_xpos[i]).max() < 1e-9
        R = data.geom_xmat[i].reshape(3, 3)
        if shape.kind == "box":
            assert np.abs(shape.X_WC[:3, :3] - R).max() < 1e-6
            assert shape.extent == pytest.approx(2.0 * model.geom_size[i])
        else:
            radius, half = model.geom_size[i][:2]
            assert shape.kind == "sphere" or np.abs(np.cross(shape.X_WC[:3, 2], R[:, 2])).max() < 1e-6
            length = {"sphere": 0.0, "cylinder": 2.0 * half, "capsule": 2.0 * (half + radius)}[shape.kind]
            assert shape.extent[2] == pytest.approx(length or 2.0 * radius)
            assert shape.extent[0] == pytest.approx(2.0 * radius)
    assert told["left_out"] == [
        "ground (a plane: a floor is surroundings.floor_z_m)",
        "blob (an ellipsoid)",
        "sign (a box that is only drawn)",
        "cart (moved by a joint)",
    ]


INCLUDING = """
<mujoco>
  <include file="parts/defaults.xml"/>
  <default><geom friction="1 0 0"/></default>
  <asset><mesh name="cup" file="cup.stl"/></asset>
  <worldbody>
    <body name="bin" pos="1.5 0 0.5"><include file="parts/bin.xml"/></body>
    <geom name="cup" mesh="cup" pos="-1.5 0 0.5"/>
    <include file="gone.xml"/>
  </worldbody>
</mujoco>
"""
DEFAULTS = """
<mujocoinclude>
  <compiler angle="radian"/>
  <default><geom type="box" size="0.1 0.1 0.2"/><mesh scale="0.001 0.001 0.001"/>
    <default class="drawn"><geom contype="0" conaffinity="0"/></default></default>
</mujocoinclude>
"""
BIN = """<mujocoinclude>
  <geom name="side" euler="0 0 0.5"/><geom name="label" class="drawn"/><include file="parts/bin.xml"/>
</mujocoinclude>"""


def test_a_model_comes_in_where_its_frame_is_put(cell: Path) -> None:
    """A shelf is drawn about its own foot, where the arm stands: MuJoCo has it in the place of a body of the world."""
    shelf = '<geom name="board" type="box" size="0.3 0.2 0.02" pos="0.1 0 0.5" euler="10 0 20"/>'
    placed = f'<mujoco><worldbody><body pos="1.3 0.2 0.1" axisangle="1 2 3 60">{shelf}</body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(placed)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    turn = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0) * np.pi / 3.0
    at = ("--at", "1.3", "0.2", "0.1", *(repr(float(value)) for value in turn))
    shapes, _ = taken(cell, "shelf.xml", f"<mujoco><worldbody>{shelf}</worldbody></mujoco>", *at)
    np.testing.assert_allclose(shapes["board"].X_WC[:3, 3], data.geom("board").xpos, atol=1e-9)
    np.testing.assert_allclose(shapes["board"].X_WC[:3, :3], data.geom("board").xmat.reshape(3, 3), atol=1e-6)


def test_a_place_beyond_a_full_turn_is_refused(cell: Path) -> None:
    before = cell.read_text()
    (cell.parent / "a.scene").write_text("(a)\n* ball\n1\nsphere\n0.1\n1.5 0 0.5\n0 0 0 1\n0 0 0 0\n.\n")
    at = ["--at", "0", "0", "0", "0", "0", "90"]
    done = CliRunner().invoke(main, ["cell", "import", str(cell.parent / "a.scene"), "--into", str(cell), *at])
    assert done.exit_code != 0
    assert "--at" in done.output
    assert cell.read_text() == before


def test_included_files_come_in_with_their_defaults(cell: Path) -> None:
    folder = cell.parent / "parts"
    folder.mkdir()
    (folder / "defaults.xml").write_text(DEFAULTS)
    (folder / "bin.xml").write_text(BIN)
    (cell.parent / "cup.stl").write_bytes(trimesh.creation.box((200, 100, 50)).export(file_type="stl"))
    shapes, told = taken(cell, "world.xml", INCLUDING)
    assert set(shapes) == {"side", "cup"}
    assert shapes["side"].X_WC[:3, 3] == pytest.approx([1.5, 0.0, 0.5])
    assert shapes["side"].X_WC[1, 0] == pytest.approx(np.sin(0.5))
    assert shapes["cup"].extent == pytest.approx([0.2, 0.1, 0.05])
    assert told["left_out"] == [
        "what world has by <include>",
        "what bin has by <include>",
        "label (a box that is only drawn)",
    ]


URDF = """
<robot name="lab">
  <link name="world"/>
  <link name="table"><collision><origin xyz="0 0 -0.05" rpy="0 0 1.5707963267948966"/>
    <geometry><box size="1.2 0.8 0.1"/></geometry></collision></link>
  <link name="post"><collision><origin xyz="0 0.1 0.3" rpy="0.3 0.2 0.1"/>
    <geometry><cylinder radius="0.04" length="0.6"/></geometry></collision></link>
  <link name="floor"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="door"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="a" type="fixed"><parent link="world"/><child link="table"/><origin xyz="1.5 0.2 0.4"/>
    <axis xyz="0 0 0"/></joint>
  <joint name="b" type="fixed"><parent link="table"/><child link="post"/>
    <origin xyz="0.1 0.1 0" rpy="0.1 -0.2 0.5"/></joint>
  <joint name="c" type="fixed"><parent link="world"/><child link="floor"/><origin xyz="-1.5 0 1"/></joint>
  <joint name="d" type="revolute"><parent link="world"/><child link="door"/><origin xyz="2 0 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
</robot>
"""


def test_collision_shapes_are_where_pinocchio_has_them(cell: Path) -> None:
    shapes, told = taken(cell, "lab.urdf", URDF)
    assert set(shapes) == {"table", "post", "scene floor"}
    model = pinocchio.buildModelFromXML(URDF)
    geometry = pinocchio.buildGeomFromUrdfString(model, URDF, pinocchio.GeometryType.COLLISION)
    data = model.createData()
    placed = geometry.createData()
    pinocchio.updateGeometryPlacements(model, data, geometry, placed, pinocchio.neutral(model))
    for i, thing in enumerate(geometry.geometryObjects):
        name = thing.name.removesuffix("_0")
        if name != "door":
            shape = shapes["scene floor" if name == "floor" else name]
            X = placed.oMg[i].homogeneous
            assert np.abs(shape.X_WC[:3, 3] - X[:3, 3]).max() < 1e-9
            assert name != "post" or np.abs(shape.X_WC - X).max() < 1e-6
    assert shapes["table"].core is None  # a quarter turn is along the axes
    assert shapes["table"].extent == pytest.approx([0.8, 1.2, 0.1])
    assert shapes["post"].extent == pytest.approx([0.08, 0.08, 0.6])
    assert told["left_out"] == ["door (moved by d)"]


def test_an_arm_that_stands_elsewhere_in_the_file_is_told(cell: Path) -> None:
    here = load_cell(cell)
    moved = replace(here, X_WB=pose([0.8, 0.9, -1e-9], np.diag([-1.0, -1.0, 1.0])))
    _, told = taken(cell, "same.urdf", urdf_of(here))
    assert not any("elsewhere" in note for note in told["notes"])
    _, told = taken(cell, "moved.urdf", urdf_of(moved))
    note = next(note for note in told["notes"] if "elsewhere" in note)
    assert "position_m = [0.8, 0.9, 0.0], rotation_vector_rad = [0.0, 0.0, 3.1416]" in note


TETRAHEDRON = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.3]]
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
SCENE = """(lab)
* bench
1.5 0.2 0.3
0 0 0.3826834323650898 0.9238795325112867
2
box
0.4 0.6 0.1
0 0 0.1
0 0 0 1
0 0 0 0
cylinder
0.05 0.5
0.1 0 0
0 0 0 1
0 0 0 0
1
handle
0 0 1
0 0 0 1
* wedge
-1.5 0 0.5
0 0 0 1
1
mesh
4 4
{vertices}
{faces}
0 0 0
0 0 0 1
0 0 0 0
0
* sky
0 0 0
0 0 0 1
1
plane
0 0 1 -3
0 0 0
0 0 0 1
0 0 0 0
0
.
"""


def test_a_scene_of_rviz_comes_in_with_its_meshes(cell: Path) -> None:
    rows = ["\n".join(" ".join(map(str, row)) for row in table) for table in (TETRAHEDRON, FACES)]
    shapes, told = taken(cell, "lab.scene", SCENE.format(vertices=rows[0], faces=rows[1]))
    turned = np.array([[np.sqrt(0.5), -np.sqrt(0.5)], [np.sqrt(0.5), np.sqrt(0.5)]])
    first, second = (name for name in shapes if name.startswith("bench"))
    assert np.abs(shapes[first].X_WC[:3, 3] - [1.5, 0.2, 0.4]).max() < 1e-9
    assert np.abs(shapes[first].X_WC[:2, :2] - turned).max() < 1e-9
    assert np.abs(shapes[second].X_WC[:3, 3] - [*(np.array([1.5, 0.2]) + turned @ [0.1, 0.0]), 0.3]).max() < 1e-9
    assert shapes[second].extent == pytest.approx([0.1, 0.1, 0.5])
    wedge = [shape for name, shape in shapes.items() if name.startswith("wedge")]
    assert np.min([shape.lower for shape in wedge], axis=0) == pytest.approx([-1.5, 0.0, 0.5])
    assert np.max([shape.upper for shape in wedge], axis=0) == pytest.approx([-1.2, 0.3, 0.8])
    assert told["left_out"] == ["sky (a plane)"]


def test_a_scene_of_the_first_format_comes_in(cell: Path) -> None:
    text = "(old)\n* box\n1\nbox\n0.2 0.2 0.2\n1.5 0 0.5\n0 0 0 1\n0 0 0 0\n.\n"
    shapes, _ = taken(cell, "old.scene", text)
    assert shapes["box"].lower == pytest.approx([1.4, -0.1, 0.4])


MESSAGE = """
world:
  collision_objects:
    - id: Can1
      header: {frame_id: base_link}
      primitives: [{type: cylinder, dimensions: [0.12, 0.03]}, {type: 1, dimensions: [0.2, 0.3, 0.4]}]
      primitive_poses:
        - position: [1.2, 0.3, 0.5]
          orientation: [0, 0, 0, 1]
        - {position: {x: -1.2, y: 0, z: 0.5}, orientation: {x: 0, y: 0, z: 0, w: 1}}
    - id: part
      pose: {position: [0, -1.2, 0.5], orientation: [0, 0, 0, 1]}
      meshes:
        - vertices: [{x: 0, y: 0, z: 0}, {x: 0.3, y: 0, z: 0}, {x: 0, y: 0.3, z: 0}, {x: 0, y: 0, z: 0.3}]
          triangles: [{vertex_indices: [0, 2, 1]}, {vertex_indices: [0, 1, 3]}, {vertex_indices: [1, 2, 3]}]
      mesh_poses: [{position: [0.1, 0, 0], orientation: [0, 0, 0, 1]}]
    - id: cup
      meshes: [{resource: "package://lab/cup.stl", dimensions: [2, 2, 2]}, {resource: gone.stl}]
      mesh_poses: [{position: [0, 2, 0.5], orientation: [0, 0, 0, 1]}, {position: [0, 0, 2], orientation: [0, 0, 0, 1]}]
  octomap: {octomap: {data: [1]}}
robot_state:
  attached_collision_objects: [{object: {id: bottle}}]
"""


def test_a_planning_scene_message_comes_in(cell: Path) -> None:
    (cell.parent / "cup.stl").write_bytes(trimesh.creation.box((0.2, 0.1, 0.05)).export(file_type="stl"))
    shapes, told = taken(cell, "scene.yaml", MESSAGE)
    can, block = (shapes[name] for name in ("Can1", next(name for name in shapes if name.startswith("Can1 "))))
    assert (can.kind, can.extent.tolist()) == ("cylinder", pytest.approx([0.06, 0.06, 0.12]))
    assert block.lower == pytest.approx([-1.3, -0.15, 0.3])
    parts = [shape for name, shape in shapes.items() if name.startswith("part")]
    assert np.min([shape.lower for shape in parts], axis=0) == pytest.approx([0.1, -1.2, 0.5])
    assert any("base_link" in note for note in told["notes"])
    assert shapes["cup"].extent == pytest.approx([0.4, 0.2, 0.1])
    assert told["left_out"] == [
        "cup (a mesh, and gone.stl is not there)",
        "bottle (in the gripper)",
        "the octomap",
    ]


SDF = """
<sdf version="1.9"><world name="w">
  <include><uri>model://sun</uri></include>
  <model name="shelf"><pose degrees="true">1.5 0 0.2 0 0 90</pose>
    <link name="l"><pose>0.1 0 0.3 0.1 0.2 0.3</pose>
      <collision name="c"><pose>0 0 0.1 0 0 0</pose><geometry><box><size>0.3 0.2 0.1</size></box></geometry></collision>
      <collision name="m"><geometry><mesh>
        <uri>package://lab/meshes/part.stl</uri><scale>0.001 0.001 0.001</scale>
      </mesh></geometry></collision>
      <collision name="n"><geometry><mesh><uri>gone.stl</uri></mesh></geometry></collision>
    </link></model>
  <model name="cone"><pose>-1.5 0 0.5 0 0 0</pose>
    <link name="l"><collision name="c"><geometry>
      <cone><radius>0.1</radius><length>0.4</length></cone>
    </geometry></collision></link></model>
</world></sdf>
"""


def test_a_world_of_gazebo_comes_in(cell: Path) -> None:
    (cell.parent / "meshes").mkdir()
    (cell.parent / "meshes" / "part.stl").write_bytes(
        trimesh.creation.box((200.0, 100.0, 50.0)).export(file_type="stl")
    )
    shapes, told = taken(cell, "world.sdf", SDF)
    model = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0, 0, np.pi / 2), np.array([1.5, 0.0, 0.2]))
    link = model * pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.1, 0.2, 0.3), np.array([0.1, 0.0, 0.3]))
    board = link * pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 0.1]))
    assert np.abs(shapes["shelf"].X_WC - board.homogeneous).max() < 1e-9
    mesh = next(shape for name, shape in shapes.items() if name.startswith("shelf "))
    assert np.abs(mesh.X_WC - link.homogeneous).max() < 1e-9
    assert mesh.extent == pytest.approx([0.2, 0.1, 0.05])
    assert (shapes["cone"].kind, shapes["cone"].extent[2]) == ("cylinder", pytest.approx(0.4))
    assert told["left_out"] == [
        "model://sun (included from another file, which is not there)",
        "shelf (a mesh, and gone.stl is not there)",
    ]


INCLUDING_SDF = """
<sdf version="1.7"><world name="w">
  <actor name="walker"/>
  <include><uri>model://post</uri><name>first</name><pose>1.5 0 0.5 0 0 0</pose></include>
  <include><uri>model://post</uri></include>
  <model name="sign"><link name="l"><visual name="v"/></link></model>
  <model name="arch"><pose>0 -1.5 0 0 0 0</pose>
    <link name="left"><pose relative_to="__model__">0.2 0 0.5 0 0 0</pose></link>
    <joint name="hinge" type="revolute"><parent>left</parent><child>right</child></joint>
    <link name="right"><pose relative_to="left">0.1 0 0 0 0 0</pose>
      <collision name="c"><pose relative_to="gone">0 0 0 0 0 0</pose></collision>
      <collision name="d"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision></link></model>
</world></sdf>
"""
POST = """
<sdf version="1.7"><model name="post"><pose>-1.5 0 0.3 0 0 0</pose>
  <link name="l"><collision name="c"><geometry><sphere><radius>0.1</radius></sphere></geometry></collision></link>
</model></sdf>
"""


def test_models_that_a_world_includes_come_in(cell: Path) -> None:
    (cell.parent / "models" / "post").mkdir(parents=True)
    (cell.parent / "models" / "post" / "model.sdf").write_text(POST)
    shapes, told = taken(cell, "world.sdf", INCLUDING_SDF)
    places = {name: shape.X_WC[:3, 3].tolist() for name, shape in shapes.items()}
    assert places == {
        "first": pytest.approx([1.5, 0.0, 0.5]),
        "post": pytest.approx([-1.5, 0.0, 0.3]),
        "arch": pytest.approx([0.3, -1.5, 0.5]),
    }
    assert told["left_out"] == ["walker (actor)", "sign (only drawn)", "arch (placed relative to gone)"]
    assert "arch: joints move right; shapes are taken where the file has them" in told["notes"]


@pytest.mark.parametrize(
    "there", ["keep_out = []", "keep_out = [\n  { lower_m = [2.0, 2.0, 0.0], upper_m = [3.0, 3.0, 1.0] },\n]", ""]
)
def test_what_stands_in_the_cell_stays_and_a_second_import_adds_to_the_first(cell: Path, there: str) -> None:
    cell.write_text(cell.read_text().replace("keep_out = []", there))
    before = len(load_cell(cell).surroundings.keep_out)
    for count, x in ((1, 1.5), (2, 1.6)):
        shapes, told = taken(cell, "old.scene", BALL.format(x=x, radius=0.1))
        assert len(shapes) == before + count
        assert told["there_already"] == []


BALL = "(old)\n* ball\n1\nsphere\n{radius}\n{x} 0 0.5\n0 0 0 1\n0 0 0 0\n.\n"
OLD_MESH = "(old)\n* wedge\n1\nmesh\n4 4\n{vertices}\n{faces}\n-1.5 0 0.5\n0 0 0 1\n0 0 0 0\n.\n"


def test_what_is_there_already_is_told_and_not_added_again(cell: Path) -> None:
    (first, _) = taken(cell, "a.scene", BALL.format(x=1.5, radius=0.1))
    written = cell.read_text()
    again, told = taken(cell, "a.scene", BALL.format(x=1.5, radius=0.1))
    assert list(again) == list(first) == ["ball"]
    assert (told["shapes"], told["there_already"]) == ([], ["ball"])
    assert cell.read_text() == written
    two = BALL.format(x=1.5, radius=0.1).replace("1\nsphere", "2\nsphere", 1)
    two = two.replace("0 0 0 0\n.", "0 0 0 0\nsphere\n0.1\n1.5 0 0.5\n0 0 0 1\n0 0 0 0\n.")
    more, told = taken(cell, "b.scene", two)  # one of both is there
    assert (len(more), told["there_already"], len(told["shapes"])) == (2, ["ball"], 1)
    _, told = taken(cell, "b.scene", two)
    assert (set(told["there_already"]), told["shapes"]) == (set(more), [])
    larger, told = taken(cell, "c.scene", BALL.format(x=1.5, radius=0.2))  # at the same place
    assert (len(larger), told["there_already"]) == (3, [])


def test_a_scene_of_every_shape_is_not_added_twice(cell: Path) -> None:
    shapes, _ = taken(cell, "world.xml", MJCF)
    rows = ["\n".join(" ".join(map(str, row)) for row in table) for table in (TETRAHEDRON, FACES)]
    wedge = OLD_MESH.format(vertices=rows[0], faces=rows[1])
    both, _ = taken(cell, "wedge.scene", wedge)
    files = sorted(cell.parent.glob("*.obj"))
    for name, text, there in (("world.xml", MJCF, list(shapes)), ("wedge.scene", wedge, ["wedge"])):
        again, told = taken(cell, name, text)
        assert list(again) == list(both)
        assert (sorted(told["there_already"]), told["shapes"]) == (sorted(there), [])
    assert sorted(cell.parent.glob("*.obj")) == files
    done = CliRunner().invoke(main, ["cell", "import", str(cell.parent / "wedge.scene"), "--into", str(cell)])
    assert "there already, the same: wedge" in done.output


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.scene", "(x)\n* a\n1\nbox\n0.1 0.1", "must be 3 numbers"),
        ("a.scene", "(x)\n* a\n1\n", "ends before"),
        ("a.yaml", "a: &x [1]\nb: *x\n", "aliases"),
        ("a.yaml", "nothing: here\n", "collision_objects"),
        ("a.xml", "<html/>", "no URDF, SDF or MJCF"),
        ("a.urdf.xacro", "<robot/>", "to be expanded"),
        ("a.sdf", "<sdf><model name='m'><link><pose>1 2 x</pose></link></model></sdf>", "must be 6 numbers"),
        ("a.xml", "<mujoco><worldbody><geom size='1' quat='0 0 0 0'/></worldbody></mujoco>", "zero"),
        ("a.srdf", "<robot/>", "no shapes"),
        ("a.scene", "(x)\n* a\n1\nsphere\n5\n0 0 0.5\n0 0 0 1\n0 0 0 0\n.\n", "home_rad"),  # around the arm
    ],
)
def test_what_is_no_scene_is_refused_and_the_cell_stays(cell: Path, name: str, text: str, words: str) -> None:
    (cell.parent / name).write_text(text)
    before = cell.read_text()
    done = CliRunner().invoke(main, ["cell", "import", str(cell.parent / name), "--into", str(cell)])
    assert done.exit_code == 1
    assert words in done.output
    assert cell.read_text() == before


def test_a_cell_that_came_with_fling_is_not_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.scene").write_text("(x)\n* a\n1\nsphere\n0.1\n2 0 0.5\n0 0 0 1\n0 0 0 0\n.\n")
    done = CliRunner().invoke(main, ["cell", "import", "a.scene", "--into", "ur5e-sim"])
    assert done.exit_code == 1
    assert "copy it to ./cells" in done.output

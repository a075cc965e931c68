"""A cell as other programs read it: arm, tool and what stands around it, as URDF and as MJCF.

The frame of a link's body is that of its joint, turned with it: the arm's DH frame of the same number lies beyond the
link's fixed transform. The object, clearances and limits on acceleration and jerk have no place in these files.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from planner.arrays import Array
from planner.calibration import fixed_transforms
from planner.cell import Cell, Solid
from planner.geometry import body_capsules
from planner.rotations import axes_along, matrix_to_quaternion, pose

FLOOR_M = (10.0, 10.0, 0.1)  # a URDF has no planes: its floor is a box that ends at the floor
POINT_INERTIA_KG_M2 = 1e-9  # of the tool, whose mass is taken at a point: MuJoCo wants some
ARM, TOOL, WORLD = "arm", "tool", "world"


@dataclass(frozen=True, eq=False)
class ExportedShape:
    """A shape of a body: kind, pose in it (4, 4), and extent along its own axes (3,) [m]."""

    kind: str
    X: Array
    extent: Array


@dataclass(frozen=True, eq=False)
class ExportedBody:
    """A body that hangs from the one before.

    Attributes:
        name: of the body.
        X: pose of its frame in the one before, its joint at 0 (4, 4).
        joint: number of the joint that turns it about z; None: it is fixed.
        mass: [kg].
        com: its centre of mass (3,) [m].
        inertia: about that, along the body's axes (3, 3) [kg m^2].
        shapes: capsules in its frame.
    """

    name: str
    X: Array
    joint: int | None
    mass: float
    com: Array
    inertia: Array
    shapes: Sequence[ExportedShape]


def _bodies(cell: Cell) -> list[ExportedBody]:
    """Returns base, links and tool, each in the one before."""
    fixed = fixed_transforms(cell.robot)
    capsules = body_capsules(cell.robot, cell.tool.capsules)
    none = np.zeros(3), np.zeros((3, 3))

    def shapes(frame: int, is_tool: bool, X: Array) -> list[ExportedShape]:
        own = [c for c in capsules if c.frame == frame and c.name.startswith("tool_") == is_tool]
        return [_capsule(X, c.p0, c.p1, c.radius_m) for c in own]

    bodies = [ExportedBody("base_link", cell.X_WB, None, 0.0, *none, shapes(0, False, np.eye(4)))]
    before = np.eye(4)
    for i, (link, X) in enumerate(zip(cell.robot.links, fixed, strict=True)):
        R = X[:3, :3]
        com = R @ link.com + X[:3, 3]
        inertia = R @ link.inertia @ R.T
        bodies.append(ExportedBody(link.name, before, i, link.mass, com, inertia, shapes(i + 1, False, X)))
        before = X
    half_way = 0.5 * cell.tool.end_F  # as the planner takes it
    inertia = POINT_INERTIA_KG_M2 * np.eye(3)
    bodies.append(ExportedBody(TOOL, before, None, cell.tool.mass_kg, half_way, inertia, shapes(6, True, np.eye(4))))
    return bodies


def _capsule(X: Array, p0: Array, p1: Array, radius_m: float) -> ExportedShape:
    """Returns a capsule between two points of a frame, whose pose is X."""
    along = p1 - p0
    length = float(np.linalg.norm(along))
    z = along / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    extent = np.array([2.0 * radius_m, 2.0 * radius_m, 2.0 * radius_m + length])
    kind = "sphere" if length == 0.0 else "capsule"
    return ExportedShape(kind, X @ pose(0.5 * (p0 + p1), axes_along(z)), extent)


def _of_solid(shape: Solid) -> ExportedShape:
    return ExportedShape(shape.kind, shape.X_WC, shape.extent)


def urdf_of(cell: Cell) -> str:
    """Returns a cell as URDF; a capsule is a cylinder and two spheres."""
    robot = Element("robot", name=cell.name)
    SubElement(robot, "link", name=WORLD)
    parent = WORLD
    for body in _bodies(cell):
        _urdf_link(
            robot, parent, body.name, body.X, [p for shape in body.shapes for p in _parts(shape)], body.joint, cell
        )
        if body.mass > 0.0:
            inertial = SubElement(robot.findall("link")[-1], "inertial")
            SubElement(inertial, "origin", xyz=_text(body.com))
            SubElement(inertial, "mass", value=_text([body.mass]))
            rows = dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), body.inertia[np.triu_indices(3)], strict=True))
            SubElement(inertial, "inertia", {key: _text([value]) for key, value in rows.items()})
        parent = body.name
    _urdf_link(robot, TOOL, "tcp", cell.tool.X_FT, [], None, cell)
    around = cell.surroundings
    floor = ExportedShape("box", pose([0.0, 0.0, around.floor_z_m - 0.5 * FLOOR_M[2]], np.eye(3)), np.array(FLOOR_M))
    for name, shape in (("floor", floor), *zip(around.keep_out_names, map(_of_solid, around.keep_out), strict=True)):
        local = ExportedShape(shape.kind, np.eye(4), shape.extent)
        called = f"keep_out {name}" if any(each.get("name") == name for each in robot) else name
        _urdf_link(robot, WORLD, called, shape.X, list(_parts(local)), None, cell)
    indent(robot)
    return tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _urdf_link(
    robot: Element, parent: str, name: str, X: Array, shapes: list[ExportedShape], joint: int | None, cell: Cell
) -> None:
    link = SubElement(robot, "link", name=name)
    for shape in shapes:
        for tag in ("collision", "visual"):
            element = SubElement(link, tag)
            _urdf_origin(element, shape.X)
            geometry = SubElement(element, "geometry")
            radius, length = (_text([x]) for x in (0.5 * shape.extent[0], shape.extent[2]))
            if shape.kind == "box":
                SubElement(geometry, "box", size=_text(shape.extent))
            elif shape.kind == "sphere":
                SubElement(geometry, "sphere", radius=radius)
            else:
                SubElement(geometry, "cylinder", radius=radius, length=length)
    kind = "fixed" if joint is None else "revolute"
    called = f"{parent}-{name}" if joint is None else cell.robot.joint_names[joint]
    element = SubElement(robot, "joint", name=called, type=kind)
    SubElement(element, "parent", link=parent)
    SubElement(element, "child", link=name)
    _urdf_origin(element, X)
    if joint is not None:
        SubElement(element, "axis", xyz="0 0 1")
        limits = cell.limits
        columns = {
            "lower": limits.q_lower,
            "upper": limits.q_upper,
            "velocity": limits.qd_max,
            "effort": limits.tau_max,
        }
        SubElement(element, "limit", {key: _text([column[joint]]) for key, column in columns.items()})


def _parts(shape: ExportedShape) -> Iterator[ExportedShape]:
    """Yields the shapes of a URDF that a shape consists of."""
    if shape.kind != "capsule":
        yield shape
        return
    thick = shape.extent[0]
    length = shape.extent[2] - thick
    yield ExportedShape("cylinder", shape.X, np.array([thick, thick, length]))
    for end in (-0.5, 0.5):
        yield ExportedShape("sphere", shape.X @ pose([0.0, 0.0, end * length], np.eye(3)), np.full(3, thick))


def _urdf_origin(element: Element, X: Array) -> None:
    """Adds the place of an element: x y z, and angles about x, then y, then z."""
    R = X[:3, :3]
    across = float(np.hypot(R[0, 0], R[1, 0]))
    pitch = float(np.arctan2(-R[2, 0], across))
    if across > 1e-9:
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    else:  # x is up or down: one angle does for both
        roll, yaw = np.arctan2(-R[1, 2], R[1, 1]), 0.0
    SubElement(element, "origin", xyz=_text(X[:3, 3]), rpy=_text([roll, pitch, yaw]))


def mjcf_of(cell: Cell) -> str:
    """Returns a cell as MJCF; parts of the arm and the tool meet what stands around them, and not each other."""
    root = Element("mujoco", model=cell.name)
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", gravity=_text([0.0, 0.0, -cell.surroundings.gravity_m_s2]))
    default = SubElement(root, "default")
    SubElement(SubElement(default, "default", {"class": ARM}), "geom", contype="1", conaffinity="2")
    SubElement(SubElement(default, "default", {"class": WORLD}), "geom", contype="2", conaffinity="1")
    world = SubElement(root, "worldbody")
    around = cell.surroundings
    place = {"pos": _text([0.0, 0.0, around.floor_z_m]), "size": "5 5 0.1"}
    SubElement(world, "geom", {"name": "floor", "class": WORLD, "type": "plane", **place})
    for name, solid in zip(around.keep_out_names, around.keep_out, strict=True):
        _geom(world, _of_solid(solid), WORLD, name)
    parent = world
    for body in _bodies(cell):
        parent = SubElement(parent, "body", {"name": body.name, **_place(body.X)})
        if body.mass > 0.0:
            inertia = body.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            inertial = {"mass": _text([body.mass]), "pos": _text(body.com), "fullinertia": _text(inertia)}
            SubElement(parent, "inertial", inertial)
        if body.joint is not None:
            limits = cell.limits
            span = [limits.q_lower[body.joint], limits.q_upper[body.joint]]
            SubElement(parent, "joint", name=cell.robot.joint_names[body.joint], axis="0 0 1", range=_text(span))
        for shape in body.shapes:
            _geom(parent, shape, ARM)
    SubElement(parent, "site", {"name": "tcp", **_place(cell.tool.X_FT)})
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def _geom(parent: Element, shape: ExportedShape, kind: str, name: str = "") -> None:
    radius, length = 0.5 * shape.extent[0], shape.extent[2]
    sizes = {
        "box": 0.5 * shape.extent,
        "sphere": [radius],
        "cylinder": [radius, 0.5 * length],
        "capsule": [radius, 0.5 * length - radius],
    }
    called = {"name": name} if name else {}
    size = _text(sizes[shape.kind])
    SubElement(
        parent, "geom", {**called, "class": kind, "type": shape.kind, "size": size, "mass": "0", **_place(shape.X)}
    )


def _place(X: Array) -> dict[str, str]:
    x, y, z, w = matrix_to_quaternion(X[:3, :3])
    return {"pos": _text(X[:3, 3]), "quat": _text([w, x, y, z])}


def _text(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(value)) for value in values)

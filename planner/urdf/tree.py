"""Links and joints of a URDF file, checked one by one.

A URDF file is somebody else's: its size and depth are bounded, every number is finite, and what it lacks is named.
Source: http://wiki.ros.org/urdf/XML
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np

from planner.arrays import Array
from planner.documents import NotXml, parse_xml
from planner.rotations import pose, roll_pitch_yaw_to_matrix

LINKS_MAX = 500  # of a file: a mobile robot with two arms and hands has a hundred
SHAPES_MAX = 1000  # of a file: an arm on its table has twenty
TEXT_MAX = 200  # characters of a name
ROUND = {"cylinder": ("radius", "length"), "sphere": ("radius",)}  # sizes of round shapes
MOVING = ("revolute", "continuous")
KINDS = (*MOVING, "prismatic", "fixed", "floating", "planar")


class UrdfRefused(ValueError):
    """A URDF file does not describe an arm that Fling can take; the message is the end of a sentence."""


@dataclass(frozen=True, eq=False)
class UrdfBody:
    """Mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg m^2], in the frame of a link."""

    mass: float
    com: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class UrdfShape:
    """A shape of a link.

    Attributes:
        kind: box, cylinder, sphere, mesh, or what else the file calls it.
        X: pose of its centre in the link's frame (4, 4).
        numbers: edges of a box, radius and length of a cylinder, radius of a sphere [m]; scales of a mesh.
        file: of a mesh, as the file writes it.
        collides: whether it is for collisions, and not only drawn.
    """

    kind: str
    X: Array
    numbers: Sequence[float]
    file: str
    collides: bool


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint of a URDF file.

    Attributes:
        name: of the joint.
        kind: one of `KINDS`.
        parent, child: names of its links.
        X: pose of the joint, and of the child at position 0, in the parent (4, 4).
        axis: unit vector in the joint's frame (3,).
        lower, upper: limits on its position [rad]; None without end, or where the file says nothing.
        velocity: limit [rad/s]; None: the file says nothing.
        effort: limit [N m]; None: the file says nothing.
    """

    name: str
    kind: str
    parent: str
    child: str
    X: Array
    axis: Array
    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None

    @property
    def moves(self) -> bool:
        """Whether it moves at all."""
        return self.kind != "fixed"


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """What a URDF file says.

    Attributes:
        name: of the robot.
        bodies: of the links, None of a link without mass.
        shapes: of the links that have some: those for collisions, or else those that are drawn.
        joints: by the name of their child.
        root: name of the link that is no child.
    """

    name: str
    bodies: Mapping[str, UrdfBody | None]
    shapes: Mapping[str, Sequence[UrdfShape]]
    joints: Mapping[str, UrdfJoint]
    root: str

    def above(self, link: str) -> list[UrdfJoint]:
        """Returns the joints from the root to a link."""
        found = []
        while link in self.joints:
            found.append(self.joints[link])
            link = self.joints[link].parent
        return found[::-1]

    def pose(self, link: str) -> Array:
        """Returns the pose of a link in the root's frame (4, 4), with every joint at position 0."""
        X = np.eye(4)
        for joint in self.above(link):
            X = X @ joint.X
        return X

    def below(self, link: str) -> list[str]:
        """Returns a link and all that hang from it."""
        return [other for other in self.bodies if link == other or any(j.parent == link for j in self.above(other))]


def parse_urdf(text: bytes) -> UrdfTree:
    """Returns what a URDF file says.

    Raises:
        UrdfRefused: it is no URDF, or a number in it is none.
    """
    try:
        root = parse_xml(text)
    except NotXml as error:
        raise UrdfRefused(str(error)) from error
    if root.tag != "robot":
        kind = " (a xacro file has to be expanded first: xacro FILE > FILE.urdf)" if "xacro" in root.tag else ""
        raise UrdfRefused(f"is not a URDF: its outermost element is <{root.tag[:TEXT_MAX]}>, not <robot>{kind}")
    if any("xacro" in child.tag for child in root):
        raise UrdfRefused("is a xacro file, which has to be expanded first: xacro FILE > FILE.urdf")
    bodies = dict(_links(root))
    joints: dict[str, UrdfJoint] = {}
    for element in root.iterfind("joint"):
        joint = _joint(element, bodies)
        if joint.child in joints:
            raise UrdfRefused(f"link {joint.child} hangs from two joints: {joints[joint.child].name} and {joint.name}")
        joints[joint.child] = joint
    return UrdfTree(root.get("name", "")[:TEXT_MAX], bodies, _shapes(root), joints, _root(bodies, joints))


def _links(root: Element) -> Iterator[tuple[str, UrdfBody | None]]:
    links = root.findall("link")
    if not links:
        raise UrdfRefused("has no links")
    if len(links) > LINKS_MAX:
        raise UrdfRefused(f"has {len(links)} links; {LINKS_MAX} are read at most")
    seen = set()
    for element in links:
        name = _name(element, "name")
        if name in seen:
            raise UrdfRefused(f"link {name} is there twice")
        seen.add(name)
        inertial = element.find("inertial")
        yield name, None if inertial is None else _body(inertial, name)


def _body(inertial: Element, link: str) -> UrdfBody:
    where = f"link {link}: inertial"
    mass = _float(_child(inertial, "mass", where), "value", where, 0.0)
    X = _origin(inertial, where)
    tensor = _child(inertial, "inertia", where)
    xx, xy, xz, yy, yz, zz = (_float(tensor, key, where) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    inertia = X[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ X[:3, :3].T
    return UrdfBody(mass, X[:3, 3], inertia)


def _shapes(root: Element) -> dict[str, list[UrdfShape]]:
    """Returns the shapes of the links that have some: what is only drawn counts where nothing collides."""
    found = {}
    for link in root.iterfind("link"):
        elements = link.findall("collision") or link.findall("visual")
        if elements:
            where = f"link {link.get('name')}: {elements[0].tag}"
            found[link.get("name", "")] = [_shape(element, where) for element in elements]
    if (number := sum(map(len, found.values()))) > SHAPES_MAX:
        raise UrdfRefused(f"has {number} shapes; {SHAPES_MAX} are read at most")
    return found


def _shape(element: Element, where: str) -> UrdfShape:
    geometry = _child(element, "geometry", where)
    shape = next(iter(geometry), None)
    if shape is None:
        raise UrdfRefused(f"{where}: its <geometry> is empty")
    key = {"box": "size", "mesh": "scale"}.get(shape.tag)
    if key is None:
        numbers = [_float(shape, each, where, 0.0) for each in ROUND.get(shape.tag, ())]
    else:
        numbers = [1.0] * 3 if key == "scale" and key not in shape.attrib else _vector(shape, key, where).tolist()
    if shape.tag == "box" and min(numbers) < 0.0:
        raise UrdfRefused(f"{where}: the size of its box is negative")
    file = shape.get("filename", "")
    return UrdfShape(shape.tag[:TEXT_MAX], _origin(element, where), numbers, file, element.tag == "collision")


def _joint(element: Element, links: Mapping[str, object]) -> UrdfJoint:
    name = _name(element, "name")
    where = f"joint {name}"
    kind = element.get("type", "")
    if kind not in KINDS:
        raise UrdfRefused(f"{where}: its type is {kind[:TEXT_MAX]!r}, not one of {', '.join(KINDS)}")
    ends = [_name(_child(element, end, where), "link") for end in ("parent", "child")]
    for end in ends:
        if end not in links:
            raise UrdfRefused(f"{where}: there is no link {end}")
    limit = element.find("limit")
    numbers = {
        key: None if limit is None or key not in limit.attrib else _float(limit, key, where)
        for key in ("lower", "upper", "velocity", "effort")
    }
    if kind == "continuous":
        numbers |= {"lower": None, "upper": None}
    axis = np.array([1.0, 0.0, 0.0]) if kind == "fixed" else _axis(element, where)  # exporters write 0 0 0
    return UrdfJoint(name, kind, ends[0], ends[1], _origin(element, where), axis, **numbers)


def _axis(element: Element, where: str) -> Array:
    child = element.find("axis")
    axis = np.array([1.0, 0.0, 0.0]) if child is None else _vector(child, "xyz", where)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        raise UrdfRefused(f"{where}: its axis is zero")
    return axis / length


def _root(links: Mapping[str, object], joints: Mapping[str, UrdfJoint]) -> str:
    roots = [link for link in links if link not in joints]
    if len(roots) != 1:
        listed = ", ".join(roots[:5]) or "none"
        raise UrdfRefused(f"is not one tree: exactly one link hangs from no joint, here {listed}")
    reached = {roots[0]}
    left = [*joints.values()]
    while grown := [joint for joint in left if joint.parent in reached]:
        reached |= {joint.child for joint in grown}
        left = [joint for joint in left if joint.child not in reached]
    if left:
        raise UrdfRefused(f"has joints in a circle: {', '.join(joint.name for joint in left[:5])}")
    return roots[0]


def _origin(element: Element, where: str) -> Array:
    """Returns the pose of an element's origin (4, 4): x y z, and rotations about x, then y, then z."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    roll, pitch, yaw = _vector(origin, "rpy", where) if "rpy" in origin.attrib else np.zeros(3)
    place = _vector(origin, "xyz", where) if "xyz" in origin.attrib else np.zeros(3)
    return pose(place, roll_pitch_yaw_to_matrix(roll, pitch, yaw))


def _child(element: Element, tag: str, where: str) -> Element:
    child = element.find(tag)
    if child is None:
        raise UrdfRefused(f"{where}: <{tag}> is missing")
    return child


def _name(element: Element, key: str) -> str:
    name = element.get(key, "")
    if not name or len(name) > TEXT_MAX or not name.isprintable():
        raise UrdfRefused(f"a <{element.tag[:TEXT_MAX]}> has no {key}, or one of more than {TEXT_MAX} characters")
    return name


def _vector(element: Element, key: str, where: str) -> Array:
    words = element.get(key, "").split()
    if len(words) != 3:
        raise UrdfRefused(f"{where}: {key} of <{element.tag}> must be three numbers")
    return np.array([_number(word, key, where) for word in words])


def _float(element: Element, key: str, where: str, least: float = -math.inf) -> float:
    value = _number(element.get(key, ""), key, where)
    if value < least:
        raise UrdfRefused(f"{where}: {key} = {value:g} is below {least:g}")
    return value


def _number(word: str, key: str, where: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UrdfRefused(f"{where}: {key} = {word[:TEXT_MAX]!r} is no finite number")
    return value

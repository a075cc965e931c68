"""What stands around the arm in a URDF file: its shapes, and what a cell file has no room for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from planner.documents import read_file
from planner.errors import FileRefused
from planner.scenes import ForeignScene, ForeignShape, mesh_at, shape_or_reason
from planner.urdf.arm import joint_frames, six_joints
from planner.urdf.tree import UrdfJoint, UrdfRefused, UrdfShape, UrdfTree, parse_urdf

URDF_BYTES = 5_000_000  # [byte] of a URDF file; that of an arm has 20,000


def scene_of_urdf(path: Path) -> ForeignScene:
    """Returns the shapes of a URDF file, but for those of the arm in it, if there is one, and of its tool.

    Raises:
        FileRefused: the file cannot be read, or is no URDF.
    """
    try:
        tree = parse_urdf(read_file(path, URDF_BYTES))
    except UrdfRefused as error:
        raise FileRefused(path, str(error)) from error
    try:
        joints = six_joints(tree)
    except UrdfRefused:
        joints = []  # it has no arm
    scene = shapes_around(tree, joints, path.parent)
    if joints:
        scene.X_WB, _ = joint_frames(tree, joints)
    return scene


def shapes_around(tree: UrdfTree, joints: Sequence[UrdfJoint], folder: Path | None = None) -> ForeignScene:
    """Returns the shapes that are neither the arm's nor the tool's, and what becomes of the others.

    The arm's are those of its six links, and of the link that carries them: its base.

    Args:
        tree: of the file.
        joints: of the arm; none without one.
        folder: of the file, beside which its meshes are; None: they are left out.
    """
    links: set[str] = set()
    scene = ForeignScene()
    if joints:
        foot = joints[0].parent
        links = {foot, *(joint.child for joint in joints), *tree.below(joints[-1].child)}
        scene.notes += _notes_on_base(tree.shapes.get(foot, ()), foot)
    for link, shapes in tree.shapes.items():
        mover = next((joint.name for joint in tree.above(link) if joint.moves), None)
        for shape in shapes if link not in links else ():
            scene.take(link, f"moved by {mover}" if mover is not None else _shape(tree, link, shape, folder))
    return scene


def _shape(tree: UrdfTree, link: str, shape: UrdfShape, folder: Path | None) -> ForeignShape | str:
    if not shape.collides:
        return f"a {shape.kind} that is only drawn"
    X = tree.pose(link) @ shape.X
    if shape.kind != "mesh":
        return shape_or_reason(link, shape.kind, X, shape.numbers)
    return "a mesh" if folder is None else mesh_at(link, X, folder, shape.file, shape.numbers)


def notes_on_shapes(scene: ForeignScene) -> list[str]:
    """Returns notes on what became of the shapes around an arm."""
    taken = ", ".join(dict.fromkeys(shape.name for shape in scene.shapes))
    notes = [f"surroundings.keep_out has the shapes of {taken}"] if taken else []
    if left := list(dict.fromkeys(scene.left_out)):
        shapes = "shape of" if len(left) == 1 else "shapes of"
        verb = "is" if len(left) == 1 else "are"
        takes = "`fling cell import` takes meshes, and surroundings.keep_out can be written by hand"
        notes.append(f"the {shapes} {', '.join(left)} {verb} not taken over: nothing keeps the arm away; {takes}")
    return [*notes, *scene.notes]


def _notes_on_base(shapes: Sequence[UrdfShape], foot: str) -> list[str]:
    """Returns a note where the link of the arm's base has more than the one mesh of a base: it may be a table, too."""
    if len(shapes) > 1 or any(shape.kind != "mesh" for shape in shapes):
        return [f"the shapes of {foot} count as the arm's base: what else they are belongs into surroundings.keep_out"]
    return []

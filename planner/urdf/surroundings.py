"""What stands around the arm in a URDF file: its boxes as keep-out boxes, and what a cell file has no room for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from planner.arrays import Array
from planner.urdf.arm import DescribedArm
from planner.urdf.tree import UrdfShape, UrdfTree

ALONG = 1e-6  # [-] sine of the angle by which a box along the world's axes may be turned: rounding of a file


@dataclass(frozen=True, eq=False)
class DescribedBox:
    """A box along the world's axes that arm and tool stay out of.

    Attributes:
        link: of the file that it is of.
        lower, upper: its corners in the file's root (3,) [m].
    """

    link: str
    lower: Array
    upper: Array


def boxes_around(tree: UrdfTree, arm: DescribedArm) -> tuple[list[DescribedBox], list[str]]:
    """Returns the boxes around the arm, and notes on every shape that is neither the arm's nor the tool's.

    The arm's are those of its six links, and of the link that carries them: its base.
    """
    foot = arm.joints[0].parent
    links = {foot, *(joint.child for joint in arm.joints), *tree.below(arm.joints[5].child)}
    boxes: list[DescribedBox] = []
    left: dict[str, str] = {}
    for link, shapes in tree.shapes.items():
        if link not in links:
            mover = next((joint.name for joint in tree.above(link) if joint.moves), None)
            reasons = [_refusal(tree, link, shape, mover) for shape in shapes]
            boxes += [_box(tree, link, s) for s, reason in zip(shapes, reasons, strict=True) if reason is None]
            if told := list(dict.fromkeys(reason for reason in reasons if reason)):
                left[link] = ", ".join(told)
    return boxes, [*_notes(boxes, left), *_notes_on_base(tree.shapes.get(foot, ()), foot)]


def _refusal(tree: UrdfTree, link: str, shape: UrdfShape, mover: str | None) -> str | None:
    """Returns why a shape is not taken over, in words; None of a box that is."""
    if mover is not None:
        return f"moved by {mover}"
    if shape.size is None or not shape.collides:
        return f"a {shape.kind}" if shape.collides else f"a {shape.kind} that is only drawn"
    if shape.size.min() == 0.0:
        return "a box without thickness"
    R = (tree.pose(link) @ shape.X)[:3, :3]
    return "a turned box" if (np.sort(np.abs(R))[:, :2] > ALONG).any() else None


def _box(tree: UrdfTree, link: str, shape: UrdfShape) -> DescribedBox:
    X = tree.pose(link) @ shape.X
    assert shape.size is not None
    half = 0.5 * np.abs(X[:3, :3]) @ shape.size
    return DescribedBox(link, X[:3, 3] - half, X[:3, 3] + half)


def _notes(boxes: Sequence[DescribedBox], left: Mapping[str, str]) -> list[str]:
    taken = ", ".join(dict.fromkeys(box.link for box in boxes))
    notes = [f"surroundings.keep_out has the boxes of {taken}"] if boxes else []
    if left:
        named = ", ".join(f"{link} ({why})" for link, why in left.items())
        shapes = "shape of" if len(left) == 1 else "shapes of"
        verb = "is" if len(left) == 1 else "are"
        takes = "surroundings.keep_out can be written by hand"
        notes.append(f"the {shapes} {named} {verb} not taken over: nothing keeps the arm away; {takes}")
    return notes


def _notes_on_base(shapes: Sequence[UrdfShape], foot: str) -> list[str]:
    """Returns a note where the link of the arm's base has more than the one mesh of a base: it may be a table, too."""
    if len(shapes) > 1 or any(shape.kind != "mesh" for shape in shapes):
        return [f"the shapes of {foot} count as the arm's base: what else they are belongs into surroundings.keep_out"]
    return []

"""What the generated functions are told about a cell and a request: one flat vector, named pieces of it.

Nothing of an arm, a tool or a room is compiled in. The same machine code serves every cell.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

LINKS = 6
TOOL_CAPSULES = 2  # capsules of a tool the generated functions have room for; more are wrapped into these
KEEP_OUT = 4  # most keep-out boxes
# DH frames of the capsules: `geometry.arm_capsules` without the foot, which the floor covers; the tool's; the object.
ARM_CAPSULE_FRAMES = (0, 1, 2, 2, 3, 3, 4, 5)  # base, shoulder, upper arm, elbow, forearm, wrists 1, 2, 3
CAPSULE_FRAMES = ARM_CAPSULE_FRAMES + (6,) * (TOOL_CAPSULES + 1)
FIRST_TOOL, OBJECT = len(ARM_CAPSULE_FRAMES), len(CAPSULE_FRAMES) - 1
# Slots that can meet on some arm with some tool; which of them do on this one is a number of `ARM`.
PAIRS = (
    *((i, j) for i in (0, 1) for j in (4, 5, 6, 7)),
    *((2, j) for j in (5, 6, 7)),
    (4, 7),
    *((i, FIRST_TOOL + j) for i in range(6) for j in range(TOOL_CAPSULES)),
)

NX = 19  # q, qd, qdd of six joints, and the time
NU = 7  # jerk of six joints, and the step's length
NZ = NX + NU
Q, QD, QDD, TIME = slice(0, 6), slice(6, 12), slice(12, 18), 18  # where they stand in the state
JERK, STEP = slice(19, 25), 25  # and in state and control together

# Scales that bring every variable to about one; they are part of the generated functions.
QD_SCALE = np.pi  # [rad/s]
QDD_SCALE = 15.0  # [rad/s^2]
JERK_SCALE = 500.0  # [rad/s^3]
TIME_SCALE = 0.1  # [s]


@dataclass(frozen=True)
class Layout:
    """Names and sizes of the pieces of a vector, in their order."""

    sizes: Mapping[str, int]

    @property
    def size(self) -> int:
        """Length of the whole vector."""
        return sum(self.sizes.values())

    def split(self, vector: Any) -> dict[str, Any]:
        """Returns the named pieces of a vector of numbers or of symbols."""
        pieces, at = {}, 0
        for name, size in self.sizes.items():
            pieces[name] = vector[at : at + size]
            at += size
        return pieces

    def pack(self, values: Mapping[str, Any]) -> Vector:
        """Returns the vector of `values`; a scalar fills its piece.

        Raises:
            ValueError: a name is missing or unknown, or a size is wrong.
        """
        if set(values) != set(self.sizes):
            raise ValueError(f"names {set(values) ^ set(self.sizes)} do not match the layout")
        rows = [np.broadcast_to(np.asarray(values[n], float).ravel(), (s,)) for n, s in self.sizes.items()]
        return np.concatenate(rows)


ARM = Layout(
    {
        "dh": 6,  # d1, a2, a3, d4, d5, d6 [m]
        "tcp": 3,  # the tool centre in the flange [m]
        "links": 10
        * LINKS,  # mass, first moment (3), inertia about the frame's origin (xx, xy, xz, yy, yz, zz), a link
        "gravity": 3,  # upward acceleration that stands for gravity, in the base [m/s^2]
        "torque": 6,  # largest joint torques [N m]
        "speed": 1,  # largest speed of the tool centre [m/s]
        "base": 12,  # pose of the base in the world: rotation by columns (9), origin (3)
        "capsules": 7 * len(CAPSULE_FRAMES),  # ends (3 + 3) in its frame, radius; a radius below zero: not there
        "pairs": len(PAIRS),  # added to the distance of each pair of `PAIRS`: 0, or far for a pair that cannot meet [m]
        "floor": 1,  # lowest height of a capsule's surface [m]
        "self_clearance": 1,  # least distance between capsules of the arm and the tool [m]
        "keep_in": 6,  # lower (3), upper (3) of the tool centre's box [m]
    }
)
BOXES = Layout({"boxes": 6 * KEEP_OUT, "box_clearance": 1})  # lower (3), upper (3) a box [m]
RELEASE = Layout({"target": 3, "gravity_z": 1, "tan_elevation": 2})
ABSENT_RADIUS = -1.0e3  # [m] radius of a capsule that is not there: never near anything
FAR = 1.0e3  # [m] added where a pair cannot meet
ABSENT_BOX = 1.0e3  # [m] where a keep-out box that is not there stands

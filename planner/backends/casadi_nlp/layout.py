"""Layout of the optimiser's variables, of the parameter vectors that its generated functions take, and of the stages.

No arm, tool or room is compiled in: the same machine code serves every cell.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

LINKS = 6
TOOL_CAPSULES = 2  # [-] slots for a tool's capsules; a tool with more has the last ones wrapped into one
SHAPE_SLOTS = (1, 2, 4)  # [-] numbers of keep-out shapes that there are functions for
KEEP_OUT_SHAPES = SHAPE_SLOTS[-1]  # [-] the nearest; further shapes are left to the certificate
KEEP_IN_ROOMS = 4  # [-] slots for keep-in shapes that are no plain boxes; further ones are left to the certificate
FLIGHT_EDGES = 8  # [-] slots for edges that the object's flight passes: two for each of four shapes
# DH frame of each capsule slot: `geometry.arm_capsules` without the foot, which the floor covers; the tool; the object.
ARM_CAPSULES = {
    "base": 0,
    "shoulder": 1,
    "upper_arm": 2,
    "upper_arm_start": 2,
    "upper_arm_end": 2,
    "elbow": 2,
    "forearm": 3,
    "forearm_start": 3,
    "wrist_1": 3,
    "wrist_2": 4,
    "wrist_3": 5,
}
ARM_CAPSULE_FRAMES = tuple(ARM_CAPSULES.values())
CAPSULE_FRAMES = ARM_CAPSULE_FRAMES + (6,) * (TOOL_CAPSULES + 1)
FIRST_TOOL = len(ARM_CAPSULE_FRAMES)
OBJECT = len(CAPSULE_FRAMES) - 1
BASE = 0  # the slot that no joint moves
PATH_TERMS = 5  # [-] of the polynomial that the object's path is; exact without drag, where the last two are zero
CHORDS = 10  # [-] that the path past the resting arm is taken for
# Pairs of slots that can collide on some arm with some tool; `ARM`'s "pairs" rules out those that cannot on this one.
MEETS = {
    ("base", "shoulder"): ("forearm", "forearm_start", "wrist_1", "wrist_2", "wrist_3"),
    ("upper_arm", "upper_arm_start", "upper_arm_end"): ("wrist_1", "wrist_2", "wrist_3"),
    ("forearm",): ("wrist_3",),
}
_SLOTS = {name: slot for slot, name in enumerate(ARM_CAPSULES)}
PAIRS = (
    *((_SLOTS[i], _SLOTS[j]) for near, far in MEETS.items() for i in near for j in far),
    *((i, FIRST_TOOL + j) for i in range(_SLOTS["wrist_2"]) for j in range(TOOL_CAPSULES)),
)

NX = 19  # state: q, qd, qdd of six joints, and the time
NU = 7  # control: jerk of six joints, and the length of the step
NZ = NX + NU
Q = slice(0, 6)
QD = slice(6, 12)
QDD = slice(12, 18)
TIME = 18  # positions within z = (state, control)
JERK = slice(19, 25)
STEP = 25
# Further states of the stages from the release on, where rows follow an object whose release is free: its position [m]
# and velocity [m/s] in the world at the release, not scaled. Blocks that depend on them take (z, thrown).
N_THROWN = 6
PLACE = slice(NZ, NZ + 3)
SPEED = slice(NZ + 3, NZ + N_THROWN)


@dataclass(frozen=True)
class VectorLayout:
    """Names and sizes of the pieces of a vector, in order."""

    sizes: Mapping[str, int]

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Position of each piece."""
        ends = np.cumsum(list(self.sizes.values())).tolist()
        return {name: slice(end - size, end) for (name, size), end in zip(self.sizes.items(), ends, strict=True)}

    @cached_property
    def size(self) -> int:
        """Length of the whole vector."""
        return sum(self.sizes.values())

    def split(self, vector: Any) -> dict[str, Any]:
        """Returns the named pieces of a vector of numbers or symbols."""
        return {name: vector[piece] for name, piece in self.slices.items()}

    def pack(self, values: Mapping[str, Any]) -> Vector:
        """Returns the vector of `values`; a scalar fills its piece.

        Raises:
            ValueError: a name is missing or unknown, or a size is wrong.
        """
        if values.keys() != self.sizes.keys():
            raise ValueError(f"names {values.keys() ^ self.sizes.keys()} do not match the layout")
        vector = np.empty(self.size)
        for name, piece in self.slices.items():
            vector[piece] = np.ravel(values[name])
        return vector


# What a scaled variable of one is in SI units; joint positions are not scaled.
SCALES = VectorLayout({"qd": LINKS, "qdd": LINKS, "jerk": LINKS, "time": 1})  # [rad/s], [rad/s^2], [rad/s^3], [s]
ARM = VectorLayout(
    {
        "dh": 6,  # d1, a2, a3, d4, d5, d6 [m]
        "tcp": 3,  # tool centre point in the flange frame [m]
        # per link: mass, first moment (3), inertia about the frame's origin (xx, xy, xz, yy, yz, zz)
        "links": 10 * LINKS,
        "gravity": 3,  # upward acceleration equivalent to gravity, in the base frame [m/s^2]
        "torque": 6,  # torque limits [N m]
        "speed": 1,  # tool speed limit [m/s]
        "base": 12,  # pose of the base in the world: rotation by columns (9), origin (3)
        "capsules": 7 * len(CAPSULE_FRAMES),  # per slot: end points (3 + 3) in its frame, radius; absent: radius < 0
        "pairs": len(PAIRS),  # added to the distance of each pair of `PAIRS`: 0, or `FAR` for a pair that cannot meet
        "floor": 1,  # least height of a capsule's surface [m]
        "self_clearance": 1,  # least distance between capsules of arm and tool [m]
        "keep_in": 6,  # lower (3) and upper (3) corner of the box that the tool centre point stays in [m]
        "grip": 4,  # what the grip withstands along the tool's axes (3), and in any direction (1) [m/s^2]
        "tool_rotation": 9,  # of the tool frame in the flange, by columns
    }
)
RELEASE = VectorLayout({"target": 3, "gravity_z": 1, "tan_elevation": 2})
# A shape is all that is within the planes of its faces and, where it is round, within a radius of a segment along z.
# What it does not have is `FAR`.
SHAPE = VectorLayout(
    {
        "rotation": 9,  # of the world in the shape's frame, by columns
        "origin": 3,  # of its frame in the world [m]
        "lower": 3,
        "upper": 3,  # corners of the box that its core is in [m]
        "is_round": 1,  # 1 where the core is the cylinder about z in that box, or 0
        "lower_faces": 3,
        "upper_faces": 3,  # [m]
        "reach": 1,  # half the length of that segment [m]
        "radius": 1,  # [m]
        "further": 1,  # clearance beyond that of the cell [m]
        "added": len(CAPSULE_FRAMES),  # to the distance of each capsule: 0, or `FAR` where the two may touch [m]
    }
)
SHAPES = VectorLayout({"shapes": SHAPE.size * KEEP_OUT_SHAPES, "clearance": 1})  # [m]
ROOMS = VectorLayout({"rooms": SHAPE.size * KEEP_IN_ROOMS, "margin": 1})  # "further": clearance from the walls [m]
FLIGHT = VectorLayout(
    {
        # per slot: normal (2), steady and offset, which tell the edge's time, direction (3) and bound [m]; see
        # `flight_rows`
        "edges": 8 * FLIGHT_EDGES,
        "mouth": 5,  # of a bin: centre (2), height of the rim, its radius, and the object's radius [m]
        "spread": 1,  # how early or late the gripper may open [s]
        # of the gripper: direction in the flange frame (3), cosine of the largest angle from it [-], way out [m]
        "opening": 5,
    }
)
OBJECT_PATH = VectorLayout(
    {
        # of the object's centre in the world, s after its release: coefficients of 1, s, s^2 ... (3 each) [m, m/s ...],
        # added to what follows from the object's states, where it has some
        "path": 3 * PATH_TERMS,
        "landing": 1,  # when its flight ends, after the release [s]; with states of the object, what drag adds to that
        "lands": 1,  # share [-] of the end of a flight without drag that is added to it: 1 with states, or 0
        "ground": 1,  # height of the object's centre where that flight ends [m]
        "gravity": 1,  # [m/s^2]
        "fall": 1,  # acceleration with which the path bends, at most [m/s^2]
        "reach": FIRST_TOOL - 1,  # distance that its centre keeps from the surface of each link but the base [m]
        "share": 1,  # of the tool's speed that the object has at the release [-]
    }
)
STANDING_CAPSULES = 2  # [-] that never move: the arm's foot, and its base
STANDING = VectorLayout(
    {
        "capsules": 7 * STANDING_CAPSULES,  # end points in the world (3 + 3), radius [m]
        "reach": STANDING_CAPSULES,  # distance that the object's centre keeps from the surface of each [m]
        "ground": 1,  # height of the object's centre where its flight ends [m]
        "gravity": 1,  # [m/s^2]
        "share": 1,  # of the tool's speed that the object has at the release [-]
    }
)
SHARED = {
    "scales": SCALES,
    "arm": ARM,
    "release": RELEASE,
    "shapes": SHAPES,
    "flight": FLIGHT,
    "object_path": OBJECT_PATH,
    "standing": STANDING,
    "rooms": ROOMS,
}  # parameters shared by all stages, in this order
ABSENT_RADIUS = -1.0e3  # [m] radius of an absent capsule: never near anything
FAR = 1.0e3  # [m] distance added where a pair cannot meet
ABSENT_SHAPE = 1.0e3  # [m] coordinates of an absent keep-out shape
UNLIMITED_GRIP = 1.0e4  # [m/s^2] stands for a grip without limit

DECIMALS = 9  # of arguments in units of one: finer than what a solver heeds, coarser than floating point differs

WATCHED_AFTER = 2  # stages after the release (or its window) on which singularities are avoided
LEAVING_STAGES = 1  # stages after the release (or its window), 20 to 40 ms, in which the object leaves the open grip
OUT_STAGES = 2  # the same where its way out is followed, until it is out
OF_THE_OBJECT = ("thrown", "carried")  # blocks whose rows are the object's next state
# Groups of rows left out until a solution violates them, at knots and, but for three from "flight" on, at middles.
LAZY_GROUPS = ("effort", "clearance", "keep_out", "rooms", "grip", "flight", "standing", "leaving", "passing")


@dataclass(frozen=True)
class StageLayout:
    """The stages of a problem, and the lazy groups of rows in it.

    Attributes:
        launch: stages before the release.
        brake: stages after it.
        window: stages on either side of the release that make up the release window.
        groups: those of `LAZY_GROUPS` that are included.
        shapes: slots for keep-out shapes, one of `layout.SHAPE_SLOTS`; 0 without group "keep_out".
        aims: whether the release is free, so that the object's path is part of the solution.
        watched: stages before the release (or its window) on which singularities are avoided.
    """

    launch: int = 8
    brake: int = 4
    window: int = 0
    groups: tuple[str, ...] = ()
    shapes: int = 0
    aims: bool = False
    watched: int = 3

    @property
    def stages(self) -> int:
        """Number of steps."""
        return self.launch + self.brake

    @property
    def has_thrown(self) -> bool:
        """Whether the object has states from the release on: not where its path is given, or no row depends on it."""
        return self.aims and bool({"leaving", "passing"} & set(self.groups))

    @property
    def thrown(self) -> int:
        """The stage from which on the object has states; one that does not exist where it has none."""
        return self.launch if self.has_thrown else self.stages + 1

    def with_groups(self, groups: Collection[str]) -> StageLayout:
        """Returns the layout with only those of its groups that are in `groups`."""
        kept = tuple(group for group in self.groups if group in groups)
        shapes = self.shapes if "keep_out" in kept else 0
        return replace(self, groups=kept, shapes=shapes, aims=self.aims and bool({"leaving", "passing"} & set(kept)))

    def function(self, block: str) -> str:
        """Returns the name of a block's functions, which have fewer slots for fewer shapes."""
        has_fewer = group_of(block) == "keep_out" and self.shapes in SHAPE_SLOTS[:-1]
        return f"{block}_{self.shapes}" if has_fewer else block

    def includes(self, block: str) -> bool:
        """Returns whether a block is part of the problem."""
        if block in OF_THE_OBJECT:
            return self.has_thrown
        group = group_of(block)
        return group not in LAZY_GROUPS or group in self.groups

    def knots(self, block: str) -> range:
        """Returns the stages on which a block applies."""
        released = self.launch + self.window
        first_watched = max(self.launch - self.window - self.watched, 0)
        last_watched = min(released + WATCHED_AFTER, self.stages)
        special = {
            "motion": range(self.stages),
            "cost": range(self.stages),
            "thrown": range(self.launch - 1, self.launch),
            "carried": range(self.launch, self.stages),
            "singularity": range(first_watched, last_watched + 1),
            "singularity_middle": range(first_watched, last_watched),
            "release": range(self.launch - self.window, released + 1),
            "standing": range(self.launch - self.window, released + 1),
            "flight": range(self.launch - self.window, min(released + LEAVING_STAGES, self.stages) + 1),
            "leaving": range(self.launch, min(released + OUT_STAGES, self.stages)),
            "grip": range(1, released + 1),
            "grip_middle": range(released),
            "passing": range(released + 1, self.stages),
            "passing_middle": range(released, self.stages),
            "passing_at_rest": range(self.stages, self.stages + 1),
        }
        everywhere = range(self.stages) if block.endswith("_middle") else range(1, self.stages + 1)
        return special.get(block, everywhere)


def group_of(block: str) -> str:
    """Returns the group of a block, which is named after it."""
    return block.removesuffix("_middle").removesuffix("_at_rest")

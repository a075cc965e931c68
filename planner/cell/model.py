"""Data model of a cell: frozen dataclasses with read-only arrays."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np

from planner.arrays import Array, Index, read_only
from planner.calibration import CalibrationFile
from planner.cell.content import content_sha256
from planner.cell.limits import Limits, Safety
from planner.cell.shapes import ROW, Solid
from planner.cell.thrown_object import ThrownBody, ThrownObject
from planner.errors import CellError
from planner.grippers import WIRED_CLOSE_S, GripperLink, SecondOutput
from planner.robots import Robot, capsule_rows

# [m] from an arm: none throws as far, and most places in a cell are farther if they are taken in millimetres
FARTHEST_M = 100.0
CONTACT_M = 1e-6  # [m] rounding: so deep in it, a point still stands on a box or on the floor
PAYLOAD_ROUNDING = 1e-9  # [-] of the sum of two masses
FLIGHT_CLEARANCE_MIN_M = 0.001  # [m] least flight clearance: meshes, calibration and flight are no better than that
CELLS_KEPT = 32  # cells as one of several grippers sees them: caches know cells by identity


@dataclass(frozen=True, eq=False)
class ToolCapsule:
    """A capsule of the tool: end points in the flange frame (3,) [m] and radius [m]."""

    from_m: Array
    to_m: Array
    radius_m: float


@dataclass(frozen=True, eq=False)
class Tool:
    """The tool on the flange.

    Attributes:
        X_FT: pose (4, 4) of the tool centre point, the object's centre, in the flange frame.
        mass_kg: mass without the object [kg].
        capsules: its shape, for collision checks.
        is_assumed: whether nobody gave the shape, and the cell assumes one, see `Cell`.
        p_FH: where the hand ends (3,) in the flange frame: the tool centre point as the table `[tool]` gives it, which
            `object.in_tool` moves away from it [m]; None: at the tool centre point.
    """

    X_FT: Array
    mass_kg: float
    capsules: tuple[ToolCapsule, ...]
    is_assumed: bool = False
    p_FH: Array | None = None

    @property
    def end_F(self) -> Array:
        """Where the hand ends (3,) in the flange frame [m]: its mass is half way there."""
        return self.X_FT[:3, 3] if self.p_FH is None else self.p_FH


@dataclass(frozen=True)
class AllowedContact:
    """Two things whose distance is not checked.

    Attributes:
        TOOL: name of all capsules of the tool together.
        OBJECT: name of the held object.
        a: a part of arm or tool, or the held object.
        b: another one, or what is kept out.
        shapes: names of the keep-out shapes that are b; none where b is a part.
    """

    TOOL: ClassVar[str] = "tool"
    OBJECT: ClassVar[str] = "object"
    a: str
    b: str
    shapes: tuple[str, ...] = ()

    def is_of(self, one: str, other: str) -> bool:
        """Returns whether it is that of a part with another part, or with a keep-out shape."""
        if self.shapes:
            return self._is(self.a, one) and other in self.shapes
        return any(self._is(self.a, x) and self._is(self.b, y) for x, y in ((one, other), (other, one)))

    @classmethod
    def _is(cls, name: str, part: str) -> bool:
        return part == name or (name == cls.TOOL and part.startswith("tool_"))


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Obstacles and gravity, in the world frame.

    Attributes:
        floor_z_m: height of the floor, a horizontal plane [m].
        clearance_m: least distance to the floor and to every keep-out shape without its own [m].
        flight_clearance_m: least distance of the object in flight to the arm and every such shape [m].
        gravity_m_s2: gravity along -z [m/s^2].
        keep_in: shapes that contain the tool centre point at all times.
        keep_out: shapes that arm, tool and held object stay out of.
        may_touch: pairs whose distance is not checked.
    """

    floor_z_m: float
    clearance_m: float
    flight_clearance_m: float
    gravity_m_s2: float
    keep_in: tuple[Solid, ...]
    keep_out: tuple[Solid, ...]
    may_touch: tuple[AllowedContact, ...] = ()

    def is_free_to_touch(self, one: str, other: str) -> bool:
        """Returns whether two parts, or a part and a keep-out shape, may touch; both by their names."""
        return any(contact.is_of(one, other) for contact in self.may_touch)

    @cached_property
    def keep_in_names(self) -> tuple[str, ...]:
        """What each keep-in shape is called: by its name, or by its kind and number."""
        return tuple(shape.called(i) for i, shape in enumerate(self.keep_in))

    @cached_property
    def keep_in_clearances(self) -> Array:
        """What the tool centre point keeps from the walls of each keep-in shape (r,) [m]; 0 without one of its own."""
        return np.array([shape.clearance_m or 0.0 for shape in self.keep_in])

    @cached_property
    def rooms(self) -> Index:
        """Numbers of the keep-in shapes that are more than a box along the axes: turned, round, named, or kept from.

        The other ones are one box together, see `box_within`.
        """
        plain = (shape.core is None and not shape.name and not shape.clearance_m for shape in self.keep_in)
        return np.flatnonzero(~np.fromiter(plain, np.bool_))

    @cached_property
    def box_within(self) -> tuple[Array, Array] | None:
        """Corners (3,) of the box along the axes that is common to the keep-in shapes that are no `rooms`; [m]."""
        boxes = [shape for i, shape in enumerate(self.keep_in) if i not in self.rooms]
        if not boxes:
            return None
        return np.max([box.lower for box in boxes], axis=0), np.min([box.upper for box in boxes], axis=0)

    @cached_property
    def keep_out_names(self) -> tuple[str, ...]:
        """What each keep-out shape is called: by its name, or by its kind and number."""
        return tuple(shape.called(i) for i, shape in enumerate(self.keep_out))

    @cached_property
    def keep_out_rows(self) -> Array:
        """The keep-out shapes as the kernel takes them (b, 20)."""
        return np.array([shape.row for shape in self.keep_out]).reshape(-1, ROW)

    @cached_property
    def keep_out_bounds(self) -> tuple[Array, Array]:
        """Corners (b, 3) of the boxes along the world's axes that bound the keep-out shapes [m]."""
        shapes = self.keep_out
        lower, upper = ([getattr(shape, side) for shape in shapes] for side in ("lower", "upper"))
        return np.array(lower).reshape(-1, 3), np.array(upper).reshape(-1, 3)

    @cached_property
    def further_clearances(self) -> Array:
        """What the clearance of each keep-out shape (b,) is beyond the cell's [m]; 0 without one of its own."""
        own = (shape.clearance_m for shape in self.keep_out)
        return np.array([0.0 if each is None else each - self.clearance_m for each in own])

    @cached_property
    def flight_clearances(self) -> Array:
        """Least distance of the object in flight from each keep-out shape (b,) [m]."""
        own = (shape.clearance_m for shape in self.keep_out)
        return np.array([self.flight_clearance_m if m is None else max(m, FLIGHT_CLEARANCE_MIN_M) for m in own])


@dataclass(frozen=True, eq=False)
class Gripper:
    """The gripper: what opens it, its delay, and how it holds the object.

    Attributes:
        output: kind of output: tool_digital, standard_digital or configurable_digital.
        index: number of the output.
        open_level: level of the output that opens the gripper.
        delay_s: time from the change of the output to the object leaving [s]; with a `link`, from one lag after the
            command was sent, when an output would have changed.
        jitter_s: standard deviation of that time, that of the period at which the gripper takes commands included [s].
        kind: one of `planner.grippers.KINDS`.
        second: a second output; None without one.
        link: how it is reached where no output switches it; None: outputs do.
        opening_direction: unit vector (3,) in the tool frame along which the object can leave; None: any.
        opening_cone_rad: largest angle between the object's way out and that direction [rad]; None: any.
        hold_acceleration_m_s2: largest acceleration against free fall that the grip withstands [m/s^2], (1,) in any
            direction or (3,) along the axes of the tool frame; None: not limited.
        release_speed_factor: the object's speed over the tool's as it leaves [-]: what a profile has learnt, no key of
            the cell file.
        close_s: time that it is given to close before the arm moves [s]; where it reports that it is closed, at most.
        grip_input: number of the digital input that is high while it holds an object, among the bits of RTDE; None
            without one.
    """

    output: str
    index: int
    open_level: bool
    delay_s: float
    jitter_s: float
    kind: str = "digital"
    second: SecondOutput | None = None
    link: GripperLink | None = None
    opening_direction: Array | None = None
    opening_cone_rad: float | None = None
    hold_acceleration_m_s2: Array | None = None
    release_speed_factor: float = 1.0
    close_s: float = WIRED_CLOSE_S
    grip_input: int | None = None


@dataclass(frozen=True, eq=False)
class MountedGripper:
    """One of several grippers on a tool, with what it holds.

    Attributes:
        gripper: what opens it, and how it holds the object.
        X_FT: pose (4, 4) of its tool centre point, the centre of its object, in the flange frame.
        object: that it holds.
    """

    gripper: Gripper
    X_FT: Array
    object: ThrownObject


@dataclass(frozen=True, eq=False)
class CarriedObject:
    """A ball in another gripper than the one that is looked at: a load and a shape of the tool.

    Attributes:
        gripper: name of the gripper; empty: the cell's own.
        p_F: its centre (3,) in the flange frame [m].
        mass_kg: [kg].
        radius_m: [m].
    """

    gripper: str
    p_F: Array
    mass_kg: float
    radius_m: float


@dataclass(frozen=True)
class Timing:
    """Timing of the controller: `lag_s` is the time from a command to its measured motion [s]."""

    lag_s: float


@dataclass(frozen=True)
class ControllerAddress:
    """How the controller is reached, and which one it must be.

    Attributes:
        kind: "sim" or "ur"; it has no default, so a real arm is never implied.
        host: network address.
        serial: serial number of the robot; None: any robot with the cell's kinematics will do.
    """

    kind: str
    host: str
    serial: str | None = None


@dataclass(frozen=True)
class Sim:
    """Settings of the simulated controller; the planner does not use them.

    Attributes:
        polyscope: version of the controller software.
        lag_s: time from a command to its motion [s].
        gripper_delay_s, gripper_jitter_s: mean and standard deviation of the gripper's delay [s].
        landing_height_m: height at which the simulated object lands [m].
        seed: of the random numbers.
    """

    polyscope: str
    lag_s: float
    gripper_delay_s: float
    gripper_jitter_s: float
    landing_height_m: float
    seed: int


@dataclass(frozen=True)
class DigitalOutput:
    """A digital output of the controller, and how it behaves.

    Attributes:
        output, index: kind and number of the output.
        delay_s: from one lag after its command, when an output without a delay would change, until this one does [s].
        jitter_s: standard deviation of that time [s].
        sense_input: number of the digital input that is wired to it, among the bits of RTDE; None without one.
    """

    output: str
    index: int
    delay_s: float = 0.0
    jitter_s: float = 0.0
    sense_input: int | None = None


@dataclass(frozen=True, eq=False)
class Cell:
    """One robot station.

    A tool centre point off the flange has a tool about it: where its shape is not given, a capsule as thick as the
    wrist is assumed, from the flange to the object.

    Attributes:
        name: stem of the cell file's name.
        sha256: hash of the cell file's bytes, and of its calibration file's; of a cell made in code, as by
            `dataclasses.replace`, of its content.
        robot: the arm; with the calibration's chain where there is one.
        calibration: the file that this is from; None for the published table.
        home: joint positions (6,) [rad] where a throw starts by default.
        X_WB: pose (4, 4) of the arm's base in the world.
        tool, limits, surroundings, object, gripper, safety, timing, link, sim: the tables of the cell file.
        outputs: further outputs, by name.
        grippers: every gripper of a tool that has several, by name; the cell's own is "". Empty: it has one.
        mounted: name of the one that tool, gripper and object are of; see `seen_from`.
        carried: what the other ones hold; their balls are the last of the tool's capsules.
        document: keys and numbers of the cell file as written, with defaults filled in.
        meshes: what became of the mesh files that the cell file names, see `covers_of`.
        content: hash of what the cell says, by which one that was changed in code is told from that of a file.
        check: raises a `CellError` for a cell that `with_tool` and its like may not return; None: there is no more to
            check than the keys.

    Raises:
        CellError: a limit is beyond the arm's own, or tool and object are heavier than the arm is rated for.
    """

    name: str
    sha256: str
    robot: Robot
    calibration: CalibrationFile | None
    home: Array
    X_WB: Array
    tool: Tool
    limits: Limits
    surroundings: Surroundings
    object: ThrownObject
    gripper: Gripper
    safety: Safety
    timing: Timing
    link: ControllerAddress
    sim: Sim
    outputs: Mapping[str, DigitalOutput]
    document: Mapping[str, Any] = field(repr=False)
    grippers: Mapping[str, MountedGripper] = field(default_factory=dict)
    mounted: str = ""
    carried: tuple[CarriedObject, ...] = ()
    meshes: bytes | None = field(default=None, repr=False)
    content: str = field(default="", repr=False)
    check: Callable[[Cell], object] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name, joint, value, own in self.limits.beyond(self.robot):
            raise CellError(f"limits.{name}[{joint}]", value, f"is beyond the arm's own limit of {own:.6g}")
        self._refuse_overweight()
        if self.tool.is_assumed or not self.tool.capsules:
            object.__setattr__(self, "tool", self._with_assumed_shape())
        content = content_sha256(self)
        if self.content not in ("", content):
            object.__setattr__(self, "sha256", content)
        object.__setattr__(self, "content", content)

    def __repr__(self) -> str:
        """Returns the station in a line."""
        tool = f"tool of {self.tool.mass_kg:g} kg, object of {self.object.mass_kg:g} kg"
        return f"<Cell {self.name}: {self.robot.name} with a {tool}; sha256 {self.sha256[:12]}>"

    def _with_assumed_shape(self) -> Tool:
        """Returns the tool with an assumed shape; without any where the hand ends on the flange.

        It reaches to the surface of a ball; of a body, which it may grip anywhere, all the way.
        """
        p_FH = self.tool.end_F
        length = float(np.linalg.norm(p_FH))
        if length <= CONTACT_M:
            return replace(self.tool, capsules=(), is_assumed=False)
        short_m = 0.0 if isinstance(self.object, ThrownBody) else self.object.radius_m
        to_object = p_FH * max(0.0, 1.0 - short_m / length)
        wrist_radius_m = capsule_rows(self.robot.shape.of)["wrist_3"]["radius_m"]
        assumed = ToolCapsule(read_only(np.zeros(3)), read_only(to_object), wrist_radius_m)
        return replace(self.tool, capsules=(assumed,), is_assumed=True)

    def _refuse_overweight(self) -> None:
        """Raises a `CellError` where tool and object are heavier together than the arm is rated for."""
        tool_kg = self.tool.mass_kg
        object_kg = self.object.mass_kg + sum(each.mass_kg for each in self.carried)
        rated_kg = self.robot.published.payload_kg
        if rated_kg is None or tool_kg + object_kg <= rated_kg * (1.0 + PAYLOAD_ROUNDING):
            return
        field, value = ("tool.mass_kg", tool_kg) if tool_kg > object_kg else ("object.mass_kg", object_kg)
        weigh = f"tool and object weigh {tool_kg + object_kg:.6g} kg together"
        raise CellError(field, value, f"{weigh}; a {self.robot.name} is rated for {rated_kg:g} kg")

    def seen_from(self, name: str, gone: Collection[str] = ()) -> Cell:
        """Returns this cell as one of its grippers sees it: tool centre point, gripper and object are its own.

        What the others hold is carried: a load and a shape of the tool. It keeps its hash.

        Args:
            name: of the gripper; one that the cell does not have sees nothing else.
            gone: names of the others that hold nothing any more.
        """
        others = frozenset(self.grippers) - {name}
        return _seen_from(self, name, others - frozenset(gone)) if name in self.grippers else self

    def digital_output(self, output: str, index: int) -> DigitalOutput:
        """Returns a digital output; one that the cell file does not list has no delay."""
        listed = self.outputs.values()
        named = (each for each in listed if (each.output, each.index) == (output, index))
        return next(named, DigitalOutput(output, index))

    def with_limits(self, **keys: Any) -> Cell:
        """Returns this cell with other limits, and a hash of its own.

        Args:
            keys: of the table `[limits]` of a cell file, such as `joint_velocity_rad_s=2.0`.

        Raises:
            CellError: there is no such key, a limit is beyond the arm's own, or home violates it.
        """
        return self._changed({"limits": keys})

    def with_tool(self, **keys: Any) -> Cell:
        """Returns this cell with another tool, and a hash of its own.

        Args:
            keys: of the table `[tool]` of a cell file, such as `mass_kg=0.8`.

        Raises:
            CellError: there is no such key, its value is refused, or home violates a limit with it.
        """
        return self._changed({"tool": keys})

    def with_obstacles(self, *shapes: Mapping[str, Any]) -> Cell:
        """Returns this cell with more shapes that arm, tool and held object stay out of, and a hash of its own.

        Args:
            shapes: as in `surroundings.keep_out` of a cell file: `{"lower_m": [3], "upper_m": [3]}`, or
                `{"shape": "cylinder", "pose": {"position_m": [3]}, "radius_m": 0.05, "length_m": 0.8}`.

        Raises:
            CellError: a shape is refused, or home is too close to it.
        """
        there = self.document["surroundings"]["keep_out"]
        return self._changed({"surroundings": {"keep_out": [*there, *shapes]}})

    def _changed(self, tables: Mapping[str, Mapping[str, Any]]) -> Cell:
        from planner.cell.changes import changed  # reads keys as the file's, and so stands above the model

        made = changed(self, tables)
        if self.check is not None:
            self.check(made)
        return made

    def as_learnt(self, **learnt: Any) -> Cell:
        """Returns this cell with attributes as a profile has learnt them.

        It keeps its hash, which says what was learnt of: a plan names the profile beside it.
        """
        return replace(self, **learnt, content="")

    def as_document(self) -> dict[str, Any]:
        """Returns the cell file's keys and numbers with defaults filled in, plus `name` and `sha256`."""
        return {"name": self.name, "sha256": self.sha256, **self.document}


@lru_cache(maxsize=CELLS_KEPT)
def _seen_from(cell: Cell, name: str, holding: frozenset[str]) -> Cell:
    """Returns a cell as a gripper sees it, while `holding` are the others that hold an object."""
    own = MountedGripper(cell.gripper, cell.tool.X_FT, cell.object)  # which a profile may have taught
    grippers = {**cell.grippers, cell.mounted: own}
    carried = carried_by(grippers, holding)
    if name == cell.mounted and [each.gripper for each in carried] == [each.gripper for each in cell.carried]:
        return cell
    shape = cell.tool.capsules[: len(cell.tool.capsules) - len(cell.carried)]
    of = grippers[name]
    tool = replace(cell.tool, X_FT=of.X_FT, capsules=(*shape, *balls(carried)), p_FH=cell.tool.end_F)
    seen = {"tool": tool, "gripper": of.gripper, "object": of.object}
    return replace(cell, **seen, grippers=grippers, mounted=name, carried=carried, content="")


def carried_by(grippers: Mapping[str, MountedGripper], names: Collection[str]) -> tuple[CarriedObject, ...]:
    """Returns what some of several grippers hold."""
    return tuple(
        CarriedObject(name, each.X_FT[:3, 3], each.object.mass_kg, each.object.radius_m)
        for name, each in grippers.items()
        if name in names
    )


def balls(carried: tuple[CarriedObject, ...]) -> tuple[ToolCapsule, ...]:
    """Returns the shapes of what is carried."""
    return tuple(ToolCapsule(each.p_F, each.p_F, each.radius_m) for each in carried)

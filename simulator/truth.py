"""The truth of a simulated cell: how arm, gripper, object and camera really behave.

By default that is the table [sim] of the cell file. A truth file replaces parts of it by what nobody but the simulator
knows; docs/simulator.md describes its keys. Frames and the units of the fields are those of the keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from planner.cell import Cell, choice, merge_defaults, number, vector
from planner.documents import NotToml, parse_toml, read_file
from planner.errors import CellError, FileRefused

# [s] chosen: first-order part of the lag where none is given; at most half of what a cycle leaves
FIRST_ORDER_S = 0.002
DISTURBANCES = ("none", "ur5-measured")
JITTER_SHAPES = ("gaussian", "skewed", "quantised")

TRUTH_BYTES = 100_000  # [byte] of a truth file; one with every key has 1,000

# Bounds of the keys; they catch typing errors, and what the simulated controller could not do.
LAG_MAX_S = 0.5  # [s] as the cell file's timing.lag_s
GAIN_MIN = 0.5
GAIN_MAX = 1.5  # [-]
OVERSHOOT_MAX = 0.5  # [-]
DRAG_MAX = 10.0  # [-]
MASS_RANGE_KG = 1e-6, 100.0  # [kg] as the cell file's object.mass_kg
OFFSET_MAX_M = 1.0  # [m] joints 2 and 3 are almost parallel: calibrated arms have large opposite offsets there
DH_ANGLE_MAX_RAD = 0.5  # [rad]
DH_BOUNDS = {"a_m": OFFSET_MAX_M, "d_m": OFFSET_MAX_M, "alpha_rad": DH_ANGLE_MAX_RAD, "theta_rad": DH_ANGLE_MAX_RAD}
TURN_MAX_RAD = 3.2  # [rad] half a turn
GRIPPER_BOUNDS = {
    "delay_s": (0.0, 5.0),  # grippers that take longer do not throw
    "jitter_s": (0.0, 0.5),
    "drift_s_per_throw": (-0.01, 0.01),
}
FURTHER_BOUNDS = {key: GRIPPER_BOUNDS[key] for key in ("delay_s", "jitter_s")}
OUTPUT_BOUNDS = {"delay_s": (0.0, 1.0), "jitter_s": (0.0, 0.1)}
RELEASE_BOUNDS = {"speed_factor": (0.0, 1.5), "cling_share": (0.0, 1.0), "cling_speed_factor": (0.0, 1.5)}
CAMERA_BOUNDS = {"std_m": (0.0, 1.0), "outlier_share": (0.0, 1.0), "outlier_std_m": (0.0, 10.0)}
FARTHEST_M = 100.0  # [m] of a belt's bin and of a feeder's places from the world's origin
PLACES_MAX = 1000
FEED_BOUNDS = {"reach_m": (1e-4, 1.0), "scatter_m": (0.0, 1.0), "missed": (0.0, 1.0)}
REFILL_MAX_S = 86400.0  # [s]
BELT_FAST_M_S = 5.0  # [m/s]
CUT_STD = 3.0  # [-] standard deviations below the mean at which an opening would be before its output: 1 in 1,000

SixNumbers = tuple[float, ...]
NONE_OF_SIX: SixNumbers = (0.0,) * 6
ONE_OF_SIX: SixNumbers = (1.0,) * 6


class TruthError(Exception):
    """A truth file is refused; the text names file, field, value and limit."""


@dataclass(frozen=True)
class MotionTiming:
    """Response of the controller to its commands.

    Attributes:
        lag_s: time from a command to its motion [s]: one cycle, a pure delay and the first-order part together.
        first_order_s: time constants of the first-order part, a joint (6,) [s].
        gain: joint speed over the speed commanded by speedj, speedl or servoj, a joint (6,) [-].
        output_delay_s: time from a command to the change of a digital output [s].
    """

    lag_s: float
    first_order_s: SixNumbers
    gain: SixNumbers
    output_delay_s: float


@dataclass(frozen=True)
class GripperOpening:
    """Time from the change of the gripper's output to the object leaving.

    Attributes:
        delay_s: its mean at the first throw [s].
        jitter_s: its standard deviation, without that of the quantisation [s].
        jitter_shape: one of `JITTER_SHAPES`.
        drift_s_per_throw: growth of the mean from throw to throw [s].
    """

    delay_s: float
    jitter_s: float
    jitter_shape: str = "gaussian"
    drift_s_per_throw: float = 0.0

    @property
    def cut_short(self) -> str:
        """Why some openings come at once, as none comes before its output; empty where none does."""
        if self.delay_s >= CUT_STD * self.jitter_s:
            return ""
        times = f"delay_s of {1e3 * self.delay_s:g} ms is less than {CUT_STD:g} jitter_s of {1e3 * self.jitter_s:g} ms"
        return f"gripper.{times}: openings before 0 are at 0"


@dataclass(frozen=True)
class OutputTiming:
    """Time from the change of an output to that of what it switches.

    Attributes:
        delay_s: its mean [s].
        jitter_s: its standard deviation [s].
    """

    delay_s: float
    jitter_s: float


@dataclass(frozen=True)
class ReleaseSpeed:
    """Speed of the leaving object over that of the tool centre point.

    Attributes:
        speed_factor: of every throw [-].
        cling_share: share of throws in which the object clings to the gripper [-].
        cling_speed_factor: a further factor in those throws [-].
    """

    speed_factor: float = 1.0
    cling_share: float = 0.0
    cling_speed_factor: float = 1.0


@dataclass(frozen=True)
class DhDeviation:
    """Deviations (6,) from the arm's published Denavit–Hartenberg table [m, rad]."""

    a_m: SixNumbers = NONE_OF_SIX
    d_m: SixNumbers = NONE_OF_SIX
    alpha_rad: SixNumbers = NONE_OF_SIX
    theta_rad: SixNumbers = NONE_OF_SIX


@dataclass(frozen=True)
class ArmDeviation:
    """What distinguishes the arm from an ideal one where the cell file has it.

    Attributes:
        disturbance: one of `DISTURBANCES`.
        overshoot: share by which a joint exceeds a step of its commanded speed (6,) [-].
        base_offset_m: true position of the base less the cell file's, in the world (3,) [m].
        base_rotation_vector_rad: turn of the true base against the cell file's, about axes of the world (3,) [rad].
        dh_deviation: of the arm's own table from the published one; None: the arm is as the cell has it.
    """

    disturbance: str = "none"
    overshoot: SixNumbers = NONE_OF_SIX
    base_offset_m: tuple[float, ...] = (0.0,) * 3
    base_rotation_vector_rad: tuple[float, ...] = (0.0,) * 3
    dh_deviation: DhDeviation | None = None


@dataclass(frozen=True)
class CameraNoise:
    """Errors of the camera that observes where the object landed, along x and y each.

    Attributes:
        std_m: standard deviation of every observation [m].
        outlier_share: share of observations with a gross error [-].
        outlier_std_m: standard deviation of that error [m].
    """

    std_m: float = 0.0
    outlier_share: float = 0.0
    outlier_std_m: float = 0.0


@dataclass(frozen=True)
class BeltMotion:
    """How a belt really carries the bins, wherever they were announced.

    Attributes:
        position_m: of a bin's bottom at `at_s` (3,) [m].
        velocity_m_s: (3,) [m/s].
        at_s: the controller's time [s].
    """

    position_m: tuple[float, float, float]
    velocity_m_s: tuple[float, float, float]
    at_s: float


@dataclass(frozen=True)
class ObjectFeed:
    """Where objects lie that the gripper has to pick up, and when it gets them.

    Attributes:
        places: centre of the object on each, in the world (n, 3) [m].
        reach_m: largest distance of the tool centre point from an object that closing takes [m].
        scatter_m: standard deviation along x and y each of an object from its place [m].
        refill_s: time from a taking until the place is filled again [s]; None: it never is.
        missed: share of the closings that take nothing although an object is within reach [-].
    """

    places: tuple[tuple[float, float, float], ...]
    reach_m: float
    scatter_m: float
    refill_s: float | None
    missed: float


@dataclass(frozen=True)
class Truth:
    """How a simulated cell really behaves.

    Attributes:
        seed: of all random numbers.
        timing, gripper, release, arm, camera: its parts.
        outputs: of the cell's `[outputs]`, by name.
        grippers: of the cell's `[grippers]`, by name.
        drag_coefficient: of the object [-].
        mass_kg: of the object [kg].
        belt: that carries the bins; None: they are where they are announced, and move as that says.
        feed: of objects that are picked up; None: the gripper always has the next one.
        hidden: whether clients learn only what a real controller and a camera tell.
    """

    seed: int
    timing: MotionTiming
    gripper: GripperOpening
    release: ReleaseSpeed
    drag_coefficient: float
    mass_kg: float
    arm: ArmDeviation
    camera: CameraNoise
    outputs: Mapping[str, OutputTiming]
    grippers: Mapping[str, GripperOpening]
    belt: BeltMotion | None = None
    feed: ObjectFeed | None = None
    hidden: bool = False


def truth_of(cell: Cell) -> Truth:
    """Returns the truth of a cell without a truth file: its table [sim]."""
    return _truth(merge_defaults({}, _defaults(cell)), cell, hidden=False)


def load_truth(path: Path, cell: Cell, hidden: bool = True) -> Truth:
    """Returns the truth of a file; what it leaves out is as in the cell's table [sim].

    Raises:
        TruthError: the file cannot be read, or a field of it is refused: an unknown key, a number out of its bounds.
    """
    try:
        given = parse_toml(read_file(path, TRUTH_BYTES))
        return _truth(merge_defaults(given, _defaults(cell)), cell, hidden)
    except (FileRefused, NotToml, CellError) as error:
        raise TruthError(f"the truth file {path} is refused: {error}") from error


def _cycle_s(cell: Cell) -> float:
    return 1.0 / cell.robot.sample_rate_hz


def _defaults(cell: Cell) -> dict[str, Any]:
    """Returns the values of the keys that a truth file leaves out; None: they follow from others."""
    sim = cell.sim
    return {
        "seed": sim.seed,
        "timing": {
            "lag_s": max(sim.lag_s, _cycle_s(cell)),
            "first_order_s": None,
            "gain": list(ONE_OF_SIX),
            "output_delay_s": None,
        },
        "gripper": {
            "delay_s": sim.gripper_delay_s,
            "jitter_s": sim.gripper_jitter_s,
            "jitter_shape": "gaussian",
            "drift_s_per_throw": 0.0,
        },
        "grippers": {
            name: {"delay_s": each.gripper.delay_s, "jitter_s": each.gripper.jitter_s}
            for name, each in cell.grippers.items()
            if name
        },
        "release": {"speed_factor": 1.0, "cling_share": 0.0, "cling_speed_factor": 1.0},
        "object": {"drag_coefficient": cell.object.drag_coefficient, "mass_kg": cell.object.mass_kg},
        "arm": {
            "disturbance": "none",
            "overshoot": list(NONE_OF_SIX),
            "base_offset_m": [0.0] * 3,
            "base_rotation_vector_rad": [0.0] * 3,
            "dh_deviation": None,
        },
        "outputs": {name: {"delay_s": None, "jitter_s": each.jitter_s} for name, each in cell.outputs.items()},
        "camera": {"std_m": 0.0, "outlier_share": 0.0, "outlier_std_m": 0.0},
        "belt": {"position_m": None, "velocity_m_s": [0.0] * 3, "at_s": 0.0},
        "feeder": dict.fromkeys(("places", *FEED_BOUNDS, "refill_s")),
    }


def _truth(document: Mapping[str, Any], cell: Cell, hidden: bool) -> Truth:
    seed = document["seed"]
    if isinstance(seed, bool) or not isinstance(seed, int):
        raise CellError("seed", seed, "must be a whole number")
    gripper = document["gripper"]
    shape = choice(gripper, "jitter_shape", "gripper.", JITTER_SHAPES)
    timing = _timing(document["timing"], _cycle_s(cell))
    return Truth(
        seed=seed,
        timing=timing,
        gripper=GripperOpening(**_numbers(gripper, "gripper.", GRIPPER_BOUNDS), jitter_shape=shape),
        release=ReleaseSpeed(**_numbers(document["release"], "release.", RELEASE_BOUNDS)),
        drag_coefficient=number(document["object"], "drag_coefficient", "object.", 0.0, DRAG_MAX),
        mass_kg=number(document["object"], "mass_kg", "object.", *MASS_RANGE_KG),
        arm=_arm(document["arm"]),
        camera=CameraNoise(**_numbers(document["camera"], "camera.", CAMERA_BOUNDS)),
        outputs=_outputs(document["outputs"], cell, timing),
        grippers={
            name: GripperOpening(**_numbers(table, f"grippers.{name}.", FURTHER_BOUNDS))
            for name, table in document["grippers"].items()
        },
        belt=_belt(document["belt"]),
        feed=_feed(document["feeder"], cell.object.radius_m),
        hidden=hidden,
    )


def _belt(table: Mapping[str, Any]) -> BeltMotion | None:
    """Returns the motion of the belt; None where no position is given."""
    if table["position_m"] is None:
        return None
    x, y, z = vector(table, "position_m", "belt.", 3, -FARTHEST_M, FARTHEST_M).tolist()
    vx, vy, vz = vector(table, "velocity_m_s", "belt.", 3, -BELT_FAST_M_S, BELT_FAST_M_S).tolist()
    return BeltMotion((x, y, z), (vx, vy, vz), number(table, "at_s", "belt.", 0.0))


def _feed(table: Mapping[str, Any], radius_m: float) -> ObjectFeed | None:
    """Returns the feed of objects; None where the file has none. Without a reach it is the object's radius."""
    where = "feeder."
    if all(value is None for value in table.values()):
        return None
    listed = table["places"]
    if not isinstance(listed, list) or not 0 < len(listed) <= PLACES_MAX:
        raise CellError(f"{where}places", listed, f"must be a list of 1 to {PLACES_MAX} positions [x, y, z]")
    places = []
    for i, position in enumerate(listed):
        name = f"places[{i}]"
        x, y, z = vector({name: position}, name, where, 3, -FARTHEST_M, FARTHEST_M).tolist()
        places.append((x, y, z))
    usual = {"reach_m": radius_m, "scatter_m": 0.0, "missed": 0.0}
    values = {key: usual[key] if table[key] is None else table[key] for key in FEED_BOUNDS}
    refill_s = None if table["refill_s"] is None else number(table, "refill_s", where, 0.0, REFILL_MAX_S)
    return ObjectFeed(tuple(places), refill_s=refill_s, **_numbers(values, where, FEED_BOUNDS))


def _outputs(tables: Mapping[str, Any], cell: Cell, timing: MotionTiming) -> dict[str, OutputTiming]:
    """Returns the timing of what each output switches; where no delay is given, the one that the cell file states."""
    found = {}
    for name, table in tables.items():
        values = dict(table)
        if values["delay_s"] is None:
            values["delay_s"] = max(cell.outputs[name].delay_s + timing.lag_s - timing.output_delay_s, 0.0)
        found[name] = OutputTiming(**_numbers(values, f"outputs.{name}.", OUTPUT_BOUNDS))
    return found


def _numbers(table: Mapping[str, Any], where: str, bounds: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """Returns the numbers of a table, each within its bounds."""
    return {key: number(table, key, where, lower, upper) for key, (lower, upper) in bounds.items()}


def _timing(table: Mapping[str, Any], cycle_s: float) -> MotionTiming:
    where = "timing."
    lag_s = number(table, "lag_s", where, cycle_s, LAG_MAX_S)
    left_s = lag_s - cycle_s
    values = dict(table)
    if values["first_order_s"] is None:
        values["first_order_s"] = min(FIRST_ORDER_S, left_s / 2.0)
    if values["output_delay_s"] is None:
        values["output_delay_s"] = lag_s
    return MotionTiming(
        lag_s=lag_s,
        first_order_s=_six(values, "first_order_s", where, 0.0, left_s),
        gain=_six(values, "gain", where, GAIN_MIN, GAIN_MAX),
        output_delay_s=number(values, "output_delay_s", where, 0.0, LAG_MAX_S),
    )


def _arm(table: Mapping[str, Any]) -> ArmDeviation:
    where = "arm."
    turn = vector(table, "base_rotation_vector_rad", where, 3, -TURN_MAX_RAD, TURN_MAX_RAD)
    return ArmDeviation(
        disturbance=choice(table, "disturbance", where, DISTURBANCES),
        overshoot=_six(table, "overshoot", where, 0.0, OVERSHOOT_MAX),
        base_offset_m=tuple(vector(table, "base_offset_m", where, 3, -OFFSET_MAX_M, OFFSET_MAX_M).tolist()),
        base_rotation_vector_rad=tuple(turn.tolist()),
        dh_deviation=_dh_deviation(table["dh_deviation"]),
    )


def _dh_deviation(given: object) -> DhDeviation | None:
    where = "arm.dh_deviation"
    if given is None:
        return None
    if not isinstance(given, Mapping):
        raise CellError(where, given, "must be a table")
    table = merge_defaults(given, {key: list(NONE_OF_SIX) for key in DH_BOUNDS}, f"{where}.")
    where = f"{where}."
    return DhDeviation(**{key: _six(table, key, where, -most, most) for key, most in DH_BOUNDS.items()})


def _six(table: Mapping[str, Any], key: str, where: str, lower: float, upper: float) -> SixNumbers:
    """Returns one number for all joints, or six, as six numbers within the bounds."""
    value = table[key]
    if isinstance(value, list | tuple):
        return tuple(vector(table, key, where, 6, lower, upper).tolist())
    return (number(table, key, where, lower, upper),) * 6

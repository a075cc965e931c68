"""The planning problem: start, release, limits and cell; frozen, and checked when it is made.

All quantities are in the world frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from planner.arrays import Array, Mask
from planner.cell import STANDING_RAD, Box, Cell, Limits, Solid, ThrownBody, shape_of
from planner.errors import FieldError, InvalidProblem
from planner.flight import drag_constant
from planner.geometry import (
    LEVEL_M,
    Misfit,
    Surface,
    body_model,
    landing_surfaces,
    misfit,
    passable,
    point_segment_distance,
    segment_shape_distance,
)
from planner.passages import NOT_YET, Passage, first_gripper, first_release, main_state, passage_errors, with_main_state
from planner.releases import JointRelease, Opening, PointRelease, PoseRelease, Release, Target, TargetRelease
from planner.rotations import pose, rotation_vector_to_matrix, unit_hint
from planner.touchdown import Leaving, Touchdowns
from planner.trajectory import Trajectory

__all__ = [
    "BACKENDS",
    "TIME_LIMIT_MAX_S",
    "TIME_LIMIT_S",
    "JointRelease",
    "Opening",
    "PointRelease",
    "PoseRelease",
    "Release",
    "ReleasePart",
    "TargetRelease",
    "ThrowProblem",
]

BACKENDS = ("auto", "casadi", "ruckig", "toppra", "cubic", "trapezoid", "ramp")
CHAIN_BACKENDS = ("auto", "ruckig")  # that make motions of several passages, or to a given end
MOVING_BACKENDS = ("auto", "casadi", "ruckig")  # that make motions from a start in motion
ROUNDING = 1e-7  # [-] share of a limit by which a start may exceed it: the certificate's, as a plan's samples may
# [s] default time limit: a search ends by its budgets of work. It took at most 3 s of processor time in 250 requests; a
# planner process of lower priority beside twelve busy ones takes up to twenty times as long, one of a batch longer.
TIME_LIMIT_S = 120.0
TIME_LIMIT_MAX_S = 120.0  # [s] longest time that one request may occupy a planner
JITTER_DEVIATIONS = 3.0  # [-] of the gripper's opening that a throw should stand: 99.7 % of normal delays
# [s] before and after the landing, for which the arm keeps out of the path of a bin that moves: an execution waits
# for its start within the first, and a motion is at rest within the second; one that goes on after the throw, within as
# long as the first.
SWEPT_S = (10.0, 2.0)
UNCERTAIN_DEVIATIONS = 3.0  # [-] of a target's place that a throw must stand: 99 % of places, in both directions
BINS_KEPT = 32  # [-] cells with a bin of late


@dataclass(frozen=True, eq=False)
class ReleasePart:
    """A motion of several grippers as one of them sees it.

    Attributes:
        problem: the whole motion, of which the gripper's own passages are judged, and no other gripper lets go: what
            later ones hold is carried to the end, what earlier ones held is gone from the beginning.
        numbers: of its passages among those of the motion.
        release: number of the passage at which it lets go, or of its last one.
    """

    problem: ThrowProblem
    numbers: tuple[int, ...]
    release: int

    def of(self, trajectory: Trajectory) -> Trajectory:
        """Returns a motion with the samples of this part's release and passages."""
        passed = tuple(trajectory.passed[number] for number in self.numbers)
        return replace(trajectory, release_index=trajectory.passed[self.release], passage_indices=passed)


@dataclass(frozen=True, eq=False)
class ThrowProblem:
    """One planning problem.

    Attributes:
        cell: the robot station; of a tool with several grippers, as the one sees it that lets go first.
        start: joint positions (6,) [rad].
        start_qd, start_qdd: joint velocities (6,) [rad/s] and accelerations (6,) [rad/s^2] there; zero: at rest.
        release: what is required of the release, see `planner.releases`. With `passages`, the state of the one that
            lets the object go; without such a one, that of the last.
        limits: the cell's, tightened by the request.
        release_window_s: largest deviation of the release time for which the landing tolerance must hold [s].
        landing_tolerance_m: landing error allowed in the window [m]; 0: only the nominal release counts.
        backend: one of `BACKENDS`.
        time_limit_s: time limit of the search [s].
        holds_object: whether the object is in the tool until the release; False for a way home after a throw.
        aim_shift: by how much the release's target, the aim, lies off the real one (3,), so that a learnt cell hits
            that [m]. The bin stands about the real one.
        passages: the states to pass one after another; empty: the release alone.
        end: state at rest in which the motion ends; None: anywhere.
        starts_not_before_s: earliest start, where the target moves [s, controller's clock].
        starts_at_s: the start of a plan to such a target, None before there is one [s, controller's clock].
        command_off_s: by how much the gripper's command may be off its instant: half a tick where the tick grid is laid
            through that of another one [s].

    Raises:
        InvalidProblem: every field that contradicts another field or the cell.
    """

    cell: Cell
    start: Array
    release: Release
    limits: Limits
    release_window_s: float = 0.0
    landing_tolerance_m: float = 0.0
    backend: str = "auto"
    time_limit_s: float = TIME_LIMIT_S
    holds_object: bool = True
    aim_shift: Array = field(default_factory=lambda: np.zeros(3))
    passages: tuple[Passage, ...] = ()
    end: Release | None = None
    start_qd: Array = field(default_factory=lambda: np.zeros(6))
    start_qdd: Array = field(default_factory=lambda: np.zeros(6))
    starts_not_before_s: float | None = None
    starts_at_s: float | None = None
    command_off_s: float = 0.0

    def __post_init__(self) -> None:
        first = first_gripper(self.passages)
        if first != self.cell.mounted and first in self.cell.grippers and self.throws:
            object.__setattr__(self, "cell", self.cell.seen_from(first))
        errors = [*_limit_errors(self.limits, self.cell), *_start_errors(*self.start_state, self.limits)]
        errors += passage_errors(self.passages, self.cell) if self.passages else self.release.errors(self.cell)
        errors += [*self._errors_of_moving_target(), *self._errors_of_several()]
        if self.backend not in BACKENDS:
            errors.append(FieldError("backend", f"{self.backend!r} is not one of {', '.join(BACKENDS)}"))
        elif self.is_chain and self.backend not in CHAIN_BACKENDS:
            reason = f"{self.backend!r} makes no motion through several states; give {' or '.join(CHAIN_BACKENDS)}"
            errors.append(FieldError("backend", reason))
        elif not self.starts_at_rest and self.backend not in MOVING_BACKENDS:
            reason = f"{self.backend!r} makes no motion from a start in motion; give {' or '.join(MOVING_BACKENDS)}"
            errors.append(FieldError("backend", reason))
        if not 0.0 < self.time_limit_s <= TIME_LIMIT_MAX_S:
            errors.append(FieldError("time_limit_s", f"{self.time_limit_s} is not in (0, {TIME_LIMIT_MAX_S:g}] s"))
        if errors:
            raise InvalidProblem(errors)

    def _errors_of_moving_target(self) -> list[FieldError]:
        """Returns what a target that moves lacks, or does not go together with."""
        if self.moving is None:
            return []
        errors = []
        if self.starts_not_before_s is None:
            reason = "is missing: a target that moves needs the earliest start on the controller's clock"
            errors.append(FieldError("starts_not_before_s", reason))
        if not self.starts_at_rest:
            errors.append(FieldError("start", "is in motion: it cannot wait for a target that moves"))
        return errors + self._errors_of_late_passages() + self._errors_of_uncertain_target()

    def _errors_of_late_passages(self) -> list[FieldError]:
        """Returns the passages that are asked for later than the motion to a target that moves may go on.

        The object lands within `swept_s` of the start, and the arm is at rest within `swept_s` of the landing.
        """
        if not self.passages:
            return []
        before_s, after_s = self.swept_s
        thrown = next((i for i, each in enumerate(self.passages) if each.releases), len(self.passages))
        errors = []
        for number, each in enumerate(self.passages):
            most_s = before_s if number <= thrown else before_s + after_s
            name, asked_s = ("not_before_s", each.not_before_s) if each.at_s is None else ("at_s", each.at_s)
            if asked_s < most_s:
                continue
            limits = f"the object lands within {before_s:g} s of the start"
            if number > thrown:
                limits += f", and the arm is at rest within {after_s:g} s of that"
            reason = f"must be below {most_s:g}, as the target moves: {limits}; it is {asked_s:g}"
            errors.append(FieldError(f"passages[{number}].{name}", reason))
        return errors

    def _errors_of_several(self) -> list[FieldError]:
        """Returns what is not supported of a motion in which another gripper than the cell's own lets go."""
        if not self.names_gripper:
            return []
        errors = []
        for number, each in enumerate(self.passages):
            target = each.state.target
            if target is None:
                continue
            if target.moves and each.state is not self.release:
                reason = "a target that moves is met by the object that leaves first: the start is chosen for that one"
                errors.append(FieldError(f"passages[{number}].state.velocity", reason))
            if target.uncertainty is not None:
                reason = "a motion in which one of `[grippers]` lets go has no odds, and follows no target: state none"
                errors.append(FieldError(f"passages[{number}].state.uncertainty", reason))
            if target.opening is not None:
                reason = f"a bin {NOT_YET} for a motion in which one of `[grippers]` lets go: state its place alone"
                errors.append(FieldError(f"passages[{number}].state.opening", reason))
        return errors

    def _errors_of_uncertain_target(self) -> list[FieldError]:
        """Returns the refusal of a target that may be elsewhere: three standard deviations are more than a hit's room.

        That is so at its landing, where that is known, otherwise at the earliest start: it grows with time.
        """
        target = self.moving
        if target is None or target.uncertainty is None or self.starts_not_before_s is None:
            return []
        known_at_s = max(self.starts_not_before_s, target.at_s)
        off_m = UNCERTAIN_DEVIATIONS * target.uncertainty.after(known_at_s - target.at_s).position_std_m
        if off_m <= self.hit_radius_m:
            return []
        reason = (
            f"the target may be {off_m:.3g} m off at {known_at_s:.12g} s of the controller's clock "
            f"({UNCERTAIN_DEVIATIONS:g} standard deviations), and the room of a hit is {self.hit_radius_m:.3g} m: "
            "observe it for longer, or throw sooner"
        )
        number = first_release(self.passages)
        return [FieldError("release.position" if number is None else f"passages[{number}].state.position", reason)]

    @cached_property
    def moving(self) -> Target | None:
        """The target, if it moves."""
        target = self.target
        return target if target is not None and target.moves else None

    @property
    def names_gripper(self) -> bool:
        """Whether another gripper than the cell's own lets go."""
        return any(each.gripper for each in self.passages)

    @property
    def start_slack_m(self) -> float:
        """How far a target that moves may be from where it is met, as the start is on the nearest tick [m]."""
        return 0.0 if self.moving is None else 0.5 * self.dt * float(np.linalg.norm(self.moving.v_W))

    @property
    def swept_s(self) -> tuple[float, float]:
        """How long before and after the landing the arm keeps out of a moving bin's path [s], see `SWEPT_S`."""
        before_s, after_s = SWEPT_S
        goes_on = bool(self.passages) and (self.end is not None or not self.passages[-1].releases)
        return before_s, before_s if goes_on else after_s

    def met_at(self, at_s: float) -> ThrowProblem:
        """Returns the problem with a target that moves where it is at a time [s, controller's clock]."""
        target = self.target
        assert target is not None
        p_W = target.p_W + (at_s - target.at_s) * target.v_W
        known = target.uncertainty
        if known is not None:
            known = known.after(max(at_s - target.at_s, 0.0))
        return self.with_release(self.release.with_target(replace(target, p_W=p_W, at_s=at_s, uncertainty=known)))

    @cached_property
    def reachable(self) -> Limits:
        """The limits, with joint positions that self-collision makes unreachable from the start excluded."""
        lower, upper = passable(self.cell.robot, self.cell.tool.capsules, self.start, self.cell.surroundings)
        limits = self.limits
        return replace(limits, q_lower=np.maximum(limits.q_lower, lower), q_upper=np.minimum(limits.q_upper, upper))

    @cached_property
    def cell_with_bin(self) -> Cell:
        """The cell as arm, tool and held object find it: a request's bin is one more keep-out box.

        The block that surrounds the bin, from its bottom to its rim: no part of the arm has business inside. Of a bin
        that moves, the block that it passes through from `swept_s` before the landing to after it.
        """
        if self.target is None or self.opening is None:
            return self.cell
        target = self.target
        radius = self.opening.radius_m
        rim = self.opening.rim_height_m
        aside = np.array([radius, radius, 0.0])
        top = np.array([radius, radius, rim])
        stands = target.p_W - self.aim_shift
        if target.moves:
            return _cell_with_path(self.cell, (*stands,), (*target.v_W,), radius, rim, self.swept_s)
        return _cell_with_block(self.cell, (*(stands - aside),), (*(stands + top),))

    @property
    def dt(self) -> float:
        """One controller tick [s]."""
        return 1.0 / self.cell.robot.sample_rate_hz

    @property
    def start_state(self) -> tuple[Array, Array, Array]:
        """Joint positions [rad], velocities [rad/s] and accelerations [rad/s^2] of the start, each (6,)."""
        return self.start, self.start_qd, self.start_qdd

    @cached_property
    def starts_at_rest(self) -> bool:
        """Whether the start is at rest; otherwise the motion begins on one that is running."""
        return not (self.start_qd.any() or self.start_qdd.any())

    def at_rest_from(self, q: Array) -> ThrowProblem:
        """Returns the problem with a start at rest in `q` (6,) [rad]."""
        return replace(self, start=q, start_qd=np.zeros(6), start_qdd=np.zeros(6))

    @cached_property
    def ends_at_rest(self) -> bool:
        """Whether the release state is at rest; such a move throws nothing and has an empty brake."""
        return self.release.is_at_rest

    @cached_property
    def throws(self) -> bool:
        """Whether the object leaves the tool; otherwise there is no flight, and what was held is held to the end."""
        lets_go = not self.passages or any(passage.releases for passage in self.passages)
        return lets_go and not self.ends_at_rest

    @property
    def is_chain(self) -> bool:
        """Whether the motion passes more than one state, a line, one at a given time, or ends in a given one."""
        has_more = any(each.is_timed or each.state.lasts_s > 0.0 for each in self.passages)
        return len(self.passages) > 1 or self.end is not None or has_more

    def with_release(self, release: Release) -> ThrowProblem:
        """Returns the problem with another release."""
        passages = with_main_state(self.passages, release) if self.passages else ()
        return replace(self, release=release, passages=passages)

    @cached_property
    def parts(self) -> tuple[ReleasePart, ...]:
        """The motion as each gripper sees it that lets go, or has passages, in the order in which they let go.

        Empty where all is one gripper's. A passage that lets nothing go is one of the cell's own.
        """
        owners = [self._owner(number) for number in range(len(self.passages))]
        if len(set(owners)) < 2:
            return ()
        releasing = [number for number, each in enumerate(self.passages) if each.releases]
        found = [self._part(owners, number, is_first=number == releasing[0]) for number in releasing]
        if "" in owners and "" not in [owners[number] for number in releasing]:
            found.append(self._part(owners, max(i for i, owner in enumerate(owners) if not owner), is_first=False))
        return tuple(found)

    @cached_property
    def kept(self) -> dict[str, ThrowProblem]:
        """The motion as each gripper sees it that lets nothing go in it, by name; none in a cell with one gripper."""
        views = [part.problem for part in self.parts] or [self]
        carried = [[each.gripper for each in view.cell.carried] for view in views]
        idle = [name for name in carried[0] if all(name in each for each in carried)]
        anywhere = JointRelease(self.cell.home, np.zeros(6))
        nothing = {"release": anywhere, "passages": (Passage("", anywhere),), "end": None, "release_window_s": 0.0}
        return {name: replace(self, cell=self.cell.seen_from(name), **nothing) for name in idle}

    def _owner(self, number: int) -> str:
        """Returns the name of the gripper whose tool centre point has a passage's state."""
        return self.passages[number].gripper if self.passages[number].releases else ""

    def _part(self, owners: list[str], number: int, is_first: bool) -> ReleasePart:
        """Returns the part of the owner of a passage, which lets go there, if it does."""
        asked = self.passages[number]
        own = tuple(i for i, owner in enumerate(owners) if owner == owners[number])
        gone = [each.gripper for each in self.passages[:number] if each.releases and asked.releases]
        off_s = 0.0 if is_first else 0.5 * self.dt
        window_s = self.release_window_s + off_s if self.release_window_s > 0.0 else 0.0
        problem = replace(
            self,
            cell=self.cell.seen_from(owners[number], gone),
            release=asked.state,
            passages=tuple(self.passages[i] for i in own),
            end=self.end if is_first else None,
            release_window_s=window_s,
            command_off_s=off_s,
        )
        return ReleasePart(problem, own, number)

    def seen_at(self, number: int) -> ThrowProblem:
        """Returns the motion as the gripper sees it whose tool centre point has a passage's state; the end's: itself.

        Args:
            number: of the passage; that of the end follows the last.
        """
        return next((part.problem for part in self.parts if number in part.numbers), self)

    def alone(self, number: int) -> ThrowProblem:
        """Returns the problem of a passage, or of the end, by itself; numbers are as of `seen_at`."""
        is_end = number == len(self.passages)
        state = self.end if is_end else self.passages[number].state
        assert state is not None
        releases = not is_end and self.passages[number].releases
        return self.seen_at(number).through(state, releases, self.is_thrown_before(number))

    def through(self, state: Release, releases: bool, is_thrown: bool) -> ThrowProblem:
        """Returns the problem of passing one state alone.

        Args:
            state: to pass.
            releases: whether the object leaves there.
            is_thrown: whether it left before.
        """
        alone = (Passage("", state, releases=releases, gripper=self.cell.mounted if releases else ""),)
        holds = self.holds_object and not is_thrown
        return replace(self, release=state, passages=alone, end=None, holds_object=holds)

    def up_to(self, number: int) -> ThrowProblem:
        """Returns the problem of the first so many passages by themselves, to rest anywhere."""
        passages = self.passages[:number]
        cell = self.cell.seen_from(first_gripper(passages))
        return replace(self, cell=cell, release=main_state(passages), passages=passages, end=None)

    def is_thrown_before(self, number: int) -> bool:
        """Returns whether the object of its gripper has left before a passage; numbers are as of `seen_at`."""
        own = self.cell.mounted if number == len(self.passages) else self._owner(number)
        return any(each.releases and each.gripper == own for each in self.passages[:number])

    @property
    def fixes_joints(self) -> bool:
        """Whether the joint states at the release are given: one, or of a pose one for each branch.

        So they are of a body that is to land somewhere: where it does depends on how it turns.
        """
        return self.release.fixes_joints or (self.target is not None and self.body is not None)

    @property
    def body(self) -> ThrownBody | None:
        """The object, if it is no ball."""
        thing = self.cell.object
        return thing if isinstance(thing, ThrownBody) else None

    @property
    def target(self) -> Target | None:
        """What the flight is to hit; None for a release without a target."""
        return self.release.target

    @property
    def opening(self) -> Opening | None:
        """The mouth of the bin around the target; None where there is none."""
        return None if self.target is None else self.target.opening

    @property
    def hit_radius_m(self) -> float:
        """The distance from the target that counts as a hit [m].

        The room of the opening about the object, else the landing tolerance, else the object's radius.
        """
        thick = self.cell.object.radius_m
        if self.opening is not None:
            return self.opening.radius_m - thick
        return self.landing_tolerance_m or thick

    @property
    def plane_z(self) -> float:
        """Height of the landing plane [m]: the target's, or the floor's for a release without a target."""
        target = self.target
        if target is not None:
            return float(target.p_W[2])
        return self.cell.surroundings.floor_z_m

    @cached_property
    def drag(self) -> float:
        """Drag constant of the object [1/m]."""
        thing = self.cell.object
        return drag_constant(thing.mass_kg, thing.drag_radius_m, thing.drag_coefficient)

    @cached_property
    def surfaces(self) -> tuple[Surface, ...]:
        """What the object lands on at the target, see `landing_surfaces`; without a target the floor."""
        target = self.target
        anywhere = np.array([0.0, 0.0, self.plane_z])
        return landing_surfaces(self.cell, anywhere if target is None else target.p_W)

    @cached_property
    def misfit(self) -> Misfit | None:
        """By how much the object does not fit at the target, beside what; None where it does, or without a target."""
        target = self.target
        return None if target is None else misfit(self.cell, target.p_W - self.aim_shift)

    @cached_property
    def carriers(self) -> Mask:
        """Which keep-out shapes (b,) carry a surface on which the object lands, or lie below one."""

        def carries(shape: Solid, surface: Surface) -> bool:
            above_m = shape.upper[2] - surface.height_m
            is_level = above_m >= -LEVEL_M and surface.meets(shape)
            return bool(above_m <= LEVEL_M) and (is_level or surface.is_within(shape))

        shapes = self.cell.surroundings.keep_out
        return np.array([any(carries(shape, surface) for surface in self.surfaces) for shape in shapes], np.bool_)

    @cached_property
    def flight_clearances(self) -> tuple[Array, Array]:
        """The distances [m] that the object in flight keeps from keep-out shapes (b,) and what the base carries (k,).

        That is the cell's or the shape's own, but 0 for what it lands on. Beside its target the object comes as near as
        it lies there: half of that distance, less the landing tolerance, is enough.
        """
        around = self.cell.surroundings
        usual = around.flight_clearance_m
        own = around.flight_clearances
        base = body_model(self.cell).base_shapes
        if self.target is None:
            return np.where(self.carriers, 0.0, own), np.full(len(base[2]), usual)
        p = self.target.p_W - self.aim_shift
        centre = p + np.array([0.0, 0.0, self.landing_radius_m])
        stands = [float(segment_shape_distance(centre, centre, shape)) for shape in around.keep_out]
        carried = [float(point_segment_distance(centre, p0, p1)) - radius for p0, p1, radius in zip(*base, strict=True)]
        spare = self.cell.object.outer_radius_m + (self.landing_tolerance_m if self.is_robust else 0.0)
        beside = [0.5 * np.maximum(np.array(gaps) - spare, 0.0) for gaps in (stands, carried)]
        return np.where(self.carriers, 0.0, np.minimum(beside[0], own)), np.minimum(beside[1], usual)

    @cached_property
    def landing_radius_m(self) -> float:
        """Height of the centre above the landing plane at which a flight to the target is over [m].

        On the floor or a shape, which the object touches then, its radius, of a body the least that it can be; 0 in the
        air, where it flies on.
        """
        return self.carrier_z + self.cell.object.inner_radius_m - self.plane_z if self.surfaces else 0.0

    @cached_property
    def lies_z(self) -> float | None:
        """Height of the centre of a ball that has landed [m]; None in the air or in a bin.

        None of a body too: nobody knows how it comes to lie, and its flight is over (`planner.touchdown`).
        """
        lies = self.surfaces and self.opening is None and self.body is None
        return self.carrier_z + self.cell.object.radius_m if lies else None

    @property
    def touched_z(self) -> float | None:
        """Height of what a body first touches as it lands at the target [m]: a bin's bottom, a surface; None: air."""
        if self.opening is not None:
            return self.plane_z
        return self.carrier_z if self.surfaces else None

    def touchdowns(self, p_WT: Array, v_WT: Array, R_WT: Array, w_WT: Array) -> Touchdowns:
        """Returns the flights of a body that leaves the tool in n states.

        Args:
            p_WT, v_WT: place and velocity of the tool centre point (n, 3) [m, m/s].
            R_WT, w_WT: axes (n, 3, 3) and angular velocity (n, 3) [rad/s] of the tool.
        """
        body = self.body
        assert body is not None
        leaving = Leaving(p_WT, self.release_speed_factor * v_WT, R_WT @ body.R_TO, w_WT)
        touched_z = self.touched_z
        height_m = self.plane_z if touched_z is None else touched_z
        return Touchdowns(body, leaving, height_m, touched_z is None, self.gravity, self.drag)

    @cached_property
    def carrier_z(self) -> float:
        """Height of what the object lies on at the target [m]; in the air the landing plane's."""
        return max((surface.height_m for surface in self.surfaces), default=self.plane_z)

    def is_met_lying(self, top_z: Array) -> Mask:
        """Returns which shapes that end at `top_z` (...) [m] are higher than what the object lies on at the target."""
        return np.asarray((top_z > self.carrier_z + LEVEL_M) & (self.lies_z is not None))

    @property
    def gravity(self) -> float:
        """Gravity along -z [m/s^2]."""
        return self.cell.surroundings.gravity_m_s2

    @property
    def release_speed_factor(self) -> float:
        """The object's speed over the tool's as it leaves [-]."""
        return self.cell.gripper.release_speed_factor

    @property
    def gravity_at_tool_speed(self) -> float:
        """Gravity under which an object with the tool's own velocity flies the true path [m/s^2]: g / f^2.

        An object that leaves with f v obeys x'' = -g - k |x'| x'. In the time s = f t its path is that of one which
        leaves with v under g / f^2 and the same k. So whoever looks for the tool's velocity uses this gravity, and
        times of flight are f times the true ones.
        """
        return self.gravity / self.release_speed_factor**2

    @property
    def is_robust(self) -> bool:
        """Whether the landing tolerance must hold for a window of release times."""
        return self.release_window_s > 0.0 and self.landing_tolerance_m > 0.0 and self.throws

    @property
    def planned_window_s(self) -> float:
        """The release window that the landing tolerance must hold for [s]: 0 without a tolerance, or for a move."""
        return self.release_window_s if self.is_robust else 0.0

    @property
    def opening_spread_s(self) -> float:
        """How early or late the gripper may open [s]: the window, or three standard deviations if that is longer.

        The object has to leave and fly clear of everything after a release at any of these times; where it lands counts
        in the window alone. 0 for a move, or without the object.
        """
        if not self.throws or not self.holds_object:
            return 0.0
        return max(self.planned_window_s, JITTER_DEVIATIONS * self.cell.gripper.jitter_s + self.command_off_s)


@lru_cache(maxsize=BINS_KEPT)
def _cell_with_block(cell: Cell, lower: tuple[float, ...], upper: tuple[float, ...]) -> Cell:
    """Returns the cell with one more keep-out box; the same one for the same bin, as caches know cells by identity."""
    return _cell_with(cell, Box(np.array(lower), np.array(upper), "bin"))


@lru_cache(maxsize=BINS_KEPT)
def _cell_with_path(
    cell: Cell,
    stands: tuple[float, ...],
    v_W: tuple[float, ...],
    radius_m: float,
    rim_m: float,
    swept_s: tuple[float, float],
) -> Cell:
    """Returns the cell with one more keep-out box: the path of a bin that moves and is met at `stands`."""
    before_s, after_s = swept_s
    speed = float(np.hypot(v_W[0], v_W[1]))
    angle = float(np.arctan2(v_W[1], v_W[0]))
    length = speed * (before_s + after_s) + 2.0 * radius_m
    middle = np.array(stands) + 0.5 * (after_s - before_s) * np.array(v_W) + np.array([0.0, 0.0, 0.5 * rim_m])
    X_WC = pose(middle, rotation_vector_to_matrix([0.0, 0.0, angle]))
    return _cell_with(cell, shape_of("box", X_WC, np.array([length, 2.0 * radius_m, rim_m]), "bin"))


def _cell_with(cell: Cell, shape: Solid) -> Cell:
    around = cell.surroundings
    return replace(cell, surroundings=replace(around, keep_out=(*around.keep_out, shape)))


def _limit_errors(limits: Limits, cell: Cell) -> list[FieldError]:
    return [
        FieldError(f"limits.{name}[{joint}]", f"{value:.6g} is beyond the arm's own limit of {own:.6g}")
        for name, joint, value, own in limits.beyond(cell.robot, STANDING_RAD)
    ]


def _start_errors(q: Array, qd: Array, qdd: Array, limits: Limits) -> list[FieldError]:
    errors = []
    for i in range(6):
        if not limits.q_lower[i] <= q[i] <= limits.q_upper[i]:
            bounds = f"[{limits.q_lower[i]:.6g}, {limits.q_upper[i]:.6g}]"
            reason = f"{q[i]:.6g} rad is outside the joint's limits {bounds} rad{unit_hint(q[i])}"
            errors.append(FieldError(f"start.positions[{i}]", reason))
    rows = (("velocities", qd, limits.qd_max, "rad/s"), ("accelerations", qdd, limits.qdd_max, "rad/s^2"))
    for name, values, most, unit in rows:
        for i in np.flatnonzero(np.abs(values) > most * (1.0 + ROUNDING)).tolist():
            reason = f"{values[i]:.6g} {unit} is beyond the joint's limit of {most[i]:.6g} {unit}"
            errors.append(FieldError(f"start.{name}[{i}]", reason))
    return errors

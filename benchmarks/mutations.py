"""Every limit of certified plans, drawn a few millionths inside the plan's true peak: does the certificate refuse it?

`python -m benchmarks.mutations --count 500`. The peaks are looked for on a dense grid, again and again around its worst
instant, so that what they are does not depend on the proofs that are tried here.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from planner.cell import Box, Cell, parse_cell
from planner.certificate import (
    SINGULARITY_WINDOW_S,
    ArmSamples,
    Examination,
    MotionSamples,
    felt_sizes,
    landing_errors,
    momentum_sizes,
    moving_heights,
    power_sizes,
    shape_gaps,
    stopping_distances,
    stopping_times,
    ticks_around_release,
    torque_sizes,
)
from planner.errors import Infeasible, InvalidProblem, SolverFailed
from planner.flight import fly
from planner.geometry import SELF_CLEARANCE_M, tool_state
from planner.kinematics import signed_singularity_distances
from planner.planning import plan
from planner.problem import JointRelease, PointRelease, PoseRelease, TargetRelease, ThrowProblem
from planner.robots import ROBOT_NAMES
from planner.trajectory import Trajectory

Vector = NDArray[np.float64]
Sizes = Callable[[ArmSamples], Vector]  # of the arm at k instants: (k,) or (items, k)

INSIDE = 3e-6  # [-] of a peak, or [m, rad] of a distance, by which a limit is drawn inside it
A_TICK = 8  # [-] instants that are looked at first
ZOOMS = 8  # [-] times that the surroundings of the worst one are looked at
ZOOM = 33  # [-] instants of each: 16 times closer
KINDS = ("joint", "pose", "point", "target", "soonest")
STRONG_M_S2 = 1e6  # [m/s^2] a grip that holds anything
PLAY_M = 0.001001  # [m] of the object in the grip, a little more than what the certificate ignores
LEAVES_S = 0.3  # [s] after the release in which the object leaves the grip
BOX_M = 0.02  # [m] size of a box beside a flight
SPREAD_RAD = 0.8
SPEED_SHARE = 0.6  # [rad] about home, [-] of the velocity limits: of the joint states that releases are taken from
TIME_LIMIT_S = 30.0  # [s] of a plan
CELL = """
robot = "{arm}"
[tool]
tcp_position_m = [0.01, 0.0, 0.12]
mass_kg = 0.5
capsules = [{{ from_m = [0.0, 0.0, 0.0], to_m = [0.0, 0.0, 0.1], radius_m = 0.04 }}]
[surroundings]
keep_in = [{{ lower_m = [-2.0, -2.0, 0.05], upper_m = [2.0, 2.0, 2.5] }}]
keep_out = [{{ lower_m = [-2.0, 1.0, 0.0], upper_m = [2.0, 1.2, 0.6] }}]
[gripper]
jitter_s = 0.0015
opening_direction = [0.0, 0.0, 1.0]
opening_cone_rad = 2.5
hold_acceleration_m_s2 = 200.0
[safety]
tool_speed_m_s = 6.0
elbow_speed_m_s = 6.0
momentum_kg_m_s = 300.0
power_w = 5000.0
stopping_time_s = 2.0
stopping_distance_m = 3.0
[link]
kind = "sim"
"""


@dataclass(frozen=True, eq=False)
class Mutation:
    """A problem with one limit inside what a plan needs: what is drawn in, the check that has to fail, the problem."""

    limit: str
    check: str
    problem: Callable[[], ThrowProblem]

    def is_refused(self, trajectory: Trajectory) -> bool:
        """Returns whether the plan's motion is refused for it."""
        try:
            problem = self.problem()
        except InvalidProblem:
            return True  # the start itself is beyond the limit
        return self.check in {failure.name for failure in Examination(problem, trajectory).failures}


@cache
def cell_of_arm(arm: str) -> Cell:
    """Returns a cell with every limit that a cell can have, of an arm by its name."""
    return parse_cell(CELL.format(arm=arm), arm)


def certified_plans(count: int, seed: int) -> Iterator[tuple[str, ThrowProblem, Trajectory]]:
    """Yields certified plans with their names; arms and kinds of release take turns."""
    rng = np.random.default_rng(seed)
    found = 0
    turn = 0
    while found < count:
        arm = ROBOT_NAMES[turn % len(ROBOT_NAMES)]
        kind = KINDS[turn % len(KINDS)]
        turn += 1
        problem = _problem(cell_of_arm(arm), kind, rng)
        if problem is None:
            continue
        try:
            made = plan(problem)
        except (Infeasible, SolverFailed):
            continue
        found += 1
        yield f"{arm}/{kind}/{turn}", problem, made.trajectory


def _problem(here: Cell, kind: str, rng: np.random.Generator) -> ThrowProblem | None:
    """Returns a problem of a kind from a random joint state; None where nothing is thrown from it."""
    q = here.home + rng.uniform(-SPREAD_RAD, SPREAD_RAD, 6)
    qd = rng.uniform(-SPEED_SHARE, SPEED_SHARE, 6) * here.limits.qd_max
    X_WT, V_WT = tool_state(here, q, qd)
    if kind == "joint":
        release = JointRelease(q, qd)
    elif kind == "pose":
        release = PoseRelease(X_WT, V_WT)
    elif kind == "point":
        release = PointRelease(X_WT[:3, 3], V_WT[:3])
    else:
        flight = fly(X_WT[:3, 3], V_WT[:3], 0.0, here.surroundings.gravity_m_s2, 0.0)
        if flight is None:
            return None
        release = TargetRelease(flight.landing_point)
    plain = ThrowProblem(here, here.home, release, here.limits, time_limit_s=TIME_LIMIT_S)
    return replace(plain, release_window_s=0.005, landing_tolerance_m=0.02) if kind == "target" else plain


def mutations(problem: ThrowProblem, trajectory: Trajectory, inside: float = INSIDE) -> Iterator[Mutation]:
    """Yields the mutations of every limit of a plan.

    Args:
        problem: of the plan.
        trajectory: its motion.
        inside: share of a peak, or distance [m, rad], by which a limit is drawn inside it.
    """
    motion = MotionSamples(problem, trajectory)
    yield from _of_joints(problem, trajectory, inside)
    yield from _of_tool(problem, motion, inside)
    yield from _of_safety(problem, motion, inside)
    yield from _of_surroundings(problem, motion, inside)
    if not problem.ends_at_rest:
        yield from _of_object(problem, motion, inside)
    if problem.is_robust:
        yield _of_landing(problem, trajectory, inside)


def _of_joints(problem: ThrowProblem, trajectory: Trajectory, inside: float) -> Iterator[Mutation]:
    limits = problem.limits
    t = _dense(trajectory)

    def changed(name: str, joint: int, value: float) -> Callable[[], ThrowProblem]:
        values = np.array(getattr(limits, name))
        values[joint] = value
        return lambda: replace(problem, limits=replace(limits, **{name: values}))

    speeds = _peaks(lambda t: np.abs(trajectory.at(t)[1]).T, t)
    accelerations = _peaks(lambda t: np.abs(trajectory.at(t)[2]).T, t)
    jerks = np.abs(trajectory.jerk).max(axis=0)
    farthest = _peaks(lambda t: np.concatenate([trajectory.at(t)[0], -trajectory.at(t)[0]], axis=1).T, t)
    for joint in range(6):
        tight = 1.0 - inside
        yield Mutation(f"qd_max[{joint}]", "joint_velocity", changed("qd_max", joint, speeds[joint] * tight))
        yield Mutation(
            f"qdd_max[{joint}]", "joint_acceleration", changed("qdd_max", joint, accelerations[joint] * tight)
        )
        yield Mutation(f"jerk_max[{joint}]", "joint_jerk", changed("jerk_max", joint, jerks[joint] * tight))
        yield Mutation(f"q_upper[{joint}]", "joint_position", changed("q_upper", joint, farthest[joint] - inside))
        yield Mutation(f"q_lower[{joint}]", "joint_position", changed("q_lower", joint, inside - farthest[6 + joint]))


def _of_tool(problem: ThrowProblem, motion: MotionSamples, inside: float) -> Iterator[Mutation]:
    limits = problem.limits
    trajectory = motion.trajectory
    t = _dense(trajectory)
    for joint, peak in enumerate(_peaks(lambda t: torque_sizes(motion, motion.at(t)), t)):
        tau_max = np.array(limits.tau_max)
        tau_max[joint] = peak * (1.0 - inside)
        tight = replace(limits, tau_max=tau_max)
        yield Mutation(f"tau_max[{joint}]", "joint_torque", lambda tight=tight: replace(problem, limits=tight))
    (fastest,) = _peaks(lambda t: motion.at(t).tool_speed, t)
    slow = replace(limits, tcp_speed_max=fastest * (1.0 - inside))
    yield Mutation("tcp_speed_max", "tcp_speed", lambda: replace(problem, limits=slow))

    first, last = trajectory.t[list(ticks_around_release(trajectory, SINGULARITY_WINDOW_S))]
    around = np.linspace(first, last, A_TICK * round((last - first) / trajectory.dt) + 1)

    def nearness(t: Vector) -> Vector:
        return -np.abs(signed_singularity_distances(problem.cell.robot, trajectory.at(t)[0])).T

    far = replace(limits, singularity_distance_min=-_peaks(nearness, around).max() + inside)
    yield Mutation("singularity_distance_min", "singularity_distance", lambda: replace(problem, limits=far))


def _of_safety(problem: ThrowProblem, motion: MotionSamples, inside: float) -> Iterator[Mutation]:
    here = problem.cell
    t = _dense(motion.trajectory)
    sizes: dict[str, tuple[str, Sizes]] = {
        "elbow_speed_m_s": ("elbow_speed", lambda arm: arm.elbow_speed),
        "momentum_kg_m_s": ("momentum", lambda arm: momentum_sizes(motion, arm)),
        "power_w": ("power", lambda arm: power_sizes(motion, arm)),
        "stopping_time_s": ("stopping_time", lambda arm: stopping_times(motion, arm)),
        "stopping_distance_m": ("stopping_distance", lambda arm: stopping_distances(motion, arm)),
        "tool_speed_m_s": ("tcp_speed", lambda arm: np.maximum(arm.tool_speed, arm.flange_speed)),
    }
    for name, (check, size) in sizes.items():
        (peak,) = _peaks(lambda t, size=size: size(motion.at(t)), t)
        safety = replace(here.safety, **{name: peak * (1.0 - inside)})
        tight = replace(here, safety=safety)
        yield Mutation(name, check, lambda tight=tight: replace(problem, cell=tight))
    held = t[t <= motion.held_until_s]
    (felt,) = _peaks(lambda t: felt_sizes(motion.at(t), False), held)
    yield _holding_less(problem, "hold_acceleration_m_s2", np.array([felt]), inside)
    for axis, felt in enumerate(_peaks(lambda t: felt_sizes(motion.at(t), True), held)):
        along = np.full(3, STRONG_M_S2)
        along[axis] = felt
        yield _holding_less(problem, f"hold_acceleration_m_s2[{axis}]", along, inside)


def _holding_less(problem: ThrowProblem, limit: str, felt: Vector, inside: float) -> Mutation:
    gripper = replace(problem.cell.gripper, hold_acceleration_m_s2=felt * (1.0 - inside))
    weak = replace(problem.cell, gripper=gripper)
    return Mutation(limit, "grip_acceleration", lambda: replace(problem, cell=weak))


def _of_surroundings(problem: ThrowProblem, motion: MotionSamples, inside: float) -> Iterator[Mutation]:
    around = problem.cell.surroundings
    body = motion.body
    t = _dense(motion.trajectory)

    def standing(**changes: object) -> Callable[[], ThrowProblem]:
        return lambda: replace(problem, cell=replace(problem.cell, surroundings=replace(around, **changes)))

    def heights(t: Vector) -> Vector:
        return -moving_heights(motion, t, body.end_points(motion.poses_at(t)))

    def gaps(t: Vector) -> Vector:
        return -shape_gaps(motion, t, body.end_points(motion.poses_at(t))).reshape(-1, len(t))

    lowest = -_peaks(heights, t).max()
    closest = -_peaks(gaps, t).max()
    yield Mutation("floor_z_m", "floor", standing(floor_z_m=around.floor_z_m + lowest - around.clearance_m + inside))
    yield Mutation("clearance_m", "keep_out", standing(clearance_m=closest + inside))
    places = _peaks(lambda t: np.concatenate([motion.at(t).p_WT, -motion.at(t).p_WT]), t)
    (room,) = around.keep_in
    for axis in range(3):
        upper = np.array(room.upper)
        lower = np.array(room.lower)
        upper[axis] = places[axis] - inside
        lower[axis] = -places[3 + axis] + inside
        yield Mutation(f"keep_in upper[{axis}]", "keep_in", standing(keep_in=(replace(room, upper=upper),)))
        yield Mutation(f"keep_in lower[{axis}]", "keep_in", standing(keep_in=(replace(room, lower=lower),)))


def _of_object(problem: ThrowProblem, motion: MotionSamples, inside: float) -> Iterator[Mutation]:
    """Yields a larger object beside the arm, a narrower gripper, and a box that the flight touches."""
    here = problem.cell
    body = motion.body
    t = _dense(motion.trajectory)
    of_object = body.pairs[:, 1] == body.object
    if of_object.any():
        held = t[t <= motion.held_until_s]

        def gaps(t: Vector) -> Vector:
            return -body.pair_distances(body.end_points(motion.poses_at(t)))[of_object]

        closest = -_peaks(gaps, held).max()
        larger = replace(here.object, radius_m=here.object.radius_m + closest - SELF_CLEARANCE_M + inside)
        bulky = replace(here, object=larger)
        yield Mutation("object.radius_m", "self_collision", lambda: replace(problem, cell=bulky))
    spread = problem.opening_spread_s
    for delay in (-spread, 0.0, spread):
        arm = motion.at(np.array([motion.trajectory.release_time_s + delay]))
        narrow = replace(here, gripper=replace(here.gripper, opening_cone_rad=_widest(motion, arm) - inside))
        yield Mutation(
            f"opening_cone_rad, {1e3 * delay:+.0f} ms",
            "opening_direction",
            lambda narrow=narrow: replace(problem, cell=narrow),
        )
        around = here.surroundings
        beside = replace(around, keep_out=(*around.keep_out, _box_beside(problem, arm, inside)))
        walled = replace(here, surroundings=beside)
        yield Mutation(
            f"keep_out beside the flight, {1e3 * delay:+.0f} ms",
            "flight_clearance",
            lambda walled=walled: replace(problem, cell=walled),
        )


def _widest(motion: MotionSamples, released: ArmSamples) -> float:
    """Returns the widest angle from the opening direction of an object's way out of the grip [rad].

    Args:
        motion: the motion.
        released: the arm at the one instant of the release.
    """
    cell = released.cell
    direction = cell.gripper.opening_direction
    assert direction is not None
    p = released.p_WT
    v = released.v_WT
    g = np.array([[0.0], [0.0], [cell.surroundings.gravity_m_s2]])

    def moved(s: Vector) -> Vector:
        later = motion.at(released.t[0] + s)
        R_WT = later.X_WL[:, 6, :3, :3] @ cell.tool.X_FT[:3, :3]
        return np.einsum("kij,ik->jk", R_WT, p + v * s - 0.5 * g * s * s - later.p_WT)

    def angles(s: Vector) -> Vector:
        way = moved(s)
        size = np.linalg.norm(way, axis=0)
        cosine = direction @ way / np.maximum(size, PLAY_M)
        return np.where(size >= PLAY_M, np.arccos(np.clip(cosine, -1.0, 1.0)), -np.inf)

    s = np.arange(0.0, LEAVES_S, motion.trajectory.dt / A_TICK)
    within = np.linalg.norm(moved(s), axis=0) < cell.object.way_out_m
    return float(_peaks(angles, s[: len(s) if within.all() else int(within.argmin())])[0])


def _box_beside(problem: ThrowProblem, released: ArmSamples, inside: float) -> Box:
    """Returns a box whose edge the object touches half-way to the ground: the flight's plane passes it by its radius.

    Args:
        problem: whose object flies without drag.
        released: the arm at the one instant of the release.
        inside: by how much it touches it [m].
    """
    p = released.p_WT[:, 0]
    v = released.v_WT[:, 0]
    flight = fly(p, v, problem.plane_z, problem.gravity, 0.0)
    assert flight is not None
    s = 0.5 * flight.time_of_flight_s
    half_way = p + v * s - 0.5 * problem.gravity * s * s * np.array([0.0, 0.0, 1.0])
    aside = np.array([-v[1], v[0]]) / np.hypot(v[0], v[1])
    edge = half_way[:2] + aside * (problem.cell.object.radius_m - inside)
    corners = np.stack([edge, edge + np.copysign(BOX_M, aside)])
    lower = np.append(corners.min(axis=0), half_way[2] - BOX_M)
    upper = np.append(corners.max(axis=0), half_way[2] + BOX_M)
    return Box(lower, upper)


def _of_landing(problem: ThrowProblem, trajectory: Trajectory, inside: float) -> Mutation:
    window = problem.release_window_s
    delays = np.linspace(-window, window, A_TICK * 2 * math.ceil(window / trajectory.dt) + 1)
    (farthest,) = _peaks(lambda delays: landing_errors(problem, trajectory, delays), delays)
    narrow = farthest * (1.0 - inside)
    return Mutation("landing_tolerance_m", "landing_window", lambda: replace(problem, landing_tolerance_m=narrow))


def _dense(trajectory: Trajectory) -> Vector:
    """Returns instants of a motion (k,) [s], every tick among them."""
    return np.linspace(0.0, trajectory.duration_s, A_TICK * (len(trajectory.q) - 1) + 1)


def _peaks(values: Callable[[Vector], Vector], t: Vector) -> Vector:
    """Returns the largest values (items,) of a function of times (k,) that returns (items, k) or (k,)."""
    rows = np.atleast_2d(values(t))
    peaks = rows.max(axis=1)
    for item, worst in enumerate(rows.argmax(axis=1)):
        middle = t[worst]
        half = t[1] - t[0]
        for _ in range(ZOOMS):
            near = np.clip(middle + np.linspace(-half, half, ZOOM), t[0], t[-1])
            found = np.atleast_2d(values(near))[item]
            peaks[item] = max(peaks[item], found.max())
            middle = near[found.argmax()]
            half *= 2.0 / (ZOOM - 1)
    return peaks


@dataclass(eq=False)
class MutationTally:
    """What was tried: plans by their arm and by their kind of release, limits, and which limits did not refuse."""

    arms: Counter[str] = field(default_factory=Counter)
    kinds: Counter[str] = field(default_factory=Counter)
    limits: Counter[str] = field(default_factory=Counter)
    certified: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        """The counts in lines, then what was certified all the same."""
        head = (
            f"{self.limits.total()} limits of {self.arms.total()} plans, {1e6 * INSIDE:g} millionths inside their peaks"
        )
        by = (("arms", self.arms), ("kinds", self.kinds), ("limits", self.limits))
        counts = [f"{name}: " + ", ".join(f"{each} {count[each]}" for each in sorted(count)) for name, count in by]
        return "\n".join([head, *counts, f"{len(self.certified)} certified all the same", *self.certified])


def tried(count: int, seed: int) -> MutationTally:
    """Returns what became of every limit of certified plans."""
    tally = MutationTally()
    for name, problem, trajectory in certified_plans(count, seed):
        arm, kind, _ = name.split("/")
        tally.arms[f"{arm} at {trajectory.sample_rate_hz:g} Hz"] += 1
        tally.kinds[kind] += 1
        for mutation in mutations(problem, trajectory):
            tally.limits[mutation.check] += 1
            if not mutation.is_refused(trajectory):
                tally.certified.append(f"{name}: {mutation.limit}")
    return tally


def main() -> None:
    """Draws in the limits of random certified plans, and says which were certified all the same."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutations", description=__doc__)
    parser.add_argument("--count", type=int, default=500, help="plans")
    parser.add_argument("--seed", type=int, default=1, help="of the plans")
    asked = parser.parse_args()
    tally = tried(asked.count, asked.seed)
    print(tally)
    raise SystemExit(bool(tally.certified))


if __name__ == "__main__":
    main()

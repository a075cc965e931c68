"""Checks of the grip: what it must hold, and along which way it lets the object go.

The gripper feels the acceleration f = a - g of the tool centre point against free fall. From the release at r on, the
object falls freely: s later its displacement in the world from the place in the tool where it was held is

    d(s) = integral of (s - u) (g - a(r + u)) du from 0 to s = w s^2 / 2

so that w(r, s) is the mean of g - a over [r, r + s] with the weights 2 (1 - u / s). Over a time h, a deviates from its
chord by at most e(h) = sup|a''| h^2/8 + c h/4, where c sums the jumps of its slope from tick to tick (`bounds`). So w
deviates from its chord over dr by at most e(dr); over ds by at most sup|a''| ds^2/48 + c ds/12, as the instant at the
share l of the time moves by l ds. A jump J that the whole interval [r, r + s] meets is met at few shares only, which
gives J dr^2 / (3 s) and J ds^2 / (8 s): the smaller bound counts. Turned into the axes of the tool, with a bound U on
|w|, W on the tool's angular velocity and A on its acceleration, w deviates by (A + W^2) U (dr^2 + ds^2) / 8 and by
W sup|a'| (dr^2 + ds^2 / 3) / 4 more. A cone of at most a half space is convex: a chord is as deep in it as its
shallower end.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.certificate.bounds import (
    EVALUATIONS_MAX,
    ROUNDS,
    joint_rates,
    kinked_bound,
    point_bound,
    prove_above,
)
from planner.certificate.certificate import Check, NotChecked, at_most
from planner.certificate.flight import Flights
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.kinematics import LinkMotion, dot

OUT_M = 0.01  # [m] least displacement at which the object is out of the grip; otherwise its radius
OUT_MAX_S = 0.5  # [s] after the release: an object that moves with the tool for longer is not proven to leave it
SPARE = 1.5  # [-] share of the time in which it would be out with what it feels at the release, looked at at once
SPACING_S = 0.008  # [s] of the instants after a release that are looked at first
TICK_ROUNDING = 1e-6  # [ticks] by which whole ticks may exceed their number in floating point
RELEASES_S = 0.004  # [s] of the releases in a window
TINY = 1e-9  # [m/s^2] an acceleration that has no direction
SAME_INSTANT = 12  # [-] decimals of a time [s]: sums that differ by rounding are one instant


def grip_acceleration(motion: MotionSamples) -> Check | NotChecked | None:
    """Checks that the grip withstands the acceleration while the object is held, in the window too; None without it."""
    name, problem = "grip_acceleration", motion.problem
    if not problem.holds_object:
        return None
    limit = problem.cell.gripper.hold_acceleration_m_s2
    if limit is None:
        return NotChecked(name)
    count = int(np.searchsorted(motion.at_knots.t, motion.held_until_s, side="right"))
    R_FT = problem.cell.tool.X_FT[:3, :3]

    def room(arm: ArmSamples) -> Array:
        felt = felt_at(arm, problem.gravity)
        held = np.sqrt(dot(felt, felt)) if len(limit) == 1 else np.abs(_in_tool(arm.X_WL, R_FT, felt))
        return 1.0 - held / limit[:, None]

    def evaluate(t: Array, item: Index) -> Array:
        return room(motion.at(t))[item, np.arange(len(t))]

    rates = np.stack(_acceleration_rates(motion, len(limit) == 3))[:, None, : count - 1]
    rates = np.repeat(rates, len(limit), axis=1) / limit[:, None]
    proof = prove_above(evaluate, motion.at_knots.t[:count], room(motion.at_knots)[:, :count], rates, 0.0, kinked_bound)
    bound, axis = float(limit[proof.item]), "xyz"[proof.item] if len(limit) == 3 else ""
    return at_most(name, (1.0 - proof.value) * bound, bound, "m/s^2", proof.at_s, axis).provided(proof.proven)


def _acceleration_rates(motion: MotionSamples, in_tool: bool) -> tuple[Array, Array]:
    """Returns sup |f''| between the knots, apart from the ends of ticks, and the sums of the jumps of f' (m,) each.

    In the axes of the tool, with w1 and w2 bounding the derivatives of a direction: f'' + 2 w1 f' + w2 f.
    """
    rates, lever = motion.rates, motion.body.tool_lever
    curvature = point_bound(lever, rates, 4)
    if in_tool:
        w1, w2 = rates.totals[0][-1], rates.totals[1][-1]
        felt = point_bound(lever, rates, 2) + motion.problem.gravity
        curvature = curvature + 2.0 * w1 * point_bound(lever, rates, 3) + w2 * felt
    return curvature, lever @ rates.jumps


def opening_direction(motion: MotionSamples) -> Check | NotChecked | None:
    """Checks that the object leaves within the cone that the gripper opens, from any release in the window.

    It is out once it has moved by its radius against the tool, or by 1 cm; None for a move that ends at rest.
    """
    name, gripper = "opening_direction", motion.problem.cell.gripper
    if motion.problem.ends_at_rest:
        return None
    if gripper.opening_direction is None or gripper.opening_cone_rad is None:
        return NotChecked(name)
    exits = Exits(Flights(motion), gripper.opening_direction, gripper.opening_cone_rad)
    angle, at_s, proven = exits.widest()
    return at_most(name, angle, gripper.opening_cone_rad, "rad", at_s).provided(proven)


class Cells(NamedTuple):
    """k intervals of releases [r0, r1] and of times after them [s0, s1], (k,) each [s]."""

    r0: Array
    r1: Array
    s0: Array
    s1: Array

    def parts(self, chosen: Mask) -> Cells:
        """Returns the parts of the `chosen` ones: halves in time, and of releases where there is more than one."""
        r0, r1, s0, s1 = (values[chosen] for values in self)
        s, r = 0.5 * (s0 + s1), 0.5 * (r0 + r1)
        parts = [(r0, r1, s0, s), (r0, r1, s, s1)]
        if (r1 > r0).any():
            parts = [half for _, _, low, high in parts for half in ((r0, r, low, high), (r, r1, low, high))]
        return Cells(*(np.concatenate(values) for values in zip(*parts, strict=True)))


class Seen(NamedTuple):
    """Cells evaluated.

    Attributes:
        angle: from the cone's axis at the corners (4, k) [rad]; -inf where the object is out.
        leaving: about the angle at which it gets out between the corners of a release (k,) [rad]; -inf where it does
            not.
        room: how deep the cells are in the cone, at least (k,) [m/s^2].
        is_out: whether the object is out from the beginning of the cells on (k,).
    """

    angle: Array
    leaving: Array
    room: Array
    is_out: Mask


class WayBounds(NamedTuple):
    """Bounds on the motion of the tool while the object leaves it.

    Attributes:
        jumps: of the slope of a at each tick (n,) [m/s^3].
        rate_hz: ticks a second.
        snap: sup |a''| between ticks [m/s^4].
        jerk: sup |a'| [m/s^3].
        most: U, sup |w| [m/s^2].
        turn: W, of the tool's angular velocity [rad/s].
        turning: A + W^2 [rad/s^2].
    """

    jumps: Array
    rate_hz: float
    snap: float
    jerk: float
    most: float
    turn: float
    turning: float

    def deviation(self, dr: float, ds: float, s0: Array) -> Array:
        """Returns how far w deviates between the corners of cells that begin at `s0` (k,) [m/s^2], at most."""
        along = self.snap * (dr * dr / 8.0 + ds * ds / 48.0)
        change = self.turn * self.jerk * (dr * dr + ds * ds / 3.0) / 4.0
        smooth = along + change + self.turning * self.most * (dr * dr + ds * ds) / 8.0
        share = self.jumps.sum() / np.maximum(s0, TINY)
        along_r = np.minimum(self._jumps_within(dr) * dr / 4.0, share * dr * dr / 3.0)
        return smooth + along_r + np.minimum(self._jumps_within(ds) * ds / 12.0, share * ds * ds / 8.0)

    def _jumps_within(self, h: float) -> float:
        """Returns the largest sum of the jumps inside a time `h` [m/s^3]."""
        ticks = min(len(self.jumps), math.ceil(h * self.rate_hz - TICK_ROUNDING))
        if ticks <= 0:
            return 0.0
        sums = np.concatenate([[0.0], np.cumsum(self.jumps)])
        return float((sums[ticks:] - sums[:-ticks]).max())


class Exits:
    """The ways on which the object leaves the tool, and how deep they are in a cone.

    Attributes:
        flights: the flights.
        direction: axis of the cone (3,) in the tool frame.
        cone_rad: its half angle [rad].
        out_m: displacement at which the object is out [m].
    """

    def __init__(self, flights: Flights, direction: Array, cone_rad: float) -> None:
        self.flights, self.direction, self.cone_rad = flights, direction, cone_rad
        self.out_m = max(flights.motion.problem.cell.object.radius_m, OUT_M)

    def widest(self) -> tuple[float, float, bool]:
        """Returns the widest angle found [rad], its time [s], and whether the cone is proven to contain all ways."""
        widest, at_s, spent = -math.inf, self.flights.released_s, 0
        first = self._first_cells()
        if first is None:
            return math.nan, at_s, False
        cells, seen, bounds = first
        for _ in range(ROUNDS):
            corner, cell = np.unravel_index(int(seen.angle.argmax()), seen.angle.shape)
            if seen.angle[corner, cell] > widest:
                r, s = (cells.r0, cells.r1)[corner // 2][cell], (cells.s0, cells.s1)[corner % 2][cell]
                widest, at_s = float(seen.angle[corner, cell]), float(r + s)
            leaving = int(seen.leaving.argmax())
            undecided = (seen.room < 0.0) & ~seen.is_out
            spent += len(cells.r0)
            if widest > self.cone_rad:
                return widest, at_s, False
            if seen.leaving[leaving] > widest:  # interpolated: no proof that the cone is left
                widest = min(float(seen.leaving[leaving]), self.cone_rad)
                at_s = float(cells.r1[leaving] + cells.s1[leaving])
            if not undecided.any() or spent > EVALUATIONS_MAX:
                return widest, at_s, not undecided.any()
            cells = cells.parts(undecided)
            seen = self._evaluate(cells, bounds)
        return widest, at_s, False

    def _first_cells(self) -> tuple[Cells, Seen, WayBounds] | None:
        """Returns the cells until the object is out, evaluated, and bounds up to their end; None if it stays."""
        begin, length, blocks = 0.0, self._first_length(), []
        while True:
            bounds = self._bounds(begin + length)
            cells, shape = self._cells_between(begin, begin + length)
            seen = self._evaluate(cells, bounds)
            is_out = np.logical_or.accumulate(seen.is_out.reshape(shape), axis=1)
            on_way = ~is_out.ravel()
            blocks.append((Cells._make(v[on_way] for v in cells), Seen._make(v[..., on_way] for v in seen)))
            begin, length = begin + length, begin + length
            if is_out[:, -1].all():
                break
            if begin > OUT_MAX_S:
                return None
        cells, seen = (zip(*(block[i] for block in blocks), strict=True) for i in (0, 1))
        return (
            Cells._make(np.concatenate(values) for values in cells),
            Seen._make(np.concatenate(values, axis=-1) for values in seen),
            bounds,
        )

    def _first_length(self) -> float:
        """Returns a time in which the object should be out, a multiple of `SPACING_S` [s]."""
        motion = self.flights.motion
        felt = felt_at(motion.at_knots, motion.problem.gravity)[:, motion.release_knot]
        least = max(float(np.linalg.norm(felt)), motion.problem.gravity)
        return SPACING_S * (2 + math.ceil(SPARE * math.sqrt(2.0 * self.out_m / least) / SPACING_S))

    def _cells_between(self, begin_s: float, end_s: float) -> tuple[Cells, tuple[int, int]]:
        """Returns the cells between two times after every release, and their numbers of rows and times."""
        window, released = self.flights.window_s, self.flights.released_s
        r = released + np.linspace(-window, window, 1 + math.ceil(2.0 * window / RELEASES_S))
        s = np.linspace(begin_s, end_s, 1 + round((end_s - begin_s) / SPACING_S))
        r0, s0 = np.meshgrid(r[: max(1, len(r) - 1)], s[:-1], indexing="ij")
        r1, s1 = np.meshgrid(r[min(1, len(r) - 1) :], s[1:], indexing="ij")
        return Cells(r0.ravel(), r1.ravel(), s0.ravel(), s1.ravel()), (r0.shape[0], r0.shape[1])

    def _bounds(self, until_s: float) -> WayBounds:
        """Returns bounds from the beginning of the window until `until_s` after its end."""
        motion = self.flights.motion
        trajectory, rate = motion.trajectory, motion.trajectory.sample_rate_hz
        last, lever = len(trajectory.q) - 1, motion.body.tool_lever
        first = min(round(motion.gone_from_s * rate), last - 1)
        end = max(min(last, math.ceil((motion.held_until_s + until_s) * rate)), first + 1)
        rates = joint_rates(trajectory, np.array([first, end]))
        speed, felt, jerk, snap = (float(point_bound(lever, rates, n)[0]) for n in (1, 2, 3, 4))
        most, drag = felt + motion.problem.gravity, motion.problem.drag
        speed += motion.problem.gravity * until_s
        snap += 2.0 * drag * ((most + drag * speed**2) ** 2 + speed * (jerk + 2.0 * drag * speed * most))
        w, a = rates.sums[:2, -1, 0]
        # Along the releases of a window jumps count three times as much as along the time: there they are exact.
        exact = self.flights.window_s > 0.0
        jumps = self._jumps(max(first, 1), end) if exact else self._most_jumps(max(first, 1), end)
        return WayBounds(jumps, rate, snap, jerk, most, float(w), float(a + w * w))

    def _jerk_changes(self, first: int, end: int) -> Array:
        """Returns the changes of the joints' jerk (n, 6) at the ticks from `first` to `end` [rad/s^3]."""
        jerk = self.flights.motion.trajectory.jerk
        following = np.zeros((end + 1 - first, jerk.shape[1]))  # none after the end
        following[: len(jerk) - first] = jerk[first : end + 1]
        return following - jerk[first - 1 : end]

    def _most_jumps(self, first: int, end: int) -> Array:
        """Returns bounds on `_jumps` by the levers."""
        return np.abs(self._jerk_changes(first, end)) @ self.flights.motion.body.tool_lever

    def _jumps(self, first: int, end: int) -> Array:
        """Returns the jumps (n,) [m/s^3] of the slope of a at ticks: those of the jerks, turned by the Jacobian."""
        motion, trajectory = self.flights.motion, self.flights.motion.trajectory
        ticks, changes = np.arange(first, end + 1), self._jerk_changes(first, end)
        turned = LinkMotion(motion.body.link_poses(trajectory.q[ticks]), changes, np.zeros_like(changes))
        jumps = turned.velocity(turned.on_flange(motion.problem.cell.tool.X_FT[:3, 3]))
        return np.sqrt(dot(jumps, jumps))

    def _evaluate(self, cells: Cells, bounds: WayBounds) -> Seen:
        """Returns what is known of cells of one size."""
        r, s = np.stack([cells.r0, cells.r0, cells.r1, cells.r1]), np.stack([cells.s0, cells.s1, cells.s0, cells.s1])
        deviation = bounds.deviation(float(cells.r1[0] - cells.r0[0]), float(cells.s1[0] - cells.s0[0]), cells.s0)
        w = self._way(r.ravel(), s.ravel()).reshape(3, 4, -1)
        size = np.sqrt(dot(w, w))
        moved = 0.5 * size * s * s
        out = moved >= self.out_m
        angles = self._angle(np.concatenate([w, self._leaving(w, moved)], axis=1))
        angle, leaving = angles[:4], np.where(out[1::2] & ~out[::2], angles[4:], -np.inf).max(axis=0)
        depth = size * np.sin(np.minimum(np.maximum(self.cone_rad - angle, -np.pi / 2), np.pi / 2))
        room = depth.min(axis=0) - deviation
        if self.cone_rad > np.pi / 2:
            room -= np.sqrt(dot(w - w[:, :1], w - w[:, :1])).max(axis=0)
        mean = w[:, 0] + w[:, 2]
        least = np.minimum(dot(w[:, 0], mean), dot(w[:, 2], mean)) / np.maximum(np.sqrt(dot(mean, mean)), TINY)
        is_out = 0.5 * (least - deviation) * cells.s0**2 >= self.out_m
        return Seen(np.where(out, -np.inf, angle), leaving, room, is_out)

    def _angle(self, w: Array) -> Array:
        """Returns the angles (...) [rad] of vectors (3, ...) from the cone's axis."""
        x, y, z = self.direction
        along = x * w[0] + y * w[1] + z * w[2]
        return np.arctan2(np.sqrt(np.maximum(dot(w, w) - along * along, 0.0)), along)

    def _leaving(self, w: Array, moved: Array) -> Array:
        """Returns w (3, 2, k) where the object gets out, interpolated between the corners (3, 4, k) of a release."""
        root = np.sqrt(moved)  # it grows about linearly in time
        share = (math.sqrt(self.out_m) - root[::2]) / np.maximum(root[1::2] - root[::2], TINY)
        return w[:, ::2] + share * (w[:, 1::2] - w[:, ::2])

    def _way(self, r: Array, s: Array) -> Array:
        """Returns w in the tool frame (3, k) [m/s^2], `s` [s] after releases at `r` [s]."""
        motion, X_FT = self.flights.motion, self.flights.motion.problem.cell.tool.X_FT
        arm, release = self._releases(r)
        instants, where = np.unique(np.round(r + s, SAME_INSTANT), return_inverse=True)
        X_WF = motion.body.link_poses(motion.trajectory.at(instants)[0])[:, 6]
        p_WT = (X_WF[:, :3, :3] @ X_FT[:3, 3] + X_WF[:, :3, 3]).T
        later, fallen = s > 0.0, self.flights.flown(arm.p_WT[:, release], arm.v_WT[:, release], s)
        w = (fallen - p_WT[:, where]) * (2.0 / np.where(later, s * s, 1.0))
        if not later.all():
            w = np.where(later, w, -felt_at(arm, motion.problem.gravity)[:, release])
        R_WT = (X_WF[:, :3, :3] @ X_FT[:3, :3]).transpose(1, 2, 0)[:, :, where]
        return np.stack([dot(R_WT[:, c], w) for c in range(3)])

    def _releases(self, r: Array) -> tuple[ArmSamples, Index]:
        """Returns the arm at releases (k,), and which of its instants each is."""
        motion = self.flights.motion
        if self.flights.window_s == 0.0:
            return motion.at_knots, np.full(len(r), motion.release_knot)
        instants, where = np.unique(r, return_inverse=True)
        return motion.at(instants), where


def felt_at(arm: ArmSamples, gravity: float) -> Array:
    """Returns the acceleration of the tool centre point against free fall (3, k) [m/s^2], in the world."""
    return arm.a_WT + np.array([[0.0], [0.0], [gravity]])


def _in_tool(X_WL: Array, R_FT: Array, vectors: Array) -> Array:
    """Returns vectors (3, k) of the world in the axes of the tool at link poses (k, 7, 4, 4)."""
    R_WT = (X_WL[:, 6, :3, :3] @ R_FT).transpose(1, 2, 0)
    return np.stack([dot(R_WT[:, c], vectors) for c in range(3)])

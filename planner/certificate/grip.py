"""Checks of the grip: what it must hold, and along which way it lets the object go.

The gripper feels the acceleration f = a - g of the tool centre point against free fall. From the release at r on, the
object falls freely: s later its displacement in the world from the place in the tool where it was held is

    d(s) = integral of (s - u) (g - a(r + u)) du from 0 to s = w s^2 / 2

so that w(r, s) is the mean of g - a over [r, r + s] with the weights 2 (1 - u / s). Over a time h, a deviates from its
chord by at most e(h) = sup|a''| h^2/8 + c h/4, where c sums the jumps of its slope from tick to tick (`bounds`). So w
deviates from its chord over dr by at most e(dr); over ds by at most sup|a''| ds^2/48 + c ds/12, as the instant at the
share l of the time moves by l ds. Turned into the axes of the tool, with bounds U on |w|, D on its change, W on the
tool's angular velocity and A on its acceleration, it deviates by (A + W^2) h^2/8 U + W h D/4 more. A cone of at most
a half space is convex: a chord is as deep in it as its shallower end.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.certificate.bounds import (
    EVALUATIONS_MAX,
    ROUNDS,
    jerk_jumps,
    joint_rates,
    kinked_bound,
    point_bound,
    prove_above,
)
from planner.certificate.certificate import Check, NotChecked, at_most
from planner.certificate.flight import Flights
from planner.certificate.samples import ArmSamples, MotionSamples
from planner.kinematics import dot

OUT_M = 0.01  # [m] least displacement at which the object is out of the grip; otherwise its radius
OUT_S = (0.08, 0.16, 0.4)  # [s] after the release: the way out is looked at this long, longer where it is not over
SPACING_S = 0.008  # [s] of the instants after a release that are looked at first
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
        if len(limit) == 1:
            return limit[:, None] - np.sqrt(dot(felt, felt))
        return limit[:, None] - np.abs(_in_tool(arm.X_WL, R_FT, felt))

    def evaluate(t: Array, item: Index) -> Array:
        return room(motion.at(t))[item, np.arange(len(t))]

    rates = np.stack(_acceleration_rates(motion, len(limit) == 3))[:, None, : count - 1]
    rates = np.repeat(rates, len(limit), axis=1)
    proof = prove_above(evaluate, motion.at_knots.t[:count], room(motion.at_knots)[:, :count], rates, 0.0, kinked_bound)
    bound, axis = float(limit[proof.item]), "xyz"[proof.item] if len(limit) == 3 else ""
    return at_most(name, bound - proof.value, bound, "m/s^2", proof.at_s, axis).provided(proof.proven)


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
    return curvature, lever @ jerk_jumps(motion.trajectory, motion.knots)


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
        room: how deep the cells are in the cone, at least (k,) [m/s^2].
        is_out: whether the object is out from the beginning of the cells on (k,).
    """

    angle: Array
    room: Array
    is_out: Mask


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
        cells, seen = self._first_cells()
        widest, at_s, spent = -math.inf, self.flights.released_s, 0
        for _ in range(ROUNDS):
            corner, cell = np.unravel_index(int(seen.angle.argmax()), seen.angle.shape)
            if seen.angle[corner, cell] > widest:
                r, s = (cells.r0, cells.r1)[corner // 2][cell], (cells.s0, cells.s1)[corner % 2][cell]
                widest, at_s = float(seen.angle[corner, cell]), float(r + s)
            undecided = (seen.room < 0.0) & ~seen.is_out
            spent += len(cells.r0)
            if widest > self.cone_rad or not undecided.any() or spent > EVALUATIONS_MAX:
                return widest, at_s, not undecided.any()
            cells = cells.parts(undecided)
            seen = self._evaluate(cells)
        return widest, at_s, False

    def _first_cells(self) -> tuple[Cells, Seen]:
        """Returns the cells up to the first in which the object is out from the beginning on, evaluated."""
        for until_s in OUT_S[:-1]:
            cells, seen, is_out = self._cells_until(until_s)
            if is_out[:, -1].all():
                break
        else:
            cells, seen, is_out = self._cells_until(OUT_S[-1])
        on_way = ~is_out.ravel()
        return Cells._make(values[on_way] for values in cells), Seen._make(values[..., on_way] for values in seen)

    def _cells_until(self, until_s: float) -> tuple[Cells, Seen, Mask]:
        """Returns the cells up to `until_s` after every release, evaluated, and where it is out (rows, times)."""
        window, released = self.flights.window_s, self.flights.released_s
        r = released + np.linspace(-window, window, 1 + math.ceil(2.0 * window / RELEASES_S))
        s = np.linspace(0.0, until_s, 1 + math.ceil(until_s / SPACING_S))
        r0, s0 = np.meshgrid(r[: max(1, len(r) - 1)], s[:-1], indexing="ij")
        r1, s1 = np.meshgrid(r[min(1, len(r) - 1) :], s[1:], indexing="ij")
        cells = Cells(r0.ravel(), r1.ravel(), s0.ravel(), s1.ravel())
        seen = self._evaluate(cells)
        return cells, seen, np.logical_or.accumulate(seen.is_out.reshape(r0.shape), axis=1)

    @cached_property
    def _rates(self) -> tuple[Array, float, float, float, float, float]:
        """Returns jumps of the slope of a at every tick [m/s^3], sup|a''|, sup|a'|, U, W, and A + W^2.

        They hold from the beginning of the window until the last instant that is looked at.
        """
        motion = self.flights.motion
        trajectory, rate = motion.trajectory, motion.trajectory.sample_rate_hz
        last, lever = len(trajectory.q) - 1, motion.body.tool_lever
        first = min(round(motion.gone_from_s * rate), last - 1)
        end = max(min(last, math.ceil((motion.held_until_s + OUT_S[-1]) * rate)), first + 1)
        rates = joint_rates(trajectory, np.array([first, end]))
        speed, felt, jerk, snap = (float(point_bound(lever, rates, n)[0]) for n in (1, 2, 3, 4))
        snap += 2.0 * motion.problem.drag * (felt * felt + speed * jerk)  # of the drag
        jerks = np.pad(trajectory.jerk, ((0, 1), (0, 0)))[max(first - 1, 0) : end + 1]  # none after the end
        jumps = np.abs(np.diff(jerks, axis=0)) @ lever
        w, a = rates.sums[:2, -1, 0]
        return jumps, snap, jerk, felt + motion.problem.gravity, float(w), float(a + w * w)

    def _deviation(self, dr: float, ds: float) -> float:
        """Returns how far w deviates between the corners of a cell [m/s^2], at most."""
        _, snap, jerk, most, w, turning = self._rates
        along = snap * (dr * dr / 8.0 + ds * ds / 48.0)
        kinks = self._jumps_within(dr) * dr / 4.0 + self._jumps_within(ds) * ds / 12.0
        change = w * (dr + ds) * jerk * (dr + ds / 3.0) / 4.0
        return along + kinks + turning * (dr + ds) ** 2 / 8.0 * most + change

    def _jumps_within(self, h: float) -> float:
        """Returns the largest sum of the jumps of the slope of a within a time `h` [m/s^3]."""
        jumps = self._rates[0]
        if h == 0.0 or len(jumps) == 0:
            return 0.0
        ticks = min(len(jumps), 1 + math.floor(h * self.flights.motion.trajectory.sample_rate_hz))
        sums = np.concatenate([[0.0], np.cumsum(jumps)])
        return float((sums[ticks:] - sums[:-ticks]).max())

    def _evaluate(self, cells: Cells) -> Seen:
        """Returns what is known of cells of one size."""
        r, s = np.stack([cells.r0, cells.r0, cells.r1, cells.r1]), np.stack([cells.s0, cells.s1, cells.s0, cells.s1])
        deviation = self._deviation(float(cells.r1[0] - cells.r0[0]), float(cells.s1[0] - cells.s0[0]))
        w = self._way(r.ravel(), s.ravel()).reshape(3, 4, -1)
        size = np.sqrt(dot(w, w))
        along = np.tensordot(self.direction, w, axes=1)
        angle = np.arctan2(np.sqrt(np.maximum(size * size - along * along, 0.0)), along)
        depth = size * np.sin(np.clip(self.cone_rad - angle, -np.pi / 2, np.pi / 2))
        room = depth.min(axis=0) - deviation
        if self.cone_rad > np.pi / 2:
            room -= np.sqrt(dot(w - w[:, :1], w - w[:, :1])).max(axis=0)
        begin = w[:, ::2]
        mean = begin.mean(axis=1)
        least = dot(begin, mean[:, None]).min(axis=0) / np.maximum(np.sqrt(dot(mean, mean)), TINY) - deviation
        is_out = 0.5 * least * cells.s0**2 >= self.out_m
        return Seen(np.where(0.5 * size * s * s < self.out_m, angle, -np.inf), room, is_out)

    def _way(self, r: Array, s: Array) -> Array:
        """Returns w in the tool frame (3, k) [m/s^2], `s` [s] after releases at `r` [s]."""
        motion, problem = self.flights.motion, self.flights.motion.problem
        p, v, felt = self._releases(r)
        instants, where = np.unique(np.round(r + s, SAME_INSTANT), return_inverse=True)
        X_WL, X_FT = motion.poses_at(instants), problem.cell.tool.X_FT
        p_WT = X_WL[:, 6, :3, :3] @ X_FT[:3, 3] + X_WL[:, 6, :3, 3]
        w = (self.flights.flown(p, v, s) - p_WT[where].T) * (2.0 / np.where(s > 0.0, s * s, 1.0))
        return _in_tool(X_WL[where], X_FT[:3, :3], np.where(s > 0.0, w, -felt))

    def _releases(self, r: Array) -> tuple[Array, Array, Array]:
        """Returns positions, velocities, and accelerations against free fall (3, k) of the tool at releases (k,)."""
        motion = self.flights.motion
        if self.flights.window_s == 0.0:
            arm, where = motion.at_knots, np.full(len(r), motion.release_knot)
        else:
            instants, where = np.unique(r, return_inverse=True)
            arm = motion.at(instants)
        return arm.p_WT[:, where], arm.v_WT[:, where], felt_at(arm, motion.problem.gravity)[:, where]


def felt_at(arm: ArmSamples, gravity: float) -> Array:
    """Returns the acceleration of the tool centre point against free fall (3, k) [m/s^2], in the world."""
    return arm.a_WT + np.array([[0.0], [0.0], [gravity]])


def _in_tool(X_WL: Array, R_FT: Array, vectors: Array) -> Array:
    """Returns vectors (3, k) of the world in the axes of the tool at link poses (k, 7, 4, 4)."""
    R_WT = (X_WL[:, 6, :3, :3] @ R_FT).transpose(1, 2, 0)
    return np.stack([dot(R_WT[:, c], vectors) for c in range(3)])

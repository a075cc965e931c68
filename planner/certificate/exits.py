"""The ways on which the object leaves the tool, proven to stay in the cone that the gripper opens.

From the release at r on, the object falls freely, while the tool has the acceleration a: s later the object's
displacement in the world from the place in the tool where it was held is

    d(s) = integral of (s - u) (g - a(r + u)) du from 0 to s = w s^2 / 2

so that w(r, s) is the mean of g - a over [r, r + s] with the weights 2 (1 - u / s). Over a time h, a deviates from its
chord by at most e(h) = sup|a''| h^2/8 + c h/4, where c sums the jumps of its slope from tick to tick (`bounds`). So w
deviates from its chord over dr by at most e(dr); over ds by at most sup|a''| ds^2/48 + c ds/12, as the instant at the
share l of the time moves by l ds. A jump J that the whole interval [r, r + s] meets is met at few shares only, which
gives J dr^2 / (3 s) and J ds^2 / (8 s): the smaller bound counts. Turned into the axes of the tool, with a bound U on
|w|, W on the tool's angular velocity and A on its acceleration, w deviates by (A + W^2) U (dr^2 + ds^2) / 8 and by
W sup|a'| (dr^2 + ds^2 / 3) / 4 more.

The object begins with the tool's velocity: that it leaves faster or slower (`release_speed_factor`) is what the opening
gripper makes of it, on the way judged here.

Displacements below 1 mm are ignored: an object that leaves slowly may be anywhere in that play.

A cone of at most a half space is convex: a chord is as deep in it as its shallower end. What lies outside a wider one
is a convex cone: in the direction n from its point nearest to the middle of a cell, w is outside it by at least n . w,
which is linear and least at a corner.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Index, Mask
from planner.certificate.bounds import EVALUATIONS_MAX, ROUNDS, joint_rates
from planner.certificate.flight import Flights
from planner.certificate.samples import ArmSamples
from planner.kinematics import LinkMotion, dot, flange_poses
from planner.native import loops

FREE_M = 0.001  # [m] displacements below this are ignored: chosen, a fraction of the play between object and palm
OUT_MAX_S = 0.5  # [s] after the release: an object that moves with the tool for longer is not proven to leave it
SPARE = 1.1  # [-] share of the time after which the object of the nominal release is out, looked at at once
MORE = 0.5  # [-] share of the time looked at that is looked at next, until the object is out
SPACING_S = 0.008  # [s] of the instants after a release that are looked at first
TICK_ROUNDING = 1e-6  # [ticks] by which whole ticks may exceed their number in floating point
RELEASES_S = 0.004  # [s] between the releases of a spread
# [rad] beyond the widest angle found, of the cones that are tried for a bound.
NARROWER_RAD = (0.01, 0.02, 0.05, 0.1, 0.2)
TINY = 1e-9  # [m/s^2] an acceleration that has no direction


class Cells(NamedTuple):
    """k intervals of releases and of times after them, all of one size, between p points.

    Attributes:
        r, s: releases and times after them at the points (p,) [s].
        corners: points at the beginning and the end of each cell's times, at its first and last release (4, k).
    """

    r: Array
    s: Array
    corners: Index

    @property
    def size(self) -> tuple[float, float]:
        """Lengths of a cell's releases and times [s]."""
        first, later, _, last = self.corners[:, 0]
        return float(self.r[last] - self.r[first]), float(self.s[later] - self.s[first])

    def at(self, corner: int, cell: int) -> float:
        """Returns the time of a corner [s]."""
        point = self.corners[corner, cell]
        return float(self.r[point] + self.s[point])

    def parts(self, chosen: Mask) -> Cells:
        """Returns the parts of the `chosen` ones: halves in time, and of releases where there is more than one."""
        first, _, _, last = self.corners[:, chosen]
        r0 = self.r[first]
        r1 = self.r[last]
        s0 = self.s[first]
        s1 = self.s[last]
        s = 0.5 * (s0 + s1)
        r = 0.5 * (r0 + r1)
        parts = [(r0, r1, s0, s), (r0, r1, s, s1)]
        if (r1 > r0).any():
            parts = [half for _, _, low, high in parts for half in ((r0, r, low, high), (r, r1, low, high))]
        r0, r1, s0, s1 = (np.concatenate(values) for values in zip(*parts, strict=True))
        every = np.arange(4 * len(r0)).reshape(4, -1)
        return Cells(np.concatenate([r0, r0, r1, r1]), np.concatenate([s0, s1, s0, s1]), every)


def cells_between(r: Array, s: Array) -> Cells:
    """Returns the cells between releases (m + 1,) or a single one (1,), and times after each (n + 1,), row by row."""
    rows = max(1, len(r) - 1)
    columns = len(s)
    first = (columns * np.arange(rows)[:, None] + np.arange(columns - 1)).ravel()
    beyond = columns if len(r) > 1 else 0
    return Cells(np.repeat(r, columns), np.tile(s, len(r)), first + np.array([[0], [1], [beyond], [beyond + 1]]))


class Cone(NamedTuple):
    """The cone that the gripper opens in the tool's axes: direction (3,), half angle [rad], begin and end [m]."""

    direction: Array
    half_rad: float
    free_m: float
    out_m: float


class Seen(NamedTuple):
    """Cells evaluated.

    Attributes:
        angle: from the cone's axis at the corners (4, k) [rad]; -inf where the object is out, or still in its place.
        leaving: about the angle at which it gets out between the corners of a release (k,) [rad]; -inf where it does
            not.
        room: how deep the cells are in the cone, at least (k,) [m/s^2]; inf where the object is still in its place.
        is_out: whether the object is out from the beginning of the cells on (k,).
        end_s: ends of the cells at their last release (k,) [s].
    """

    angle: Array
    leaving: Array
    room: Array
    is_out: Mask
    end_s: Array

    @property
    def is_undecided(self) -> Mask:
        """Whether the object may be outside the cone before it is out (k,)."""
        return ~((self.room >= 0.0) | self.is_out)


class WayBounds(NamedTuple):
    """Bounds on the motion of the tool while the object leaves it.

    Attributes:
        sums: of the jumps of the slope of a at the ticks before each, and at all of them (n + 1,) [m/s^3].
        rate_hz: ticks a second.
        snap: sup |a''| between ticks [m/s^4].
        jerk: sup |a'| [m/s^3].
        most: U, sup |w| [m/s^2].
        turn: W, of the tool's angular velocity [rad/s].
        turning: A + W^2 [rad/s^2].
    """

    sums: Array
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
        share = float(self.sums[-1]) / np.maximum(s0, TINY)
        along_r = np.minimum(self._jumps_within(dr) * dr / 4.0, share * (dr * dr / 3.0))
        return smooth + along_r + np.minimum(self._jumps_within(ds) * ds / 12.0, share * (ds * ds / 8.0))

    def _jumps_within(self, h: float) -> float:
        """Returns the largest sum of the jumps inside a time `h` [m/s^3]."""
        ticks = min(len(self.sums) - 1, math.ceil(h * self.rate_hz - TICK_ROUNDING))
        return float((self.sums[ticks:] - self.sums[:-ticks]).max()) if ticks > 0 else 0.0


class Exits:
    """The ways on which the object leaves the tool, and how deep they are in a cone.

    Attributes:
        flights: the flights.
        cone: the cone; it ends where the object is out.
    """

    def __init__(self, flights: Flights, direction: Array, cone_rad: float) -> None:
        """Takes the flights, the axis of the cone (3,) in the tool frame and its half angle [rad]."""
        out_m = flights.motion.problem.cell.object.way_out_m
        self.flights, self.cone = flights, Cone(direction, cone_rad, FREE_M, out_m)

    def widest(self) -> tuple[float, float, bool]:
        """Returns the widest angle found [rad], its time [s], and whether the cone is proven to contain all ways."""
        widest = -math.inf
        at_s = self.flights.released_s
        spent = 0
        first = self._first_cells()
        if first is None:
            return math.nan, at_s, False
        cells, seen, bounds = first
        for _ in range(ROUNDS):
            corner, cell = np.unravel_index(int(seen.angle.argmax()), seen.angle.shape)
            if seen.angle[corner, cell] > widest:
                widest = float(seen.angle[corner, cell])
                at_s = cells.at(int(corner), int(cell))
            leaving = int(seen.leaving.argmax())
            undecided = seen.is_undecided
            spent += len(undecided)
            if widest > self.cone.half_rad:
                return widest, at_s, False
            if seen.leaving[leaving] > widest:  # interpolated: no proof that the cone is left
                widest = min(float(seen.leaving[leaving]), self.cone.half_rad)
                at_s = float(seen.end_s[leaving])
            if not undecided.any() or spent > EVALUATIONS_MAX:
                return widest, at_s, not undecided.any()
            cells = cells.parts(undecided)
            seen = self._evaluate(cells, bounds)
        return widest, at_s, False

    def bound(self, widest: float) -> float:
        """Returns an angle that no way exceeds [rad], where this cone is proven to contain them all.

        Narrower cones are tried, each a little wider than the widest angle that is known.
        """
        for beyond in NARROWER_RAD:
            half_rad = widest + beyond
            if half_rad >= self.cone.half_rad:
                break
            found, _, proven = Exits(self.flights, self.cone.direction, half_rad).widest()
            if proven:
                return half_rad
            widest = max(widest, found)
        return self.cone.half_rad

    def _first_cells(self) -> tuple[Cells, Seen, WayBounds] | None:
        """Returns the cells until the object is out, evaluated, and bounds up to their end; None if it stays."""
        begin = 0.0
        length = self._first_length()
        blocks = []
        spread = self.flights.spread_s
        released = self.flights.released_s
        r = released + np.linspace(-spread, spread, 1 + math.ceil(2.0 * spread / RELEASES_S))
        while True:
            bounds = self._bounds(begin + length)
            cells = cells_between(r, np.linspace(begin, begin + length, 1 + round(length / SPACING_S)))
            seen = self._evaluate(cells, bounds)
            is_out = np.logical_or.accumulate(seen.is_out.reshape(max(1, len(r) - 1), -1), axis=1)
            on_way = ~is_out.ravel()
            blocks.append((cells._replace(corners=cells.corners[:, on_way]), Seen._make(v[..., on_way] for v in seen)))
            begin = begin + length
            length = SPACING_S * math.ceil(MORE * length / SPACING_S - TICK_ROUNDING)
            if is_out[:, -1].all():
                break
            if begin > OUT_MAX_S:
                return None
        return *_joined(blocks), bounds

    def _first_length(self) -> float:
        """Returns a time in which the object should be out, a multiple of `SPACING_S` [s]."""
        k = self.flights.motion.release_knot
        motion = self.flights.motion
        arm = motion.at_knots
        s = motion.at_knots.t[k + 1 :] - motion.at_knots.t[k]
        fallen = self.flights.flown_on_grid(arm.p_WT[:, k, None], arm.v_WT[:, k, None], s[None])[:, 0]
        apart = fallen - arm.p_WT[:, k + 1 :]
        moved = np.sqrt(dot(apart, apart))
        out = np.flatnonzero(moved >= self.cone.out_m)
        if len(out) > 0:  # the displacement grows about like the square of the time
            out_s = float(s[out[0]] * math.sqrt(self.cone.out_m / moved[out[0]]))
        else:
            out_s = s.max(initial=0.0) + math.sqrt(2.0 * self.cone.out_m / motion.problem.gravity)
        return SPACING_S * (2 + math.ceil(SPARE * out_s / SPACING_S))

    def _bounds(self, until_s: float) -> WayBounds:
        """Returns bounds from the beginning of the spread until `until_s` after its end."""
        motion = self.flights.motion
        rate = motion.trajectory.sample_rate_hz
        trajectory = motion.trajectory
        last = len(trajectory.q) - 1
        lever = motion.body.tool_lever
        first = min(round(motion.gone_from_s * rate), last - 1)
        end = max(min(last, math.ceil((motion.held_until_s + until_s) * rate)), first + 1)
        rates = joint_rates(trajectory, np.array([first, end]))
        speed, felt, jerk, snap = (lever @ rates.by_derivative)[:, 0].tolist()
        most = felt + motion.problem.gravity
        drag = motion.problem.drag
        speed += motion.problem.gravity * until_s
        snap += 2.0 * drag * ((most + drag * speed**2) ** 2 + speed * (jerk + 2.0 * drag * speed * most))
        w, a = rates.sums[:2, -1, 0].tolist()
        # Along the releases of a spread jumps count three times as much as along the time: there they are exact.
        exact = self.flights.spread_s > 0.0
        jumps = self._jumps(max(first, 1), end) if exact else self._most_jumps(max(first, 1), end)
        sums = np.concatenate([[0.0], np.cumsum(jumps)])
        return WayBounds(sums, rate, snap, jerk, most, w, a + w * w)

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
        trajectory = self.flights.motion.trajectory
        motion = self.flights.motion
        changes = self._jerk_changes(first, end)
        turned = LinkMotion(motion.body.link_poses(trajectory.q[first : end + 1]), changes, changes)
        jumps = turned.velocity(turned.on_flange(motion.problem.cell.tool.X_FT[:3, 3]))
        return np.sqrt(dot(jumps, jumps))

    def _evaluate(self, cells: Cells, bounds: WayBounds) -> Seen:
        """Returns what is known of cells."""
        w = self._ways(cells.r, cells.s)
        s0 = cells.s[cells.corners[0]]
        rows = loops.exit_cells(w, cells.s, cells.corners, bounds.deviation(*cells.size, s0), self.cone)
        last = cells.corners[3]
        return Seen(rows[:4], rows[4], rows[5], rows[6] > 0.0, cells.r[last] + cells.s[last])

    def _ways(self, r: Array, s: Array) -> Array:
        """Returns w in the tool frame (3, p) [m/s^2], `s` [s] after releases at `r` [s]."""
        motion = self.flights.motion
        arm, release = self._releases(r)
        cell = motion.problem.cell
        X_WF = flange_poses(cell.robot, motion.trajectory.at(r + s)[0], cell.X_WB)
        fallen = self.flights.flown(arm.p_WT[:, release], arm.v_WT[:, release], s)
        return loops.ways(X_WF, cell.tool.X_FT, fallen, s, arm.felt[:, release])

    def _releases(self, r: Array) -> tuple[ArmSamples, Index]:
        """Returns the arm at releases (k,), and which of its instants each is."""
        motion = self.flights.motion
        if self.flights.spread_s == 0.0:
            return motion.at_knots, np.full(len(r), motion.release_knot)
        instants, where = np.unique(r, return_inverse=True)
        return motion.at(instants), where


def _joined(blocks: list[tuple[Cells, Seen]]) -> tuple[Cells, Seen]:
    """Returns blocks of cells as one."""
    if len(blocks) == 1:
        return blocks[0]
    cells, seen = zip(*blocks, strict=True)
    begins = np.cumsum([0, *(len(block.r) for block in cells[:-1])])
    corners = np.concatenate([block.corners + begin for block, begin in zip(cells, begins, strict=True)], axis=1)
    r, s = (np.concatenate([getattr(block, name) for block in cells]) for name in "rs")
    return Cells(r, s, corners), Seen._make(np.concatenate(values, axis=-1) for values in zip(*seen, strict=True))

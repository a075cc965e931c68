"""Bounds on the variables and rows of one instance."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from planner.backends.casadi_nlp.layout import (
    JERK,
    NX,
    NZ,
    OUT_STAGES,
    QD,
    QDD,
    STEP,
    TIME,
    WATCHED_AFTER,
    Q,
    Vector,
)
from planner.backends.casadi_nlp.release_rows import FALL_MIN, ROUNDING, release_bounds
from planner.backends.casadi_nlp.symbols import FLIGHT_ROWS, LEAVING_ROWS, RELEASE_ROWS
from planner.backends.casadi_nlp.transcription import Indices, RowIndex
from planner.backends.casadi_nlp.tuning import LONGEST_STEP, SHORTEST_STEP, TOUCHING
from planner.cell import Limits
from planner.problem import ThrowProblem
from planner.seeds import Candidate

WATCHED_S = 0.05  # [s] before and after the release that the certificate checks, in whole ticks
WATCHED_BEYOND_S = 0.002  # [s] by which the watched stages last longer
SHORTENED = 2.0  # [-] times as long as its solution an initial guess mostly is at most
DRIFT_SHARE = 2.0  # [-] of tolerance over window, for the rate of change of the landing with the release time

MIDDLE_VELOCITY = slice(NX, NX + 6)
MIDDLE_POSITION = slice(NX + 6, NX + 12)  # rows of block "motion"
TOOL_SPEED = slice(6, 7)  # rows of block "effort"


def watched_stages(steps: Vector, window: int, watched_s: float) -> int:
    """Returns on how many stages before the release singularities are avoided; on all of a short launch.

    If fewer were watched there, they alone would have to last `watched_s`, and so delay the release.

    Args:
        steps: lengths of the launch's stages in the initial guess [s].
        window: the last of these, within the release window.
        watched_s: how long to avoid singularities.
    """
    lasting = np.cumsum(steps[::-1])[window:]
    return min(1 + int(np.searchsorted(lasting, SHORTENED * watched_s)), len(lasting))


def watched_time(window_s: float, dt: float) -> float:
    """Returns how long to avoid singularities before the release, and after it [s]: as long as the certificate watches.

    Args:
        window_s: half of the release window [s].
        dt: one tick [s].
    """
    return max(dt * math.ceil(WATCHED_S / dt - ROUNDING) + WATCHED_BEYOND_S, window_s)


class Bounds:
    """Lower and upper bounds, narrowed step by step; at first only the dynamics are held.

    Attributes:
        x: of the variables (2, N + 1, NZ), in SI units; the last stage is padded with a control.
        g: of the rows (2, rows).
        qd_scale: of the joint velocities in the rows of block "motion" (6,) [rad/s].
    """

    def __init__(self, index: RowIndex, qd_scale: Vector) -> None:
        self.launch = index.stages.launch
        self.index = index
        self.qd_scale = qd_scale
        infinite = np.array([-np.inf, np.inf])
        self.x = np.tile(infinite[:, None, None], (1, len(index.dynamics) + 1, NZ))
        self.g = np.tile(infinite[:, None], (1, index.size))
        self.g[:, np.concatenate(index.dynamics)] = 0.0

    def limit_joints(self, limits: Limits, margin: float, given: Sequence[Vector]) -> None:
        """Bounds joint position, velocity, acceleration and jerk, at the knots and between them.

        Args:
            limits: of the joints.
            margin: distance from the position limits [rad].
            given: joint positions (6,) that the problem fixes; the range always includes them [rad].
        """
        x = self.x
        lower = np.min([limits.q_lower + margin, *given], axis=0)
        upper = np.max([limits.q_upper - margin, *given], axis=0)
        x[0, :, Q] = lower
        x[1, :, Q] = upper
        for rows, limit in ((QD, limits.qd_max), (QDD, limits.qdd_max), (JERK, limits.jerk_max)):
            x[0, :, rows] = -limit
            x[1, :, rows] = limit
        rows = self._rows_by_knot("motion")
        scaled = limits.qd_max / self.qd_scale
        middle = rows[:, MIDDLE_POSITION]
        velocity = rows[:, MIDDLE_VELOCITY]
        self.g[0, velocity] = -scaled
        self.g[1, velocity] = scaled
        self.g[0, middle] = lower
        self.g[1, middle] = upper

    def limit_group(self, group: str, lower: Vector, upper: Vector) -> None:
        """Bounds the rows of a lazy group, at knots and midpoints."""
        rows = self.index.rows_of_group[group].reshape(-1, len(lower))
        self.g[0, rows] = lower
        self.g[1, rows] = upper

    def free_flights_after_release(self, leaving: bool) -> None:
        """Frees block "flight" on the stages after the release, but for the gripper's opening where asked for.

        The object's whole way out is looked at from the last release alone: stages within the window are shorter.
        """
        for k in self.index.knots.get("flight", ()):
            rows = self.index.rows["flight", k]
            last = self.launch + self.index.stages.window
            if k > last:
                self._free(np.delete(rows, FLIGHT_ROWS.slices["opening"]) if leaving else rows)
            elif k < last:
                self._free(rows[FLIGHT_ROWS.slices["out"]])

    def ease_beside_given(self, group: str, given: Vector) -> None:
        """Holds the rows next to a state that is given to no more clearance than that has.

        The optimiser's distances are smaller than the true ones, and the margins are taken off: without this a start
        close to something could not be left.

        Args:
            group: a lazy group of clearances.
            given: its rows at the start, and at the release where that is given, too (k, n) [m].
        """
        for stage, clearance in zip((0, self.launch), given, strict=False):
            middle = f"{group}_middle"
            beside = {(group, stage - 1), (middle, stage - 1), (middle, stage), (group, stage + 1)}
            for place in beside & self.index.rows.keys():
                rows = self.index.rows[place]
                self.g[0, rows] = np.minimum(self.g[0, rows], clearance)

    def avoid_singularities(self, signed: Vector, distance: float) -> None:
        """Keeps the arm `distance` from the singularities around the release, on the side given by `signed` (3,)."""
        positive = signed > 0.0
        for name in ("singularity", "singularity_middle"):
            rows = self._rows_by_knot(name)
            self.g[0, rows] = np.where(positive, distance, -np.inf)
            self.g[1, rows] = np.where(positive, np.inf, -distance)

    def fix_ends(self, q: Vector, qd: Vector, qdd: Vector) -> None:
        """Fixes the start's state, each (6,) [rad, rad/s, rad/s^2], the end at rest, and the release's time, 0."""
        x = self.x
        x[:, 0, Q] = q
        x[:, 0, QD] = qd
        x[:, 0, QDD] = qdd
        x[:, self.launch, TIME] = 0.0
        x[:, -1, QD] = 0.0
        x[:, -1, QDD] = 0.0
        x[0, -1, NX:] = -np.inf
        x[1, -1, NX:] = np.inf

    def limit_steps(self, steps: Vector) -> None:
        """Bounds each step around its initial length (N,) [s]."""
        self.x[0, :-1, STEP] = SHORTEST_STEP * steps
        self.x[1, :-1, STEP] = LONGEST_STEP * steps

    def follow_object(self, leaving_s: float) -> None:
        """Frees what block "flight" says of the object's way out, where block "leaving" follows it.

        The object is that of the nominal release: the directions in which it begins to leave within a window still
        count. The window's stages are short: what is followed counts at their ends. After the stages that follow, the
        object is out; they are kept short, lest it leaves the opening between two rows.

        Args:
            leaving_s: the time after which the object is out [s].
        """
        last = self.launch + self.index.stages.window
        end = self.index.knots["leaving"].stop
        ways = LEAVING_ROWS.slices["ways"]
        is_out = LEAVING_ROWS.slices["is_out"]
        for k in self.index.knots["leaving"]:
            rows = self.index.rows["leaving", k]
            if k < last:
                self._free(rows[ways][:-1])
            if k < end - 1:
                self._free(rows[is_out])
        followed = slice(last, end)
        self.x[1, followed, STEP] = np.maximum(leaving_s / OUT_STAGES, self.x[0, followed, STEP])
        for k in self.index.knots.get("flight", ()):
            self._free(self.index.rows["flight", k][FLIGHT_ROWS.slices["out"]])

    def watch_long_enough(self, watched_s: float) -> None:
        """Lets the watched stages last, in sum, as long as the certificate watches; the window is part of that.

        Where a singularity is in the way, they would shrink until hardly anything is watched.

        Args:
            watched_s: how long that is [s].
        """
        n = self.index.stages.window
        first = self.launch - n - self.index.stages.watched
        last = self.launch + n + WATCHED_AFTER
        if first > 0:
            self.x[1, first, TIME] = -min(watched_s, self._longest(first, self.launch))
        if last < self.index.stages.stages:
            self.x[0, last, TIME] = min(watched_s, self._longest(self.launch, last))

    def _longest(self, first: int, last: int) -> float:
        """Returns how long stages may be asked to last in sum [s]: nine tenths of what their steps may last."""
        return 0.9 * float(self.x[1, first:last, STEP].sum())

    def fix_times(self, start_s: float, end_s: float) -> None:
        """Fixes the times of the start and of the end, the release being at 0."""
        self.x[:, 0, TIME] = start_s
        self.x[:, -1, TIME] = end_s

    def set_release(self, problem: ThrowProblem, candidate: Candidate, offsets: Vector | float) -> None:
        """Bounds the release as requested: the candidate's joint state where that is given, or rows, with `offsets`."""
        if problem.fixes_joints:
            self._fix_release_state(candidate.q, candidate.qd)
        else:
            asked = release_bounds(problem)
            self.g[:, self.index.rows["release", self.launch]] = asked + offsets
            if np.ptp(asked[:, RELEASE_ROWS.slices["velocity"]], axis=0).max() == 0.0:
                self._free_release_tool_speed()
        if problem.ends_at_rest:
            self.x[:, self.launch, QD] = 0.0
            self.x[:, self.launch, QDD] = 0.0

    def _fix_release_state(self, q: Vector, qd: Vector) -> None:
        """Fixes joint positions and velocities at the release; its acceleration stays free within its limits.

        Rows that depend on these alone are freed: no variable is left to satisfy them, and the certificate checks them.

        A joint released at its velocity limit can only have zero acceleration there: more would exceed the limit just
        after the release, less just before it. Two touching inequalities leave an interior-point method no interior,
        so this is stated as an equality, and the inequalities that it implies are freed.
        """
        k = self.launch
        index = self.index
        limit = self.g[1, index.rows["motion", k - 1][MIDDLE_VELOCITY]] * self.qd_scale
        reached = np.abs(qd) >= (1.0 - TOUCHING) * limit
        for stage in {k - 1, k} & set(index.knots["motion"]):
            self._free(index.rows["motion", stage][MIDDLE_VELOCITY][reached])
        self.x[:, k, QDD][:, reached] = 0.0
        self.x[:, k, Q] = q
        self.x[:, k, QD] = qd
        self._free_release_tool_speed()
        for name in ("clearance", "keep_out", "rooms", "singularity"):
            if (name, k) in index.rows:
                self._free(index.rows[name, k])

    def hold_window(self, window_s: float, tolerance_m: float, share: float, offsets: Vector | float) -> None:
        """Bounds the landings of releases at the window's knots, and the drift of the landing at the release itself.

        Args:
            window_s: half the length of the release window.
            tolerance_m: of the landing.
            share: usable share of the tolerance, in x and in y [-].
            offsets: added to the landing error at each knot of the window (2 n + 1, 2) [m].
        """
        n = self.index.stages.window
        k = self.launch
        error = share * tolerance_m
        offsets = np.broadcast_to(offsets, (2 * n + 1, 2))
        for knot in (o for o in range(-n, n + 1) if o):
            rows = self._release_rows("landing", knot)
            self.g[0, rows] = -error - offsets[n + knot]
            self.g[1, rows] = error - offsets[n + knot]
            self.g[0, self._release_rows("falls", knot)] = FALL_MIN
        rows = self._release_rows("drift")
        drift = DRIFT_SHARE * tolerance_m / window_s
        self.g[0, rows] = -drift
        self.g[1, rows] = drift
        self.x[:, k - n : k + n, STEP] = window_s / n

    def _rows_by_knot(self, block: str) -> Indices:
        """Returns the rows (knots, n) of a block."""
        return self.index.rows_of[block].reshape(len(self.index.knots[block]), -1)

    def _release_rows(self, name: str, knot: int = 0) -> Indices:
        """Returns the problem's rows of one entry of `RELEASE_ROWS`, `knot` knots from the release."""
        return self.index.rows["release", self.launch + knot][RELEASE_ROWS.slices[name]]

    def _free_release_tool_speed(self) -> None:
        """Frees the tool speed at the release, where the request fixes it."""
        if ("effort", self.launch) in self.index.rows:
            self._free(self.index.rows["effort", self.launch][TOOL_SPEED])

    def _free(self, rows: Indices) -> None:
        self.g[0, rows] = -np.inf
        self.g[1, rows] = np.inf

"""When a body that is no ball has landed, for every release of the spread, and whether it lands on what it is to."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Mask
from planner.certificate.samples import MotionSamples
from planner.certificate.touchdown import CellProof, LandingCells, Spans, hull_places, prove, touchdowns_of
from planner.spin import Rotation
from planner.touchdown import TOUCH_M, Touchdowns

EDGE = "the edge of what it is to land on"
FLOOR = "floor"
UNKNOWN = "an unknown landing"
NEVER = "never lands"
UNBOUNDED_M = 100.0  # [m] stands for the room on a floor, which has no edge
ROUNDING_S = 1e-12  # [s] by which neighbouring cells may seem to overlap


class LandedSpans(NamedTuple):
    """Of k intervals of releases: as `Spans` (k,) [s], or (k, 1)."""

    earliest_s: Array
    latest_s: Array
    falling_s: Array

    def in_rows(self) -> LandedSpans:
        """Returns the same as rows (k, 1), for patches of each interval at several times."""
        return LandedSpans._make(each[:, None] for each in self)

    def is_over(self, carries: Mask, t0: Array, t1: Array) -> Mask:
        """Returns which of the patches (k,) no longer count, for intervals of time (k,); of rows (items, k, n), (n,).

        Of what the body lands on, (k,) or (items, 1, 1), those that reach beyond a landing: until then all of it is
        above that.
        """
        falls = (t0 >= self.falling_s) | (t0 >= self.earliest_s)
        return np.where(carries, (t1 > self.earliest_s) & falls, t0 >= self.latest_s)


class BodyLandings:
    """Landings of the body of a motion after any release of the spread.

    Attributes:
        thing: the body.
        missed: by how much one of them touches the floor, or the edge of what it is to land on [m], its release [s]
            and what is in the way; None where all are proven to land.
    """

    def __init__(self, motion: MotionSamples, spread_s: float) -> None:
        """Takes a motion, and the largest deviation of the release [s]."""
        problem = motion.problem
        assert problem.body is not None
        self.thing = problem.body
        self._motion = motion
        self._released_s = motion.trajectory.release_time_s
        proof, found = prove(motion, spread_s, self._left, np.inf)
        self.missed = self._told(proof)
        every = Spans._make(np.concatenate(each) for each in zip(*found, strict=True)) if found else None
        if self.missed is None and every is not None:
            order = np.argsort(every.at_s)
            self._spans = Spans._make(each[order] for each in every)

    def _left(self, cells: LandingCells) -> tuple[Array, Array]:
        """Returns how far within what it lands on, and above the floor, the body of each cell is (n,), see `prove`."""
        left = np.minimum(self._inside(cells.touchdowns), cells.floor_gap_m)
        off = cells.aside_m + self.thing.reach_m * cells.turned_rad
        return left, np.where(cells.floor_s >= cells.latest_s, off, np.inf)

    def _inside(self, landings: Touchdowns) -> Array:
        """Returns how far within what they land on bodies are (n,) [m], with all of their hull; NaN: they never land.

        Where there is no edge, `UNBOUNDED_M`.
        """
        problem = self._motion.problem
        inside = np.full(len(landings.time_s), UNBOUNDED_M)
        if not landings.is_in_air:
            places = np.moveaxis(hull_places(landings), -1, 0)
            room = [surface.depth(places) for surface in problem.surfaces]
            if problem.target is not None and problem.opening is not None:
                aside = places[:2] - problem.target.p_W[:2, None, None]
                room = [problem.opening.radius_m - np.hypot(*aside)]
            each = np.min(room, axis=1) - self.thing.radius_m  # of every surface, by the ball that is least within it
            inside = np.minimum(np.max(each, axis=0), UNBOUNDED_M)
        return np.where(np.isnan(landings.time_s), np.nan, inside)

    def _told(self, proof: CellProof) -> tuple[float, float, str] | None:
        """Returns what `missed` tells of a proof."""
        if np.isnan(proof.value):
            return np.nan, proof.at_s, NEVER
        if proof.value < 0.0:
            return proof.value, proof.at_s, EDGE if self._least_inside(proof) <= proof.value + TOUCH_M else FLOOR
        return None if proof.proven else (-TOUCH_M, proof.at_s, UNKNOWN)

    def _least_inside(self, proof: CellProof) -> float:
        """Returns how far within what it lands on the body is whose release a proof names [m]."""
        at = self._motion.at(np.array([proof.at_s]))
        return float(self._inside(touchdowns_of(self._motion.problem, at))[0])

    @cached_property
    def end(self) -> tuple[float, float] | None:
        """Height of the landing plane [m], and time of the nominal landing [s]; None: it never lands."""
        at = self._motion.at(np.array([self._released_s]))
        time_s = float(touchdowns_of(self._motion.problem, at).time_s[0])
        return None if np.isnan(time_s) else (self._motion.problem.plane_z, self._released_s + time_s)

    @property
    def last_s(self) -> float:
        """Time by which the last release has landed [s]."""
        return float(self._spans.latest_s.max())

    def spans(self, r0: Array, r1: Array) -> LandedSpans:
        """Returns when the releases of intervals (k,) [s] land: over all cells that reach into each."""
        begin = self._spans.at_s - self._spans.half_s
        pairs, which = np.unique(np.stack([r0, r1]), axis=1, return_inverse=True)
        first = np.clip(np.searchsorted(begin, pairs[0] + ROUNDING_S, side="right") - 1, 0, None)
        last = np.maximum(np.searchsorted(begin, pairs[1] - ROUNDING_S, side="left"), first + 1)
        rows = [slice(int(low), int(high)) for low, high in zip(first, last, strict=True)]
        earliest = np.array([self._spans.earliest_s[each].min() for each in rows])
        latest = np.array([self._spans.latest_s[each].max() for each in rows])
        falling = np.array([self._spans.falling_s[each].max() for each in rows])
        which = which.ravel()
        return LandedSpans(earliest[which], latest[which], falling[which])

    def axes(self, r: Array, t: Array) -> Array:
        """Returns the body's axes in the world (k, 3, 3) at times t (k,) after releases at r (k,) [s]."""
        distinct, where = np.unique(r, return_inverse=True)
        leaving = touchdowns_of(self._motion.problem, self._motion.at(distinct)).leaving
        until_s = float((t - r).max(initial=0.0))
        rotation = Rotation(leaving.R_WO, leaving.w_W, self.thing.inertia_kg_m2, until_s)
        return rotation.axes(where.ravel(), t - r)

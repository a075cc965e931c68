"""Checks of where the object lands: on its target after the nominal release, near it after those in the window."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from planner.cell import Cell, ThrownBody
from verifier.aims import BEFORE_S, Aim
from verifier.drag import releases_of
from verifier.finding import Finding, Status, judged, not_covered
from verifier.flights import OutsideMotion, Releases, release_pieces
from verifier.plan_document import Demands, SampledMotion

LANDING_M = 6e-4  # [m] of the nominal landing: what a bouncing ball, or a camera, tells of it is ten times coarser
START_S = 1e-6  # [s] of a clock: rounding
SHARE = 1e-6  # [-] of a limit
HALVINGS = 6  # [-] of a piece of releases


def met_demands(cell: Cell, motion: SampledMotion, demands: Demands) -> Demands:
    """Returns demands whose target, if it moves, is where it is about the time at which the object lands."""
    if demands.aim is None or not demands.aim.moves or motion.release is None:
        return demands
    flown_s = float(releases_of(cell, release_pieces(motion, 0.0)).falls_to(float(demands.aim.p_W[2])).c0[0])
    lands_s = motion.release / motion.rate_hz + (flown_s if math.isfinite(flown_s) else 0.0)
    return replace(demands, aim=demands.aim.met_at(lands_s))


def landing_findings(cell: Cell, motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Returns the findings about the landing of the nominal release, and of those in the window."""
    aim = demands.aim
    if not demands.throws or aim is None or isinstance(cell.object, ThrownBody):
        return
    yield _landing("landing", releases_of(cell, release_pieces(motion, 0.0)), aim, LANDING_M)
    if aim.moves:
        yield from _in_time(motion, aim)
    if aim.is_robust:
        try:
            window = release_pieces(motion, aim.window_s)
        except OutsideMotion as error:
            yield not_covered("landing_window", str(error))
            return
        # Where a moving target is off by its slack, the landing is.
        allowed = aim.tolerance_m * (1.0 + SHARE) - aim.slack_m
        yield _landing("landing_window", releases_of(cell, window), aim, max(allowed, 0.0))


def _in_time(motion: SampledMotion, aim: Aim) -> Iterator[Finding]:
    """Returns the findings about a motion that is to be over while the arm keeps out of the way of a moving target."""
    ends_s = (len(motion.q) - 1) / motion.rate_hz
    before_s = BEFORE_S - aim.met_s
    after_s = aim.after_s - (ends_s - aim.met_s)
    yield judged("start", aim.waits_s + START_S, aim.waits_s + START_S, 0.0, "time after the earliest start")
    yield judged("landing", before_s, before_s, aim.met_s, "time from the start to the landing")
    yield judged("landing", after_s, after_s, ends_s, "time from the landing to the end")


def _landing(name: str, releases: Releases, aim: Aim, allowed: float) -> Finding:
    """Returns whether all flights come down through the target's height within a distance of it [m]."""
    for turn in range(HALVINGS + 1):
        z = float(aim.p_W[2])
        lands = aim.beside(releases.falls_through(z), releases.pieces.times + releases.falls_to(z))
        off = lands - aim.p_W[:, None]
        missed = off[0] * off[0] + off[1] * off[1]
        lower, upper = allowed**2 - missed.upper, allowed**2 - missed.lower
        at_s = releases.pieces.middle_s
        if (broken := np.flatnonzero(upper < 0.0)).size:
            by = math.sqrt(float(missed.lower[broken[0]]))
            return Finding(name, Status.VIOLATED, float(at_s[broken[0]]), f"lands {by:.5f} m off at least")
        is_open = ~(lower >= 0.0)
        if not is_open.any():
            return Finding(name, Status.PROVEN, None, _aimed(aim))
        if turn == HALVINGS:
            first = int(np.flatnonzero(is_open)[0])
            return Finding(name, Status.NOT_PROVEN, float(at_s[first]), "lands off the target, or never")
        releases = releases.of(releases.pieces.chosen(is_open).halves())
    raise AssertionError("the last turn returns")


def _aimed(aim: Aim) -> str:
    """Returns how far from the target a flight is aimed, if it is."""
    return f"aimed {np.linalg.norm(aim.shift):.4f} m beside the target" if aim.shift.any() else ""

"""Checks of a body that is no ball: its flight until it touches what it is to land on, and how it lands there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from planner.cell import Cell, Solid, ThrownBody, shape_of
from verifier.aims import Aim
from verifier.arm import ArmPieces
from verifier.arm_in_flight import ArmAfter, CapsuleWatch, accelerations
from verifier.bodies import BallReleases, lowest_in, may_touch
from verifier.capsules import MovingCapsule, capsules_of
from verifier.clearance_checks import LENGTH_M
from verifier.drag import releases_of
from verifier.elementary import Array
from verifier.finding import Finding, Status, not_covered
from verifier.flight_checks import GRIPPED_FRAMES, LOW_M, NAME, apart, beside_base, depth_within, wall_rooms
from verifier.flights import (
    FlightPatches,
    OutsideMotion,
    PatchRooms,
    first_patches,
    prove_patches,
    release_pieces,
)
from verifier.landing_checks import LANDING_M, SHARE
from verifier.landing_place import LandingPlace, landing_place
from verifier.pieces import Pieces, all_pieces, instant
from verifier.plan_document import Demands, SampledMotion
from verifier.solids import nearest_on_segments, out_of_solid
from verifier.taylor import dot

DEEPER_M = 1e-4  # [m] that a body may get deeper into what its hull touches in the grip: play of the parts of a hand
ANGLE = 1e-6  # [rad] of an angle asked for: far below what a landing shows
UP = 1.0 + 1e-12


def body_findings(cell: Cell, motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Returns the findings about flight and landing of a body; none of a ball."""
    thing = cell.object
    if not demands.throws or not isinstance(thing, ThrownBody) or NAME in demands.not_covered:
        return
    place = landing_place(cell, demands)
    try:
        spread = _ball(cell, release_pieces(motion, demands.spread_s), place, demands)
    except OutsideMotion as error:
        yield not_covered(NAME, str(error))
        return
    lasts_s = _lasts(spread)
    if lasts_s is None or not place.fits:
        yield Finding(NAME, Status.NOT_PROVEN, None, "may never come down to where it lands, or does not fit there")
        return
    yield from _flown(cell, motion, demands, spread, place, lasts_s)
    yield from _arm_findings(cell, motion, spread, place, lasts_s)
    if demands.aim is not None:
        yield from _landings(cell, motion, demands, place, spread)


def _ball(cell: Cell, pieces: Pieces, place: LandingPlace, demands: Demands) -> BallReleases:
    """Returns the releases of a body, by its middle ball."""
    is_in_bin = demands.aim is not None and demands.aim.bin is not None
    height = place.plane_z if is_in_bin or place.height_m is None else place.height_m
    centre = releases_of(cell, pieces)
    return BallReleases(cell, pieces, 1, centre, 0.0, height, place.height_m is None and not is_in_bin)


def _lasts(releases: BallReleases) -> float | None:
    """Returns how long after its release a body has touched, at most [s]: its lowest point is below its centre."""
    lasts = releases.centre.falls_to(releases.height_m - LOW_M).upper
    return float(lasts.max()) if np.isfinite(lasts).all() else None


def _of_balls(releases: BallReleases, rooms: Callable[[FlightPatches], Array]) -> PatchRooms:
    """Returns the least rooms of the balls of a hull, each given its patches: of all that count."""

    def least(patches: FlightPatches) -> tuple[Array, Array]:
        body = patches.releases
        assert isinstance(body, BallReleases)
        found = np.full(len(patches.rows), np.inf)
        for place_m in body.thing.balls_m:
            found = np.minimum(found, rooms(FlightPatches(body.ball(place_m), patches.rows, patches.s0, patches.s1)))
        counts = body.counts(patches, 0.0)
        return np.where(counts, found, np.inf)[None], np.full((1, len(found)), np.inf)

    return least


def _flown(
    cell: Cell, motion: SampledMotion, demands: Demands, spread: BallReleases, place: LandingPlace, lasts_s: float
) -> Iterator[Finding]:
    """Returns the findings about a flight among floor, solids and a bin's wall, and about the edge of its landing."""
    patches = first_patches(spread, lasts_s)
    radius = cell.object.radius_m
    yield prove_patches(NAME, patches, _above(cell), ["the floor", "above what it is to land on, as it begins to fall"])
    for k, (solid, name) in enumerate(zip(cell.surroundings.keep_out, cell.surroundings.keep_out_names, strict=True)):
        required = float(place.clearances[k]) - LENGTH_M
        yield prove_patches(NAME, patches, _solid(spread, solid, required, bool(place.carries[k])), [name])
    aim = demands.aim
    if aim is not None and aim.bin is not None:
        wall = wall_rooms(cell, aim, is_until_inside=False)
        yield prove_patches(NAME, patches, _of_balls(spread, lambda ball: wall(ball)[0][0]), ["the bin's wall"])
        inside = _in_bin(aim, radius)
    elif place.tops:
        inside = _of_tops(place, radius)
    else:
        return
    yield prove_patches(NAME, patches, _touching(inside), ["the edge of what it is to land on"])


def _above(cell: Cell) -> PatchRooms:
    """Returns how far a body is above the floor until it lands, and above what it lands on as it begins to fall."""
    floor = cell.surroundings.floor_z_m

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        body = patches.releases
        assert isinstance(body, BallReleases)
        counts = body.counts(patches, 0.0)
        on_floor = not body.is_in_air and body.height_m <= floor
        low = lowest_in(patches, of_body=True) - floor + LENGTH_M
        low = np.where(counts & ~(patches.falls & on_floor), low, np.inf)
        first = np.where(patches.s0 == 0.0, body.lowest(patches.rows, patches.s0)[0], np.inf)
        apex = np.where(patches.falls, first, lowest_in(patches))
        apex = np.where(patches.rises, np.inf, apex - body.height_m + LENGTH_M)
        return np.array([low, apex]), np.full((2, len(low)), np.inf)

    return rooms


def _solid(releases: BallReleases, solid: Solid, required: float, carries: bool) -> PatchRooms:
    """Returns what a body is farther from a solid than it must be: by its hull, or by its lowest point above it.

    While it falls, all of it is above what it lands on until it touches that.
    """
    thing = releases.thing
    hull = _of_balls(releases, lambda ball: apart(*ball.ends, ball.bend, solid) - thing.radius_m)

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        far = apart(*patches.ends, patches.bend, solid) - thing.reach_m - thing.radius_m - required
        if (far >= 0.0).all():
            return far[None], np.full((1, len(far)), np.inf)
        lower, upper = hull(patches)
        above = lowest_in(patches, of_body=True) - float(solid.upper[2])
        lower = np.maximum(lower[0], above) - required
        return np.where(patches.falls & carries, np.inf, lower)[None], upper

    return rooms


def _in_bin(aim: Aim, radius: float) -> Callable[[FlightPatches], Array]:
    """Returns how far within a bin's wall a ball of a body is [m]."""
    assert aim.bin is not None
    inner, _ = aim.bin

    def room(ball: FlightPatches) -> Array:
        return inner - _aside(ball, aim.p_W) - radius + LENGTH_M

    return room


def _aside(patches: FlightPatches, p_W: Array) -> Array:
    """Returns bounds (m,) [m] on the horizontal distance of flights from a place: it is convex along a chord."""
    far = []
    for x in patches.ends:
        off = x[:2] - p_W[:2, None]
        far.append(np.sqrt((off[0] * off[0] + off[1] * off[1]).upper) * UP)
    return np.maximum(*far) + patches.bend


def _of_tops(place: LandingPlace, radius: float) -> Callable[[FlightPatches], Array]:
    """Returns how far within the tops on which it lands a ball of a body is [m]."""

    def room(ball: FlightPatches) -> Array:
        return np.asarray(np.max([depth_within(ball, top) for top in place.tops], axis=0)) - radius + LENGTH_M

    return room


def _touching(room: Callable[[FlightPatches], Array]) -> PatchRooms:
    """Returns the least rooms of the balls of a body where it may touch."""

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        body = patches.releases
        assert isinstance(body, BallReleases)
        lower, upper = _of_balls(body, room)(patches)
        return np.where(may_touch(patches), lower, np.inf), upper

    return rooms


def _landings(
    cell: Cell, motion: SampledMotion, demands: Demands, place: LandingPlace, spread: BallReleases
) -> Iterator[Finding]:
    """Returns the findings about where and how a body lands, of the nominal release and of those in the window."""
    aim = demands.aim
    assert aim is not None
    nominal = _ball(cell, release_pieces(motion, 0.0), place, demands)
    window = nominal
    if aim.is_robust and aim.window_s == demands.spread_s:
        window = spread
    elif aim.is_robust:
        window = _ball(cell, release_pieces(motion, aim.window_s), place, demands)
    for name, releases, allowed in (
        ("landing", nominal, LANDING_M),
        ("landing_window", window, aim.tolerance_m * (1.0 + SHARE)),
    ):
        lasts_s = _lasts(releases)
        if lasts_s is None:
            yield Finding(name, Status.NOT_PROVEN, None, "may never land")
        elif name == "landing" or aim.is_robust:
            yield prove_patches(name, first_patches(releases, lasts_s), _near(aim, allowed), ["off the target"])
    orientation = demands.release.get("orientation")
    if orientation is not None and (lasts_s := _lasts(window)) is not None:
        axis = demands.direction(orientation["axis"])
        limit = float(orientation["tolerance_rad"]) + ANGLE
        rooms = _along(axis / np.linalg.norm(axis), math.cos(limit) if limit < math.pi / 2 else 0.0)
        yield prove_patches("landing_axis", first_patches(window, lasts_s), rooms, ["off the axis, in its cosine"])


def _near(aim: Aim, allowed: float) -> PatchRooms:
    """Returns what a body lands nearer to a target than it must, where it may touch [m]."""

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        room = np.where(may_touch(patches), allowed - _aside(patches, aim.p_W), np.inf)
        return room[None], np.full((1, len(room)), np.inf)

    return rooms


def _along(axis: Array, least: float) -> PatchRooms:
    """Returns by how much the cosine between a body's z axis and a direction (3,) is larger, where it may touch."""

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        body = patches.releases
        assert isinstance(body, BallReleases)
        both = [dot(axis[:, None], body.spin.axes(patches.rows, s, (2,))[0]) for s in (patches.s0, patches.s1)]
        sign = np.where(both[0].c0 < 0.0, -1.0, 1.0)
        h = patches.s1 - patches.s0
        bend = body.spin.bending[patches.rows] * h * h / 8.0 * UP
        cosine = np.minimum(*((x * sign).lower for x in both)) - bend
        room = np.where(may_touch(patches), cosine - least, np.inf)
        return room[None], np.full((1, len(room)), np.inf)

    return rooms


def _arm_findings(
    cell: Cell, motion: SampledMotion, spread: BallReleases, place: LandingPlace, lasts_s: float
) -> Iterator[Finding]:
    """Returns the findings about the arm, which moves on: of every capsule and every ball of the hull."""
    whole = ArmPieces(cell, all_pieces(motion))
    clearance = cell.surroundings.flight_clearance_m
    touches = replace(place, ends_z=math.inf)  # of a body, that is told by its releases
    middle = ArmAfter(cell, spread)
    after = [ArmAfter(cell, spread.ball(place_m), middle) for place_m in cell.object.balls_m]
    for capsule in capsules_of(cell)[:-1]:
        gap, is_held = _in_grip(cell, motion, capsule)
        grips = capsule.frame in GRIPPED_FRAMES and gap < clearance
        required = beside_base(cell, place, capsule, clearance) if capsule.frame == 0 else clearance
        thick = capsule.radius_m + cell.object.radius_m - LENGTH_M
        bending = accelerations(whole, capsule)
        watches = [(capsule, thick + (0.0 if grips else required), grips)]
        if grips and not is_held:
            watches.append((capsule, thick + min(gap, 0.0) - DEEPER_M, False))
        for watched, thick, is_gripped in watches:
            far = CapsuleWatch((watched, thick + cell.object.reach_m, False), touches, bending)
            if far.is_far(middle, lasts_s):
                yield Finding(NAME, Status.PROVEN)
                continue
            watch = CapsuleWatch((watched, thick, is_gripped), touches, bending)
            yield from watch.findings(NAME, after, lasts_s)


def _in_grip(cell: Cell, motion: SampledMotion, capsule: MovingCapsule) -> tuple[float, bool]:
    """Returns the distance of the hull from a capsule at the release [m], and whether the body itself is in it.

    To rounding.
    """
    thing = cell.object
    assert isinstance(thing, ThrownBody) and motion.release is not None
    arm = ArmPieces(cell, instant(motion, motion.release))
    ends = np.array([arm.point(capsule.frame, end).c0 for end in capsule.ends])
    R_WO = arm.R_WT.c0[:, :, 0] @ thing.R_TO
    x = arm.p_WT.c0
    gaps = []
    for place_m in thing.balls_m:
        y = x + place_m * (R_WO @ thing.hull_axis_O)[:, None]
        near, other = nearest_on_segments(np.array([y, y]), ends)
        gaps.append(float(np.linalg.norm(near - other)))
    X_WO = np.eye(4)
    X_WO[:3, :3], X_WO[:3, 3] = R_WO, x[:, 0]
    size = thing.size_m
    round_m = np.array([0.5 * size[0], size[2] - (size[0] if thing.kind == "capsule" else 0.0)])
    solid = shape_of(thing.kind, X_WO, size if thing.kind == "box" else round_m)
    is_held = float(np.linalg.norm(out_of_solid(ends, solid))) <= capsule.radius_m
    return min(gaps) - capsule.radius_m - thing.radius_m, is_held

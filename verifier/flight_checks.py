"""Checks of the object's flight: what it must not meet, until it lands (docs/conventions.md, Tool and object)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from planner.cell import Cell, Solid, ThrownBody
from verifier.aims import Aim
from verifier.arm import ArmPieces
from verifier.arm_in_flight import ArmAfter, CapsuleWatch, accelerations
from verifier.capsules import MovingCapsule, capsules_of
from verifier.clearance_checks import LENGTH_M
from verifier.drag import releases_of
from verifier.elementary import ROUNDING, Array
from verifier.finding import Finding, Status, not_covered
from verifier.flights import (
    FlightPatches,
    OutsideMotion,
    PatchRooms,
    Releases,
    first_patches,
    prove_patches,
    release_pieces,
)
from verifier.grippers import HeldBall
from verifier.landing_place import LEVEL_M, LandingPlace, LandingTop, landing_place
from verifier.pieces import all_pieces
from verifier.plan_document import Demands, SampledMotion
from verifier.solids import from_solid, lengths_up, shortened, support, toward
from verifier.taylor import TaylorModel, dot, stacked

NAME = "flight_clearance"
GRIPPED_FRAMES = (4, 5, 6)  # of the links that hold the hand, and of the tool: what the object may be released beside
LOW_M = 1e-4  # [m] below the height at which it ends, to which a flight is looked at


def flight_findings(cell: Cell, motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Returns the findings about the flight."""
    if not demands.throws or NAME in demands.not_covered or isinstance(cell.object, ThrownBody):
        return
    try:
        releases = releases_of(cell, release_pieces(motion, demands.spread_s))
    except OutsideMotion as error:
        yield not_covered(NAME, str(error))
        return
    place = landing_place(cell, demands)
    yield from _flown(cell, motion, demands, releases, place)


def _flown(
    cell: Cell, motion: SampledMotion, demands: Demands, releases: Releases, place: LandingPlace
) -> Iterator[Finding]:
    """Returns the findings about flights that end on a place."""
    assert motion.release is not None
    released_s = motion.release / motion.rate_hz
    if not place.fits:
        yield Finding(NAME, Status.NOT_PROVEN, None, "the object does not fit at the target")
    lasts = releases.falls_to(min(place.plane_z, place.ends_z) - LOW_M).upper
    passes = releases.falls_to(place.ends_z).lower
    if not np.isfinite(lasts).all() or not (passes > 0.0).all():
        yield Finding(NAME, Status.NOT_PROVEN, released_s, "may never come down to where it lands")
        return
    patches = first_patches(releases, float(lasts.max()))
    yield prove_patches(NAME, patches, _floor(cell, place), ["the floor"])
    is_in_bin = demands.aim is not None and demands.aim.bin is not None
    for k, (solid, name) in enumerate(zip(cell.surroundings.keep_out, cell.surroundings.keep_out_names, strict=True)):
        yield prove_patches(NAME, patches, _solid(cell, place, k, solid, is_in_bin), [name])
    if place.tops:
        yield prove_patches(NAME, patches, _on_top(place), ["beside what it is to land on"])
    if demands.aim is not None and demands.aim.bin is not None:
        yield prove_patches(NAME, patches, wall_rooms(cell, demands.aim), ["the bin's wall"])
    yield from _arm_findings(cell, motion, releases, place, float(lasts.max()))


def _floor(cell: Cell, place: LandingPlace) -> PatchRooms:
    """Returns how far the object is above the floor, until it touches what it lands on."""
    floor = cell.surroundings.floor_z_m
    touches = floor + cell.object.radius_m

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        # On the floor it lands where it touches that: it only has to begin above. Elsewhere it touches it never.
        if place.height_m is not None and place.height_m <= floor and not place.tops:
            first = patches.s0 == 0.0
            z = patches.ends[0][2]
            room, most = (np.where(first, bound - touches + LENGTH_M, np.inf) for bound in (z.lower, z.upper))
            return room[None], most[None]
        low = patches.lowest - touches + LENGTH_M
        # What falls below the height at which flights end counts down to that alone.
        low = np.where(patches.falls & (patches.lowest < place.ends_z), np.maximum(low, place.ends_z - touches), low)
        return np.where(patches.counts(place.ends_z), low, np.inf)[None], np.full((1, len(low)), np.inf)

    return rooms


def apart(x: TaylorModel, y: TaylorModel, bend: Array, solid: Solid) -> Array:
    """Returns lower bounds (m,) [m] on the distance of flights between places (3, m) from a solid."""
    n = toward(from_solid(0.5 * (x.c0 + y.c0), solid))
    least = np.minimum(dot(n, x).lower, dot(n, y).lower) - bend * lengths_up(n)
    reach = support(solid, n)
    return shortened(least - reach - 2.0 * ROUNDING * np.abs(reach), n)


def _solid(cell: Cell, place: LandingPlace, k: int, solid: Solid, is_in_bin: bool) -> PatchRooms:
    """Returns what the object is farther from a solid than it must be: in flight, then lying until it is at the target.

    Above a top on which it may land it touches nothing of what carries that before.
    """
    thick = cell.object.radius_m + float(place.clearances[k]) - LENGTH_M
    carries = bool(place.carries[k])
    lies_z = None if place.height_m is None or is_in_bin else place.height_m + cell.object.radius_m
    is_higher = lies_z is not None and bool(solid.upper[2] > lies_z - cell.object.radius_m + LEVEL_M)

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        x, y = patches.ends
        exempt = np.full(len(patches.rows), carries and not place.tops)  # it lands on the floor above it
        for top in place.tops if carries else ():
            exempt |= (depth_within(patches, top) >= 0.0) & (patches.lowest >= top.height_m)
        flies = np.where(exempt, np.inf, apart(x, y, patches.bend, solid) - thick)
        lower = np.where(patches.counts(place.ends_z), flies, np.inf)
        if is_higher and lies_z is not None:
            lying = apart(_lying(x, place, lies_z), _lying(y, place, lies_z), patches.bend, solid) - thick
            lies = (patches.lowest <= place.ends_z) & ~patches.rises & patches.counts(place.plane_z)
            lower = np.where(lies, np.minimum(lower, lying), lower)
        out = from_solid(x.c0, solid)
        unsure = x.r.sum(axis=0) + 64.0 * ROUNDING * x.size.sum(axis=0)
        most = np.sqrt((out * out).sum(axis=0)) * (1.0 + 1e-12) + unsure - thick
        flying = (x[2].lower > place.ends_z) & ~exempt
        return lower[None], np.where(flying, most, np.inf)[None]

    return rooms


def _lying(x: TaylorModel, place: LandingPlace, z: float) -> TaylorModel:
    """Returns places at a height of an object that lies: as far off its flight there as the target is off the aim."""
    return stacked([x[0] - float(place.shift[0]), x[1] - float(place.shift[1]), x[2] * 0.0 + z])


def depth_within(patches: FlightPatches, top: LandingTop) -> Array:
    """Returns lower bounds (m,) [m] on how far within a top's outline flights are."""
    depths = []
    for x in patches.ends:
        u = [x[0] * float(side[0]) + x[1] * float(side[1]) - float(side @ top.centre) for side in top.sides]
        sizes = [np.maximum(each.upper, -each.lower) for each in u]
        if top.is_round:
            depths.append(top.half[0] - np.sqrt(sizes[0] ** 2 + sizes[1] ** 2) * (1.0 + 1e-12))
        else:
            depths.append(np.min([half - size for half, size in zip(top.half, sizes, strict=True)], axis=0))
    return np.min(depths, axis=0) - patches.bend - 1e-12


def _on_top(place: LandingPlace) -> PatchRooms:
    """Returns how far within the tops on which it lands the centre is as it comes down to their height."""

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        comes = (patches.lowest <= place.ends_z) & ~patches.rises & patches.counts(place.ends_z)
        depth = np.max([depth_within(patches, top) for top in place.tops], axis=0)
        return np.where(comes, depth, np.inf)[None], np.full((1, len(depth)), np.inf)

    return rooms


def wall_rooms(cell: Cell, aim: Aim, is_until_inside: bool = True) -> PatchRooms:
    """Returns what the object is farther from a bin's wall than its radius, until its centre is below the mouth.

    In the half plane of the distance from the axis and the height, the wall is a segment from bottom to rim. Beside a
    bin that moves evenly, a flight bends as it does beside one that stands.

    Args:
        cell: the cell.
        aim: with the bin.
        is_until_inside: whether that is so until the centre is below the mouth alone, not until the end of the flight.
    """
    assert aim.bin is not None
    p_W = aim.p_W
    inner, rim = aim.bin
    thick = cell.object.radius_m + aim.slack_m - LENGTH_M
    top = float(p_W[2]) + rim

    def rooms(patches: FlightPatches) -> tuple[Array, Array]:
        squares = []
        x, y = (aim.beside(each, t) for each, t in zip(patches.ends, patches.times, strict=True))
        for end in (x, y):
            u, v = end[0] - float(p_W[0]), end[1] - float(p_W[1])
            squares.append(u * u + v * v)
        # Along a chord the distance from the axis is convex: largest at an end; least, no more than the chord below.
        far = np.sqrt(np.max([square.upper for square in squares], axis=0)) * (1.0 + 1e-12)
        length = np.sqrt(sum(np.maximum((x - y)[i].upper, (y - x)[i].upper) ** 2 for i in range(2))) * (1.0 + 1e-12)
        near = np.sqrt(np.maximum(np.min([s.lower for s in squares], axis=0), 0.0)) - 0.5 * length
        aside = np.maximum(np.maximum(inner - far, near - inner), 0.0) - patches.bend
        above = np.maximum(patches.lowest - top, 0.0)
        gap = np.hypot(np.maximum(aside, 0.0), above) * (1.0 - 1e-12)
        room = gap - thick
        # Nor does it come up through the bottom: below that it is outside.
        room = np.where(patches.lowest < float(p_W[2]), np.minimum(room, near - patches.bend - inner), room)
        # Once inside, below the mouth, it may touch the wall: it came in over the rim, as patches before have shown.
        inside = (patches.highest < top) & (far + patches.bend < inner) & (patches.s0 > 0.0) & is_until_inside
        over = inside | ~patches.counts(float(p_W[2]))
        return np.where(over, np.inf, room)[None], np.full((1, len(room)), np.inf)

    return rooms


def _arm_findings(
    cell: Cell, motion: SampledMotion, releases: Releases, place: LandingPlace, lasts_s: float
) -> Iterator[Finding]:
    """Returns the findings about the arm, which moves on: one a capsule.

    Of a ball that another gripper holds nothing is gripped: however near it is, the flight is judged from its begin.
    """
    capsules = capsules_of(cell)[:-1]
    hand = len(capsules) - sum(isinstance(each, HeldBall) for each in cell.tool.capsules)
    whole = ArmPieces(cell, all_pieces(motion))
    after = ArmAfter(cell, releases)
    clearance = cell.surroundings.flight_clearance_m
    for number, capsule in enumerate(capsules):
        is_near = capsule.frame in GRIPPED_FRAMES and _gap_at_release(cell, motion, capsule) < clearance
        required = 0.0 if is_near else clearance
        if capsule.frame == 0:
            required = beside_base(cell, place, capsule, clearance)
        thick = capsule.radius_m + cell.object.radius_m + required - LENGTH_M
        watch = CapsuleWatch((capsule, thick, is_near and number < hand), place, accelerations(whole, capsule))
        yield from watch.findings(NAME, [after], lasts_s)


def beside_base(cell: Cell, place: LandingPlace, capsule: MovingCapsule, clearance: float) -> float:
    """Returns what the object keeps from a capsule of the base [m]: less where the target is near it."""
    if place.target is None:
        return clearance
    X = cell.X_WB
    ends = capsule.ends @ X[:3, :3].T + X[:3, 3]
    along = ends[1] - ends[0]
    share = float(np.clip((place.target - ends[0]) @ along / max(float(along @ along), 1e-30), 0.0, 1.0))
    room = float(np.linalg.norm(place.target - ends[0] - share * along)) - capsule.radius_m
    return min(0.5 * max(room - place.spare_m, 0.0), clearance)


def _gap_at_release(cell: Cell, motion: SampledMotion, capsule: MovingCapsule) -> float:
    """Returns the distance of the object's surface from a capsule at the release [m], to rounding."""
    arm = ArmPieces(cell, release_pieces(motion, 0.0))
    a, b = (arm.point(capsule.frame, end).c0[:, 0] for end in capsule.ends)
    x = arm.p_WT.c0[:, 0]
    share = float(np.clip((x - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-30), 0.0, 1.0))
    return float(np.linalg.norm(x - a - share * (b - a))) - capsule.radius_m - cell.object.radius_m

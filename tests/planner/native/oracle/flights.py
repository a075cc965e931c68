"""The object's flight, its way out of the tool, and past the arm: numpy twins of planner/native/kernel/flights.c."""

from __future__ import annotations

import math
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from planner.arrays import Array, Index
from planner.certificate.exits import Cone
from planner.certificate.flight.flights import TINY_M, nearest_on_segments
from planner.kinematics import dot

TINY = 1e-9  # [m/s^2] an acceleration that has no direction

ConeNumbers = tuple[Array, float, float, float]  # direction, half angle, distances at which an object is free, and out


def drag_paths(states: Array, steps: Index, h: Array, air: tuple[float, float]) -> Array:
    """Returns positions (n, k, 3) of flights from `states` (n, 6): after steps[j] steps of h[:, j] more, each."""
    rows = []
    for j, count in enumerate(steps):
        for _ in range(count):
            states = _step(states, h[:, j, None], *air)
        rows.append(states[:, :3])
    return np.array(rows).reshape(len(steps), len(states), 3).swapaxes(0, 1)


def drag_landings(state: Array, plane_z: float, step: tuple[float, float], air: tuple[float, float]) -> Array:
    """Returns state at the landing, time and apex (n, 8) of flights from states (n, 6); NaN where they miss it."""
    (h, longest) = step
    flying = np.arange(len(state))
    t = 0.0
    before = np.full(state.shape, np.nan)
    found = np.full((len(state), 8), np.nan)
    apex = state[:, 2].copy()
    while len(flying) and t < longest:
        following = _step(state, h, *air)
        tops = (state[:, 5] > 0.0) & (following[:, 5] <= 0.0)
        highest = _step(state[tops], _crossing(state[tops], h, *air, 5, 0.0)[:, None], *air)
        apex[flying[tops]] = highest[:, 2]
        below = (following[:, 5] < 0.0) & (following[:, 2] < plane_z)
        lands = below & (state[:, 2] >= plane_z)
        before[flying[lands]] = state[lands]
        found[flying[lands], 6] = t
        state = following[~below]
        flying = flying[~below]
        t = t + h
    rest = _crossing(before, h, *air, 2, plane_z)
    found[:, :6] = _step(before, rest[:, None], *air)
    found[:, 6] += rest
    landed = ~np.isnan(found[:, 6])
    found[landed, 7] = apex[landed]
    found[landed, 2] = plane_z
    return found


def _crossing(state: Array, h: float, gravity: float, drag: float, index: int, level: float) -> Array:
    """Returns the times (...,) [s] within one step at which component `index` falls through `level`, by bisection."""
    low = np.zeros(state.shape[:-1])
    high = np.full(state.shape[:-1], h)
    for _ in range(50):
        middle = 0.5 * (low + high)
        above = _step(state, middle[..., None], gravity, drag)[..., index] > level
        low = np.where(above, middle, low)
        high = np.where(above, high, middle)
    return 0.5 * (low + high)


def _step(state: Array, h: ArrayLike, gravity: float, drag: float) -> Array:
    """Returns the states (..., 6) one Runge-Kutta step of `h` (..., 1) later."""
    down = np.array([0.0, 0.0, gravity])

    def rate(x: Array) -> Array:
        v = x[..., 3:]
        return np.concatenate([v, -drag * np.sqrt((v * v).sum(axis=-1, keepdims=True)) * v - down], axis=-1)

    h = np.asarray(h, float)
    k1 = rate(state)
    k2 = rate(state + 0.5 * h * k1)
    k3 = rate(state + 0.5 * h * k2)
    k4 = rate(state + h * k3)
    return state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def ways(X_WF: Array, X_FT: Array, fallen: Array, s: Array, felt: Array) -> Array:
    """Returns w in the tool frame (3, p), for flange poses (p, 4, 4) and the object at `fallen` (3, p) after `s` (p,).

    At the beginning it is against what the gripper has `felt` (3, p).
    """
    later = s > 0.0
    p_WT = (X_WF[:, :3, :3] @ X_FT[:3, 3] + X_WF[:, :3, 3]).T
    w = np.where(later, (fallen - p_WT) * (2.0 / np.where(later, s * s, 1.0)), -felt)
    R_WT = (X_WF[:, :3, :3] @ X_FT[:3, :3]).transpose(1, 2, 0)
    return np.stack([dot(R_WT[:, c], w) for c in range(3)])


def exit_cells(w: Array, s: Array, corners: Index, deviation: Array, numbers: ConeNumbers) -> Array:
    """Returns the first rows of `Seen` (7, k): angles at the four corners, leaving, room, is_out.

    Args:
        w: at the points (3, p) [m/s^2].
        s: time after the release (p,) [s].
        corners: points of the cells (4, k).
        deviation: of w between them, at most (k,) [m/s^2].
        numbers: of the cone.
    """
    cone = Cone(*numbers)
    w = w[:, corners]
    s = s[corners]
    size = np.sqrt(dot(w, w))
    moved = 0.5 * size * s * s
    out = moved >= cone.out_m
    angle = _angle(w, cone)
    root = np.sqrt(moved)  # it grows about linearly in time
    share = (math.sqrt(cone.out_m) - root[::2]) / np.maximum(root[1::2] - root[::2], TINY)
    leaving = _angle(w[:, ::2] + share * (w[:, 1::2] - w[:, ::2]), cone)
    leaving = np.where(out[1::2] & ~out[::2], leaving, -np.inf).max(axis=0)
    if cone.half_rad > np.pi / 2:
        room = _outside(w, cone)
    else:
        room = (size * np.sin(np.maximum(cone.half_rad - angle, -np.pi / 2))).min(axis=0)
    in_place = 0.5 * (size.max(axis=0) + deviation) * s.max(axis=0) ** 2 < cone.free_m
    mean = w[:, 0] + w[:, 2]
    least = np.minimum(dot(w[:, 0], mean), dot(w[:, 2], mean)) / np.maximum(np.sqrt(dot(mean, mean)), TINY)
    is_out = 0.5 * (least - deviation) * s[0] ** 2 >= cone.out_m
    counted = np.where(out | (moved < cone.free_m), -np.inf, angle)
    return np.stack([*counted, leaving, np.where(in_place, np.inf, room - deviation), is_out])


def _angle(w: Array, cone: Cone) -> Array:
    """Returns the angles (...) [rad] of vectors (3, ...) from the cone's axis."""
    along = dot(cone.direction, w)
    return np.arctan2(np.sqrt(np.maximum(dot(w, w) - along * along, 0.0)), along)


def _outside(w: Array, cone: Cone) -> Array:
    """Returns lower bounds (k,) on how far cells with corners (3, 4, k) are outside of what a wide cone leaves out."""
    axis = cone.direction[:, None]
    middle = w.sum(axis=1)
    across = middle - axis * dot(cone.direction, middle)
    across = across / np.maximum(np.sqrt(dot(across, across)), TINY)
    edge = math.sin(cone.half_rad) * axis - math.cos(cone.half_rad) * across
    tip = middle / np.maximum(np.sqrt(dot(middle, middle)), TINY)
    away = np.where(_angle(middle, cone) <= cone.half_rad - np.pi / 2, tip, edge)
    return dot(away[:, None], w).min(axis=0)


def capsule_bounds(
    grid: tuple[Array, Array, Array], capsules: tuple[Index, Array], rates: Array, reach: Array, moving: Array
) -> Array:
    """Returns lower bounds (c, m, n) [m] on the distances of patches from capsules, but for the bend of the flights.

    Args:
        grid: positions (3, m + 1, n + 1), or (3, 1, n + 1) of a single release, link poses (n + 1, 7, 4, 4), and
            lengths of the intervals between the instants (n,).
        capsules: frames (c,) and ends in them (c, 2, 3).
        rates: sums of joint speeds and accelerations that move each frame (2, 7, n).
        reach: of the joints before each frame (7,) [m].
        moving: bounds on the object's speed and on the bend of its flight in time (2, m, n) [m/s, m].
    """
    (x, X_WL, h) = grid
    (frames, ends) = capsules
    (w, a) = rates[:, :, None]
    R = X_WL[:, :, :3, :3].transpose(2, 3, 1, 0)
    origins = X_WL[:, :, :3, 3].transpose(2, 1, 0)
    apart = x[:, None] - origins[:, :, None]
    local = np.stack([dot(R[:, c, :, None], apart) for c in range(3)])  # (3, 7, m + 1, n + 1)
    far = reduce(np.maximum, corners_on_grid(np.sqrt(dot(local[:, 0], local[:, 0])))) + moving[1]
    turned = (2.0 * w * moving[0] + (a + w * w) * (far + reach[:, None, None])) * (h * h / 8.0)
    start, end = (ends[:, i].T[:, :, None, None] for i in (0, 1))
    return segment_bound(corners_on_grid(local[:, frames]), start, end) - turned[frames]


def segment_bound(corners: list[Array], start: Array, end: Array) -> Array:
    """Returns lower bounds (...) [m] on the distance of patches from segments, along n from the nearest point on.

    Args:
        corners: of the patches, each (3, ...) [m].
        start, end: of the segments (3, ...) [m].
    """
    centre = reduce(np.add, corners) / len(corners)
    near = nearest_on_segments(centre, start, end)
    apart = centre - near
    least = reduce(np.minimum, [dot(apart, corner) for corner in corners])
    return (least - dot(apart, near)) / np.maximum(np.sqrt(dot(apart, apart)), TINY_M)


def corners_on_grid(x: Array) -> list[Array]:
    """Returns the corners of patches, (..., m, n) each, of values (..., m + 1, n + 1) or (..., 1, n + 1)."""
    if x.shape[-2] == 1:
        return [x[..., :-1], x[..., 1:]]
    return [x[..., :-1, :-1], x[..., :-1, 1:], x[..., 1:, :-1], x[..., 1:, 1:]]


def patch_distances(poses: tuple[Array, Index], capsules: tuple[Index, Array], corners: Array) -> Array:
    """Returns distances [m] of k patches of flights, each from the axis of a capsule (5, k).

    First lower bounds, but for the bend of the flights and the turning of the links, then those of the corners.

    Args:
        poses: link poses (n, 7, 4, 4), and which of them are at both instants of each patch (2, k).
        capsules: frames (k,) and ends in them (k, 2, 3).
        corners: of the patches (3, 4, k) [m].
    """
    (X, at) = poses
    (frames, ends) = capsules
    X = X[np.concatenate([at, at]), frames]  # the corners of both releases are at the same two instants
    apart = corners - X[..., :3, 3].transpose(2, 0, 1)
    R = X[..., :3, :3].transpose(2, 3, 0, 1)
    x = np.stack([dot(R[:, c], apart) for c in range(3)])
    start, end = ends.transpose(1, 2, 0)
    sampled = np.linalg.norm(x - nearest_on_segments(x, start[:, None], end[:, None]), axis=0)
    return np.concatenate([segment_bound(list(x.swapaxes(0, 1)), start, end)[None], sampled])

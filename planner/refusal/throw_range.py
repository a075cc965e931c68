"""Which targets no throw reaches: bounds on the arm's reach and on the tool's speed away from the shoulder.

The shoulder is where the axes of the first two joints meet, so these do not change the tool's distance r from it.
Behind it a UR arm is a chain in a plane, of the links a2, a3 and the wrist, and an offset across the plane:

    r^2 = P^2 + N^2,  N = d4 + D sin(t),  wrist: W(t) = hypot(d5, D cos(t)),  D = d6 + the tool's length,

where joint 5 decides on t, and P <= |a2| + |a3| + W is the length of the planar chain. Joints 3 and 4 change P by at
most their speeds w times their distances h from the chain's chord. With the links l_k and W_k, the sum of the speeds
of the joints behind link k, Lagrange duality bounds that for every m and every n >= 0:

    sum of w h <= sum of l_k hypot(W_k - m, n) - n P.

Joint 5 adds at most w5 D (P |sin t| + |N cos t|) / r. So an arm that is nearly stretched cannot throw away from its
shoulder, which is where the farthest targets have to be thrown from, and to.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from planner.arrays import Array, Mask, read_only
from planner.cell import Cell
from planner.problem import ThrowProblem
from planner.releases import Target

SLACK = 1e-3  # [m, m/s, rad/s] beyond the certificate's tolerances on release and landing, all below it
ANGLES = 240
DISTANCES = 80  # [-] parts in which the wrist's turn and the distances from the shoulder are looked at
DUALS = 17, 25  # [-] values of m and n that are tried
DUAL_RANGE_RAD_S = (0.1, 100.0)  # [rad/s] of n beside 0
CELLS_KEPT = 32  # [-] bounds that are cached: of an arm with its tool and its joint limits
CUBES_MAX = 40_000  # [-] places that are looked at; a target just out of range is left to the search
TINY = 1e-9  # [m, s] keeps lengths and times away from zero
HALVES = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


class OutOfRange(NamedTuple):
    """Why no throw reaches a target: speeds [m/s] away from the shoulder, at the place that lacks least.

    Of all places that were looked at, so that somewhere between them a little less may lack.
    """

    least_needed: float
    most_possible: float

    def lacking(self) -> float:
        """Returns the speed that is lacking [m/s]."""
        return self.least_needed - self.most_possible


class _Chain(NamedTuple):
    """Lengths behind the shoulder: links (2,), offset d4, wrist d5, tool D along the last axis and beside it [m]."""

    links: Array
    offset: float
    wrist: float
    tool: float
    beside: float


class _Places(NamedTuple):
    """Cubes of tool positions: centres (n, 3) relative to the shoulder [m], and half the length of their edges [m]."""

    x: Array
    half: float

    @property
    def radius(self) -> float:
        """Half the length of their diagonals [m]."""
        return math.sqrt(3.0) * self.half

    def parts(self, chosen: Mask) -> _Places:
        """Returns the eighths of the chosen ones."""
        half = self.half / 2.0
        return _Places((self.x[chosen][:, None] + half * HALVES).reshape(-1, 3), half)


@lru_cache(maxsize=CELLS_KEPT)
def farthest_reach_from_shoulder(cell: Cell) -> float:
    """Returns a bound on the tool centre's distance from the shoulder [m].

    Of a calibrated arm, whose axes are not parallel, the sum of its links.
    """
    chain = _chain(cell)
    robot = cell.robot
    if chain is None:
        links = np.hypot(robot.a, robot.d)[1:].sum() + np.linalg.norm(cell.tool.X_FT[:3, 3])
        return float(abs(robot.a[0]) + links)
    turn, half = _turns()
    across = chain.offset + chain.tool * np.sin(turn)
    along = chain.links.sum() + np.hypot(chain.wrist, chain.tool * np.cos(turn))
    return float(np.hypot(across, along).max() + chain.beside + half * chain.tool)


def out_of_range(problem: ThrowProblem, target: Target) -> OutOfRange | None:
    """Returns why no drag-free throw from anywhere reaches a target; None where that is not proven.

    The ball of the arm's reach is divided into cubes until a throw from each takes more speed than allowed, or more
    speed away from the shoulder than the joints give, or until one allows both.
    """
    cell = problem.cell
    limits = problem.limits
    chain = _chain(cell)
    if chain is None or chain.beside > TINY or problem.drag > 0.0:
        return None
    shoulder = shoulder_position(cell)
    reach = farthest_reach_from_shoulder(cell)
    goal = target.p_W - shoulder
    bound = _radial_bound(cell, limits.qd_max[2:5].tobytes())
    fastest = min(limits.tcp_speed_max, target.max_speed_m_s) + SLACK
    gravity = problem.gravity_at_tool_speed
    places = _Places(np.zeros((1, 3)), reach)
    looked_at = 0
    closest = OutOfRange(math.inf, 0.0)
    while len(places.x):
        looked_at += len(places.x)
        away = np.linalg.norm(places.x, axis=1)
        points = places.x[away <= reach]
        needed = _least_radial_speed(_Places(points, 0.0), goal, gravity, fastest)
        given = bound.most(away[away <= reach])
        if looked_at > CUBES_MAX or (needed <= given).any():
            return None  # smaller cubes would not exclude that point
        if len(points):
            i = int((needed - given).argmin())
            closest = min(closest, OutOfRange(float(needed[i]), float(given[i])), key=OutOfRange.lacking)
        needed = _least_radial_speed(places, goal, gravity, fastest)
        needed[away - places.radius > reach] = np.inf
        places = places.parts(needed <= bound.most(away - places.radius) + SLACK)
    return closest if math.isfinite(closest.least_needed) else None


def shoulder_position(cell: Cell) -> Array:
    """Returns the position (3,) [m] where the axes of the first two joints meet."""
    return cell.X_WB[:3, :3] @ [0.0, 0.0, cell.robot.d[0]] + cell.X_WB[:3, 3]


class _RadialBound(NamedTuple):
    """Bound on the speed away from the shoulder beyond distances (n,) [m] from it: speeds (n,) [m/s]."""

    distances: Array
    speeds: Array

    def most(self, distance: Array) -> Array:
        """Returns the bound (...,) [m/s] on the speed at `distance` (...,) [m] or farther."""
        row = np.searchsorted(self.distances, distance, side="right") - 1
        return self.speeds[np.clip(row, 0, len(self.speeds) - 1)]


def _least_radial_speed(places: _Places, target: Array, gravity: float, fastest: float) -> Array:
    """Returns the least speed (n,) [m/s] away from the shoulder of a throw from a place to the target, at least.

    A flight of duration t over the vector d begins with d / t + g t / 2 upwards. It is no faster than allowed between
    two durations. Its share along the direction u from the shoulder, d.u / t + g t u_z / 2, is least at one of them or
    where its slope vanishes. Infinite where every throw is too fast.

    Args:
        places: where it begins; d and u vary within a cube.
        target: relative to the shoulder (3,) [m].
        gravity: [m/s^2].
        fastest: allowed speed [m/s].
    """
    d = target - places.x
    away = np.linalg.norm(places.x, axis=1)
    spread = places.radius + SLACK
    length = np.linalg.norm(d, axis=1)
    budget = fastest**2 - gravity * (d[:, 2] - spread)
    root = budget**2 - (gravity * np.maximum(length - spread, 0.0)) ** 2
    reaches = (root >= 0.0) & (budget > 0.0)
    root = np.sqrt(np.maximum(root, 0.0))
    shortest, longest = (np.sqrt(2.0 * np.maximum(budget + s * root, 0.0)) / gravity for s in (-1.0, 1.0))
    turned = np.where(away > spread, np.sqrt(2.0) * spread / np.maximum(away, spread), 2.0)  # chord of asin(share)
    u = places.x / np.maximum(away, TINY)[:, None]
    along = (d * u).sum(axis=1) - spread - turned * (length + spread)
    up = u[:, 2] - turned
    flat = np.sqrt(2.0 * np.maximum(along, 0.0) / (gravity * np.maximum(up, TINY)))
    durations = [shortest, longest, np.clip(np.where(up > 0.0, flat, longest), shortest, longest)]
    least = np.min([along / np.maximum(t, TINY) + gravity * t * up / 2.0 for t in durations], axis=0)
    return np.where(reaches, np.where(shortest > TINY, least, -np.inf), np.inf)


@lru_cache(maxsize=CELLS_KEPT)
def _radial_bound(cell: Cell, speeds: bytes) -> _RadialBound:
    """Returns the bound for the speed limits of joints 3 to 5, as bytes [rad/s]."""
    chain = _chain(cell)
    (w3, w4, w5) = np.frombuffer(speeds) + SLACK
    assert chain is not None
    edges = np.linspace(0.0, farthest_reach_from_shoulder(cell), DISTANCES + 1)
    low = edges[:-1, None]
    high = edges[1:, None]
    turn, half = _turns()
    across = np.abs(chain.offset + chain.tool * np.sin(turn))
    most_across = across + half * chain.tool
    least_across = np.maximum(across - half * chain.tool, 0.0)
    wrist = np.hypot(chain.wrist, chain.tool * np.cos(turn)) + half * chain.tool
    shortest = np.sqrt(np.maximum(low**2 - most_across**2, 0.0))
    longest = np.sqrt(np.maximum(high**2 - least_across**2, 0.0))
    links = np.stack(np.broadcast_arrays(*chain.links, wrist))
    planar = _planar_bound(links, np.array([w3 + w4, w4, 0.0]), shortest)
    swung = longest * (np.abs(np.sin(turn)) + half) + most_across * (np.abs(np.cos(turn)) + half)
    speed = planar + w5 * chain.tool * swung / np.maximum(low, TINY)
    exists = (high >= least_across) & (shortest <= chain.links.sum() + wrist)
    most = np.where(exists, speed, 0.0).max(axis=1)
    return _RadialBound(read_only(edges[:-1]), read_only(np.maximum.accumulate(most[::-1])[::-1]))


def _planar_bound(links: Array, behind: Array, chord: Array) -> Array:
    """Returns bounds (k, n) [m/s] on the change of the planar chain's length.

    Args:
        links: lengths of the three links (3, n) [m].
        behind: sum of the speeds of the joints behind each (3,) [rad/s].
        chord: least length of the chain (k, n) [m].
    """
    best = np.full(chord.shape, np.inf)
    for n in [0.0, *np.geomspace(*DUAL_RANGE_RAD_S, DUALS[1])]:
        sums = [(links.T * np.hypot(behind - m, n)).sum(axis=1) for m in np.linspace(0.0, behind[0], DUALS[0])]
        best = np.minimum(best, np.min(sums, axis=0) - n * chord)
    return best


def _turns() -> tuple[Array, float]:
    """Returns turns of the wrist (ANGLES,) [rad], and the farthest that any turn is from one of them [rad]."""
    return np.linspace(-np.pi, np.pi, ANGLES, endpoint=False), np.pi / ANGLES


def _chain(cell: Cell) -> _Chain | None:
    """Returns the chain behind the shoulder; None for an arm whose axes 2 to 4 are not parallel."""
    robot = cell.robot
    tcp = cell.tool.X_FT[:3, 3]
    if robot.fixed is not None or robot.a[0] != 0.0 or robot.d[1] != 0.0 or robot.d[2] != 0.0:
        return None
    lengths = (abs(float(robot.d[3])), abs(float(robot.d[4])), abs(float(robot.d[5] + tcp[2])))
    return _Chain(np.abs(robot.a[1:3]), *lengths, float(np.hypot(tcp[0], tcp[1])))

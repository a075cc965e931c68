"""Pieces and trees in joint space: numpy twins of planner/native/kernel/paths.c."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index
from planner.native import Pinned
from tests.planner.native.oracle.arm import fixed_chain_poses
from tests.planner.native.oracle.distances import pair_distances, shape_distances


class Way:
    """Tells whether pieces are clear, and counts the postures; it looks at everything in each of them, or as C does."""

    def __init__(self, scene: Pinned, ends: Array, numbers: Array, skips: bool) -> None:
        self.chain, self.capsules, self.pairs, self.shapes, self.bounds, self.touching, self.rooms = scene.arrays
        self.ends = ends
        self.margin, self.own, self.near, self.spacing, self.point = numbers
        self.skips = skips
        self.looked = 0

    def spares(self, q: Array) -> tuple[Array, Array, Array]:
        """Returns what is spare to floor, shapes, each other and the tool's box (k,), its margin, and the levers."""
        X = fixed_chain_poses(np.cos(q)[None], np.sin(q)[None], self.chain[1:], self.chain[0])[0]
        at = X[self.capsules[:, 0].astype(int)]
        local = self.capsules[:, 1:7].reshape(-1, 2, 3)
        ends = np.einsum("kij,kej->kei", at[:, :3, :3], local) + at[:, None, :3, 3]
        thick = self.capsules[:, 7]
        levers = self.capsules[:, 8:14]
        body, shape = (each.ravel() for each in np.indices((len(ends), len(self.shapes))))
        meets = (self.capsules[body, 15] > 0.0) & (self.touching[shape, body] == 0.0)
        to_shapes = (
            shape_distances(ends[body, 0], ends[body, 1], shape, self.shapes[:, :20])
            - thick[body]
            - self.shapes[shape, 20]
        )
        low = self.capsules[:, 14] > 0.0
        heights = ends[..., 2].min(axis=1) - thick - self.bounds[0]
        inside = np.min([ends[-1, 0] - self.bounds[1:4], self.bounds[4:] - ends[-1, 0]])
        own = pair_distances(ends[..., None], self.pairs[:, :2].astype(int), self.point)[:, 0] - self.pairs[:, 2]
        rooms = [_depth(room, ends[-1, 0]) - room[20] for room in self.rooms]
        outer = [to_shapes[meets], heights[low], [inside, *rooms]]
        spare = np.concatenate([*outer, own])
        margins = np.repeat([self.margin, self.own], [len(spare) - len(own), len(own)])
        return (
            spare,
            margins,
            np.concatenate([levers[body][meets], levers[low], levers[[-1] * (1 + len(rooms))], self.pairs[:, 3:]]),
        )

    def is_clear(self, start: Array, end: Array, kept: Array | None = None) -> bool:
        q = 0.5 * (start + end)
        half = 0.5 * np.abs(end - start)
        self.looked += 1
        spare, margins, levers = self.spares(q)
        kept = np.ones(len(spare), bool) if kept is None else kept
        share = min(1.0, np.abs(q - self.ends).max(axis=1).min() / self.near)
        if (spare < margins * share)[kept].any():
            return False
        if self.skips:
            kept = kept & (spare < margins + levers @ half)
        if not kept.any() or 2.0 * half.max() <= self.spacing:
            return True
        return self.is_clear(start, q, kept) and self.is_clear(q, end, kept)


def _depth(room: Array, p: Array) -> float:
    """Returns how deep a point (3,) is in a shape (20,), by its distance from each face, wall and axis."""
    x = room[:9].reshape(3, 3).T @ (p - room[9:12])
    lower, upper = room[12:15], room[15:18]
    if room[19] > 0.0:
        return room[19] - np.linalg.norm(x - np.clip(x, lower, upper))
    faces = np.minimum(x - lower, upper - x)
    return min(faces[2], room[15] - np.hypot(*x[:2])) if room[18] else faces.min()


def pieces_clear(scene: Pinned, ends: Array, numbers: Array, start: Array, end: Array) -> Array:
    """Returns 1 for each straight piece that is clear, 0 for others (n,), by postures that are close everywhere."""
    way = Way(scene, ends, numbers, skips=False)
    return np.array([float(way.is_clear(*each)) for each in zip(start, end, strict=True)])


def grow_trees(
    scene: Pinned, ends: Array, numbers: Array, random: Array, step: float, trees: tuple[Array, Index, Index]
) -> Index:
    """Returns the state of two trees that grow until they meet."""
    way = Way(scene, ends, numbers, skips=True)
    (q, parents, state) = trees
    sizes = state[:2].tolist()
    met = [-1, -1]
    turn = int(state[2])

    def grow(tree: int, towards: Array) -> int:
        if sizes[tree] == q.shape[1]:
            return -1
        near = int(((q[tree, : sizes[tree]] - towards) ** 2).sum(axis=1).argmin())
        move = towards - q[tree, near]
        longest = np.abs(move).max()
        new = q[tree, near] + step / longest * move if longest > step else towards
        if not way.is_clear(q[tree, near], new):
            return -1
        q[tree, sizes[tree]] = new
        parents[tree, sizes[tree]] = near
        sizes[tree] += 1
        return sizes[tree] - 1

    for towards in random:
        if way.looked >= state[5] or met[0] >= 0:
            break
        new = grow(turn, towards)
        other = grow(1 - turn, q[turn, new]) if new >= 0 else -1
        while other >= 0 and not np.array_equal(q[1 - turn, other], q[turn, new]):
            other = grow(1 - turn, q[turn, new])
        if other >= 0:
            met[turn] = new
            met[1 - turn] = other
        turn = 1 - turn
    return np.array([*sizes, turn, *met, state[5] - way.looked])

"""The kernel's functions on arrays of any layout. Shapes are checked here, because C would not."""

from __future__ import annotations

import numpy as np

from planner.arrays import Array, Index
from planner.native.arguments import Pinned, indices, read, written
from planner.native.libraries import kernel

LINKS = 7
JOINTS = 6  # base and links; joints
STEPS_MAX = 100_000  # [-] of one interval of a flight
STATE = 6
LANDING = 8  # position and velocity of a flight; with time and apex
BODIES = 8  # links, tool and object
SHAPE = 20  # numbers of a shape
BRANCHES = 8  # of the inverse kinematics


def link_poses(cosine: Array, sine: Array, dh: Array, base: Array) -> Array:
    """Returns link poses (n, 7, 4, 4) for cosines and sines (n, 6) of the joints, see `kinematics.link_poses`."""
    n = len(cosine)
    X = np.empty((len(cosine), LINKS, 4, 4))
    rows = (n, JOINTS)
    joints = read(cosine, rows), read(sine, rows)
    kernel().link_poses(n, *joints, read(dh, (4, JOINTS)), read(base, (4, 4)), written(X))
    return X


def flange_poses(cosine: Array, sine: Array, dh: Array, base: Array) -> Array:
    """Returns flange poses (n, 4, 4) for cosines and sines (n, 6) of the joints, as `link_poses` does."""
    n = len(cosine)
    X = np.empty((len(cosine), 4, 4))
    joints = read(cosine, (n, JOINTS)), read(sine, (n, JOINTS))
    kernel().flange_poses(n, *joints, read(dh, (4, JOINTS)), read(base, (4, 4)), written(X))
    return X


def fixed_chain_poses(cosine: Array, sine: Array, fixed: Array, base: Array) -> Array:
    """Returns link poses (n, 7, 4, 4) of a measured chain with `fixed` transforms (6, 4, 4); see `link_poses`."""
    n = len(cosine)
    X = np.empty((len(cosine), LINKS, 4, 4))
    rows = (n, JOINTS)
    joints = read(cosine, rows), read(sine, rows)
    kernel().fixed_chain_poses(n, *joints, read(fixed, (JOINTS, 4, 4)), read(base, (4, 4)), written(X))
    return X


def end_points(X: Array, frames: Index, ends: Array) -> Array:
    """Returns ends (k, 2, 3, n) in the world of segments with `ends` (k, 2, 3) in `frames` (k,) of X."""
    n = len(X)
    k = len(frames)
    out = np.empty((k, 2, 3, n))
    poses = read(X, (n, LINKS, 4, 4))
    places = indices(frames, (k,), LINKS)
    kernel().end_points(n, poses, k, places, read(ends, (k, 2, 3)), written(out))
    return out


def end_points_of(X: Array, frames: Index, ends: Array) -> Array:
    """Returns ends (n, 2, 3) in the world of one segment an instant with `ends` (n, 2, 3) in `frames` (n,) of X."""
    n = len(X)
    out = np.empty((n, 2, 3))
    poses = read(X, (n, LINKS, 4, 4))
    places = indices(frames, (n,), LINKS)
    kernel().end_points_of(n, poses, places, read(ends, (n, 2, 3)), written(out))
    return out


def point_velocity(X: Array, qd: Array, point: Array) -> Array:
    """Returns velocities (3, n) of a point (3, n) that moves with the flange."""
    n = len(X)
    out = np.empty((3, len(X)))
    motion = read(X, (n, LINKS, 4, 4)), read(qd, (n, JOINTS))
    kernel().point_velocity(n, *motion, read(point, (3, n)), written(out))
    return out


def point_acceleration(X: Array, qd: Array, qdd: Array, point: Array) -> Array:
    """Returns accelerations (3, n) of a point (3, n) that moves with the flange."""
    n = len(X)
    out = np.empty((3, len(X)))
    motion = read(X, (n, LINKS, 4, 4)), read(qd, (n, JOINTS)), read(qdd, (n, JOINTS))
    kernel().point_acceleration(n, *motion, read(point, (3, n)), written(out))
    return out


def fastest(X: Array, qd: Array, frames: Index, places: Array) -> Array:
    """Returns speeds (n,) of the fastest of points at `places` (k, 3) of `frames` (k,)."""
    n = len(X)
    k = len(frames)
    out = np.empty(n)
    motion = (read(X, (n, LINKS, 4, 4)), read(qd, (n, JOINTS)))
    kernel().fastest(n, *motion, k, indices(frames, (k,), LINKS), read(places, (k, 3)), written(out))
    return out


def momentum(X: Array, qd: Array, mass: Array, coms: Array) -> Array:
    """Returns the linear momentum (3, n) of links of `mass` (6,) with centres of mass `coms` (6, 3) in them."""
    n = len(X)
    out = np.empty((3, len(X)))
    motion = read(X, (n, LINKS, 4, 4)), read(qd, (n, JOINTS))
    kernel().momentum(n, *motion, read(mass, (JOINTS,)), read(coms, (JOINTS, 3)), written(out))
    return out


def chain_torques(
    X: Array, rates: tuple[Array, Array], bodies: tuple[Array, Array, Array], upward: Array, p_F: Array
) -> Array:
    """Returns torques (2, 6, n) of the links, and per kilogram at `p_F` of the flange; see `chain_torques`."""
    out = np.empty((2, JOINTS, len(X)))
    kernel().chain_torques(len(X), *_chain(X, rates, bodies, upward, p_F), written(out))
    return out


def torque_terms(
    X: Array, rates: tuple[Array, Array], bodies: tuple[Array, Array, Array], upward: Array, p_F: Array
) -> Array:
    """Returns torques (3, 2, 6, n) as `chain_torques` does, see `torque_terms`."""
    out = np.empty((3, 2, JOINTS, len(X)))
    kernel().torque_terms(len(X), *_chain(X, rates, bodies, upward, p_F), written(out))
    return out


def pair_distances(ends: Array, pairs: Index, shortest_m2: float) -> Array:
    """Returns the distances (p, n) of `pairs` (p, 2) of segments with `ends` (k, 2, 3, n)."""
    k, *_, n = ends.shape
    out = np.empty((len(pairs), n))
    chosen = indices(pairs, (len(pairs), 2), k)
    kernel().pair_distances(n, read(ends, (k, 2, 3, n)), len(pairs), chosen, shortest_m2, written(out))
    return out


def shape_distances(p0: Array, p1: Array, items: Index, rows: Array) -> Array:
    """Returns the distances (n,) of segments p0-p1, each (n, 3), from shapes `items` (n,) of `rows` (k, 20)."""
    n = len(p0)
    out = np.empty(n)
    chosen = indices(items, (n,), len(rows))
    table = read(rows, (len(rows), SHAPE))
    kernel().shape_distances(n, read(p0, (n, 3)), read(p1, (n, 3)), chosen, table, written(out))
    return out


def all_shape_distances(p0: Array, p1: Array, rows: Array) -> Array:
    """Returns the distances (k, n) of segments p0-p1, each (n, 3), from every shape of `rows` (k, 20)."""
    n = len(p0)
    k = len(rows)
    out = np.empty((k, n))
    table = read(rows, (k, SHAPE))
    kernel().all_shape_distances(n, read(p0, (n, 3)), read(p1, (n, 3)), k, table, written(out))
    return out


def drag_paths(states: Array, steps: Index, h: Array, air: tuple[float, float]) -> Array:
    """Returns positions (n, k, 3) of flights from `states` (n, 6), after k times of steps[j] steps of `h` (n, k).

    Args:
        states: positions and velocities (n, 6).
        steps: numbers of steps (k,).
        h: their durations (n, k).
        air: gravity and drag constant.
    """
    n, k = h.shape
    out = np.empty((n, k, 3))
    given = (read(states, (n, STATE)), k, indices(steps, (k,), STEPS_MAX))
    kernel().drag_paths(n, *given, read(h, (n, k)), *air, written(out))
    return out


def drag_landings(states: Array, plane_z: float, step: tuple[float, float], air: tuple[float, float]) -> Array:
    """Returns landing state, time and apex (n, 8) of flights from `states` (n, 6) with gravity and drag `air`.

    Args:
        states: positions and velocities (n, 6).
        plane_z: height of the landing plane.
        step: duration of a step and of the longest flight.
        air: gravity and drag constant.
    """
    out = np.empty((len(states), LANDING))
    kernel().drag_landings(len(states), read(states, (len(states), STATE)), plane_z, *step, *air, written(out))
    return out


def states_at(t: Array, rate: float, samples: Pinned) -> Array:
    """Returns states (3, k, c) at times `t` (k,) of a motion with `samples` q, qd, qdd (n, c), jerk (n-1, c)."""
    (n, c) = samples.arrays[0].shape
    k = len(t)
    out = np.empty((3, k, c))
    motion = samples.of_shapes(*3 * [(n, c)], (n - 1, c))
    kernel().states_at(k, read(t, (k,)), n, c, rate, *motion, written(out))
    return out


def joint_rates(samples: Pinned, dt: float, rows: Index) -> Array:
    """Returns bounds (4, c, k-1) between `rows` (k,), see `joint_rates`, for q, qd, qdd (n, c), jerk (n-1, c)."""
    (n, c) = samples.arrays[0].shape
    k = len(rows)
    out = np.empty((4, c, k - 1))
    (_, *rates) = samples.of_shapes(*3 * [(n, c)], (n - 1, c))
    kernel().joint_rates(c, *rates, dt, k, indices(rows, (k,), n), written(out))
    return out


def derivative_bounds(rates: Array) -> Array:
    """Returns bounds (11, c, m) for `rates` (3, c, m), see `Rates`."""
    _, c, m = rates.shape
    out = np.empty((11, c, m))
    kernel().derivative_bounds(c, m, read(rates, (3, c, m)), written(out))
    return out


def load_bounds(rates: tuple[Array, Array], bodies: tuple[Array, ...], inertia: float, g: float) -> Array:
    """Returns bounds (33, m), see `load_bounds`, for `rates` (4, 6, m) and their `derivative_bounds` (11, 6, m)."""
    m = rates[0].shape[-1]
    out = np.empty((33, rates[0].shape[-1]))
    given = (read(values, (rows, JOINTS, m)) for values, rows in zip(rates, (4, 11), strict=True))
    shapes = (BODIES, JOINTS), (BODIES, JOINTS), (BODIES,), (JOINTS,), (JOINTS, JOINTS)
    moved = (read(values, shape) for values, shape in zip(bodies, shapes, strict=True))
    kernel().load_bounds(m, *given, *moved, inertia, g, written(out))
    return out


def joint_extremes(dt: float, samples: Pinned) -> Array:
    """Returns extremes (2, 6, 6), see `joint_extremes`, for `samples` q, qd, qdd (n, 6), jerk (n-1, 6)."""
    n = len(samples.arrays[0])
    out = np.empty((2, 6, JOINTS))
    motion = samples.of_shapes(*3 * [(n, JOINTS)], (n - 1, JOINTS))
    kernel().joint_extremes(n, dt, *motion, written(out))
    return out


def ways(X: Array, X_FT: Array, fallen: Array, s: Array, felt: Array) -> Array:
    """Returns w (3, n), see `certificate.exits`: flange `X` (n, 4, 4), `X_FT` (4, 4), `fallen`, `felt` (3, n)."""
    n = len(X)
    out = np.empty((3, len(X)))
    given = read(X, (n, 4, 4)), read(X_FT, (4, 4)), read(fallen, (3, n)), read(s, (n,)), read(felt, (3, n))
    kernel().ways(n, *given, written(out))
    return out


def exit_cells(w: Array, s: Array, corners: Index, deviation: Array, cone: tuple[Array, float, float, float]) -> Array:
    """Returns rows (7, k), see `certificate.exits`, of cells with `corners` (4, k) among `w` (3, p), `s` (p,)."""
    p = len(s)
    k = corners.shape[1]
    out = np.empty((7, k))
    (axis, *numbers) = cone
    cells = k, indices(corners, (4, k), p), read(deviation, (k,))
    kernel().exit_cells(p, read(w, (3, p)), read(s, (p,)), *cells, read(axis, (3,)), *numbers, written(out))
    return out


def capsule_bounds(
    grid: tuple[Array, Array, Array],
    capsules: tuple[Index, Array],
    rates: Array,
    reach: Array,
    moving: Array,
) -> Array:
    """Returns bounds (c, m, n), see `certificate.flight.patches`.

    Args:
        grid: positions (3, rows, n + 1), link poses (n + 1, 7, 4, 4) and lengths of the intervals (n,).
        capsules: frames (c,) and ends (c, 2, 3).
        rates: that move the frames (2, 7, n).
        reach: of the joints before them (7,).
        moving: bounds on speed and bend of the flights (2, m, n).
    """
    (x, X, h) = grid
    (frames, ends) = capsules
    (_, rows, columns) = x.shape
    c = len(frames)
    n = len(h)
    out = np.empty((c, max(1, rows - 1), n))
    scratch = np.empty((LINKS, rows, columns, 3))
    given = read(x, (3, rows, n + 1)), read(X, (n + 1, LINKS, 4, 4))
    bodies = c, indices(frames, (c,), LINKS), read(ends, (c, 2, 3))
    moved = read(rates, (2, LINKS, n)), read(reach, (LINKS,)), read(moving, (2, *out.shape[1:])), read(h, (n,))
    kernel().capsule_bounds(rows, n, *given, *bodies, *moved, written(scratch), written(out))
    return out


def patch_distances(poses: tuple[Array, Index], capsules: tuple[Index, Array], corners: Array) -> Array:
    """Returns rows (5, k), see `certificate.flight.patches`, of patches with corners (3, 4, k).

    Args:
        poses, corners: link poses (n, 7, 4, 4), and which are those of each patch (2, k); its corners.
        capsules: frames (k,) and ends (k, 2, 3).
    """
    (X, at) = poses
    (frames, ends) = capsules
    k = corners.shape[2]
    given = read(X, (len(X), LINKS, 4, 4)), indices(at, (2, k), len(X)), indices(frames, (k,), LINKS)
    out = np.empty((5, k))
    kernel().patch_distances(k, *given, read(ends, (k, 2, 3)), read(corners, (3, 4, k)), written(out))
    return out


def pieces_clear(scene: Pinned, ends: Array, numbers: Array, start: Array, end: Array) -> Array:
    """Returns 1 for each straight piece from postures `start` to `end`, both (n, 6), that is clear, 0 for others (n,).

    Args:
        scene, ends, numbers: see `planner.approach.rrt_connect.Obstacles`.
        start, end: the postures.
    """
    n = len(start)
    out = np.empty(n)
    given = read(start, (n, JOINTS)), read(end, (n, JOINTS))
    kernel().pieces_clear(*_scene(scene, ends, numbers), n, *given, written(out))
    return out


def grow_trees(
    scene: Pinned, ends: Array, numbers: Array, random: Array, step: float, trees: tuple[Array, Index, Index]
) -> Index:
    """Returns the state of two trees of clear pieces that grow until they meet; see `pieces_clear`.

    Args:
        scene, ends, numbers: see `pieces_clear`.
        random: postures (n, 6) towards which they grow in turn.
        step: by which at most.
        trees: their postures (2, most, 6) and parents (2, most), to which new ones are added in place, and state (6,):
            sizes of both, whose turn it is, where they met in each or -1, how many postures may yet be evaluated.

    Raises:
        ValueError: the arrays have other shapes, or do not lie in one piece.
        IndexError: the state is no such.
    """
    (q, parents, state) = trees
    (_, most, _) = q.shape
    if q.shape != (2, most, JOINTS) or parents.shape != (2, most) or state.shape != (STATE,):
        raise ValueError(f"two trees are {q.shape}, {parents.shape}, {state.shape}")
    indices(state[:2] - 1, (2,), most)
    indices(state[2:3], (1,), 2)
    now = state.copy()
    given = read(random, (len(random), JOINTS)), step, most
    kernel().grow_trees(*_scene(scene, ends, numbers), len(random), *given, *map(written, (q, parents, now)))
    return now


def _scene(scene: Pinned, ends: Array, numbers: Array) -> tuple[bytes | int, ...]:
    """Returns the arguments of paths.c that say what moves among what."""
    (_, capsules, pairs, shapes, _, _, rooms) = scene.arrays
    k = len(capsules)
    rows = (
        (LINKS, 4, 4),
        (k, 16),
        (len(pairs), 9),
        (len(shapes), SHAPE + 1),
        (7,),
        (len(shapes), k),
        (len(rooms), SHAPE + 1),
    )
    (chain, capsule, pair, shape, bounds, touching, room) = scene.of_shapes(*rows)
    indices(capsules[:, 0].astype(np.intp), (k,), LINKS)
    indices(pairs[:, :2].astype(np.intp), (len(pairs), 2), k)
    given = read(ends, (2, JOINTS)), read(numbers, (5,))
    return chain, k, capsule, len(pairs), pair, len(shapes), shape, bounds, touching, len(rooms), room, *given


def jacobians(X: Array, p_F: Array) -> Array:
    """Returns Jacobians (n, 6, 6) of a point `p_F` (3,) of the flange, linear rows first."""
    n = len(X)
    out = np.empty((len(X), JOINTS, JOINTS))
    kernel().jacobians(n, read(X, (n, LINKS, 4, 4)), read(p_F, (3,)), written(out))
    return out


def branches(X: Array, lengths: Array) -> Array:
    """Returns joint positions and missing reach (n, 8, 7) of flange poses `X` (n, 4, 4); `lengths` (8,)."""
    n = len(X)
    out = np.empty((len(X), BRANCHES, JOINTS + 1))
    kernel().branches(n, read(X, (n, 4, 4)), read(lengths, (8,)), written(out))
    return out


def least_norms(J: Array, weight: Array, v: Array, floor: float) -> Array:
    """Returns joint velocities (k, 6) for velocities `v` (k, 3), Jacobians `J` (n, 3, 6) taken in turn."""
    k = len(v)
    n = len(J)
    out = np.empty((len(v), JOINTS))
    given = read(v, (k, 3)), n, read(J, (n, 3, JOINTS)), read(weight, (JOINTS,))
    kernel().least_norms(k, *given, floor, written(out))
    return out


def largest_shares(qd: Array, qd_max: Array) -> Array:
    """Returns the largest shares (k,) of the limits (6,) in joint velocities `qd` (k, 6)."""
    k = len(qd)
    out = np.empty(len(qd))
    kernel().largest_shares(k, read(qd, (k, JOINTS)), read(qd_max, (JOINTS,)), written(out))
    return out


def lower_shares(
    states: tuple[Array, Array, Array], qd_max: Array, norms: Array, floors: tuple[float, float], times: int
) -> Array:
    """Returns joint velocities (k, 6) with smaller shares of the limits, see `_towards_maximum_norm`.

    Args:
        states: Jacobians (k, 3, 6), velocities (k, 3) and joint velocities (k, 6).
        qd_max: the limits (6,).
        norms: p of the norms in turn.
        floors: least share, and of the Gram matrix.
        times: refinements of each solution.
    """
    J, v, qd = states
    k = len(qd)
    out = np.empty((len(qd), JOINTS))
    given = read(J, (k, 3, JOINTS)), read(v, (k, 3)), read(qd, (k, JOINTS)), read(qd_max, (JOINTS,))
    steps = len(norms), read(norms, norms.shape), read(np.array(floors), (2,)), times
    kernel().lower_shares(k, *given, *steps, written(out))
    return out


def penalised_bounds(q: Array, qd: Array, start: Array, bounds: tuple[Array, Array], penalty: float) -> Array:
    """Returns lower bounds (k,) on launch times to `qd` (k, 6) in postures `q` (n, 6), taken in turn.

    Args:
        q, qd: joint states.
        start: posture (6,) from which they are launched.
        bounds: of velocity and acceleration (6,).
        penalty: per multiple of a speed limit.
    """
    k = len(qd)
    n = len(q)
    out = np.empty(len(qd))
    states = read(qd, (k, JOINTS)), n, read(q, (n, JOINTS))
    fixed = (read(values, (JOINTS,)) for values in (start, *bounds))
    kernel().penalised_bounds(k, *states, *fixed, penalty, written(out))
    return out


def distinct_rows(q: Array, least: float, most: int) -> Index:
    """Returns the first `most` rows of `q` (n, 6) that differ in some joint by more than `least` from others."""
    n = len(q)
    rows = np.empty(most, dtype=np.intp)
    kernel().distinct_rows(n, read(q, (n, JOINTS)), least, most, written(rows))
    return rows[rows >= 0]


def _chain(
    X: Array, rates: tuple[Array, Array], bodies: tuple[Array, Array, Array], upward: Array, p_F: Array
) -> tuple[bytes | int, ...]:
    """Returns copies of poses (n, 7, 4, 4), qd and qdd (n, 6), masses, what is fixed in the links, and two vectors."""
    n = len(X)
    (mass, fixed, principal) = bodies
    motion = read(X, (n, LINKS, 4, 4)), *(read(rate, (n, JOINTS)) for rate in rates)
    masses = read(mass, (JOINTS,)), read(fixed, (4, JOINTS, 3)), read(principal, (3, JOINTS))
    return *motion, *masses, read(upward, (3,)), read(p_F, (3,))

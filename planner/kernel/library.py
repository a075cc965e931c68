"""The compiled kernel: kernel.c as a library, and its functions on numpy arrays."""

from __future__ import annotations

import ctypes
import logging
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from planner.arrays import Array, Index
from planner.kernel.compilation import SHARED, compile_once, library_path

SOURCE = Path(__file__).with_name("kernel.c")
# Multiplications and additions are not fused, and no processor is asked for: every machine rounds alike.
FLAGS = ("-O2", "-ffp-contract=off", "-fno-math-errno", *SHARED)
# Arguments of each function, in order: a count, a number, or the address of an array.
SIGNATURES = {
    "link_poses": "naaaaa",
    "fixed_chain_poses": "naaaaa",
    "end_points": "nanaaa",
    "end_points_of": "naaaa",
    "point_velocity": "naaaa",
    "largest_between": "nanana",
    "chain_torques": "naaaaaaaaaa",
    "pair_distances": "nanaxa",
    "box_distances": "naaaaa",
    "drag_paths": "nanaaxxa",
    "drag_landings": "naxxxxxa",
}
TYPES = {"n": ctypes.c_ssize_t, "x": ctypes.c_double, "a": ctypes.c_void_p}
LINKS, JOINTS = 7, 6  # base and links; joints
STEPS_MAX = 100_000  # [-] of one interval of a flight
STATE, LANDING = 6, 8  # position and velocity of a flight; with time and apex
MEMORY = ctypes.c_char * 0  # of an array: its address


def compile_kernel() -> bool:
    """Compiles the kernel unless that is done, and returns whether it can be used; takes a quarter of a second.

    Raises:
        OSError: the cache folder cannot be written.
        subprocess.CalledProcessError: the compiler rejects the C.
    """
    compile_once(path(), FLAGS, SOURCE.read_text)
    loaded.cache_clear()
    return loaded() is not None


@cache
def loaded() -> Kernel | None:
    """Returns the kernel, None if it has not been compiled; compiles nothing."""
    file = path()
    if not file.exists():
        return None
    try:
        return Kernel(file)
    except (OSError, AttributeError) as error:
        logging.getLogger(__name__).warning("%s is not used, numpy is: %s", file, error)
        return None


def path() -> Path:
    """Returns the path of the compiled kernel, whether it exists or not."""
    return library_path("kernel", FLAGS, [SOURCE.read_bytes()])


class Kernel:
    """The functions of kernel.c, on arrays of any layout. Shapes are checked here, because C would not."""

    def __init__(self, path: Path) -> None:
        """Loads the library.

        Raises:
            OSError: it cannot be loaded.
            AttributeError: it lacks a function.
        """
        self._library = ctypes.CDLL(str(path))
        for name, signature in SIGNATURES.items():
            function = getattr(self._library, name)
            function.argtypes, function.restype = [TYPES[letter] for letter in signature], None

    def link_poses(self, cosine: Array, sine: Array, dh: Array, base: Array) -> Array:
        """Returns link poses (n, 7, 4, 4) for cosines and sines (n, 6) of the joints, see `kinematics.link_poses`."""
        n, X = len(cosine), np.empty((len(cosine), LINKS, 4, 4))
        rows = (n, JOINTS)
        joints = _in(cosine, rows), _in(sine, rows)
        self._library.link_poses(n, *joints, _in(dh, (4, JOINTS)), _in(base, (4, 4)), _out(X))
        return X

    def fixed_chain_poses(self, cosine: Array, sine: Array, fixed: Array, base: Array) -> Array:
        """Returns link poses (n, 7, 4, 4) of a measured chain with `fixed` transforms (6, 4, 4); see `link_poses`."""
        n, X = len(cosine), np.empty((len(cosine), LINKS, 4, 4))
        rows = (n, JOINTS)
        joints = _in(cosine, rows), _in(sine, rows)
        self._library.fixed_chain_poses(n, *joints, _in(fixed, (JOINTS, 4, 4)), _in(base, (4, 4)), _out(X))
        return X

    def end_points(self, X: Array, frames: Index, ends: Array) -> Array:
        """Returns ends (k, 2, 3, n) in the world of segments with `ends` (k, 2, 3) in `frames` (k,) of X."""
        n, k = len(X), len(frames)
        out = np.empty((k, 2, 3, n))
        poses, places = _in(X, (n, LINKS, 4, 4)), _rows(frames, (k,), LINKS)
        self._library.end_points(n, poses, k, places, _in(ends, (k, 2, 3)), _out(out))
        return out

    def end_points_of(self, X: Array, frames: Index, ends: Array) -> Array:
        """Returns ends (n, 2, 3) in the world of one segment an instant with `ends` (n, 2, 3) in `frames` (n,) of X."""
        n = len(X)
        out = np.empty((n, 2, 3))
        poses, places = _in(X, (n, LINKS, 4, 4)), _rows(frames, (n,), LINKS)
        self._library.end_points_of(n, poses, places, _in(ends, (n, 2, 3)), _out(out))
        return out

    def point_velocity(self, X: Array, qd: Array, point: Array) -> Array:
        """Returns velocities (3, n) of a point (3, n) that moves with the flange."""
        n, out = len(X), np.empty((3, len(X)))
        motion = _in(X, (n, LINKS, 4, 4)), _in(qd, (n, JOINTS))
        self._library.point_velocity(n, *motion, _in(point, (3, n)), _out(out))
        return out

    def largest_between(self, values: Array, rows: Index, closed: bool) -> Array:
        """Returns the largest sizes (c, k-1) of `values` (n, c) from each of `rows` (k,) to the next."""
        (n, c), k = values.shape, len(rows)
        out = np.empty((c, k - 1))
        chosen = _rows(rows, (k,), n if closed else n + 1)
        self._library.largest_between(c, _in(values, (n, c)), k, chosen, int(closed), _out(out))
        return out

    def chain_torques(
        self, X: Array, rates: tuple[Array, Array], bodies: tuple[Array, Array, Array], upward: Array, p_F: Array
    ) -> tuple[Array, Array]:
        """Returns the torques (6, n) of the links, and per kilogram at `p_F` of the flange; see `chain_torques`."""
        n, (mass, fixed, principal) = len(X), bodies
        motion = (_in(X, (n, LINKS, 4, 4)), *(_in(rate, (n, JOINTS)) for rate in rates))
        masses = _in(mass, (JOINTS,)), _in(fixed, (4, JOINTS, 3)), _in(principal, (3, JOINTS))
        out = np.empty((JOINTS, n)), np.empty((JOINTS, n))
        self._library.chain_torques(n, *motion, *masses, _in(upward, (3,)), _in(p_F, (3,)), *map(_out, out))
        return out

    def pair_distances(self, ends: Array, pairs: Index, shortest_m2: float) -> Array:
        """Returns the distances (p, n) of `pairs` (p, 2) of segments with `ends` (k, 2, 3, n)."""
        k, *_, n = ends.shape
        out, chosen = np.empty((len(pairs), n)), _rows(pairs, (len(pairs), 2), k)
        self._library.pair_distances(n, _in(ends, (k, 2, 3, n)), len(pairs), chosen, shortest_m2, _out(out))
        return out

    def box_distances(self, p0: Array, p1: Array, lower: Array, upper: Array) -> Array:
        """Returns the distances (n,) of segments p0-p1 from boxes, each (n, 3)."""
        n = len(p0)
        out = np.empty(n)
        self._library.box_distances(n, *(_in(x, (n, 3)) for x in (p0, p1, lower, upper)), _out(out))
        return out

    def drag_paths(self, states: Array, steps: Index, h: Array, air: tuple[float, float]) -> Array:
        """Returns positions (n, k, 3) of flights from `states` (n, 6), after k times of steps[j] steps of `h` (n, k).

        Args:
            states: positions and velocities (n, 6).
            steps: numbers of steps (k,).
            h: their durations (n, k).
            air: gravity and drag constant.
        """
        n, k = h.shape
        out, given = np.empty((n, k, 3)), (_in(states, (n, STATE)), k, _rows(steps, (k,), STEPS_MAX))
        self._library.drag_paths(n, *given, _in(h, (n, k)), *air, _out(out))
        return out

    def drag_landings(
        self, states: Array, plane_z: float, step: tuple[float, float], air: tuple[float, float]
    ) -> Array:
        """Returns landing state, time and apex (n, 8) of flights from `states` (n, 6) with gravity and drag `air`.

        Args:
            states: positions and velocities (n, 6).
            plane_z: height of the landing plane.
            step: duration of a step and of the longest flight.
            air: gravity and drag constant.
        """
        out = np.empty((len(states), LANDING))
        self._library.drag_landings(len(states), _in(states, (len(states), STATE)), plane_z, *step, *air, _out(out))
        return out


def _in(values: Array, shape: tuple[int, ...]) -> bytes:
    """Returns a copy of an argument, whatever its layout: 2 us where it is large, less than taking its address.

    Raises:
        ValueError: it has another shape, or does not hold doubles.
    """
    if values.shape != shape or values.dtype.char != "d":
        raise ValueError(f"an array of the kernel is {values.dtype} {values.shape} instead of float64 {shape}")
    return values.tobytes()


def _rows(values: Index, shape: tuple[int, ...], count: int) -> bytes:
    """Returns a copy of indices of rows.

    Raises:
        ValueError: they have another shape or type.
        IndexError: one is not a row of `count`.
    """
    if values.shape != shape or values.dtype != np.intp:
        raise ValueError(f"indices of the kernel are {values.dtype} {values.shape} instead of {shape}")
    if values.size and np.maximum.reduce(values.ravel().view(np.uintp)) >= count:  # a negative one is larger than any
        raise IndexError(f"an index of the kernel is outside [0, {count})")
    return values.tobytes()


def _out(values: Array) -> ctypes.Array[Any]:
    return MEMORY.from_buffer(values.data)

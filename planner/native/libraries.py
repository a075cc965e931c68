"""The compiled libraries: extension modules that ctypes loads. They export C functions, and no Python module."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

SUFFIX = ".abi3.so"
KERNEL = Path(__file__).with_name(f"kernel{SUFFIX}")
OPTIMISER = Path(__file__).with_name(f"optimiser{SUFFIX}")
# Arguments of each function of the kernel, in order: a count, a number, or the address of an array.
SIGNATURES = {
    "link_poses": "naaaaa",
    "flange_poses": "naaaaa",
    "fixed_chain_poses": "naaaaa",
    "end_points": "nanaaa",
    "end_points_of": "naaaa",
    "point_velocity": "naaaa",
    "point_acceleration": "naaaaa",
    "fastest": "naanaaa",
    "momentum": "naaaaa",
    "chain_torques": "naaaaaaaaa",
    "torque_terms": "naaaaaaaaa",
    "pair_distances": "nanaxa",
    "shape_distances": "naaaaa",
    "all_shape_distances": "naanaa",
    "drag_paths": "nanaaxxa",
    "drag_landings": "naxxxxxa",
    "states_at": "nannxaaaaa",
    "joint_rates": "naaaxnaa",
    "derivative_bounds": "nnaa",
    "load_bounds": "naaaaaaaxxa",
    "joint_extremes": "nxaaaaa",
    "ways": "naaaaaa",
    "exit_cells": "naanaaaxxxa",
    "capsule_bounds": "nnaanaaaaaaaa",
    "patch_distances": "naaaaaa",
    "pieces_clear": "anananaaanaaanaaa",
    "grow_trees": "anananaaanaaanaxnaaa",
    "jacobians": "naaa",
    "branches": "naaa",
    "least_norms": "nanaaxa",
    "largest_shares": "naaa",
    "lower_shares": "naaaanaana",
    "penalised_bounds": "nanaaaaxa",
    "distinct_rows": "naxna",
}
TYPES = {"n": ctypes.c_ssize_t, "x": ctypes.c_double, "a": ctypes.c_void_p}


@cache
def kernel(path: Path = KERNEL) -> ctypes.CDLL:
    """Returns the kernel.

    Raises:
        OSError: it cannot be loaded.
    """
    library = ctypes.CDLL(str(path))
    for name, signature in SIGNATURES.items():
        function = getattr(library, name)
        function.argtypes = [TYPES[letter] for letter in signature]
        function.restype = None
    return library

"""Samples in binary: a table of numbers with named columns. JSON and CSV are made from it when they are asked for.

Layout: `FLS1`, the length of the header (uint32), the header (JSON: columns, rows, about), then the numbers row by row
(float64). Little-endian. Numbers read back exactly, and so do the texts made from them.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import orjson
from numpy.typing import ArrayLike, NDArray

MAGIC = b"FLS1"
PREFIX = struct.Struct("<4sI")
KINDS = ("positions", "velocities", "accelerations")  # of a trajectory


def pack_samples(columns: Sequence[str], rows: ArrayLike, about: Mapping[str, Any] | None = None) -> bytes:
    """Returns the binary form of rows (n, columns) of numbers.

    Args:
        columns: Their names.
        rows: The numbers.
        about: Kept with them.
    """
    numbers = np.ascontiguousarray(rows, dtype="<f8").reshape(-1, len(columns))
    header = orjson.dumps({"columns": list(columns), "rows": len(numbers), "about": dict(about or {})})
    return PREFIX.pack(MAGIC, len(header)) + header + numbers.tobytes()


def unpack_samples(data: bytes) -> tuple[list[str], NDArray[np.float64], dict[str, Any]]:
    """Returns columns, rows (n, columns) and what was kept with them.

    Raises:
        ValueError: These are no samples.
    """
    magic, length = PREFIX.unpack_from(data)
    if magic != MAGIC:
        raise ValueError("these are no samples")
    header = orjson.loads(data[PREFIX.size : PREFIX.size + length])
    numbers = np.frombuffer(data, "<f8", offset=PREFIX.size + length)
    return header["columns"], numbers.reshape(header["rows"], len(header["columns"])), header["about"]


def samples_csv(data: bytes) -> bytes:
    """Returns samples as CSV with a header; the numbers read back exactly."""
    columns, rows, _ = unpack_samples(data)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows.tolist())]
    return ("\n".join(lines) + "\n").encode()


def samples_of_csv(text: bytes) -> bytes:
    """Returns the samples of a CSV with a header, as earlier versions of Fling wrote it."""
    header, *lines = text.decode().splitlines()
    return pack_samples(header.split(","), [[float(x) for x in line.split(",")] for line in lines])


def pack_trajectory(trajectory: Mapping[str, Any]) -> bytes:
    """Returns the samples of a plan's `trajectory`: time, then positions, velocities, accelerations of each joint."""
    joints = list(trajectory["joint_names"])
    time = np.asarray(trajectory["time_from_start"], dtype=np.float64)
    kinds = [np.asarray(trajectory[kind], dtype=np.float64).reshape(len(time), len(joints)) for kind in KINDS]
    columns = ["time_from_start", *(f"{kind}.{joint}" for kind in KINDS for joint in joints)]
    return pack_samples(columns, np.hstack([time[:, None], *kinds]), {"joint_names": joints})


def trajectory_json(data: bytes) -> bytes:
    """Returns a plan's `trajectory` as JSON."""
    _, rows, about = unpack_samples(data)
    joints = about["joint_names"]
    parts = np.ascontiguousarray(rows[:, 1:].reshape(-1, len(KINDS), len(joints)).transpose(1, 0, 2))
    document = {"joint_names": joints, "time_from_start": np.ascontiguousarray(rows[:, 0])}
    document |= dict(zip(KINDS, parts, strict=True))
    return orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY)


def join_plan(summary: bytes, samples: bytes) -> bytes:
    """Returns the JSON of a whole plan: its summary and its trajectory."""
    return summary.rstrip().removesuffix(b"}") + b',"trajectory":' + trajectory_json(samples) + b"}"


def split_plan(document: bytes) -> tuple[bytes, bytes]:
    """Returns summary and samples of the JSON of a whole plan."""
    plan = orjson.loads(document)
    samples = pack_trajectory(plan.pop("trajectory"))
    return orjson.dumps(plan), samples

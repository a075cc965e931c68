from __future__ import annotations

import csv
import io
import random
import struct

import pytest

from store import pack_samples, samples_of_csv
from store.samples import samples_csv, unpack_samples


def numbers(count: int) -> list[float]:
    """Returns finite numbers of every size, from random bits."""
    bits = random.Random(3)
    found = [struct.unpack("<d", bits.randbytes(8))[0] for _ in range(count)]
    return [x if x == x and abs(x) != float("inf") else 0.5 for x in found]


def test_samples_and_their_csv_read_back_exactly():
    rows = [numbers(60)[k : k + 3] for k in range(0, 60, 3)]
    data = pack_samples(["a", "b", "c"], rows, {"rate": 500})
    columns, read, about = unpack_samples(data)
    assert (columns, read.tolist(), about) == (["a", "b", "c"], rows, {"rate": 500})
    header, *lines = csv.reader(io.StringIO(samples_csv(data).decode()))
    assert header == columns
    assert [[float(x) for x in line] for line in lines] == rows
    assert samples_of_csv(samples_csv(data)) == pack_samples(columns, rows)


def test_no_rows_and_other_bytes():
    assert unpack_samples(pack_samples(["a", "b"], []))[1].shape == (0, 2)
    with pytest.raises(ValueError, match="no samples"):
        unpack_samples(b"MCAP0000")

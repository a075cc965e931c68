"""A map as Zarr, which xarray opens with its coordinates, units and reasons."""

from __future__ import annotations

import io
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from jobs.maps.document import state_word
from jobs.maps.landing_cells import LandingState
from jobs.maps.table import MapTable

DIMENSIONS = ("z", "y", "x")
FORMAT = 2  # of Zarr: every reader knows it, and it has texts of fixed length
CHUNK = 256  # [-] landing cells along x and y: the largest map of one plane has a few chunks
LONG_NAMES = {
    "release_time_s": ("release time of the certified plan", "s"),
    "shift_early_m": ("shift of the landing point for a release 10 ms early", "m"),
    "shift_late_m": ("shift of the landing point for a release 10 ms late", "m"),
    "hit_probability": ("probability that the throw hits", "1"),
    "margin": ("least margin of the certificate, as a share of its limit", "1"),
}
ZIP_DATE = (1980, 1, 1, 0, 0, 0)  # the least that the format knows: equal maps are equal files


class OutputUnavailable(Exception):
    """A library that writes a map is not installed: the message says how to get it."""

    def __init__(self, library: str) -> None:
        super().__init__(f"{library} is not installed: pip install 'fling-robotics[maps]'")


def write_zarr(folder: Path, table: MapTable, void: str | None = None) -> None:
    """Writes a map as a Zarr folder; one that is there is replaced.

    Args:
        folder: such as `floor.zarr`.
        table: the map.
        void: why it does not hold any more; None where it does.

    Raises:
        OutputUnavailable: zarr is not installed.
    """
    try:
        import zarr
    except ImportError:
        raise OutputUnavailable("zarr") from None
    group = zarr.open_group(str(folder), mode="w", zarr_format=FORMAT, attributes=_attributes(table, void))
    x, y = table.centres_m
    for name, values in (("x", x), ("y", y), ("z", np.array(table.definition.planes_z_m))):
        _add(group, name, values, (name,), {"units": "m", "long_name": f"{name} of the landing cell's centre"})
    _add(group, "state", table.state, DIMENSIONS, _flags([state.name.lower() for state in LandingState]))
    for name, (words, unit) in LONG_NAMES.items():
        _add(group, name, table.measures[name], DIMENSIONS, {"units": unit, "long_name": words})
    _add(group, "margin_check", table.check, DIMENSIONS, _flags(table.checks))
    _add(group, "reason", table.reason, DIMENSIONS, {"long_name": "row of the attribute `reasons`; -1: none"})
    _add(group, "plan_id", table.plan_ids, DIMENSIONS, {"long_name": "id of the certified plan"})
    zarr.consolidate_metadata(group.store, zarr_format=FORMAT)


def zarr_zip(table: MapTable, void: str | None = None) -> bytes:
    """Returns a map as a zipped Zarr; see `write_zarr`."""
    packed = io.BytesIO()
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(packed, "w", zipfile.ZIP_STORED) as archive:
        write_zarr(Path(folder), table, void)
        for path in sorted(Path(folder).rglob("*")):
            if path.is_file():
                entry = zipfile.ZipInfo(str(path.relative_to(folder)), ZIP_DATE)
                archive.writestr(entry, path.read_bytes())
    return packed.getvalue()


def _attributes(table: MapTable, void: str | None) -> dict[str, Any]:
    """Returns what a map says of itself."""
    row = table.row
    return {
        "title": f"Where {row.cell} can throw",
        "map": row.id,
        "cell_version": row.cell_version,
        "state": state_word(table, void),
        "void_because": void or "",
        "sha256": table.sha256,
        "reasons": [f"{constraint}: {text}" for constraint, text in table.reasons],
        **table.definition.document(),
    }


def _flags(meanings: Any) -> dict[str, Any]:
    """Returns the attributes of numbers that stand for words. Source: CF conventions, section 3.5."""
    return {"flag_values": list(range(len(meanings))), "flag_meanings": " ".join(meanings)}


def _add(group: Any, name: str, values: np.ndarray, dimensions: tuple[str, ...], attributes: dict[str, Any]) -> None:
    array = group.create_array(
        name,
        shape=values.shape,
        dtype=values.dtype,
        chunks=tuple(min(n, CHUNK) for n in values.shape),
        fill_value=None,  # every number is one: readers take a fill value for a missing one
        attributes={"_ARRAY_DIMENSIONS": list(dimensions), **attributes},
    )
    array[...] = values

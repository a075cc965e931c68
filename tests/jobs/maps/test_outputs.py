"""What a map is written as: arrays that xarray opens, pictures, a page, JSON; and when it is void."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from jobs.driver import drive
from jobs.maps import (
    DrivenMap,
    LandingState,
    MapInputs,
    map_document,
    map_html,
    map_picture,
    map_table,
    void_because,
    write_zarr,
    zarr_zip,
)
from jobs.maps.colours import STOPS, colours_of, map_colours
from planner.cell import CellSource
from store import Store
from tests.jobs.maps.planners import Killed, begun, definition, plan_all

INPUTS = MapInputs(CellSource("c", b"text"))
OF = definition((8, 9), planes=(0.0, 0.25))
EMPTY = "Fling is drawn without it: make setup"


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    store = Store.open(f"sqlite:///{tmp_path_factory.mktemp('map') / 'map.db'}")
    row = begun(store, OF)
    drive(DrivenMap(store, row, INPUTS), plan_all())
    yield map_table(store.map(row.id), store.landing_cells(row.id))
    store.close()


@pytest.fixture
def coarse(store):
    """A map of which only the first level is there."""
    row = begun(store, OF)
    with pytest.raises(Killed):
        drive(DrivenMap(store, row, INPUTS), plan_all(kill_after=[len(OF.level(0))]))
    return map_table(store.map(row.id), store.landing_cells(row.id))


@pytest.mark.slow
def test_xarray_opens_the_zarr_with_coordinates_units_and_reasons(table, tmp_path):
    pytest.importorskip("zarr", reason=EMPTY)
    xarray = pytest.importorskip("xarray", reason=EMPTY)
    write_zarr(tmp_path / "map.zarr", table, "the cell file has changed")
    write_zarr(tmp_path / "map.zarr", table, "the cell file has changed")  # replaces the one before
    found = xarray.open_zarr(tmp_path / "map.zarr")
    assert dict(found.sizes) == {"z": 2, "y": 8, "x": 9}
    np.testing.assert_allclose(found.x, -0.35 + 0.1 * np.arange(9))
    np.testing.assert_allclose(found.z, [0.0, 0.25])
    np.testing.assert_array_equal(found.state, table.state)
    np.testing.assert_array_equal(found.release_time_s, table.measures["release_time_s"])
    here = found.sel(x=-0.25, y=0.45, z=0.0, method="nearest")
    assert (float(here.shift_early_m), np.isnan(here.shift_late_m), float(here.margin)) == (0.02, True, 0.25)
    assert found.margin_check.flag_meanings.split()[int(here.margin_check)] == "b"
    assert (str(here.plan_id.values), found.release_time_s.units) == (table.plan_ids[0, 2, 1], "s")
    there = found.sel(x=-0.25, y=0.85, z=0.0, method="nearest")
    assert found.reasons[int(there.reason)].startswith("reach: 0.85 m against a limit of 0.7 m")
    assert (found.state.attrs["flag_meanings"].split()[2], found.void_because) == (
        "proven",
        "the cell file has changed",
    )


def test_a_zipped_zarr_is_opened_too_and_equal_maps_are_equal_files(table, tmp_path):
    zarr = pytest.importorskip("zarr", reason=EMPTY)
    xarray = pytest.importorskip("xarray", reason=EMPTY)
    (tmp_path / "map.zip").write_bytes(zarr_zip(table))
    with zarr.storage.ZipStore(tmp_path / "map.zip", mode="r") as packed:
        np.testing.assert_array_equal(xarray.open_zarr(packed).state, table.state)
    assert zarr_zip(table) == (tmp_path / "map.zip").read_bytes()


def test_the_picture_has_the_colour_of_each_landing_cell_with_y_upwards(table):
    image = pytest.importorskip("PIL.Image", reason=EMPTY)
    picture = map_picture(table, base_m=(0.0, 0.5))
    drawn = np.asarray(image.open(io.BytesIO(picture.png)))
    colours = map_colours(table)
    assert drawn.shape == (picture.height, picture.width, 3)
    for k, j, i in [(0, 0, 0), (0, 7, 8), (1, 2, 6), (1, 6, 3)]:
        box = picture.boxes[k]
        column = box.left + (i + 0.5) * box.cell_px
        row = box.top + (7 - j + 0.5) * box.cell_px
        assert tuple(drawn[int(row), int(column)]) == tuple(colours.pixels[k, j, i])


def test_a_void_map_says_so_on_its_picture(table):
    image = pytest.importorskip("PIL.Image", reason=EMPTY)
    red = [
        (np.asarray(image.open(io.BytesIO(map_picture(table, void).png))) == (190, 20, 20)).all(axis=-1).any()
        for void in (None, "the cell file has changed")
    ]
    assert red == [False, True]


def test_soon_is_bright_late_is_dark_and_refusals_are_grey(table):
    scale = (0.1, 0.5)
    np.testing.assert_array_equal(colours_of(np.array([0.1, 0.5, 0.9]), scale), STOPS[[0, -1, -1]])
    colours = map_colours(table)
    assert {(e.constraint, e.is_proven) for e in colours.greys} == {("reach", True), ("joint_jerk", False)}
    assert sum(e.count for e in colours.greys) == (table.state > LandingState.YES).sum()
    grey = (colours.pixels == colours.pixels[..., :1]).all(axis=-1)
    np.testing.assert_array_equal(grey, table.state > LandingState.YES)


def test_a_coarse_map_is_painted_in_blocks_of_its_level(coarse):
    stride = OF.strides[0]
    assert coarse.level_m == pytest.approx(stride * 0.1)
    assert coarse.answered == len(OF.level(0))
    pixels = map_colours(coarse).pixels
    assert not (pixels == 255).all(axis=-1).any()
    np.testing.assert_array_equal(pixels[0, 1, 1], pixels[0, 0, 0] if stride > 2 else pixels[0, 2, 2])


def test_the_page_asks_nobody_for_anything_and_says_what_is_known(table):
    pytest.importorskip("PIL", reason=EMPTY)
    page = map_html(table, "the cell <file> has changed")
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert "default-src 'none'" in page and "the cell &lt;file&gt; has changed" in page
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    assert data["planes"][0]["plans"][2][1] == table.plan_ids[0, 2, 1]


def test_the_json_is_a_plane_of_the_map(table, coarse):
    found = map_document(table, None, 1)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    head = [found[name] for name in ("plane_z_m", "shape", "origin", "state")]
    assert head == [0.25, [8, 9], [-0.35, 0.25], "finished"]
    assert found["progress"] == {"done": 144, "total": 144}
    values = found["values"]
    j = 2
    i = 1
    assert [values[name][j][i] for name in ("state", "landing_shift_10ms_m", "hit_probability")] == [1, 0.02, 0.5]
    assert (values["reason"][j][i], found["plans"][j][i]) == (None, table.plan_ids[1, j, i])
    assert values["state"][7][0] == 2 and values["release_time_s"][7][0] is None and found["plans"][7][0] is None
    assert found["reasons"][values["reason"][7][0]]["constraint"] == "reach"
    assert map_document(coarse)["values"]["state"][1][1] == 0


def test_a_map_is_void_where_cell_or_profile_changed_and_says_which():
    of = definition(profile="p1")
    assert void_because(of, of.cell_sha256, "p1") is None
    assert "cell file of 'c' has changed" in void_because(of, "other", "p1")
    assert "is gone" in void_because(of, None, "p1")
    assert "profile p1; the cell uses profile p2 now" in void_because(of, of.cell_sha256, "p2")
    assert "uses the cell file's own numbers now" in void_because(of, of.cell_sha256, None)


def test_nobody_works_on_a_running_map_that_was_not_heard_of_for_a_minute(store):
    row = begun(store, OF)
    assert map_document(map_table(row, []))["state"] == "running"
    old = replace(row, beat_at=row.beat_at - 61.0)
    assert map_document(map_table(old, []))["state"] == "waiting"
    assert map_document(map_table(row, []), "changed")["state"] == "void"

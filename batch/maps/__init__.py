"""Throwability maps: where an arm in its cell can throw, how soon and how surely, and why not elsewhere."""

from batch.maps.definition import RESOLUTION_M, MapDefinition, definition_from, landing_grid
from batch.maps.document import map_document, map_head
from batch.maps.landing_cells import LandingState
from batch.maps.making import MapInputs, PlanAll, make_map
from batch.maps.opening import MapRequest, begin_map, map_definition, map_inputs, why_void
from batch.maps.page import map_html
from batch.maps.picture import map_picture
from batch.maps.rounds import Step
from batch.maps.table import MapTable, map_table, void_because
from batch.maps.zarr_file import OutputUnavailable, write_zarr, zarr_zip

__all__ = [
    "RESOLUTION_M",
    "LandingState",
    "MapDefinition",
    "MapInputs",
    "MapRequest",
    "MapTable",
    "OutputUnavailable",
    "PlanAll",
    "Step",
    "begin_map",
    "definition_from",
    "landing_grid",
    "make_map",
    "map_definition",
    "map_document",
    "map_head",
    "map_html",
    "map_inputs",
    "map_picture",
    "map_table",
    "void_because",
    "why_void",
    "write_zarr",
    "zarr_zip",
]

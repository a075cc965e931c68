"""Throwability maps: where an arm in its cell can throw, how soon and how surely, and why not elsewhere."""

from jobs.maps.definition import RESOLUTION_M, MapDefinition, definition_from, landing_grid
from jobs.maps.document import map_document, map_head
from jobs.maps.driven import DrivenMap, MapInputs
from jobs.maps.landing_cells import LandingState
from jobs.maps.opening import MapRequest, begin_map, map_definition, map_inputs, why_void
from jobs.maps.page import map_html
from jobs.maps.picture import map_picture
from jobs.maps.rounds import Step
from jobs.maps.table import MapTable, map_table, void_because
from jobs.maps.zarr_file import OutputUnavailable, write_zarr, zarr_zip

__all__ = [
    "RESOLUTION_M",
    "LandingState",
    "MapDefinition",
    "MapInputs",
    "MapRequest",
    "MapTable",
    "DrivenMap",
    "OutputUnavailable",
    "Step",
    "begin_map",
    "definition_from",
    "landing_grid",
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

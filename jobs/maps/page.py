"""A map as one self-contained HTML file: the picture, what each landing cell says under the pointer, and a table."""

from __future__ import annotations

import base64
import html
import json
from pathlib import Path
from typing import Any

import numpy as np

from jobs.maps.colours import map_colours
from jobs.maps.document import map_document
from jobs.maps.landing_cells import LandingState
from jobs.maps.picture import map_picture, title_lines
from jobs.maps.table import MapTable

PROGRAM = Path(__file__).with_name("pointer.js")
# A map asks no other machine for anything: the browser is told to refuse it.
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
STYLE = (
    "body{font:16px/1.4 system-ui,sans-serif;margin:1.5rem;color:#141414;background:#fff}"
    "img{max-width:100%;height:auto}#said{min-height:4.5em;font-variant-numeric:tabular-nums}"
    "td,th{text-align:left;padding:.15rem 1rem .15rem 0;vertical-align:top}.void{color:#be1414;font-weight:bold}"
)


def map_html(table: MapTable, void: str | None = None, base_m: tuple[float, float] | None = None) -> str:
    """Returns a map as HTML; see `map_picture`.

    Raises:
        OutputUnavailable: Pillow is not installed.
    """
    picture = map_picture(table, void, base_m)
    first, second = (html.escape(line) for line in title_lines(table, void))
    image = base64.b64encode(picture.png).decode()
    size = f'width="{picture.width}" height="{picture.height}"'
    parts = (
        f"<h1>{first}</h1><p>{second}</p>",
        f'<p class="void">Void: {html.escape(void)}</p>' if void else "",
        f'<img id="map" alt="{first}" {size} src="data:image/png;base64,{image}">',
        '<p id="said">Point at a landing cell to read it.</p>',
        _table(table),
    )
    data = {"boxes": [vars(box) for box in picture.boxes], "width": picture.width, "planes": _planes(table, void)}
    text = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    program = PROGRAM.read_text(encoding="utf-8")
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}"><title>{first}</title><style>{STYLE}</style>'
    )
    body = f'{"".join(parts)}<script type="application/json" id="data">{text}</script><script>{program}</script>'
    return f'<!doctype html>\n<html lang="en"><head>{head}</head><body>{body}</body></html>\n'


def _planes(table: MapTable, void: str | None) -> list[dict[str, Any]]:
    """Returns what the pointer reads: the planes, with numbers rounded to what a person reads."""
    planes = []
    for k in range(len(table.definition.planes_z_m)):
        plane = map_document(table, void, k)
        values = {name: _rounded(rows) for name, rows in plane["values"].items()}
        reasons = [f"{each['constraint']}: {each['text']}" for each in plane["reasons"]]
        kept = {name: plane[name] for name in ("plane_z_m", "resolution_m", "origin", "shape", "plans")}
        planes.append({**kept, "values": values, "reasons": reasons})
    return planes


def _rounded(rows: list[list[Any]]) -> list[list[Any]]:
    return [[round(value, 4) if isinstance(value, float) else value for value in row] for row in rows]


def _table(table: MapTable) -> str:
    """Returns how many landing cells there are of each kind, and what their plans are like."""
    times = table.measures["release_time_s"]
    shifts = table.landing_shift_m
    rows = [("planned and certified", str(table.count_of(LandingState.YES)))]
    rows += [(entry.words.rpartition(":")[0], str(entry.count)) for entry in map_colours(table).greys]
    rows += [("not planned yet", str(table.count_of(LandingState.UNKNOWN)))]
    if np.isfinite(times).any():
        low, middle, high = np.nanpercentile(times, (0, 50, 100)) * 1000.0
        rows.append(("release after, least, median, most", f"{low:.0f}, {middle:.0f}, {high:.0f} ms"))
        shift = np.nanpercentile(shifts, 50) * 1000.0 if np.isfinite(shifts).any() else np.nan
        rows.append(("shift of the landing for 10 ms, median", f"{shift:.0f} mm"))
        odds = table.measures["hit_probability"]
        if np.isfinite(odds).any():
            rows.append(("hit probability, median", f"{np.nanpercentile(odds, 50):.2f}"))
    lines = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in rows)
    return f"<table>{lines}</table>"

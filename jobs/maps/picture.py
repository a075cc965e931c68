"""A map as a picture: its planes with axes, scale and legend, as PNG."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from jobs.maps.colours import MapColours, colours_of, map_colours
from jobs.maps.document import state_word
from jobs.maps.landing_cells import LandingState
from jobs.maps.table import MapTable
from jobs.maps.zarr_file import OutputUnavailable

PLOT_PX = 720
SMALL_PX = 300  # [px] longer side of a plane by itself, and of one of many
COLUMNS = 4  # planes beside each other
TOP = 92
LEFT = 70
BETWEEN = 34
LEGEND = 330  # [px] room for the title, the numbers beside, between planes, the legend
SCALE_PX = (22, 260)
SWATCH_PX = 16  # [px] of the scale of colours, and of a grey in the legend
FONT = 20
SMALL_FONT = 15  # [px]
INK = (20, 20, 20)
VOID_INK = (190, 20, 20)
TICKS = 6  # numbers along an axis, about
LEGEND_MAX = 14  # greys in the legend


@dataclass(frozen=True)
class PlaneBox:
    """Where a plane is in the picture: its upper left corner, and the size of a landing cell [px]."""

    left: int
    top: int
    cell_px: float


@dataclass(frozen=True)
class MapPicture:
    """A picture of a map.

    Attributes:
        png: the file.
        width, height: [px].
        boxes: of the planes.
    """

    png: bytes
    width: int
    height: int
    boxes: tuple[PlaneBox, ...]


def map_picture(table: MapTable, void: str | None = None, base_m: tuple[float, float] | None = None) -> MapPicture:
    """Returns a map as PNG.

    Args:
        table: the map.
        void: why it does not hold any more; None where it does.
        base_m: where the arm stands, x and y [m]; it is marked.

    Raises:
        OutputUnavailable: Pillow is not installed.
    """
    try:
        from PIL import Image, ImageDraw, ImageFont
    except ImportError:
        raise OutputUnavailable("Pillow") from None
    colours = map_colours(table)
    boxes = _boxes(table)
    rows, columns = table.definition.shape
    side = boxes[0].cell_px
    width = round(max(box.left for box in boxes) + columns * side) + LEGEND
    height = max(round(max(box.top for box in boxes) + rows * side) + 60, TOP + SCALE_PX[1] + 60 + 24 * LEGEND_MAX)
    image = Image.new("RGB", (width, height), (255, 255, 255))
    draw = ImageDraw.Draw(image)
    fonts = ImageFont.load_default(FONT), ImageFont.load_default(SMALL_FONT)
    sheet = _Sheet(image, draw, *fonts)
    for k, box in enumerate(boxes):
        plane = Image.fromarray(np.ascontiguousarray(colours.pixels[k, ::-1]))  # y points up
        size = (round(columns * side), round(rows * side))
        image.paste(plane.resize(size, Image.Resampling.NEAREST), (box.left, box.top))
        sheet.axes(table, box, size, k)
        if base_m is not None:
            sheet.base(table, box, size, base_m)
    sheet.title(table, void)
    sheet.legend(colours, width - LEGEND + 24)
    packed = io.BytesIO()
    image.save(packed, "PNG", optimize=True)
    return MapPicture(packed.getvalue(), width, height, tuple(boxes))


def title_lines(table: MapTable, void: str | None) -> tuple[str, str]:
    """Returns what a map is of, and what it was made with, in a line each."""
    definition = table.definition
    row = table.row
    low = definition.planes_z_m[0]
    high = definition.planes_z_m[-1]
    where = f"z = {low:g} m" if low == high else f"z = {low:g} to {high:g} m"
    kind = "robust" if definition.robust else "soonest"
    profile = "the cell file's own numbers" if definition.profile is None else f"profile {definition.profile[:8]}"
    level = "" if table.level_m in (None, definition.resolution_m) else f" (so far {table.level_m:g} m)"
    first = f"Where {row.cell} can throw, {where}: {kind} plans, {state_word(table, void)}"
    planned = f"{table.count_of(LandingState.YES)} of {definition.count} landing cells"
    second = f"cell version {row.cell_version}, {profile}, Fling {definition.planner_version}"
    return first, f"{planned} of {definition.resolution_m:g} m{level}; {second}"


def _boxes(table: MapTable) -> list[PlaneBox]:
    rows, columns = table.definition.shape
    count = len(table.definition.planes_z_m)
    side = (PLOT_PX if count == 1 else SMALL_PX) / max(rows, columns)
    side = max(1.0, math.floor(side)) if side >= 1.0 else side
    step_x = round(columns * side) + LEFT + BETWEEN
    step_y = round(rows * side) + BETWEEN + 40
    return [PlaneBox(LEFT + k % COLUMNS * step_x, TOP + 24 + k // COLUMNS * step_y, side) for k in range(count)]


@dataclass(frozen=True, eq=False)
class _Sheet:
    """What is drawn on, and with which letters."""

    image: Any
    draw: Any
    font: Any
    small: Any

    def title(self, table: MapTable, void: str | None) -> None:
        first, second = title_lines(table, void)
        self.draw.text((LEFT, 14), first, INK, self.font)
        self.draw.text((LEFT, 42), second, INK, self.small)
        if void is not None:
            self.draw.text((LEFT, 64), f"VOID: {void}", VOID_INK, self.small)

    def axes(self, table: MapTable, box: PlaneBox, size: tuple[int, int], k: int) -> None:
        """Draws a frame, numbers in metres along both axes, and the height of one of many planes."""
        resolution = table.definition.resolution_m
        (x0, y0) = table.definition.origin_m
        right = box.left + size[0]
        bottom = box.top + size[1]
        self.draw.rectangle((box.left - 1, box.top - 1, right, bottom), outline=INK)
        for value in _ticks(x0, size[0] / box.cell_px * resolution):
            at = box.left + (value - x0 + resolution / 2) / resolution * box.cell_px
            self.draw.line((at, bottom, at, bottom + 5), INK)
            self.draw.text((at, bottom + 7), f"{value:g}", INK, self.small, anchor="mt")
        for value in _ticks(y0, size[1] / box.cell_px * resolution):
            at = bottom - (value - y0 + resolution / 2) / resolution * box.cell_px
            self.draw.line((box.left - 6, at, box.left - 1, at), INK)
            self.draw.text((box.left - 9, at), f"{value:g}", INK, self.small, anchor="rm")
        self.draw.text((right, bottom + 26), "x [m]", INK, self.small, anchor="rt")
        self.draw.text((box.left - 9, box.top - 4), "y [m]", INK, self.small, anchor="rb")
        if len(table.definition.planes_z_m) > 1:
            words = f"z = {table.definition.planes_z_m[k]:g} m"
            self.draw.text((box.left, box.top - 6), words, INK, self.small, anchor="lb")

    def base(self, table: MapTable, box: PlaneBox, size: tuple[int, int], base_m: tuple[float, float]) -> None:
        """Marks where the arm stands, where that is on the map."""
        resolution = table.definition.resolution_m
        origin = table.definition.origin_m
        x, y = ((at - x0 + resolution / 2) / resolution * box.cell_px for at, x0 in zip(base_m, origin, strict=True))
        if 0.0 <= x <= size[0] and 0.0 <= y <= size[1]:
            x = box.left + x
            y = box.top + size[1] - y
            self.draw.ellipse((x - 6, y - 6, x + 6, y + 6), outline=(255, 255, 255), fill=INK, width=2)

    def legend(self, colours: MapColours, left: int) -> None:
        """Draws the scale of release times, and the greys with their reasons."""
        width, length = SCALE_PX
        top = TOP + 24
        if colours.scale_s is not None:
            low, high = colours.scale_s
            shades = colours_of(np.linspace(low, high, length), colours.scale_s)
            for k, shade in enumerate(shades):
                self.draw.line((left, top + k, left + width, top + k), tuple(shade.tolist()))
            for share in np.linspace(0.0, 1.0, 5):
                late = " or later" if share == 1.0 else ""
                words = f"{1000 * (low + share * (high - low)):.0f} ms{late}"
                self.draw.text((left + width + 8, top + share * length), words, INK, self.small, anchor="lm")
            self.draw.text((left, top - 26), "release after", INK, self.small)
        top += length + 34
        entries = [(entry.words, (entry.grey,) * 3) for entry in colours.greys[:LEGEND_MAX]]
        for words, shade in [*entries, ("not planned yet", (255, 255, 255))]:
            self.draw.rectangle((left, top, left + SWATCH_PX, top + SWATCH_PX), fill=shade, outline=INK)
            self.draw.text((left + SWATCH_PX + 8, top + SWATCH_PX / 2), words, INK, self.small, anchor="lm")
            top += 24


def _ticks(first_m: float, length_m: float) -> list[float]:
    """Returns round numbers along an axis that begins at `first_m` [m]."""
    step = 10.0 ** math.floor(math.log10(length_m / TICKS))
    step *= next(factor for factor in (1.0, 2.0, 5.0, 10.0) if length_m / (step * factor) <= TICKS)
    begin = math.ceil(first_m / step - 1e-9)
    return [round(n * step, 9) for n in range(begin, begin + TICKS + 2) if n * step <= first_m + length_m + 1e-9]

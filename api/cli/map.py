"""`fling map`: where a cell can throw, without a service."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.errors import Finite
from api.cli.support.exit_status import INTERRUPTED, exit_status
from api.cli.support.options import cell_option, json_option
from api.cli.support.terminal import say

if TYPE_CHECKING:
    from jobs.maps import MapRequest, MapTable, Step
    from planner.cell import CellSource
    from store import MapRow, Store

KINDS = (".zarr", ".png", ".html")  # of output files; a path without a suffix is a folder for all of them


@click.command("map")
@cell_option()
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS.")
@click.option("--plane", "plane_z_m", type=Finite(), help="Height of the plane [m]; default: the cell's floor.")
@click.option("--volume", "volume_m", type=(Finite(),) * 2, help="Lowest and highest plane [m], a resolution apart.")
@click.option("--resolution", "resolution_m", type=Finite(), default=0.05, show_default=True, help="Landing cell [m].")
@click.option("--extent", "extent_m", type=(Finite(),) * 4, help="X0 X1 Y0 Y1 [m]; default: the range.")
@click.option("--robust", is_flag=True, help="Plans with a release window; default: those that release soonest.")
@click.option("--out", multiple=True, type=click.Path(path_type=Path), help="FILE.zarr, .png, .html, or a folder.")
@click.option("--workers", type=click.IntRange(1), help="Planner processes; default: one a core.")
@click.option("--ray", "ray_address", envvar="FLING_RAY_ADDRESS", help="Address of a Ray cluster.")
@json_option
def map_command(
    cell: str | None,
    cells: Path | None,
    out: tuple[Path, ...],
    workers: int | None,
    ray_address: str | None,
    as_json: bool,
    **asked: Any,
) -> None:
    """Plan a throw to every landing cell of a plane or a volume: how soon and how surely, or why not.

    Coarse points come first; the files of --out are written after each level. Every answer is stored: after an
    interruption the same command resumes.
    """
    from jobs.maps import MapRequest
    from store import Store

    _check_outputs(out)
    settings, source = _cell(cell, cells)
    store = Store.open(settings.database_url)
    try:
        work = _MapCommand(store, source, MapRequest(**asked), out, as_json)
        state = work.run(workers, ray_address)
    finally:
        store.close()
    if state != "finished":
        sys.exit(exit_status("solver-failed"))


class _MapCommand:
    """One call of the command: makes the map, says how far it is, writes its files."""

    def __init__(
        self, store: Store, source: CellSource, request: MapRequest, out: Sequence[Path], as_json: bool
    ) -> None:
        from api import fling_version
        from jobs.maps import begin_map

        self.store = store
        self.source = source
        self.out = out
        self.as_json = as_json
        self.row: MapRow = begin_map(store, source, request, fling_version(), "command")

    def run(self, workers: int | None, ray_address: str | None) -> str:
        """Makes the map. Returns its state in the end."""
        known = self.store.landing_cell_count(self.row.id)
        if known and self.row.state != "finished":
            self._say(f"map {self.row.id} resumes: {known} landing cells are answered already")
        try:
            state = self.row.state if self.row.state == "finished" else self._make(workers, ray_address)
        except KeyboardInterrupt:
            self.store.end_map(self.row.id, "cancelled")
            done = self.store.landing_cell_count(self.row.id)
            self._say(f"interrupted: {done} landing cells are stored; the same command resumes the map")
            sys.exit(INTERRUPTED)
        self._conclude(state)
        return state

    def _make(self, workers: int | None, ray_address: str | None) -> str:
        from jobs import driver
        from jobs.maps import DrivenMap, map_inputs
        from jobs.pool import PoolBroken

        task = DrivenMap(self.store, self.row, map_inputs(self.store, self.row), self._report)
        try:
            driver.run(task, workers, ray_address)
        except PoolBroken as error:
            self.store.end_map(self.row.id, "cancelled")
            raise click.ClickException(str(error)) from error
        return self._table().row.state

    def _report(self, step: Step, done: int, total: int) -> None:
        """Says how far a step is: on a terminal in place, elsewhere when it is completed."""
        if self.out and done == total and step.numbers:
            self._write(self._table())
        what = f"{step.level_m:g} m" if step.round == 0 else f"from neighbours, round {step.round}"
        if sys.stderr.isatty() and not self.as_json and total:
            click.echo(f"\r{what}: {done} of {total}", nl=done == total, err=True)
        elif done == total and total:
            self._say(f"{what}: {total} landing cells")

    def _conclude(self, state: str) -> None:
        table = self._table()
        self._write(table)
        if self.as_json:
            click.echo(json.dumps(_summary(table, state)))
        else:
            say("\n".join(_words(table, state, self.out)))

    def _table(self) -> MapTable:
        from jobs.maps import map_table

        row = self.store.map(self.row.id)
        assert row is not None  # it was begun, and nobody deletes maps
        return map_table(row, self.store.landing_cells(row.id))

    def _write(self, table: MapTable) -> None:
        from jobs.maps import map_html, map_picture, why_void, write_zarr
        from planner.cell import cell_of

        void = why_void(self.store, table.row, self.source)
        x, y = cell_of(self.source).X_WB[:2, 3].tolist()
        for path in _files(self.out):
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.suffix == ".zarr":
                write_zarr(path, table, void)
            elif path.suffix == ".png":
                path.write_bytes(map_picture(table, void, (x, y)).png)
            else:
                path.write_text(map_html(table, void, (x, y)), encoding="utf-8")

    def _say(self, text: str) -> None:
        if not self.as_json:
            click.echo(text, err=True)


def _cell(name: str | None, cells: Path | None) -> tuple[Any, CellSource]:
    """Returns the settings and the content of the cell's files.

    Raises:
        click.ClickException: there is no such cell.
        SettingsError: a setting is wrong.
        CellError: its file is refused.
    """
    from api.cell_repository import CellRepository, UnknownCell
    from api.settings import read_settings

    settings = read_settings(cells=cells)
    try:
        source, _ = CellRepository(settings.cells).required(name or settings.default_cell)
    except UnknownCell as error:
        raise click.ClickException(str(error)) from None
    return settings, source


def _check_outputs(out: Sequence[Path]) -> None:
    """Refuses what cannot be written, before hours of planning.

    Raises:
        click.UsageError: a suffix is none of `KINDS`.
        click.ClickException: a library is missing.
    """
    from importlib.util import find_spec

    for path in _files(out):
        if path.suffix not in KINDS:
            raise click.UsageError(f"--out {path}: a map is written as {', '.join(KINDS)}, or into a folder")
        library = "zarr" if path.suffix == ".zarr" else "PIL"
        if find_spec(library) is None:
            raise click.ClickException(f"{path}: {library} is not installed: pip install 'fling-robotics[maps]'")


def _files(out: Sequence[Path]) -> list[Path]:
    """Returns the files of the option --out: a folder has one of each kind."""
    files = []
    for path in out:
        files += [path] if path.suffix else [path / f"map{kind}" for kind in KINDS]
    return files


def _summary(table: MapTable, state: str) -> dict[str, Any]:
    from jobs.maps import LandingState

    counts = {each.name.lower(): table.count_of(each) for each in LandingState}
    head = {"id": table.row.id, "cell": table.row.cell, "cell_version": table.row.cell_version, "state": state}
    return head | {"definition": table.definition.document(), "counts": counts, "sha256": table.sha256}


def _words(table: MapTable, state: str, out: Sequence[Path]) -> list[str]:
    """Returns the summary for a person."""
    from jobs.maps import LandingState

    yes, proven, missing, unknown = (
        table.count_of(each)
        for each in (LandingState.YES, LandingState.PROVEN, LandingState.NOT_FOUND, LandingState.UNKNOWN)
    )
    lines = [
        f"map {table.row.id}, {state}: {yes} of {table.definition.count} landing cells planned and certified",
        f"  refused: {proven} proven, {missing} not found",
    ]
    if unknown:
        lines.append(f"  {unknown} have no answer: their search was cut off; the same command tries them again")
    return [*lines, *(f"  {path}" for path in _files(out))]

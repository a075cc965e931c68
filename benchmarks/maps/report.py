"""The report on maps: times, kills, truth, and the picture."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import fling
from benchmarks.maps.runs import MapMeasurement, run_map
from benchmarks.maps.truth import Certified, PlannedAgain, certify_again, plan_again, trajectories_sha256
from benchmarks.results import machine, machine_words
from jobs.maps import LandingState, MapRequest, map_picture
from planner.cell import CellSource, cell_of

KILLS = (0.02, 0.15, 0.4, 0.7, 0.95)  # [-] of the answers: in every level, and near the end


@dataclass(frozen=True)
class MapTask:
    """What is measured.

    Attributes:
        source: content of the cell's files.
        request: what the map is to show.
        sample: number of landing cells that are planned again.
        workers: number of planner processes.
        command: that measures it.
    """

    source: CellSource
    request: MapRequest
    sample: int
    workers: int
    command: str


def maps_report(task: MapTask, picture: Path) -> str:
    """Measures a map and returns the page.

    Args:
        task: what is measured.
        picture: file of the map's picture.
    """
    about = machine()
    with tempfile.TemporaryDirectory() as folder:
        calm = _run(task, Path(folder) / "calm")
        killed = _run(task, Path(folder) / "killed", KILLS)
        certified = certify_again(calm, task.source)
        again = plan_again(calm, task.source, task.sample, task.workers)
        same = calm.table.sha256 == killed.table.sha256 and trajectories_sha256(calm) == trajectories_sha256(killed)
    x, y = cell_of(task.source).X_WB[:2, 3].tolist()
    picture.parent.mkdir(parents=True, exist_ok=True)
    picture.write_bytes(map_picture(calm.table, None, (x, y)).png)
    sections = [
        "# Throwability maps",
        f"{machine_words(about)} Written by `{task.command}`.",
        f"![The map]({picture.name})",
        _times(calm, task),
        _kills(calm, killed, same),
        _truth(calm, certified, again),
    ]
    return "\n\n".join(sections) + "\n"


def _run(task: MapTask, folder: Path, kill_at: tuple[float, ...] = ()) -> MapMeasurement:
    folder.mkdir()
    return run_map(folder, task.source, task.request, fling.__version__, task.workers, kill_at)


def _times(made: MapMeasurement, task: MapTask) -> str:
    definition = made.table.definition
    table = made.table
    rows, columns = definition.shape
    lines = [f"| {level:g} m | {at:.0f} s |" for level, at in made.levels_s]
    yes, proven, missing = (
        table.count_of(state) for state in (LandingState.YES, LandingState.PROVEN, LandingState.NOT_FOUND)
    )
    return (
        f"## Times\n\n{columns} × {rows} landing cells of {definition.resolution_m:g} m, "
        f"{'robust' if definition.robust else 'soonest'} plans, {task.workers} planner processes, from the start of "
        f"the process on: {made.duration_s:.0f} s in all, {1000 * made.duration_s / definition.count:.0f} ms a landing "
        f"cell.\n\n| points every | completed after |\n|---|---|\n" + "\n".join(lines) + "\n\n"
        f"{yes} landing cells have a plan; {proven} are refused with proof, {missing} were searched for in vain. "
        f"The store has {made.store_bytes / 1e6:.0f} MB: {made.store_bytes / max(yes, 1) / 1000:.0f} kB a plan."
    )


def _kills(calm: MapMeasurement, killed: MapMeasurement, same: bool) -> str:
    at = ", ".join(str(count) for count in killed.kills)
    verdict = "**the same to the bit**" if same else "**NOT THE SAME**"
    return (
        f"## Killed and resumed\n\nA second map in a store of its own; its process was killed with SIGKILL after {at} "
        f"answers and begun again each time. Answers, reasons and the bytes of all trajectories are {verdict} as those "
        f"of the map that nothing disturbed (`{calm.table.sha256[:16]}`, `{killed.table.sha256[:16]}`)."
    )


def _truth(made: MapMeasurement, certified: Certified, again: PlannedAgain) -> str:
    share = again.only_alone / max(again.asked, 1)
    return (
        "## Truth\n\n"
        f"Every stored plan was read and certified again: {certified.valid} valid, {certified.invalid} invalid, "
        f"{certified.misplaced} for another target or release time than the map says. {again.asked} landing cells, "
        f"drawn at random, were planned again by an ordinary request each: {again.same} have the same plan to the bit, "
        f"{again.other} another plan, {again.neither} none; {again.only_map} have a plan in the map only, "
        f"{again.only_alone} ({share:.1%}) by themselves only. Of the {again.refused} refused without proof, "
        f"{again.aside} have a plan to a target 1 cm beside their centre."
    )

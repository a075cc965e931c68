"""`python -m benchmarks.fault_matrix [--mode script]`: every fault in every phase, on three controllers; writes a page.

Three quarters of an hour on a quiet machine. The exit status is 1 where something does not hold in a cell of the table.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import psutil

from benchmarks.markdown import markdown_table
from benchmarks.results import machine, machine_words, write_report
from tests.system.fault_matrix import (
    FAULT,
    FAULTS,
    GRIP_SENSOR,
    GRIPPER_FAULTS,
    INPUT_FAULTS,
    PHASES,
    REST_S,
    ROBOTIQ,
    STREAMED,
    THROWS,
    CellResult,
    Fault,
    Phase,
    run_cell,
)
from tests.system.rig import CELLS, Rig

ROOT = Path(__file__).parents[1]
MODES = ("speedj", "servoj", "script")
TRIES = 3  # of a cell: a machine that stalls may miss the moment
METHOD = f"""\
Milliseconds from the fault to the arm's last motion, by the simulator's own account of it: the worst of `ur5e-sim`
(500 Hz, PolyScope 5), `ur5e-sim-x` (the same with PolyScope X, which has no dashboard) and `ur5-sim` (125 Hz, CB3), or
of those that were asked for. At most {1e3 * REST_S:.0f} are promised; "on" where the run went on and was completed as
planned. Approaches at 2 rad/s, a launch that reaches 2.5 rad/s. What else holds in every cell: the object is kept,
lands as planned, or is told lost. The last rows are of a gripper on a network, and of one whose grip an input shows, in
the phases of a streamed throw: as planned is there what its command times allow, and an object lost while the fingers
are told to open is "untold"."""


def main(argv: Sequence[str]) -> int:
    """Runs the table, writes the page and returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fault_matrix", description=__doc__)
    parser.add_argument("--cell", dest="cells", action="append", choices=[*CELLS], help="default: all three")
    parser.add_argument("--phase", dest="phases", action="append", choices=[phase.name for phase in PHASES])
    parser.add_argument("--mode", choices=MODES, default="speedj", help="how motions are made")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "benchmarks")
    given = parser.parse_args(argv)
    where = machine_words(machine())
    possible = [phase for phase in PHASES if given.mode != "script" or phase not in STREAMED]
    phases = [phase for phase in possible if given.phases is None or phase.name in given.phases]
    throws = [phase for phase in phases if phase in THROWS and given.mode != "script"]
    names = given.cells or [*CELLS]
    results = []
    for name in names:
        results += run_table(name, phases, FAULTS, given.mode)
        results += run_table(name, throws, GRIPPER_FAULTS, given.mode, ROBOTIQ)
        results += run_table(name, throws, INPUT_FAULTS, given.mode, GRIP_SENSOR)
    broken = [result for result in results if result.broken()]
    page = "fault-matrix.md" if given.mode == "speedj" else f"fault-matrix-{given.mode}.md"
    write_report(_page(f"{where}; {given.mode}", phases, results, broken), given.out, page)
    of_grippers = len(GRIPPER_FAULTS) + len(INPUT_FAULTS)
    cells = (len(phases) * len(FAULTS) + len(throws) * of_grippers) * len(names)
    return 1 if broken or len(results) < cells else 0


def run_table(
    name: str, phases: Sequence[Phase], faults: Sequence[Fault], mode: str, gripper: str = ""
) -> list[CellResult]:
    """Returns the results of faults in some phases of executions in a mode, on a rig of its own.

    `gripper` replaces the cell's.
    """
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(Path(folder), *CELLS[name])
        try:
            if gripper:
                rig.set_gripper(gripper)
            rig.start()
            tried = [_tried(rig, phase, fault, mode) for phase in phases for fault in faults]
            return [result for result in tried if result is not None]
        finally:
            rig.stop()


def _tried(rig: Rig, phase: Phase, fault: Fault, mode: str) -> CellResult | None:
    """Returns the result of one cell; of several tries the first in which everything holds.

    None where its moment never came: a busy machine may end each run before.
    """
    where = f"{rig.cell.robot.name} {rig.cell.sim.polyscope}, {phase.name}, {fault.name}"
    result = None
    for _ in range(TRIES):
        try:
            result = run_cell(rig, phase, fault, mode)
        except (AssertionError, psutil.NoSuchProcess) as error:  # the moment never came, or was over
            print(f"{where}: {error}", flush=True)
            continue
        if not result.broken():
            print(f"{where}: {result.outcome}, at rest after {1e3 * result.rest_s:.0f} ms", flush=True)
            break
        print(f"{where}: {'; '.join(result.broken())}", flush=True)
    return result


def _page(where: str, phases: Sequence[Phase], results: Sequence[CellResult], broken: Sequence[CellResult]) -> str:
    head = ["fault", *(phase.name for phase in phases)]
    body = [[fault.name, *(_worst(results, phase, fault) for phase in phases)] for fault in FAULT.values()]
    kept = f"{len(results) - len(broken)} of {len(results)} cells hold; those without a number were not reached."
    words = [f"* {r.phase.name}, {r.fault.name}: {'; '.join(r.broken())}" for r in broken]
    lines = ["# Fault matrix", "", where, "", METHOD, "", kept, "", *words, *markdown_table(head, body)]
    return "\n".join(lines) + "\n"


def _worst(results: Sequence[CellResult], phase: Phase, fault: Fault) -> str:
    """Returns the longest time to rest in one cell of the table [ms]; "on" where every run went on, "" without any.

    "untold" where nothing tells what became of the object.
    """
    of_cell = [result for result in results if result.phase is phase and result.fault is fault]
    if not of_cell:
        return ""
    if phase.name in fault.unseen:
        return "untold"
    rests = [result.rest_s for result in of_cell if result.outcome != "completed"]
    return f"{1e3 * max(rests):.0f}" if rests else "on"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

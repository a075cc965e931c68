"""`python -m simulator --cell PATH`: runs a simulated controller until SIGTERM, SIGINT or "quit"."""

from __future__ import annotations

import argparse
import gc
import os
import signal
import sys
from dataclasses import replace
from pathlib import Path

from planner.cell import Cell, checked_polyscope, load_cell
from planner.errors import CellError
from simulator import scheduling
from simulator.loop import SimulatorLoop
from simulator.settings import SimulatorSettings
from simulator.simulation import Simulation
from simulator.truth import TruthError, load_truth, truth_of


def main(arguments: list[str] | None = None) -> int:
    """Runs the simulator; prints "ready" once it listens. Returns the exit status."""
    options = parse(arguments)
    try:
        cell = cell_of(options)
        settings = settings_of(options, cell)
        truth = load_truth(options.truth, cell, hidden=not options.reveal) if options.truth else truth_of(cell)
        simulation = Simulation(cell, settings, options.host or cell.link.host, truth)
        loop = SimulatorLoop(simulation)
    except (CellError, TruthError, OSError) as error:
        print(f"simulator: {error}", file=sys.stderr)
        return 1
    if truth.gripper.cut_short:
        print(f"simulator: warning: {truth.gripper.cut_short}", file=sys.stderr)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: loop.quit())
    gc.collect()
    gc.freeze()
    granted = scheduling.request_real_time(options.priority, options.core)
    simulation.pacing.is_real_time = scheduling.is_real_time()
    api = "".join(f", Robot API on port {p.number}" for p in simulation.network.ports if p.name == "robot_api")
    print(f"ready: {cell.robot.name} {cell.sim.polyscope} on {simulation.network.host}{api}, {granted}", flush=True)
    loop.run()
    return 0


def cell_of(options: argparse.Namespace) -> Cell:
    """Returns the cell, with another version of PolyScope where the options ask for one.

    Raises:
        CellError: the file is refused, or the version is none for its arm.
    """
    cell = load_cell(options.cell)
    if options.polyscope is None:
        return cell
    return replace(cell, sim=replace(cell.sim, polyscope=checked_polyscope(options.polyscope, cell.robot)))


def settings_of(options: argparse.Namespace, cell: Cell) -> SimulatorSettings:
    """Returns the settings that the command-line options ask for."""
    usual = SimulatorSettings()
    return SimulatorSettings(
        restitution=options.restitution,
        protective_stop_lock_s=options.protective_stop_lock_s,
        stall_tolerant=not options.strict_clock,
        remote_control_enabled=not options.no_remote_control,
        programs=options.programs,
        position_noise_rad=0.0 if options.no_noise else usual.position_noise_rad,
        velocity_noise_rad_s=0.0 if options.no_noise else usual.velocity_noise_rad_s,
        serial_number=options.serial_number or cell.link.serial or usual.serial_number,
    )


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """Returns the command-line options."""
    parser = argparse.ArgumentParser(prog="python -m simulator", description="A simulated UR controller.")
    add = parser.add_argument
    try:
        core = scheduling.default_core(os.environ)
    except ValueError as error:
        parser.error(str(error))
    add("--cell", type=Path, required=True, help="cell file (TOML)")
    add("--host", help="address to listen on; the cell's link.host by default")
    add("--polyscope", help="version to present, or x for PolyScope X; the cell's sim.polyscope by default")
    add("--truth", type=Path, help="truth file (TOML): how arm, gripper, object and camera really behave")
    add("--reveal", action="store_true", help="tell what is hidden under --truth, as without it")
    add("--priority", type=int, default=scheduling.REALTIME_PRIORITY, help="SCHED_FIFO priority, 0 for none")
    core_help = f"processor to stay on at that priority, -1 for any; {scheduling.CORE_VARIABLE}, or the highest"
    add("--core", type=int, default=core, help=core_help)
    add("--restitution", type=float, default=0.0, help="of a landing; above 0 objects bounce")
    lock_s = SimulatorSettings.protective_stop_lock_s
    lock_help = "time during which a protective stop cannot be unlocked"
    add("--protective-stop-lock-s", type=float, default=lock_s, help=lock_help)
    add("--programs", type=Path, help="folder of stored programs: NAME.script is what the dashboard loads as NAME.urp")
    add("--serial-number", help="of the robot; the cell's link.serial by default, or a made-up one")
    remote_help = "remote control is not switched on in the settings, as on a new robot: no command is refused"
    add("--no-remote-control", action="store_true", help=remote_help)
    add("--no-noise", action="store_true", help="measured joint positions and speeds are the true ones")
    strict_help = "keep the absolute grid of cycles where the machine stalls, instead of letting controller time slip"
    add("--strict-clock", action="store_true", help=strict_help)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())

"""`python -m executor --cell NAME`: the executor of one cell, until SIGTERM or SIGINT; or its doctor, or an import."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
from importlib.util import find_spec

from executor.calibration_import import ImportFailed, import_calibration
from executor.calibration_import import report as import_report
from executor.daemon import Daemon
from executor.doctor import DURATION_S, examine, grade_lag, known_timing, report, report_document
from executor.logs import configure_logs, log
from executor.ownership import CellTaken
from executor.preflight import closest_models
from executor.records import Journal, JournalLocked
from executor.robot import RobotSession, find_robot
from executor.settings import ExecutorSettings
from fling import tracing
from planner.cell import Cell, load_cell
from planner.errors import CellError
from store import Store, StoreUnavailable

NO_CLIENT = (
    "ur_rtde is not installed, which streams to the arm: pip install 'fling-robotics[executor]' (it has wheels for "
    "Python 3.11 and 3.12)"
)


def main(arguments: list[str] | None = None) -> int:
    """Runs the executor until SIGTERM or SIGINT; prints "ready" when it serves; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m executor", description="The executor of one cell.")
    parser.add_argument("--cell", help="name of the cell; FLING_DEFAULT_CELL otherwise")
    parser.add_argument("--read-only", action="store_true", help="connect and report, never move")
    parser.add_argument("--doctor", action="store_true", help="check this machine's timing and the link, then exit")
    parser.add_argument("--kinematics", action="store_true", help="import the controller's kinematics, then exit")
    parser.add_argument("--find", metavar="HOST", help="print what the controller there tells of itself, then exit")
    parser.add_argument("--json", action="store_true", help="print the import, or what the doctor found, as JSON")
    options = parser.parse_args(arguments)
    if options.find is not None:
        return run_search(options.find)
    configure_logs()
    if (missing := tracing.configure_tracing("fling-executor")) is not None:
        log(missing)
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    try:
        settings = ExecutorSettings.from_environment(os.environ, options.cell, options.read_only)
        if options.kinematics:
            return run_import(settings, options.json)
        cell = load_cell(settings.cell_path)
        if options.doctor:
            return run_doctor(cell, settings.database_url, options.json)
        if find_spec("rtde_control") is None and not settings.read_only:
            raise ValueError(NO_CLIENT)
        journal = Journal(settings.data)
        store = Store.open(settings.database_url)
    except (ValueError, CellError, OSError, JournalLocked, StoreUnavailable) as error:
        hint = " (FLING_DATABASE_URL)" if isinstance(error, StoreUnavailable) else ""
        print(f"executor: {error}{hint}", file=sys.stderr)
        return 1
    try:
        return serve(Daemon(RobotSession.open(cell, settings), store, journal), ended)
    finally:
        store.close()
        journal.close()


def serve(daemon: Daemon, ended: threading.Event) -> int:
    """Takes the daemon's cell and serves it until the end; returns the exit code."""
    session = daemon.session
    try:
        daemon.take()
    except (CellTaken, StoreUnavailable) as error:
        print(f"executor: {error}", file=sys.stderr)
        return 1
    read_only = ", read-only" if session.settings.read_only else ""
    print(f"ready: {session.cell.name} at {session.cell.link.host}{read_only}", flush=True)
    if daemon.run(ended):
        return 0
    print(f"executor: another executor has taken cell {session.cell.name!r} over", file=sys.stderr)
    return 1


def run_doctor(cell: Cell, database_url: str, as_json: bool) -> int:
    """Prints the doctor's report; returns its exit code."""
    print(f"Measuring for {DURATION_S:.0f} seconds …", file=sys.stderr)
    found = find_robot(cell.link.host)
    findings = [*examine(cell, found), grade_lag(cell, known_timing(cell, database_url))]
    text, code = report(cell, found, findings)
    print(json.dumps(report_document(cell, found, findings)) if as_json else text)
    return code


def run_search(host: str) -> int:
    """Prints as JSON what the controller at an address tells of itself; returns the exit code."""
    found = find_robot(host)
    if not found.is_there:
        print(f"no controller answers at {host}", file=sys.stderr)
        return 1
    state = found.state
    document = {
        "models": [] if found.kinematics is None else closest_models(found.kinematics.table),
        "polyscope": found.polyscope,
        "serial": found.serial,
        "payload_kg": None if state is None else state.payload_kg,
        "tcp_offset": None if state is None else state.tcp_offset,
    }
    print(json.dumps(document))
    return 0


def run_import(settings: ExecutorSettings, as_json: bool) -> int:
    """Imports the controller's kinematics and prints what was written; returns the exit code."""
    try:
        imported = import_calibration(settings.cell_path)
    except ImportFailed as error:
        print(f"fling: {error}", file=sys.stderr)
        return 1
    print(json.dumps(imported.as_document()) if as_json else import_report(imported, settings.cell))
    return 0


if __name__ == "__main__":
    sys.exit(main())

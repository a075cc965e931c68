"""Whose cell it is: one executor a cell, at its controller and in the store.

At the controller the monitor's RTDE connection claims an input that no program reads: the controller gives it to one
connection, and takes it back when that ends. In the store the executor holds the row of its cell, which its heartbeats
renew. A newcomer that finds either taken ends, and touches nothing (docs/decisions/0026-one-executor.md).
"""

from __future__ import annotations

import os
import socket
import time

from executor.preflight import taken_words
from executor.robot import Monitor
from planner.cell import Cell
from store import CellRow, Store

CONNECT_S = 3.0  # [s] longest wait for the monitor's first look at the controller
FREED_S = 3.0  # [s] for a controller to notice that an earlier executor's connection has ended
LEASE_S = 10.0  # [s] heartbeats come four times a second; a locked database holds one up for five, a robot for two
LOOK_S = 0.2  # [s] between two looks


class CellTaken(Exception):
    """Another executor owns the cell, or its controller."""


def take_controller(monitor: Monitor) -> None:
    """Waits until this executor owns the controller; returns too where it cannot be reached, or has no such input.

    Raises:
        CellTaken: another client keeps the input.
    """
    monitor.looked.wait(CONNECT_S)
    end = time.monotonic() + FREED_S
    while monitor.owned is False:
        if time.monotonic() > end:
            raise CellTaken(taken_words(monitor.host))
        time.sleep(LOOK_S)


def take_cell(store: Store, cell: Cell, executor_id: str, earlier: str | None) -> None:
    """Takes the cell in the store; waits for the lease of a holder that may have died.

    Args:
        store: with the row of the cell.
        cell: to take.
        executor_id: of this executor.
        earlier: id of the executor that had this one's folder, which has ended; None: there was none.

    Raises:
        CellTaken: another executor holds the cell, and lives.
        StoreUnavailable: the database is gone.
    """
    seen = store.cell_status(cell.name)
    if seen is not None and seen.held_by is not None and seen.executor_id != earlier:
        _outlive(store, seen)
    if not store.take_cell(cell.name, executor_id, cell.link.kind, where_it_runs(), seen):
        raise CellTaken(f"another executor of cell {cell.name!r} was started at the same moment")


def where_it_runs() -> str:
    """Returns where this executor runs, in words."""
    return f"process {os.getpid()} on {socket.gethostname()}"


def _outlive(store: Store, seen: CellRow) -> None:
    """Waits for as long as a lease lasts without a heartbeat.

    Raises:
        CellTaken: one came.
    """
    end = time.monotonic() + LEASE_S
    while time.monotonic() < end:
        now = store.cell_status(seen.cell)
        if now is not None and (now.executor_id, now.heartbeat_at) != (seen.executor_id, seen.heartbeat_at):
            raise CellTaken(f"another executor of cell {seen.cell!r} is running ({now.held_by})")
        time.sleep(LOOK_S)

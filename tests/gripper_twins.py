"""A gripper's twin on the wire: its ports in a thread, whose clock is the real one."""

from __future__ import annotations

import itertools
import math
import os
import select
import socket
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from planner.cell import Cell, parse_cell
from simulator.grippers import gripper_ports
from simulator.interfaces import Network
from simulator.physics import SimulatedGripper
from simulator.truth import GripperOpening

NUMBERS = itertools.count(1)
DT = 0.002  # [s]
OBJECT_M = 0.04  # [m] diameter
DELAY_S = 0.03  # [s] from a command to the object leaving
WITHIN_S = 10.0  # [s] long enough for a busy machine


class TwinOnWire:
    """The twin of a gripper that a table `[gripper]` describes, with `HOST` in the place of its address."""

    def __init__(self, table: str, takes: Callable[[float], int | None] | None = None) -> None:
        pid = os.getpid()
        self.host = f"127.{90 + next(NUMBERS) % 30}.{pid >> 8 & 255}.{pid & 255 or 1}"
        text = f'robot = "ur5e"\n[link]\nkind = "sim"\nhost = "{self.host}"\n[gripper]\n{table}'
        self.cell: Cell = parse_cell(text.replace("HOST", self.host), "c")
        link = self.cell.gripper.link
        assert link is not None
        self.link = link
        self.gripper = SimulatedGripper(self.cell.gripper, OBJECT_M, GripperOpening(DELAY_S, 0.0), 1, takes)
        self.network = Network(self.host)
        self.network.add(*gripper_ports(self.cell.gripper, self.gripper, self.host))
        self.left_at = math.nan  # [s] when the last object left, of the monotonic clock
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        due = time.monotonic()
        while not self._ended.is_set():
            for sock in select.select(self.network.sockets, (), (), max(due - time.monotonic(), 0.0))[0]:
                self.network.readable(sock)
            if time.monotonic() >= due:
                due += DT
                self.network.tick()
                self.gripper.cycle(due, 0.0, DT)
                if self.gripper.take_release(due) is not None:
                    self.left_at = time.monotonic()
                    self.gripper.let_go()
                self.gripper.rearm(True)
        self.network.close()

    def connect(self) -> socket.socket:
        """Returns a connection to the twin, as a foreign client has it."""
        client = socket.create_connection((self.host, self.link.port), WITHIN_S)
        client.settimeout(WITHIN_S)
        return client

    def job(self, descriptor: int) -> Any:
        """Returns what a port reads of a connection with an inherited descriptor."""
        job = SimpleNamespace(link=self.link, gripper_fd=descriptor, host=self.host, dt=DT, grip_input=None)
        return SimpleNamespace(job=job, stamp=0.0, memory=SimpleNamespace(fields=[math.nan] * 18))

    def close(self) -> None:
        """Ends the thread and closes the sockets."""
        self._ended.set()
        self._thread.join()


def until(condition: Any, each: Any = None) -> None:
    """Waits for a condition; `each` is called meanwhile, once a tick."""
    end = time.monotonic() + WITHIN_S
    while not condition():
        assert time.monotonic() < end, "waited too long"
        if each is not None:
            each()
        time.sleep(DT)

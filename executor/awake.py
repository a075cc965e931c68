"""Keeps the stream's processor from going to sleep while an execution lasts, in a process of its own.

A processor with nothing to do between two ticks wakes up late: by the exit latency of its sleep state, or, in a virtual
machine, by whatever its host does with it meanwhile. A machine is asked to stay awake through the kernel's PM QoS
interface (source: Documentation/power/pm_qos_interface.rst). A virtual one cannot be: there this process keeps the
processor busy, at a priority at which it takes nothing from anybody else.

Run as `python awake.py CORE PARENT_PID`: it imports nothing that takes long.
"""

from __future__ import annotations

import ctypes
import os
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LATENCY = Path("/dev/cpu_dma_latency")
PROCESSORS, QUOTA = Path("/proc/cpuinfo"), Path("/sys/fs/cgroup/cpu.max")
PR_SET_PDEATHSIG = 1  # source: linux/prctl.h
ANY = -1  # no processor of its own: then there is none to keep awake


@contextmanager
def kept(core: int) -> Iterator[None]:
    """Keeps processor `core` awake for a while, where that can be done; it is a help, no condition."""
    process = _start(core)
    try:
        yield
    finally:
        if process is not None:
            process.kill()
            process.wait()


def _start(core: int) -> subprocess.Popen[bytes] | None:
    if core == ANY or (has_quota() if is_virtual() else not may_ask()):
        return None
    command = [sys.executable, "-I", "-S", __file__, str(core), str(os.getpid())]
    null = subprocess.DEVNULL
    try:
        return subprocess.Popen(command, stdin=null, stdout=null, stderr=null)
    except OSError:
        return None


def is_virtual() -> bool:
    """Whether this is a virtual machine, by what its processor says."""
    try:
        return "hypervisor" in PROCESSORS.read_text().split()
    except OSError:
        return False


def may_ask() -> bool:
    """Whether this process may ask the machine to stay awake."""
    return os.access(LATENCY, os.W_OK)


def has_quota() -> bool:
    """Whether this container's processor time is limited: what is burnt here the stream would lack."""
    try:
        return not QUOTA.read_text().startswith("max")
    except OSError:
        return False


def stay_awake(core: int, parent: int) -> None:
    """Stays, and keeps the processor awake, until the parent ends."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    if is_virtual():
        while os.getppid() == parent:
            pass
        return
    request = os.open(LATENCY, os.O_WRONLY)  # holds for as long as it is open
    os.write(request, struct.pack("i", 0))  # [us]
    while os.getppid() == parent:
        time.sleep(1.0)


if __name__ == "__main__":
    stay_awake(*map(int, sys.argv[1:3]))

"""Making this process as punctual as the machine allows. What is not permitted is told, not required."""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import signal
import socket

MCL_CURRENT, MCL_FUTURE = 1, 2  # source: linux/mman.h
PR_SET_PDEATHSIG = 1  # source: linux/prctl.h
PR_SET_TIMERSLACK = 29  # source: linux/prctl.h


def prepare(core: int, priority: int) -> list[str]:
    """Stays on one core, locks memory, takes SCHED_FIFO one above `priority`; returns what was not permitted, in words.

    Call it before any interface of ur_rtde is constructed: its threads inherit the scheduling. `step_down` then puts
    this thread below them: the library waits for them in a busy loop, which on one core would keep them from running.
    """
    refused = []
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl(PR_SET_TIMERSLACK, 1)
    if core >= 0:
        os.sched_setaffinity(0, {core})
    if libc.mlockall(MCL_CURRENT | MCL_FUTURE) != 0:
        refused.append("memory is not locked")
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority + 1))
    except PermissionError:
        refused.append("no real-time scheduling (SCHED_FIFO)")
    return refused


def step_down(priority: int) -> None:
    """Puts this thread at `priority`, below the library's threads; nothing where real time was not permitted."""
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))


def sleeps() -> int:
    """Returns how often this thread has gone to sleep, or waited for something other than a processor."""
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw


def freeze_memory() -> None:
    """Ends garbage collection; what lives now lives until the process ends."""
    gc.collect()
    gc.freeze()
    gc.disable()


def die_with_parent(parent: int) -> None:
    """Asks for SIGTERM when the parent is gone, and sends it at once where it is already."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)


def no_delay() -> int:
    """Puts TCP_NODELAY in force on every TCP socket of this process; returns on how many.

    ur_rtde sets it on a socket that its connect then closes and opens anew (reference: rtde.md, section 2).
    """
    count = 0
    for name in os.listdir("/proc/self/fd"):
        try:
            copy = socket.socket(fileno=os.dup(int(name)))
        except OSError:
            continue  # not a socket, or the directory's own descriptor
        with copy:
            if copy.family in (socket.AF_INET, socket.AF_INET6) and copy.type == socket.SOCK_STREAM:
                copy.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                count += 1
    return count

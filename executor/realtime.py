"""Real-time scheduling, memory locking, processor wake-up and parent death, for every process of the executor.

Nothing here is required to succeed: what the system does not permit is reported. The streaming process imports this
module, and `keep_awake` runs it as a script: it imports the standard library only.
"""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

CORE_VARIABLE = "FLING_STREAM_CORE"  # processor of the stream; a simulated controller reads it too
ANY_CORE = -1
STREAM_PRIORITY = 50  # of SCHED_FIFO; below the kernel's interrupt threads
URGENT_PRIORITY = 5  # of SCHED_FIFO; below the daemon
DAEMON_PRIORITY = 10  # of SCHED_FIFO; above ordinary processes, below the stream

MCL_CURRENT = 1
MCL_FUTURE = 2  # source: linux/mman.h
PR_SET_PDEATHSIG = 1  # source: linux/prctl.h
PR_SET_TIMERSLACK = 29  # source: linux/prctl.h
AUTOGROUP = Path("/proc/self/autogroup")  # source: sched(7)
AUTOGROUP_S = 0.1  # [s] between two settings by users without privileges; source: kernel/sched/autogroup.c
LEAST_NICE = "19"
LATENCY = Path("/dev/cpu_dma_latency")  # source: Documentation/power/pm_qos_interface.rst
PROCESSORS = Path("/proc/cpuinfo")
QUOTA = Path("/sys/fs/cgroup/cpu.max")


# Scheduling


def default_core(environment: Mapping[str, str]) -> int:
    """Returns the stream's processor: the one set in the environment, by default the highest available one.

    Interrupts and planner processes gather on the low ones.

    Raises:
        ValueError: it is none of this machine.
    """
    text = environment.get(CORE_VARIABLE) or str(max(os.sched_getaffinity(0)))
    last = os.sysconf("SC_NPROCESSORS_CONF") - 1  # an isolated one, made for this, is in no process's own set
    if text not in map(str, range(ANY_CORE, last + 1)):
        raise ValueError(f"{CORE_VARIABLE} {text!r} is neither a processor of this machine, 0 to {last}, nor -1")
    return int(text)


def is_real_time() -> bool:
    """Whether this thread runs at real-time priority."""
    return os.sched_getscheduler(0) == os.SCHED_FIFO


def is_permitted() -> bool:
    """Whether this process may take real-time priority; tries it on this thread."""
    if is_real_time():
        return True
    before = os.sched_getscheduler(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(DAEMON_PRIORITY))
    except PermissionError:
        return False
    os.sched_setscheduler(0, before, os.sched_param(0))
    return True


def prepare_stream(core: int, priority: int) -> list[str]:
    """Binds the process to a processor, locks its memory and takes SCHED_FIFO one above `priority`.

    Call it before constructing an interface of ur_rtde: its threads inherit the scheduling. `step_down` then puts this
    thread below them: the library waits for its threads in a busy loop, which would block them on a shared processor.

    Returns:
        What was not permitted, in words; empty where everything was granted.
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
    """Lowers this thread to `priority`, below the library's threads; no effect at ordinary priority."""
    if is_real_time():
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))


@contextmanager
def real_time_process() -> Iterator[None]:
    """Runs every thread of this process at DAEMON_PRIORITY, where permitted.

    All threads together: one that holds the interpreter lock without a processor would block the others.
    """
    permitted = is_permitted()
    if permitted:
        _schedule_threads(os.SCHED_FIFO, DAEMON_PRIORITY)
    try:
        yield
    finally:
        if permitted:
            _schedule_threads(os.SCHED_OTHER, 0)


@contextmanager
def urgent() -> Iterator[None]:
    """Runs this thread before all ordinary ones, behind the daemon's, where permitted: for some tenths of a second."""
    permitted = is_permitted()
    if permitted:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(URGENT_PRIORITY))
    try:
        yield
    finally:
        if permitted:
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _schedule_threads(policy: int, priority: int) -> None:
    for thread in os.listdir("/proc/self/task"):
        with suppress(ProcessLookupError):  # it has just ended
            os.sched_setscheduler(int(thread), policy, os.sched_param(priority))


# Memory, and the time a thread sleeps or waits for a processor


def freeze_memory() -> None:
    """Collects garbage once and disables the collector; live objects stay until the process ends."""
    gc.collect()
    gc.freeze()
    gc.disable()


def sleep_count() -> int:
    """Returns how often this thread has slept or blocked (its voluntary context switches)."""
    return resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw


class RunDelay:
    """Time that the constructing thread has been ready to run without a processor."""

    def __init__(self) -> None:
        self._schedstat = os.open(f"/proc/self/task/{threading.get_native_id()}/schedstat", os.O_RDONLY)

    def total_s(self) -> float:
        """Returns the time since the thread began [s]; source: Documentation/scheduler/sched-stats.rst."""
        return int(os.pread(self._schedstat, 64, 0).split()[1]) * 1e-9


# Parent death


def terminate_with_parent(parent: int) -> None:
    """Requests SIGTERM when process `parent` ends; sends it at once where it has ended already."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)


# Processor wake-up


@contextmanager
def keep_awake(core: int) -> Iterator[None]:
    """Keeps processor `core` from sleeping, by a process of its own; no effect where that is not possible.

    An idle processor wakes up late: by the exit latency of its sleep state, or, in a virtual machine, by what the host
    does meanwhile. A physical machine is asked through the kernel's PM QoS interface. In a virtual machine the process
    keeps the processor busy at SCHED_IDLE, if the stream may take real-time priority: at ordinary priority it would
    yield to the stream, but not to a busy process of another container, with which the two then share.
    """
    process = _start_waker(core)
    try:
        yield
    finally:
        if process is not None:
            process.kill()
            process.wait()


def _start_waker(core: int) -> subprocess.Popen[bytes] | None:
    if core == ANY_CORE or not (may_keep_busy() if is_virtual() else may_set_latency()):
        return None
    command = [sys.executable, "-I", "-S", __file__, str(core), str(os.getpid())]
    null = subprocess.DEVNULL
    try:
        return subprocess.Popen(command, stdin=null, stdout=null, stderr=null)
    except OSError:
        return None


def is_virtual() -> bool:
    """Whether this is a virtual machine, from its processor flags."""
    try:
        return "hypervisor" in PROCESSORS.read_text().split()
    except OSError:
        return False


def may_set_latency() -> bool:
    """Whether this process may request a wake-up latency from the kernel."""
    return os.access(LATENCY, os.W_OK)


def may_keep_busy() -> bool:
    """Whether a busy process at SCHED_IDLE would cost this process's streams nothing."""
    return is_permitted() and not has_quota()


def has_quota() -> bool:
    """Whether this container's processor time is limited: busy waiting would use up the stream's share."""
    try:
        return not QUOTA.read_text().startswith("max")
    except OSError:
        return False


def stay_awake(core: int, parent: int) -> None:
    """Keeps processor `core` awake until process `parent` ends."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    _yield_to_every_session()
    if is_virtual():
        while os.getppid() == parent:
            pass
        return
    request = os.open(LATENCY, os.O_WRONLY)  # in force while the file is open
    os.write(request, struct.pack("i", 0))  # [us]
    while os.getppid() == parent:
        time.sleep(1.0)


def _yield_to_every_session() -> None:
    """Yields to other sessions, too: with autogroups, they share a processor whatever is idle in them."""
    with suppress(OSError):  # it leads a session already, or this kernel has no autogroups
        os.setsid()
        try:
            AUTOGROUP.write_text(LEAST_NICE)
        except BlockingIOError:  # some other process has just set its own
            time.sleep(AUTOGROUP_S)
            AUTOGROUP.write_text(LEAST_NICE)


if __name__ == "__main__":
    stay_awake(*map(int, sys.argv[1:3]))

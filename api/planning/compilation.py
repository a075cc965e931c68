"""Compiles the solvers beside the service: when it starts, while nothing is executed.

Compiling takes about a minute of one processor, which a streaming arm must not share: it is ended where an execution
begins, and begun again after it. Requests are answered meanwhile, with the interpreted functions.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress

COMPILER = (sys.executable, "-P", "-m", "planner.backends.casadi_nlp.codegen")
NICENESS = 10  # below the planner processes, which answer requests meanwhile
POLL_S = 0.2  # [s] within which a compilation ends once an execution begins: the approach alone takes longer

log = logging.getLogger("fling")


async def compile_when_idle(is_idle: Callable[[], bool], command: tuple[str, ...] = COMPILER) -> bool:
    """Runs the compiler to its end, at times at which `is_idle` alone; returns whether it succeeded.

    Args:
        is_idle: called in a thread: whether nothing is executed.
        command: compiles the solvers.
    """
    while True:
        while not await asyncio.to_thread(is_idle):
            await asyncio.sleep(POLL_S)
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
        os.setpriority(os.PRIO_PROCESS, process.pid, NICENESS)
        try:
            ended = await _run_while(is_idle, process)
        finally:
            _kill(process)
        if ended:
            if process.returncode != 0:
                log.warning("the solvers are not compiled; plans take longer: see 'fling warm'")
            return process.returncode == 0


async def _run_while(is_idle: Callable[[], bool], process: subprocess.Popen[bytes]) -> bool:
    """Returns True once the process has ended, False if something is executed before."""
    while process.poll() is None:
        if not await asyncio.to_thread(is_idle):
            return False
        await asyncio.sleep(POLL_S)
    return True


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Ends the process with what it has started: the C compiler."""
    if process.poll() is None:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()

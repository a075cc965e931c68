"""Workers that are processes of this machine: spawned, warm, each at the other end of a pipe."""

from __future__ import annotations

import os
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from jobs.planning import PlanningJob, end_with_parent
from jobs.pool.planning_pool import Report
from jobs.pool.results import Chunk, Work, answer

LOWER = 10  # [-] niceness beyond that of planning for a person: a batch can wait for them
CONTEXT = get_context("spawn")  # never fork: this process may have threads


class LocalEngine:
    """Processes of this machine; see `Engine`.

    A worker has its pipe to itself and sends each result as it is made, so that its death loses the job in hand alone.

    Args:
        count: Number of processes.
        warm_up: Planned by each process when it starts.
        work: What a process does.
    """

    def __init__(self, count: int, warm_up: PlanningJob | None, work: Work) -> None:
        self.count = count
        self._warm_up = warm_up
        self._work = work
        self._processes: dict[int, BaseProcess] = {}
        self._pipes: dict[int, Connection] = {}
        for worker in range(count):
            self._start(worker)

    def give(self, worker: int, chunk: Chunk) -> None:
        """Gives a chunk to a worker that is ready: one that waits for it, so that sending never blocks for long."""
        with suppress(OSError):  # it has died; the next reports say so
            self._pipes[worker].send(chunk)

    def reports(self, timeout_s: float) -> list[Report]:
        """Returns what was reported since the last call; waits for the first report."""
        pipes = {pipe: worker for worker, pipe in self._pipes.items()}
        return [self._report(pipes[pipe], pipe) for pipe in wait(list(pipes), timeout_s)]  # type: ignore[index, arg-type]

    def replace(self, worker: int) -> None:
        """Ends a worker, dead or alive, and starts another in its place."""
        self._end(worker)
        self._start(worker)

    def close(self) -> None:
        """Ends all processes."""
        for worker in list(self._processes):
            self._end(worker)

    def _report(self, worker: int, pipe: Connection) -> Report:
        try:
            return Report(worker, pipe.recv())
        except (EOFError, OSError):
            process = self._processes[worker]
            process.join()  # its end of the pipe is closed: it has ended, or is about to
            return Report(worker, death=f"exit status {process.exitcode}")

    def _start(self, worker: int) -> None:
        ours, theirs = CONTEXT.Pipe()
        process = CONTEXT.Process(target=_do_chunks, args=(theirs, self._warm_up, self._work), daemon=True)
        process.start()
        theirs.close()  # so that the pipe ends with the process
        self._processes[worker] = process
        self._pipes[worker] = ours

    def _end(self, worker: int) -> None:
        process = self._processes.pop(worker)
        process.kill()
        process.join()
        process.close()
        self._pipes.pop(worker).close()


def _do_chunks(pipe: Connection, warm_up: PlanningJob | None, work: Work) -> None:
    """Does chunks until the pool is gone; None says that this worker is ready for one."""
    end_with_parent()
    os.nice(LOWER)
    work.load(warm_up)
    try:
        while True:
            pipe.send(None)
            for number, job in pipe.recv():
                pipe.send(answer(number, job, work))
    except (EOFError, OSError):  # the pool is gone
        return

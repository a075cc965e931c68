"""Workers that are processes of this machine: spawned, warm, each at the other end of a pipe."""

from __future__ import annotations

from contextlib import suppress
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from jobs.planning import PlanningJob
from jobs.pool.lifetime import end_with_parent
from jobs.pool.worker import JobCancelled, Report, Work
from planner.progress import Progress

CONTEXT = get_context("spawn")  # never fork: this process has threads
BUG_STATUS = 1  # of a process that an exception has ended; source: Python's multiprocessing


class LocalEngine:
    """Processes of this machine; see `Engine`.

    A worker has its pipe to itself, so that its death, even in the middle of an answer, concerns its own job alone.

    Args:
        count: Number of processes.
        work: What a process does.
    """

    def __init__(self, count: int, work: Work) -> None:
        self.count = count
        self._work = work
        self._processes: dict[int, BaseProcess] = {}
        self._pipes: dict[int, Connection] = {}
        self._woken, self._waker = CONTEXT.Pipe(duplex=False)
        for worker in range(count):
            self._start(worker)

    def give(self, worker: int, job: PlanningJob) -> None:
        """Gives a job to a worker that has none: it waits for one, so that sending never blocks for long."""
        with suppress(OSError):  # it has died; the next reports say so
            self._pipes[worker].send(job)

    def cancel(self, worker: int) -> None:
        """Asks a worker to end its job; it looks for that at each step of its search."""
        with suppress(OSError):  # it has died; the next reports say so
            self._pipes[worker].send(None)

    def reports(self, timeout_s: float) -> list[Report]:
        """Returns what was reported since the last call; waits for the first report, or for `wake`."""
        workers = {pipe: worker for worker, pipe in self._pipes.items()}
        ready = wait([self._woken, *workers], timeout_s)
        while self._woken.poll():
            self._woken.recv_bytes()
        return [self._report(workers[pipe], pipe) for pipe in ready if pipe in workers]  # type: ignore[index, arg-type]

    def wake(self) -> None:
        """Ends a call of `reports` in another thread."""
        self._waker.send_bytes(b"")

    def replace(self, worker: int) -> None:
        """Ends a worker, dead or alive, and starts another in its place."""
        self._end(worker)
        self._start(worker)

    def close(self) -> None:
        """Ends all processes."""
        for worker in list(self._processes):
            self._end(worker)
        self._woken.close()
        self._waker.close()

    def _report(self, worker: int, pipe: Connection) -> Report:
        try:
            said = pipe.recv()
        except (EOFError, OSError):
            process = self._processes[worker]
            process.join()  # its end of the pipe is closed: it has ended, or is about to
            pipe.close()
            self._pipes.pop(worker)
            return Report(worker, death=f"exit status {process.exitcode}", is_bug=process.exitcode == BUG_STATUS)
        return Report(worker, progress=said) if isinstance(said, Progress) else Report(worker, result=said)

    def _start(self, worker: int) -> None:
        ours, theirs = CONTEXT.Pipe()
        process = CONTEXT.Process(target=_work, args=(theirs, self._work), daemon=True)
        process.start()
        theirs.close()  # so that the pipe ends with the process
        self._processes[worker] = process
        self._pipes[worker] = ours

    def _end(self, worker: int) -> None:
        process = self._processes.pop(worker)
        process.kill()
        process.join()
        process.close()
        if (pipe := self._pipes.pop(worker, None)) is not None:
            pipe.close()


def _work(pipe: Connection, work: Work) -> None:
    """Does one job after another until the pool is gone; the first answer, None, says that this worker is ready."""
    end_with_parent()
    work.begin()
    try:
        pipe.send(None)
        while True:
            job = pipe.recv()
            if job is not None:  # that would be the end of a job which was answered before it came
                pipe.send(work.answer(job, partial(_step, pipe, job)))
    except (EOFError, OSError):  # the pool is gone
        return


def _step(pipe: Connection, job: PlanningJob, progress: Progress) -> None:
    """Reports the progress of a job.

    Raises:
        JobCancelled: the pool has asked for its end: nothing else comes while a worker has a job.
    """
    if pipe.poll():
        raise JobCancelled
    if job.tells_progress:
        pipe.send(progress)

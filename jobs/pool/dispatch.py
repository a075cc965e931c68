"""Which worker gets which jobs: chunks that shrink towards the end, and a second try for the jobs of a dead worker.

Nothing here knows what a worker is.
"""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from itertools import islice

from jobs.planning import PlanningJob
from jobs.pool.results import Chunk

CHUNK = 100  # jobs given to a worker at once: about ten seconds of planning, and no time to speak of between two
READ_AHEAD = 2  # chunks per worker that are read ahead
TRIES = 2  # a job whose worker died over it is tried once more


class Dispatch:
    """The jobs of one call: waiting, in a worker's hands, or answered.

    At most `READ_AHEAD` chunks a worker are read ahead. A chunk is the share of one worker in half of what was read,
    so that the last ones are single jobs, and all workers end together.

    Args:
        jobs: read as they are needed.
        workers: their number.
    """

    def __init__(self, jobs: Iterable[PlanningJob], workers: int) -> None:
        self._jobs: Iterator[tuple[int, PlanningJob]] = enumerate(jobs)
        self._workers = workers
        self._waiting: deque[tuple[int, PlanningJob]] = deque()
        self._suspects: deque[tuple[int, PlanningJob]] = deque()
        self._in_hand: dict[int, deque[tuple[int, PlanningJob]]] = {}
        self._since: dict[int, float] = {}
        self._deaths: Counter[int] = Counter()

    def chunk(self, worker: int) -> Chunk:
        """Returns what a worker that has nothing in hand is to do next; empty where there is nothing left.

        A job over which a worker died is given out by itself: who dies over it again dies of it.
        """
        if self._suspects:
            chunk = [self._suspects.popleft()]
        else:
            room = READ_AHEAD * self._workers * CHUNK - len(self._waiting)
            self._waiting.extend(islice(self._jobs, max(0, room)))
            size = -(-len(self._waiting) // (READ_AHEAD * self._workers))  # rounded up
            chunk = [self._waiting.popleft() for _ in range(size)]
        if chunk:
            self._in_hand[worker] = deque(chunk)
            self._since[worker] = time.monotonic()
        return chunk

    def answered(self, worker: int, number: int) -> None:
        """Notes the answer to the job that a worker had in hand first."""
        first, _ = self._in_hand[worker].popleft()
        assert first == number  # a worker does its chunk in order
        self._since[worker] = time.monotonic()
        if not self._in_hand[worker]:
            del self._in_hand[worker]

    def died(self, worker: int) -> int | None:
        """Takes back what a dead worker had in hand; returns the number of the job that is given up, if one is."""
        unanswered = self._in_hand.pop(worker, None)
        if not unanswered:
            return None
        number, job = unanswered.popleft()
        self._waiting.extendleft(reversed(unanswered))
        self._deaths[number] += 1
        if self._deaths[number] >= TRIES:
            return number
        self._suspects.append((number, job))
        return None

    def abandoned(self, worker: int) -> None:
        """Takes back what a worker had in hand, but for the first job, which is answered otherwise."""
        self._waiting.extendleft(reversed(list(islice(self._in_hand.pop(worker), 1, None))))

    def at_hand(self) -> list[tuple[int, int, PlanningJob, float]]:
        """Returns what is being worked on: worker, number, job, and for how long [s]."""
        now = time.monotonic()
        return [(worker, *jobs[0], now - self._since[worker]) for worker, jobs in self._in_hand.items()]

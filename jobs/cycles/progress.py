"""How far a job is, from its record alone: what comes next, and whether it stops.

A driver that takes a job over reads the same record, and goes on as the one before would have.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from jobs.cycles.order import JobOrder
from store import JobCycleRow

NOT_BEGUN = "not_begun"  # the arm did not move: the object is where it was, or in the gripper there
MOVED = "moved"  # an approach: the arm stands at its pick
THROWN = "thrown"  # the object was let go; landings say whether it hit
MISSED_GRIP = "missed_grip"  # the gripper closed on nothing and was opened again; the arm did not move
FAILED = "failed"  # an approach that did not arrive
KEPT = "kept"  # the arm moved, and the object was not let go
DROPPED = "dropped"  # the gripper let the object go, or lost it, before it was told to
UNKNOWN = "unknown"  # nobody can say whether the object was let go
NOT_PLANNED = "not_planned"  # no motion was found
WENT = (MOVED, THROWN)  # results after which the arm stands where the motion was to end
STAYED = (MISSED_GRIP, NOT_BEGUN)  # results after which it stands where the motion was to begin
BLOCKED = 2  # approaches in a row without a motion: it is rather the arm that cannot go than the picks out of reach
GRIPPED = (KEPT, DROPPED, UNKNOWN)  # results after which the gripper may be closed, on its object or on nothing
MAY_HAVE_THROWN = (THROWN, KEPT, DROPPED, UNKNOWN)  # results that use a target's turn up


@dataclass(frozen=True)
class NextMotion:
    """What a job does next.

    Attributes:
        kind: to a pick, or from one over a throw to the next.
        pick: that the throw starts at; None of an approach.
        next_pick: where it ends; None: at home.
        rises_from: the pick at which the arm stands before; None: elsewhere.
        turn: counts the throws at targets, which have their turns one after another; None of an approach.
        attempt: of this pick, counted from 1.
    """

    kind: Literal["approach", "throw"]
    pick: int | None
    next_pick: int | None
    rises_from: int | None
    turn: int | None = None
    attempt: int = 1


@dataclass(frozen=True)
class JobProgress:
    """The record of a job.

    Attributes:
        order: what was ordered.
        rows: its motions so far, in their order.
        missed: when each throw was seen to have landed beside its target [s since the epoch], by its number.
    """

    order: JobOrder
    rows: Sequence[JobCycleRow]
    missed: Mapping[int, float] = field(default_factory=dict)

    def state_of(self, pick: int) -> str:
        """Returns "waiting", or the result that a pick has in the end."""
        last = self.last_of(pick)
        if last is None or last.result in (None, NOT_BEGUN):
            return "waiting"
        if last.result != MISSED_GRIP:
            return last.result
        policy = self.order.policy
        again = policy["missed_grip"] == "stop" or (
            policy["missed_grip"] == "retry" and last.attempt < policy["attempts"]
        )
        return "waiting" if again else MISSED_GRIP

    def last_of(self, pick: int) -> JobCycleRow | None:
        """Returns the last throw from a pick, or the approach to it that was not planned; None without one."""
        return self._last.get(pick)

    def attempts(self, pick: int) -> int:
        """Returns how many throws from a pick were begun, or refused by the planner."""
        return self._attempts[pick]

    @cached_property
    def _last(self) -> dict[int, JobCycleRow]:
        return {pick: row for row in self.rows if (pick := _pick_of(row)) is not None}

    @cached_property
    def _attempts(self) -> Counter[int | None]:
        return Counter(row.pick for row in self.rows if row.result != NOT_BEGUN)

    def arm_at(self) -> int | None:
        """Returns the pick at which the arm stands if nobody has moved it since; None: elsewhere."""
        for row in reversed(self.rows):
            if row.result == NOT_PLANNED:
                continue
            if row.result in WENT:
                return row.next_pick
            return row.pick if row.result in STAYED else None
        return None

    def next_motion(self, at: int | None) -> NextMotion | None:
        """Returns what comes next; None: every pick is done.

        Args:
            at: the pick at which the arm stands; None: elsewhere.
        """
        waiting = [pick for pick in range(len(self.order.picks)) if self.state_of(pick) == "waiting"]
        if not waiting:
            return None
        if at not in waiting:
            return NextMotion("approach", None, waiting[0], at)
        others = (pick for pick in waiting if pick != at)
        attempt = 1 + self.attempts(at)
        return NextMotion("throw", at, next(others, None), at, self._turn(), attempt)

    def stop_reason(self, since: float) -> str | None:
        """Returns why the job stops, by what happened after a time [s since the epoch]; None: it goes on."""
        policy = self.order.policy
        last = next(iter(self.rows[-1:]), None)
        if last is not None and last.ended_at is not None and last.ended_at > since:
            if last.result == MISSED_GRIP:
                if policy["missed_grip"] == "stop":
                    return f"nothing was gripped at pick {last.pick}"
            elif last.result != NOT_PLANNED and (last.outcome != "completed" or last.result not in WENT):
                ended = f"execution {last.execution_id} ended as {last.outcome}: {last.reason or 'no reason was told'}"
                return f"{ended}; empty and open the gripper, then resume" if last.result in GRIPPED else ended
        vain = [row for row in self.rows[-BLOCKED:] if _is_vain(row) and (row.ended_at or 0.0) > since]
        if len(vain) == BLOCKED:
            to = f"at last to pick {vain[-1].next_pick}"
            return f"no motion was found in {BLOCKED} approaches in a row, {to}: {vain[-1].reason}"
        seen = [number for number, at in self.missed.items() if at > since]
        if seen and policy["missed_throw"] == "stop":
            row = next(row for row in self.rows if row.number == seen[0])
            return f"the object of pick {row.pick} landed beside target {row.target}"
        return None

    def _turn(self) -> int:
        """Returns the turn of the next throw: the first one that wants another object, or a new one."""
        policy = self.order.policy
        served: dict[int, list[JobCycleRow]] = {}
        for row in self.rows:
            if row.turn is not None and (row.result is None or row.result in MAY_HAVE_THROWN):
                served.setdefault(row.turn, []).append(row)
        if policy["missed_throw"] == "retry":
            for turn, rows in sorted(served.items()):
                if rows[-1].number in self.missed and len(rows) < policy["attempts"]:
                    return turn
        return max(served, default=-1) + 1


def _is_vain(row: JobCycleRow) -> bool:
    """Returns whether this is an approach for which no motion was found."""
    return row.kind == "approach" and row.result == NOT_PLANNED


def _pick_of(row: JobCycleRow) -> int | None:
    """Returns the pick that a motion decides about; None of an approach that was planned."""
    return row.next_pick if _is_vain(row) else row.pick

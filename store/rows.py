"""Rows of the tables as frozen dataclasses, and their ids. Times are seconds since the epoch."""

from __future__ import annotations

import hashlib
import secrets
import time
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import orjson
from numpy.typing import NDArray

from store.samples import join_plan, samples_csv, samples_of_csv, trajectory_json, unpack_samples

HEARTBEAT_FRESH_S = 2.0  # [s] an executor beats several times a second
DRIVER_FRESH_S = 10.0  # [s] the driver of a batch beats every second, but waits for other writers meanwhile
RobotAction = Literal["power_on", "brake_release", "unlock_protective_stop", "power_off"]
MAP_FRESH_S = 60.0  # [s] answers of a map are stored every second; a landing cell takes a few seconds at most


def new_id() -> str:
    """Returns a fresh UUID of version 7, whose text sorts by creation time, within a millisecond too.

    The first twelve of its random bits are the fraction of the millisecond. Source: RFC 9562, section 6.2, method 3.
    """
    milliseconds, rest_ns = divmod(time.time_ns(), 1_000_000)
    return _uuid7(milliseconds, (rest_ns * 4096 // 1_000_000) << 62 | secrets.randbits(62))


def derived_id(owner: str, part: str) -> str:
    """Returns the id of a part of something that has an id; always the same for the same owner and part.

    A UUID of version 7: the time of the owner's own id, then bits of a hash.
    """
    digest = hashlib.sha256(f"{owner} {part}".encode()).digest()
    return _uuid7(uuid.UUID(owner).int >> 80, int.from_bytes(digest[:10]) >> 6)


def _uuid7(milliseconds: int, random: int) -> str:
    """Returns 48 bits of Unix time [ms], then 74 random bits. Source: RFC 9562, section 5.7."""
    value = (milliseconds << 80) | (0x7 << 76) | ((random >> 62) << 64) | (0b10 << 62) | (random & (2**62 - 1))
    return str(uuid.UUID(int=value))


def plan_sha256(id: str, summary: bytes, samples: bytes) -> str:
    """Returns the hash of a plan's whole content, under its id (docs/decisions/0019-store.md)."""
    digest = hashlib.sha256()
    for part in (id.encode(), summary, samples):
        digest.update(len(part).to_bytes(8))
        digest.update(part)
    return digest.hexdigest()


@dataclass(frozen=True)
class PlanRow:
    """One plan.

    Attributes:
        id: From `new_id`.
        created_at: Time of the request [s since the epoch].
        cell: Name of the cell.
        cell_sha256: Hash of the cell's files.
        backend: Back end that found it.
        request_id: Id of the HTTP request.
        summary: Its JSON without the trajectory, and all that lists contain.
        samples: Its trajectory; see `store.samples`. Empty where it was not read.
        earlier_document: Its whole JSON, where an earlier version of Fling stored it so.
        sha256: Of `plan_sha256`, by the planner that made it; None: an earlier version of Fling did.
    """

    id: str
    created_at: float
    cell: str
    cell_sha256: str
    backend: str
    summary: bytes
    request_id: str | None = None
    samples: bytes | None = None
    earlier_document: bytes = b""
    sha256: str | None = None

    @property
    def is_intact(self) -> bool:
        """Whether id, summary and trajectory are those that its planner wrote."""
        return self.sha256 == plan_sha256(self.id, self.summary, self.samples or b"")

    @property
    def document(self) -> bytes:
        """The whole JSON; the summary where the trajectory was not read."""
        return self.earlier_document or (join_plan(self.summary, self.samples) if self.samples else self.summary)

    @property
    def trajectory(self) -> bytes:
        """The JSON of the trajectory alone, where it was read."""
        if self.samples:
            return trajectory_json(self.samples)
        return orjson.dumps(orjson.loads(self.earlier_document)["trajectory"])


@dataclass(frozen=True)
class ExecutionRow:
    """One run of one plan on one cell.

    Attributes:
        replace_request: The newest request that another plan replaces the running one: id, plan_id, requested_by,
            requested_at.
        replacements: What became of each: id, plan_id, joins_s on the execution's clock or null, reason.
    """

    id: str
    plan_id: str
    cell: str
    mode: str
    dry_run: bool
    requested_by: str
    created_at: float
    abort_requested_at: float | None
    claimed_at: float | None
    executor_id: str | None
    state: str
    outcome: str | None
    reason: str | None
    metrics: Mapping[str, Any] | None
    finished_at: float | None
    experiment_id: str | None = None
    request_id: str | None = None
    replace_request: Mapping[str, Any] | None = None
    replacements: Sequence[Mapping[str, Any]] | None = None

    @property
    def joined(self) -> list[Mapping[str, Any]]:
        """The replacements that joined, in their order."""
        return [each for each in self.replacements or () if each["joins_s"] is not None]

    @property
    def open_replacement(self) -> Mapping[str, Any] | None:
        """The request for a replacement that nobody has answered; None without one."""
        request = self.replace_request
        answered = [each["id"] for each in self.replacements or ()]
        return None if request is None or request["id"] in answered else request


@dataclass(frozen=True)
class EventRow:
    """One event of an execution; `kind` is "state", "telemetry" or "target"."""

    id: int
    execution_id: str
    at: float
    kind: str
    data: Mapping[str, Any]


@dataclass(frozen=True)
class RecordingRow:
    """Planned and measured motion, one sample per tick: as MCAP, and as samples.

    Attributes:
        mcap: For Foxglove.
        samples: The rows; see `store.samples`.
        earlier_csv: The rows, where an earlier version of Fling stored them so.
    """

    execution_id: str
    mcap: bytes
    samples: bytes | None
    earlier_csv: bytes = b""

    @property
    def table(self) -> tuple[list[str], NDArray[np.float64]]:
        """Names of the columns, and the rows (n, columns); both empty where nothing was recorded."""
        samples = self.samples or (samples_of_csv(self.earlier_csv) if self.earlier_csv else None)
        return unpack_samples(samples)[:2] if samples else ([], np.zeros((0, 0)))

    @property
    def csv(self) -> bytes:
        """The rows as CSV."""
        return samples_csv(self.samples) if self.samples else self.earlier_csv


@dataclass(frozen=True)
class LandingRow:
    """One observation of a landing: a position with its standard deviation, or a result for a target's radius.

    `source` is what observed it (`person`, `sim-camera`, a client's name for its camera), `reported_by` who told. One
    that was withdrawn, at `withdrawn_at` by `withdrawn_by`, is kept and counts nowhere.
    """

    id: str
    execution_id: str
    at: float
    source: str
    reported_by: str
    position: Sequence[float] | None = None
    std_m: float | None = None
    result: str | None = None
    radius_m: float | None = None
    withdrawn_at: float | None = None
    withdrawn_by: str | None = None


@dataclass(frozen=True)
class TrackedTargetRow:
    """A target of a cell that is observed again and again.

    Attributes:
        observed_at: When its last observation was stored [s since the epoch].
        track: What is known of it; see `planner.tracking.TargetTrack`.
    """

    id: str
    cell: str
    created_at: float
    created_by: str
    observed_at: float
    track: Mapping[str, Any]


@dataclass(frozen=True)
class ExperimentRow:
    """A series of executions; `settings` is what its client keeps with it."""

    id: str
    created_at: float
    name: str
    created_by: str
    settings: Mapping[str, Any]


@dataclass(frozen=True)
class ProfileRow:
    """What was learnt of a cell at one time; `document` is its JSON, `sha256` the hash of that."""

    id: str
    created_at: float
    cell: str
    cell_sha256: str
    created_by: str
    sha256: str
    document: bytes
    cell_version: int | None = None


@dataclass(frozen=True)
class CellVersionRow:
    """One version of a cell's files, from when on it was seen, and by whom.

    Attributes:
        meshes: What became of the mesh files that it names, as JSON; None where it names none.
    """

    cell: str
    version: int
    sha256: str
    text: bytes
    calibration: bytes | None
    seen_at: float
    seen_by: str
    meshes: bytes | None = None


@dataclass(frozen=True)
class CellRow:
    """Last heartbeat of a cell's executor, and what a person asked of it: to clear its fault, to operate its robot.

    Attributes:
        executor_id: The executor that holds the cell, or held it last.
        held_by: Where that runs, in words; None: it has given the cell up.
        robot_request: The newest one to operate the robot: id, action, requested_by, requested_at.
        robot_answer: What became of one: its id, whether it was done, and the words for it.
    """

    cell: str
    executor_id: str
    heartbeat_at: float
    link_kind: str
    robot: Mapping[str, Any]
    fault: Mapping[str, Any] | None
    read_only: bool
    acknowledge_requested_at: float | None = None
    acknowledge_handled_at: float | None = None
    acknowledged_by: str | None = None
    held_by: str | None = None
    robot_request: Mapping[str, Any] | None = None
    robot_answer: Mapping[str, Any] | None = None

    @property
    def open_robot_request(self) -> Mapping[str, Any] | None:
        """The request to operate the robot that nobody has answered; None without one."""
        request = self.robot_request
        answered = None if self.robot_answer is None else self.robot_answer["id"]
        return None if request is None or request["id"] == answered else request

    @property
    def is_alive(self) -> bool:
        """Whether the last heartbeat is younger than `HEARTBEAT_FRESH_S`."""
        return time.time() - self.heartbeat_at < HEARTBEAT_FRESH_S


@dataclass(frozen=True)
class BatchRow:
    """Many planning requests.

    Attributes:
        driven_by: "service" or "command": whose drivers take it up.
        specification: Its requests; see `jobs.batches`. Empty where it was not read.
        total: Number of requests.
        state: queued, running, finished.
        outcome: completed, cancelled or failed.
        counts: Number of results by outcome.
        driver_id: The process that plans it; its last heartbeat was at `heartbeat_at`.
        started_at: When that took it up, with `started_done` results there.
    """

    id: str
    created_at: float
    created_by: str
    request_id: str | None
    driven_by: str
    total: int
    state: str
    outcome: str | None
    reason: str | None
    counts: Mapping[str, int]
    cancel_requested_at: float | None
    driver_id: str | None
    heartbeat_at: float | None
    started_at: float | None
    started_done: int
    finished_at: float | None
    specification: bytes = b""

    @property
    def done(self) -> int:
        """Number of results."""
        return sum(self.counts.values())

    @property
    def is_driven(self) -> bool:
        """Whether its driver has sent a heartbeat within `DRIVER_FRESH_S`."""
        fresh = self.heartbeat_at is not None and time.time() - self.heartbeat_at < DRIVER_FRESH_S
        return self.state == "running" and fresh

    @property
    def rate_per_s(self) -> float | None:
        """Results per second since it was taken up [1/s]; None while it is not being planned, or nothing is known."""
        if self.state != "running" or self.started_at is None or self.heartbeat_at is None:
            return None
        new = self.done - self.started_done
        duration_s = self.heartbeat_at - self.started_at
        return new / duration_s if new > 0 and duration_s > 0.0 else None


@dataclass(frozen=True)
class BatchResultRow:
    """The result of one request of a batch.

    Attributes:
        number: of the request in its batch, counted from 0.
        problem_sha256: Hash of request, cell and profile.
        outcome: "planned", or the type of the problem that refuses it.
        planning_time_s: What its planner took [s].
        trajectory_sha256: Hash of the plan's samples.
        release_speed_m_s: Speed of the object at the release [m/s].
        refusal: Record of the planner's error.
    """

    batch_id: str
    number: int
    problem_sha256: str
    outcome: str
    planning_time_s: float
    plan_id: str | None = None
    trajectory_sha256: str | None = None
    release_time_s: float | None = None
    duration_s: float | None = None
    release_speed_m_s: float | None = None
    hit_probability: float | None = None
    refusal: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class MapRow:
    """One throwability map.

    Attributes:
        made_by: Who makes it: "service" or "command".
        definition: What it is of, as JSON; see `jobs.maps`.
        state: "running", "finished" or "cancelled".
        beat_at: When its last answers were stored.
    """

    id: str
    created_at: float
    cell: str
    cell_version: int
    created_by: str
    made_by: str
    definition_sha256: str
    definition: Mapping[str, Any]
    state: str
    beat_at: float | None = None
    cancel_requested_at: float | None = None
    finished_at: float | None = None

    @property
    def is_worked_on(self) -> bool:
        """Whether it is running, and answers were stored within `MAP_FRESH_S`."""
        return self.state == "running" and time.time() - (self.beat_at or 0.0) < MAP_FRESH_S


@dataclass(frozen=True)
class LandingCellRow:
    """The answer of one landing cell of a map.

    Attributes:
        map_id: The map.
        number: Of the landing cell.
        round: In which it was answered: 0 by its own search, later from the releases of its neighbours.
        state: 1 planned, 2 refused with proof, 3 not found; see `jobs.maps`.
        plan_id: Its plan.
        samples_sha256: Hash of the plan's trajectory.
        release_time_s: Of the plan.
        shift_early_m, shift_late_m: How far the landing point moves for a release 10 ms early, or late.
        hit_probability: Of the plan [-].
        margin, margin_check: Least margin of the certificate as a share of its limit [-], and which check has it.
        constraint_name, reason: Why it is refused: which constraint, and by how much.
    """

    map_id: str
    number: int
    round: int
    state: int
    plan_id: str | None = None
    samples_sha256: str | None = None
    release_time_s: float | None = None
    shift_early_m: float | None = None
    shift_late_m: float | None = None
    hit_probability: float | None = None
    margin: float | None = None
    margin_check: str | None = None
    constraint_name: str | None = None
    reason: str | None = None


@dataclass(frozen=True)
class JobRow:
    """A job: picks and throws one after another.

    Attributes:
        total: Number of its picks.
        state: queued, running, paused or finished.
        outcome: completed, cancelled or stopped, which can be resumed.
        reason: Why it stopped.
        revision: Grows with every change that a client is told of.
        resumed_at: What happened before it stops the job no more.
        driver_id: The process that drives it; its last heartbeat was at `heartbeat_at`.
        ordered: What was asked for; see `jobs.cycles`. Empty where it was not read.
    """

    id: str
    created_at: float
    created_by: str
    request_id: str | None
    cell: str
    total: int
    state: str
    outcome: str | None
    reason: str | None
    revision: int
    pause_requested_at: float | None
    cancel_requested_at: float | None
    resumed_at: float | None
    driver_id: str | None
    heartbeat_at: float | None
    started_at: float | None
    finished_at: float | None
    ordered: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_driven(self) -> bool:
        """Whether its driver has sent a heartbeat within `DRIVER_FRESH_S`."""
        fresh = self.heartbeat_at is not None and time.time() - self.heartbeat_at < DRIVER_FRESH_S
        return self.state != "finished" and fresh


@dataclass(frozen=True)
class JobCycleRow:
    """One motion of a job, written in one transaction with its execution, or once it was found that there is none.

    Attributes:
        number: In its job, counted from 0; its execution's idempotency key is made of both.
        kind: "approach" to a pick, or "throw" from one to the next.
        pick: That the throw starts at; None of an approach.
        next_pick: At which it ends; None: at home.
        turn: Counts the throws at targets.
        target: Number of the target.
        attempt: Of the pick, counted from 1.
        target_m: The target's place (3,) in the world [m].
        hit_radius_m: Distance from it that counts as a hit [m].
        result: What it was for the job, see `jobs.cycles`; None while its execution is not finished.
        outcome: Of its execution.
        object_at: Where its object is as far as known, in words.
        asked_at, ended_at: When its execution was asked for, and when its end was noted [s since the epoch].
    """

    job_id: str
    number: int
    kind: str
    pick: int | None
    next_pick: int | None
    turn: int | None = None
    target: int | None = None
    attempt: int = 1
    plan_id: str | None = None
    execution_id: str | None = None
    target_m: Sequence[float] | None = None
    hit_radius_m: float | None = None
    result: str | None = None
    outcome: str | None = None
    object_at: str | None = None
    reason: str | None = None
    asked_at: float | None = None
    ended_at: float | None = None


@dataclass(frozen=True)
class AuditLine:
    """Who did what, or was refused it.

    Attributes:
        who: Name of the token; "local" without tokens, "unknown" with a wrong one.
        action: Such as "execute" or "abort".
        remote: Address of the client.
        request_id: Id of the HTTP request.
        resource: Path of what was acted on.
        outcome: "done", or the type of the problem.
        reason: Why it was refused.
    """

    who: str
    action: str
    remote: str
    request_id: str | None = None
    resource: str = ""
    outcome: str = "done"
    reason: str | None = None


@dataclass(frozen=True)
class IdempotencyKey:
    """A client's idempotency key: its scope (client and path), the key itself, and the hash of the body."""

    scope: str
    key: str
    body_sha256: str

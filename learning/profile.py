"""Profiles: what is known of a cell at one time, as a document, and the cell with it applied."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import orjson

from learning.evidence import ThrowEvidence, UnusedThrow, throw_evidence
from learning.hit_evidence import weighed_by_outcomes
from learning.joint_speeds import JointSpeeds, learn_joint_speeds
from learning.outputs import learnt_outputs
from learning.predictions import LandingForecast, forecast
from learning.release import DRAG, LEAD, PRIOR_STD, STATE, ReleasePosterior, learn_release, prior_state, told_by_reports
from learning.streamed_arm import StreamedArm
from learning.throws import bin_rim, table_times, throw_table
from learning.timing_history import pooled_document, timing_runs
from planner.arrays import Array
from planner.cell import Cell
from planner.problem import ThrowProblem
from planner.trajectory import Trajectory
from store import Store

VERSION = 1  # of the document
DOUBTED = 0.5  # [-] probability of a mistake above which a reported landing is named as doubted
DRAG_KNOWN = 0.5  # [-] of the prior's width, below which a drag was learnt and takes the cell file's place


@dataclass(frozen=True, eq=False)
class CellKnowledge:
    """What is known about a cell: its arm, the release, and the joints' speeds.

    Attributes:
        arm: lag, with which it is streamed, and gains.
        release: posterior of lead, speed, base and drag.
        speeds: of the joints at the release.
    """

    arm: StreamedArm
    release: ReleasePosterior
    speeds: JointSpeeds

    @property
    def delay_s(self) -> float:
        """Gripper delay to plan with [s]: the lead less the lag."""
        return float(self.release.state[0]) - self.arm.lag_s

    @property
    def release_std_s(self) -> float:
        """Standard deviation of a release about its planned time [s]: jitter, and what is not known of the lead."""
        release = self.release
        return math.hypot(release.jitter, math.sqrt(float(release.state_covariance[LEAD, LEAD])))

    def release_deviation(self, cell: Cell, trajectory: Trajectory) -> tuple[Array, Array]:
        """Returns by how much positions [rad] and speeds [rad/s] are expected to be off a plan at its release, (6,).

        Args:
            cell: with the lag that it is streamed with.
            trajectory: as planned.
        """
        at = np.array([trajectory.release_time_s])
        off_q, off_qd = self.arm.deviation(trajectory, cell.timing.lag_s, cell.robot.qd_max, at)
        return off_q[0], off_qd[0] + self.speeds.expected(trajectory.qd[trajectory.release_index])

    def predicted(self, problem: ThrowProblem, trajectory: Trajectory) -> LandingForecast:
        """Returns where throws of a plan land, with the lag and the delay that the problem's cell assumes."""
        lag = problem.cell.timing.lag_s
        exact = lag == self.arm.lag_s and bool((self.arm.gain == 1.0).all())
        qd_max = problem.cell.robot.qd_max
        off = None if exact else self.arm.deviation(trajectory, lag, qd_max, table_times(trajectory.release_time_s))
        table = throw_table(problem, trajectory, off, beside_target=True)
        lead = problem.cell.gripper.delay_s + lag
        return forecast(self.release, self.speeds, table, lead, rim=bin_rim(problem, table))


def prior_knowledge(cell: Cell) -> CellKnowledge:
    """Returns the knowledge before any throw: the cell file's numbers, with the uncertainty of unmeasured ones."""
    prior = prior_state(cell.gripper.delay_s + cell.timing.lag_s, cell.object.drag_coefficient)
    nothing = np.zeros((0, 6))
    release = learn_release([], prior)
    if cell.gripper.jitter_s > 0.0:
        release = replace(release, jitter_s=np.full(len(release.weight), cell.gripper.jitter_s))
    return CellKnowledge(StreamedArm(cell.timing.lag_s, np.ones(6)), release, learn_joint_speeds(nothing, nothing))


def estimate_profile(store: Store, cell: Cell) -> dict[str, Any]:
    """Returns the document of a profile from everything that is known of a cell.

    Args:
        store: with executions, recordings and landings.
        cell: as its file says, without a profile.
    """
    runs = timing_runs(store, cell)
    timing = pooled_document([run for _, run in runs], cell.timing.lag_s)
    lag = cell.timing.lag_s if timing is None else timing["lag_s"]
    arm = StreamedArm(lag, np.ones(6) if timing is None else known_gains(timing["gain"]))
    throws, unused = throw_evidence(store, cell, arm)
    prior = prior_state(cell.gripper.delay_s + cell.timing.lag_s, cell.object.drag_coefficient)
    release = learn_release([t.observed for t in throws if t.observed is not None], prior)
    release = told_by_reports(release, [t.opened for t in throws if t.opened is not None])
    release = weighed_by_outcomes(release, [t.outcome for t in throws if t.outcome is not None])
    recorded = [(t.planned_qd, t.deviation) for t in throws if t.deviation is not None]
    pairs = np.array(recorded, float).reshape(-1, 2, 6)
    speeds = learn_joint_speeds(pairs[:, 0], pairs[:, 1])
    known = CellKnowledge(arm, release, speeds)
    switched = ((row.metrics or {}).get("outputs", ()) for row in store.executions_of_cell(cell.name))
    outputs = learnt_outputs(cell, switched, lag)
    head = {"version": VERSION, "cell": cell.name, "cell_sha256": cell.sha256}
    found = {
        "timing": timing,
        "outputs": outputs,
        "evidence": _evidence_document(throws, unused, [row.id for row, _ in runs], release),
    }
    return {**head, **_numbers(cell, known, timing), **_landings(throws, release), **found, **_posterior(known)}


def knowledge_of(document: Mapping[str, Any]) -> CellKnowledge:
    """Returns the knowledge that a profile's document holds."""
    mixture = document["mixture"]
    speeds = document["joint_speeds"]
    release = ReleasePosterior(
        weight=np.array(mixture["weight"], float),
        mean=np.array(mixture["mean"], float),
        covariance=np.array(mixture["covariance"], float),
        jitter_s=np.array(mixture["jitter_s"], float),
        scatter_rad_s=np.array(mixture["scatter_rad_s"], float),
        cling_alpha=float(mixture["cling_alpha"]),
        cling_beta=float(mixture["cling_beta"]),
    )
    gains = (np.array(speeds["gain_error"], float), np.array(speeds["gain_std"], float))
    arm = StreamedArm(float(document["lag_s"]), known_gains(document["gain"] or [None] * 6))
    return CellKnowledge(arm, release, JointSpeeds(*gains, speeds["shape"], speeds["scale"]))


def known_gains(gains: Sequence[float | None]) -> Array:
    """Returns the joints' gains (6,); 1 where no run shows one."""
    return np.array([1.0 if gain is None else gain for gain in gains])


def cell_with_profile(cell: Cell, document: Mapping[str, Any] | None) -> Cell:
    """Returns the cell with a profile's lag, delays and jitter, release speed and drag; None: the cell itself.

    Nothing else is replaced: limits, surroundings and tool stay the cell file's.
    """
    if document is None:
        return cell
    gripper = replace(
        cell.gripper,
        delay_s=float(document["delay_s"]),
        jitter_s=float(document["jitter_s"]),
        release_speed_factor=float(document.get("speed_factor", 1.0)),
    )
    thing = replace(cell.object, drag_coefficient=float(document["drag_coefficient"]))
    timing = replace(cell.timing, lag_s=float(document["lag_s"]))
    shown = document.get("outputs", {})
    outputs = {
        name: replace(each, delay_s=shown[name]["delay_s"], jitter_s=shown[name]["jitter_s"]) if name in shown else each
        for name, each in cell.outputs.items()
    }
    return cell.as_learnt(timing=timing, gripper=gripper, object=thing, outputs=outputs)


def cell_in_use(store: Store, cell: Cell) -> tuple[Cell, str | None]:
    """Returns a cell with the numbers of the profile that it uses, and the profile's id; None: the cell file's."""
    profile = store.profile_in_use(cell.name, cell.sha256)
    return (cell, None) if profile is None else (cell_with_profile(cell, orjson.loads(profile.document)), profile.id)


def profile_bytes(document: Mapping[str, Any]) -> bytes:
    """Returns the document as the bytes that are hashed and stored."""
    return orjson.dumps(document, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_SORT_KEYS)


def is_drag_learnt(drag_coefficient_std: float) -> bool:
    """Returns whether throws have shown a cell's drag, so that a profile's is learnt and not the cell file's."""
    return bool(drag_coefficient_std < DRAG_KNOWN * PRIOR_STD[DRAG])


def _numbers(cell: Cell, known: CellKnowledge, timing: Mapping[str, Any] | None) -> dict[str, Any]:
    """Returns the numbers of a profile that people read, each with its standard deviation."""
    release = known.release
    state = release.state
    std = np.sqrt(np.diag(release.state_covariance))
    jitter_std = math.sqrt(float(release.weight @ (release.jitter_s - release.jitter) ** 2))
    seen = is_drag_learnt(float(std[DRAG]))
    return {
        "lag_s": known.arm.lag_s,
        "lag_std_s": None if timing is None else timing["lag_std_s"],
        "gain": None if timing is None else timing["gain"],
        "delay_s": known.delay_s,
        "delay_std_s": float(std[0]),
        "jitter_s": release.jitter,
        "jitter_std_s": jitter_std,
        "speed_factor": float(state[1]),
        "speed_factor_std": float(std[1]),
        "landing_offset_m": state[2:4].tolist(),
        "landing_offset_std_m": std[2:4].tolist(),
        "drag_coefficient": max(0.0, float(state[4])) if seen else cell.object.drag_coefficient,
        "drag_coefficient_std": float(std[4]),
        "base_turn_rad": float(state[5]),
        "base_turn_std_rad": float(std[5]),
        "cling_share": release.cling_alpha / (release.cling_alpha + release.cling_beta),
        "state": list(STATE),
        "covariance": release.state_covariance.tolist(),
        "cell_file": {"lag_s": cell.timing.lag_s, "delay_s": cell.gripper.delay_s, "jitter_s": cell.gripper.jitter_s},
    }


def _landings(throws: Sequence[ThrowEvidence], release: ReleasePosterior) -> dict[str, Any]:
    """Returns where each throw was to land, did, and would be expected to by what was learnt, with median distances."""
    rows = []
    distances = []
    for throw in throws:
        if throw.observed is not None and np.isfinite(throw.landing).all():
            seen = throw.observed.landing
            expected = release.expected_landing(throw.observed)
            points = {"planned": throw.landing.tolist(), "observed": seen.tolist(), "expected": expected.tolist()}
            rows.append({"execution_id": throw.execution_id, **points})
            distances.append([np.linalg.norm(seen - throw.landing), np.linalg.norm(seen - expected)])
    before, after = np.median(distances, axis=0).tolist() if distances else (None, None)
    return {"landings": rows, "landing_error_before_m": before, "landing_error_after_m": after}


def _evidence_document(
    throws: Sequence[ThrowEvidence], unused: Sequence[UnusedThrow], timing_ids: list[str], release: ReleasePosterior
) -> dict[str, Any]:
    return {
        "throws": [t.execution_id for t in throws if t.observed is not None or t.outcome is not None],
        "landings": [id for t in throws for id in t.landing_ids],
        "reported": [t.execution_id for t in throws if t.opened is not None],
        "recordings": [t.execution_id for t in throws if t.deviation is not None],
        "timing": timing_ids,
        "not_used": [vars(throw) for throw in unused],
        "doubted": [vars(throw) for throw in _doubted(throws, release)],
    }


def _doubted(throws: Sequence[ThrowEvidence], release: ReleasePosterior) -> Iterator[UnusedThrow]:
    """Yields the throws whose reported landing is more likely a mistake than not, which weighs it lightly."""
    seen = [(throw.execution_id, throw.observed) for throw in throws if throw.observed is not None]
    for (execution_id, observed), mistaken in zip(seen, release.mistaken, strict=True):
        if mistaken > DOUBTED:
            away_m = np.linalg.norm(observed.landing - release.expected_landing(observed))
            yield UnusedThrow(execution_id, f"its landing is {away_m:.2f} m from where this profile expects it")


def _posterior(known: CellKnowledge) -> dict[str, Any]:
    release = known.release
    speeds = known.speeds
    names = ("weight", "mean", "covariance", "jitter_s", "scatter_rad_s")
    mixture = {name: getattr(release, name).tolist() for name in names}
    mixture |= {"cling_alpha": release.cling_alpha, "cling_beta": release.cling_beta}
    joints = {"gain_error": speeds.gain_error.tolist(), "gain_std": speeds.gain_std.tolist()}
    return {"mixture": mixture, "joint_speeds": {**joints, "shape": speeds.shape, "scale": speeds.scale}}

"""The motion of an execution as its plans have it: the state at a time, and the throw that is still to come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import orjson

from api.dependencies import Service
from planner.trajectory import Trajectory
from store import ExecutionRow


@dataclass(frozen=True)
class RunningMotion:
    """The motion of an execution from one tick on.

    Attributes:
        summary: of the plan that moves it then.
        motion: the plan's trajectory.
        tick: of that.
    """

    summary: dict[str, Any]
    motion: dict[str, Any]
    tick: int

    @property
    def state(self) -> dict[str, Any]:
        """Positions, velocities and accelerations at the tick."""
        return {name: self.motion[name][self.tick] for name in ("positions", "velocities", "accelerations")}

    @property
    def throw(self) -> Trajectory | None:
        """What is left of it; None unless a release, and nothing else, is still to be passed."""
        release = self.summary["release"]
        passages = self.summary.get("passages") or [release]
        ahead = [each["index"] for each in passages if each is not None and each["index"] > self.tick]
        if release is None or release.get("command_time_s") is None or ahead != [release["index"]]:
            return None
        arrays = [np.array(self.motion[name]) for name in self.state]
        whole = Trajectory(self.summary["sample_rate_hz"], *arrays, release_index=release["index"])
        return whole.since(self.tick)


def running_motion(service: Service, row: ExecutionRow, at_s: float) -> RunningMotion | None:
    """Returns an execution's motion from the tick nearest to a time [s] on; None beyond its end."""
    begins_s = 0.0
    plan_id = row.plan_id
    for each in row.joined:
        if each["joins_s"] <= at_s:
            begins_s = each["joins_s"]
            plan_id = each["plan_id"]
    plan = service.store.plan(plan_id)
    assert plan is not None  # retention keeps the plans of executions
    motion = orjson.loads(plan.trajectory)
    summary = orjson.loads(plan.summary)
    tick = round((at_s - begins_s) * summary["sample_rate_hz"])
    return RunningMotion(summary, motion, tick) if 0 <= tick < len(motion["positions"]) else None

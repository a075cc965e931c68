"""Plans as ROS 2 messages, without ROS: dictionaries in the shape of `trajectory_msgs/msg/JointTrajectory`.

`rosidl_runtime_py.set_message_fields(JointTrajectory(), as_joint_trajectory(plan))` makes the message of it.
Source of the fields: common_interfaces of ROS 2, trajectory_msgs/msg/JointTrajectory and JointTrajectoryPoint.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fling.plans import Plan

NANOSECONDS = 1_000_000_000  # in a second


def as_joint_trajectory(
    plan: Plan | Mapping[str, Any], joint_names: Sequence[str] | None = None, frame_id: str = ""
) -> dict[str, Any]:
    """Returns the motion of a plan as a `trajectory_msgs/msg/JointTrajectory`, one point a tick.

    A message knows no gripper: open it at the plan's `release.command_time_s`.

    Args:
        plan: from `fling.plan()`, or a plan document with its trajectory.
        joint_names: of the driver, where they have a prefix; by default those of UR's ROS driver.
        frame_id: of the header.

    Raises:
        ValueError: the document has no trajectory, or there are not as many names as joints.
    """
    names, times, rows = _samples(plan)
    if joint_names is not None and len(joint_names) != len(names):
        raise ValueError(f"{len(joint_names)} joint_names are given for {len(names)} joints")
    points = [
        {"positions": q, "velocities": qd, "accelerations": qdd, "effort": [], "time_from_start": _duration(t)}
        for t, q, qd, qdd in zip(times, *rows, strict=True)
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id}
    return {"header": header, "joint_names": list(joint_names or names), "points": points}


def _samples(plan: Plan | Mapping[str, Any]) -> tuple[list[str], list[float], tuple[list[list[float]], ...]]:
    """Returns joint names, times [s], and positions, velocities and accelerations (N, 6) of a plan."""
    if isinstance(plan, Plan):
        motion = plan.trajectory
        rows = (motion.q.tolist(), motion.qd.tolist(), motion.qdd.tolist())
        return list(motion.joint_names), motion.t.tolist(), rows
    if "trajectory" not in plan:
        raise ValueError("the plan document has no trajectory; ask for it without trajectory=false")
    motion = plan["trajectory"]
    rows = (motion["positions"], motion["velocities"], motion["accelerations"])
    return list(motion["joint_names"]), list(motion["time_from_start"]), rows


def _duration(time_s: float) -> dict[str, int]:
    """Returns a time as `builtin_interfaces/msg/Duration`, rounded to the nanosecond."""
    seconds, nanoseconds = divmod(round(time_s * NANOSECONDS), NANOSECONDS)
    return {"sec": seconds, "nanosec": nanoseconds}

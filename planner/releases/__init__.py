"""Kinds of release, one module each; `KINDS` lists them."""

from typing import Any

from planner.releases.joint import JointRelease
from planner.releases.line import SteadyLine
from planner.releases.point import PointRelease
from planner.releases.pose import POSE, PoseRelease
from planner.releases.release import Bound, LandingAxis, Opening, PointState, Release, ReleaseSample, Target
from planner.releases.target import UPTIME_MAX_S, TargetRelease

__all__ = [
    "KINDS",
    "POSE",
    "UPTIME_MAX_S",
    "Bound",
    "JointRelease",
    "LandingAxis",
    "Opening",
    "PointRelease",
    "PointState",
    "PoseRelease",
    "Release",
    "ReleaseSample",
    "SteadyLine",
    "Target",
    "TargetRelease",
    "release_document",
]

KINDS: dict[str, type[Release]] = {
    kind.name: kind
    for kind in (
        PoseRelease,
        PointRelease,
        JointRelease,
        TargetRelease,
    )
}


def release_document(release: Release) -> dict[str, Any]:
    """Returns a release in the shape of `POST /plan`, in the world frame."""
    return {"kind": release.name, **release.to_json()}

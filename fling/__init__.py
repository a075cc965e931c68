"""Plan a throw for a Universal Robots arm, get it certified, stream it to the arm: the public face of Fling.

Everything that documentation and examples use is reached from here, and loaded when it is first used::

    import fling

    cell = fling.open_cell("ur5e-sim")
    plan = fling.plan(fling.Target([1.2, 0.3, 0.0]), cell)
    print(plan, plan.release_time_s, plan.certificate.valid)

Names that are not listed in `__all__` may change without notice.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from fling import stop_socket, this_machine, tracing
    from fling.camera import Camera
    from fling.cells import cell_names, open_cell
    from fling.client import Client, ServiceRefusal
    from fling.motion import Trajectory
    from fling.picture import plan_svg
    from fling.planning import plan, problem
    from fling.plans import Edge, Flight, Odds, Passed, Plan, Release
    from fling.requests import Bin, Joint, Limits, Line, Options, Output, Passage, Point, Pose, Target
    from fling.ros import as_joint_trajectory
    from planner import flight, kinematics, rotations, timing
    from planner.cell import Cell
    from planner.certificate import Certificate, Check, certify
    from planner.errors import (
        BackendUnavailable,
        CellError,
        FieldError,
        FileRefused,
        IncompleteRobot,
        Infeasible,
        InvalidProblem,
        PlannerError,
        SolverFailed,
        UnknownRobot,
        Violation,
    )
    from planner.problem import ThrowProblem
    from planner.progress import Progress
    from planner.robots import Robot, robot
    from planner.trajectory import integrate

__all__ = [
    "BackendUnavailable",
    "Bin",
    "Camera",
    "Cell",
    "CellError",
    "Certificate",
    "Check",
    "Client",
    "Edge",
    "FieldError",
    "FileRefused",
    "Flight",
    "IncompleteRobot",
    "Infeasible",
    "InvalidProblem",
    "Joint",
    "Limits",
    "Line",
    "Odds",
    "Options",
    "Output",
    "Passage",
    "Passed",
    "Plan",
    "PlannerError",
    "Point",
    "Pose",
    "Progress",
    "Release",
    "Robot",
    "ServiceRefusal",
    "SolverFailed",
    "Target",
    "ThrowProblem",
    "Trajectory",
    "UnknownRobot",
    "Violation",
    "__version__",
    "as_joint_trajectory",
    "cell_names",
    "certify",
    "flight",
    "integrate",
    "kinematics",
    "open_cell",
    "plan",
    "plan_svg",
    "problem",
    "robot",
    "rotations",
    "stop_socket",
    "this_machine",
    "timing",
    "tracing",
]

DISTRIBUTION = "fling-robotics"  # on the package index, where "fling" is another project's name

_HOMES = {  # module: the public names that it holds
    "fling.camera": ("Camera",),
    "fling.cells": ("cell_names", "open_cell"),
    "fling.client": ("Client", "ServiceRefusal"),
    "fling.motion": ("Trajectory",),
    "fling.picture": ("plan_svg",),
    "fling.planning": ("plan", "problem"),
    "fling.plans": ("Edge", "Flight", "Odds", "Passed", "Plan", "Release"),
    "fling.requests": ("Bin", "Joint", "Limits", "Line", "Options", "Output", "Passage", "Point", "Pose", "Target"),
    "fling.ros": ("as_joint_trajectory",),
    "planner": ("flight", "kinematics", "rotations", "timing"),
    "planner.cell": ("Cell",),
    "planner.certificate": ("Certificate", "Check", "certify"),
    "planner.errors": (
        "BackendUnavailable",
        "CellError",
        "FieldError",
        "FileRefused",
        "IncompleteRobot",
        "Infeasible",
        "InvalidProblem",
        "PlannerError",
        "SolverFailed",
        "UnknownRobot",
        "Violation",
    ),
    "planner.problem": ("ThrowProblem",),
    "planner.progress": ("Progress",),
    "planner.robots": ("Robot", "robot"),
    "planner.trajectory": ("integrate",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Loads a public name when it is first used: `import fling` itself costs nothing."""
    if name == "__version__":
        return _version()
    if name in ("stop_socket", "this_machine", "tracing"):
        return import_module(f"fling.{name}")
    if name not in _HOME_OF:
        raise AttributeError(f"module 'fling' has no attribute {name!r}")
    home = import_module(_HOME_OF[name])
    found = getattr(home, name, None) or import_module(f"{home.__name__}.{name}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Returns the public names, loaded or not."""
    return sorted({*globals(), *__all__})


def _version() -> str:
    """Returns the installed version, or "0+unknown" in a checkout that was never installed."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "0+unknown"

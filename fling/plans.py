"""A plan as library and client return it: typed views of its document, which says the same in JSON."""

from __future__ import annotations

import html
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from fling.cells import open_cell
from fling.motion import Trajectory
from fling.picture import STYLE, plan_svg
from planner.answer import Attempt, passing_text
from planner.arrays import Array
from planner.cell import Cell
from planner.certificate import Certificate, Check
from planner.errors import CellError
from planner.planning import Plan as Planned
from planner.problem import ThrowProblem


@dataclass(frozen=True, eq=False, kw_only=True)
class Release:
    """The state in which the object leaves the tool, in the world.

    Attributes:
        time_s: on the trajectory, exactly a tick [s].
        command_time_s: of the gripper's open command, its delay and the arm's lag sooner [s]; None for a move that
            ends at rest.
        index: sample of the trajectory.
        q, qd, qdd: joint positions, velocities, accelerations (6,) [rad, rad/s, rad/s^2].
        position: of the tool centre point (3,) [m].
        quaternion: its orientation [x, y, z, w] (4,).
        rotation_vector: the same orientation (3,) [rad].
        linear, angular: velocity of the tool centre point (3,) [m/s], angular velocity of the tool (3,) [rad/s].
    """

    time_s: float
    command_time_s: float | None
    index: int
    q: Array
    qd: Array
    qdd: Array
    position: Array
    quaternion: Array
    rotation_vector: Array
    linear: Array
    angular: Array

    @property
    def speed_m_s(self) -> float:
        """Speed of the tool centre point [m/s]."""
        return float(np.linalg.norm(self.linear))


@dataclass(frozen=True, kw_only=True)
class Edge:
    """An output that switches about a passage; times are on the plan's clock [s].

    Attributes:
        output, index, level, offset_s, offset_m: as in the request.
        command_time_s: when it is commanded.
        edge_time_s: when it changes.
    """

    output: str
    index: int
    level: bool
    offset_s: float
    command_time_s: float
    edge_time_s: float
    offset_m: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Passed(Release):
    """A passage of the motion, of a line its start; `command_time_s` is None where nothing is let go.

    Attributes:
        name: as in the request.
        end_index: sample at which it ends; that of a state itself.
        edges: its outputs, in the order of the request.
        flight: of the object that leaves here, in a cell with `[grippers]`; else None: see `Plan.flight`.
    """

    name: str
    end_index: int
    edges: tuple[Edge, ...]
    flight: Flight | None = None


@dataclass(frozen=True, eq=False)
class Flight:
    """The object's path after the release, in the world.

    Attributes:
        landing_point: (3,) [m].
        time_of_flight_s: [s].
        apex_height_m: highest point [m].
        speed_m_s: of the object as it leaves [m/s].
        path: positions every 20 ms from the release to the landing (N, 3) [m].
        release_window_s: half width of the window of release times; 0: only the nominal release [s].
        landing_tolerance_m: landing error allowed in the window [m].
        window: release delays [s] and landing errors [m] (M, 2); infinite where the object never lands.
        landing_per_release_delay_m_s: shift of the landing point per delay (3,) [m/s]; None where it never lands.
    """

    landing_point: Array
    time_of_flight_s: float
    apex_height_m: float
    speed_m_s: float
    path: Array = field(repr=False)
    release_window_s: float
    landing_tolerance_m: float
    window: Array = field(repr=False)
    landing_per_release_delay_m_s: Array | None


@dataclass(frozen=True, eq=False)
class Odds:
    """How likely a throw hits.

    Attributes:
        value: probability of a hit [-].
        interval: 90 % interval of this cell's own probability (2,) [-].
        radius_m: distance from the target that counts as a hit [m].
        profile: learnt profile that it rests on; None: the cell file and wide priors, so that little is known.
    """

    value: float
    interval: Array
    radius_m: float
    profile: str | None


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """A certified motion for a request.

    Attributes:
        document: the plan as JSON, as `GET /plans/{id}` answers it and `fling report` reads it.
    """

    document: Mapping[str, Any]
    planned: Planned | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """Returns the plan in a line."""
        return f"<Plan {'; '.join(self._facts().values())}>"

    def _repr_html_(self) -> str:
        """Returns facts and picture of the plan, as notebooks show them."""
        rows = "".join(f"<tr><th>{name}</th><td>{html.escape(text)}</td></tr>" for name, text in self._facts().items())
        cell = self._own_cell
        picture = plan_svg(self.document, cell) if cell is not None and "trajectory" in self.document else ""
        return f'<div class="fling-plan"><style>{STYLE}</style><table>{rows}</table>{picture}</div>'

    @property
    def id(self) -> str:
        """Identifier; a service knows the plan by it."""
        return self.document["id"]

    @property
    def cell(self) -> str:
        """Name of the cell."""
        return self.document["cell"]

    @property
    def request(self) -> dict[str, Any]:
        """The request, as it was asked."""
        return self.document["request"]

    @property
    def backend(self) -> str:
        """Back end that found the motion."""
        return self.document["backend"]

    @property
    def status(self) -> str:
        """Final status of the back end, in words."""
        return self.document["solver"]["status"]

    @property
    def attempts(self) -> tuple[Attempt, ...]:
        """Log of the search."""
        return tuple(Attempt(**attempt) for attempt in self.document["solver"]["attempts"])

    @property
    def solve_time_s(self) -> float:
        """Duration of the search, loading of libraries excluded [s]."""
        return self.document["solver"]["solve_time_s"]

    @property
    def duration_s(self) -> float:
        """Time from the start to standstill [s]."""
        return self.document["duration_s"]

    @property
    def release_time_s(self) -> float | None:
        """Time of the release [s]; None for passages that let nothing go."""
        return self.document["release_time_s"]

    @cached_property
    def release(self) -> Release | None:
        """The state in which the object leaves the tool; None for passages that let nothing go."""
        found = self.document["release"]
        if found is None:
            return None
        return Release(**_passed(found), time_s=self.document["release_time_s"])

    @cached_property
    def passages(self) -> tuple[Passed, ...]:
        """The passages in their order; none where a release alone was asked for."""
        return tuple(
            Passed(
                **_passed(found),
                time_s=found["time_s"],
                name=found["name"],
                end_index=found["end_index"],
                edges=tuple(Edge(**edge) for edge in found["outputs"]),
                flight=_flight(found.get("flight")),
            )
            for found in self.document.get("passages", ())
        )

    @cached_property
    def flight(self) -> Flight | None:
        """The path of the object that leaves first; None for a move that ends at rest."""
        return _flight(self.document["flight"])

    @property
    def odds(self) -> Odds | None:
        """How likely the throw hits; None for a release without a target, and in plans made without a service."""
        found = self.document.get("hit_probability")
        if found is None:
            return None
        return Odds(found["value"], np.array(found["interval"]), found["radius_m"], found["profile"])

    @cached_property
    def certificate(self) -> Certificate:
        """The checks of the motion."""
        found = self.document["certificate"]
        checks = tuple(Check(**{**check, **_numbers(check)}) for check in found["checks"])
        return Certificate(checks, tuple(found["not_checked"]))

    @cached_property
    def trajectory(self) -> Trajectory:
        """The joint motion.

        Raises:
            ValueError: the service was asked for the plan without it.
        """
        if self.planned is not None:
            motion = self.planned.trajectory
            names = self.planned.problem.cell.robot.joint_names
            samples = (motion.sample_rate_hz, motion.q, motion.qd, motion.qdd)
            return Trajectory(*samples, motion.release_index, names, passage_indices=motion.passage_indices)
        found = self.document.get("trajectory")
        if found is None:
            raise ValueError("the plan has no trajectory; ask for it without trajectory=False")
        passages = self.document.get("passages", ())
        release = self.document["release"]
        return Trajectory(
            sample_rate_hz=self.document["sample_rate_hz"],
            q=np.array(found["positions"], float),
            qd=np.array(found["velocities"], float),
            qdd=np.array(found["accelerations"], float),
            release_index=(release or passages[-1])["index"],
            passage_indices=tuple(passage["index"] for passage in passages),
            joint_names=tuple(found["joint_names"]),
        )

    @property
    def problem(self) -> ThrowProblem:
        """The problem in the planner's units, for `fling.certify`.

        Raises:
            ValueError: a service made the plan; state it with `fling.problem(plan.request, cell)`.
        """
        if self.planned is None:
            raise ValueError("a service made the plan: state its problem with fling.problem(plan.request, cell)")
        return self.planned.problem

    @property
    def _own_cell(self) -> Cell | None:
        """The cell that the plan was made for; None where this machine has no such file, or another one."""
        if self.planned is not None:
            return self.planned.problem.cell
        try:
            cell = open_cell(self.cell)
        except CellError:
            return None
        return cell if cell.sha256 == self.document["cell_sha256"] else None

    def _facts(self) -> dict[str, str]:
        """Returns what the plan is in a few words each, by name."""
        facts = {"Cell": self.cell}
        if self.passages or self.release is None:
            facts["Passages"] = passing_text(self.document)
        else:
            release = f"at {self.release.time_s:.3f} s of {self.duration_s:.3f} s, {self.release.speed_m_s:.2f} m/s"
            facts["Release"] = f"{self.request['release']['kind']} {release}"
        if self.flight is not None:
            facts["Landing"] = _landing_text(self.flight)
        if self.odds is not None:
            facts["Odds"] = _odds_text(self.odds)
        count = len(self.document["certificate"]["checks"])
        facts["Certificate"] = f"valid, {count} checks" if self.document["certificate"]["valid"] else "not valid"
        facts["Found by"] = f"{self.backend} in {1e3 * self.solve_time_s:.0f} ms"
        return facts


def _passed(found: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the attributes of a `Release`, but its time."""
    return {
        "index": found["index"],
        "command_time_s": found["command_time_s"],
        "q": np.array(found["positions"]),
        "qd": np.array(found["velocities"]),
        "qdd": np.array(found["accelerations"]),
        **{name: np.array(values) for name, values in {**found["pose"], **found["twist"]}.items()},
    }


def _flight(found: Mapping[str, Any] | None) -> Flight | None:
    """Returns a flight as a plan's document tells it; None without one."""
    if found is None:
        return None
    errors = [(entry["delay_s"], _finite(entry["landing_error_m"])) for entry in found["window"]]
    drift = found["landing_per_release_delay_m_s"]
    return Flight(
        landing_point=np.array(found["landing_point"]),
        time_of_flight_s=found["time_of_flight_s"],
        apex_height_m=found["apex_height_m"],
        speed_m_s=found["speed_m_s"],
        path=np.array(found["object_path"]),
        release_window_s=found["release_window_s"],
        landing_tolerance_m=found["landing_tolerance_m"],
        window=np.array(errors),
        landing_per_release_delay_m_s=None if drift is None else np.array(drift),
    )


def _landing_text(flight: Flight) -> str:
    """Returns where and when the object lands."""
    x, y, z = flight.landing_point
    place = f"lands at ({x:.3f}, {y:.3f}, {z:.3f}) m after {flight.time_of_flight_s:.3f} s"
    if flight.release_window_s <= 0.0:
        return place
    window = f"{1e3 * flight.landing_tolerance_m:.0f} mm for a release ±{1e3 * flight.release_window_s:.1f} ms"
    return f"{place}, within {window}"


def _odds_text(odds: Odds) -> str:
    """Returns how likely the throw hits; without a profile the number would only say how little is known."""
    if odds.profile is None:
        return "timing unknown: the cell is not calibrated"
    return f"hits within {1e3 * odds.radius_m:.0f} mm with {odds.value:.0%}"


def _finite(number: float | None) -> float:
    """Returns a number of a document, in which null stands for what is not finite."""
    return math.inf if number is None else number


def _numbers(check: Mapping[str, Any]) -> dict[str, float]:
    return {name: _finite(check[name]) for name in ("value", "limit", "margin")}

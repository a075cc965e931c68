"""What a client asks for of a job, as JSON: picks, targets, policy; and the picks of a grid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from jobs.cycles.motions import PickLines
from planner.errors import FieldError, InvalidProblem
from planner.fields import Choice, Field, Kinds, ListOr, Number, Record, RecordList, Text, Vector, Whole, required
from planner.releases import KINDS, POSE

PICKS_MAX = 1000  # objects of a job: an hour at one every 3.6 s
TARGETS_MAX = 100
ATTEMPTS_MAX = 10
SIDE_MAX = 100  # columns or rows of a grid
APPROACH_M = 0.1  # [m] above a pick: an object, and its neighbours, are lower as a rule
LINE_M_S = 0.25  # [m/s] the speed of a collaborative arm's tool in setup; source: ISO 10218-1, reduced speed
STANDS = "stands still in a job, whose cycles are planned ahead: give its position alone"

PICK = Record(
    "PickRequest",
    "An object that lies ready, and how the tool takes it.",
    {
        "pose": required(POSE, "Pose of the tool centre point as the gripper closes, in the world."),
        "object": Field(Text(64), "What it is, for people and tables."),
    },
)
GRID = Record(
    "PickGridRequest",
    "A tray: picks in columns and rows, the columns of the first row first.",
    {
        "corner": required(POSE, "Pose of the first pick, in the world; the others have its orientation."),
        "along_m": required(Vector(3), "From one column to the next, in the world [m]."),
        "across_m": required(Vector(3), "From one row to the next, in the world [m]."),
        "columns": required(Whole(1, SIDE_MAX), "Number of columns."),
        "rows": required(Whole(1, SIDE_MAX), "Number of rows."),
    },
)
PICK_GRID = Record("PicksOfGridRequest", "Picks on a grid.", {"grid": required(GRID, "The tray.")})
POLICY = Record(
    "JobPolicy",
    "What is done about a miss. A fault of an execution stops the job in any case.",
    {
        "missed_grip": Field(
            Choice(("retry", "skip", "stop")),
            "Nothing was gripped: grip again, put the pick aside, or stop the job.",
            default="stop",
        ),
        "missed_throw": Field(
            Choice(("retry", "skip", "stop")),
            "An object landed beside its target: the target gets another one, or nothing is done, or the job stops.",
            default="skip",
        ),
        "attempts": Field(
            Whole(1, ATTEMPTS_MAX), "Grips of a pick, and throws at a target's turn, at most.", default=2
        ),
    },
)
JOB_REQUEST = Record(
    "JobRequest",
    "Picks and throws one after another.",
    {
        "cell": Field(Text(64, least=1), "Name of the cell; absent: the service's default cell."),
        "picks": required(
            ListOr(RecordList(PICK, 1, PICKS_MAX), PICK_GRID), "What to pick, in this order: a list, or a grid."
        ),
        "targets": required(
            RecordList(Kinds({"target": KINDS["target"].record}).record("target"), 1, TARGETS_MAX),
            "What to throw at, in turn: points or bins, as in `release`.",
        ),
        "policy": Field(POLICY, "What is done about a miss.", default={}),
        "approach_m": Field(
            Number(above=0.0, most=1.0),
            "Height above a pick of the lines down to it and up from it [m].",
            default=APPROACH_M,
        ),
        "line_speed_m_s": Field(Number(above=0.0, most=2.0), "Speed of the tool along them [m/s].", default=LINE_M_S),
    },
)


@dataclass(frozen=True)
class JobOrder:
    """A job as it was ordered.

    Attributes:
        cell: name of the cell.
        picks: poses in the world, each with what its object is.
        targets: releases of kind `target`.
        policy: what is done about a miss.
        lines: above the picks.
    """

    cell: str
    picks: list[dict[str, Any]]
    targets: list[dict[str, Any]]
    policy: Mapping[str, Any]
    lines: PickLines

    @classmethod
    def read(cls, document: Mapping[str, Any], default_cell: str) -> Self:
        """Returns the order that a request of `POST /jobs` states; `to_json` of one is such a request, too.

        Raises:
            InvalidProblem: every refused field with its reason.
        """
        errors: list[FieldError] = []
        asked = JOB_REQUEST.read(document, "", errors)
        if errors:
            raise InvalidProblem(errors)
        lines = PickLines(asked["approach_m"], asked["line_speed_m_s"])
        picks = asked["picks"]
        if isinstance(picks, dict):
            picks = _grid_picks(picks["grid"], errors)
        _check_targets(asked["targets"], errors)
        _check_lines(lines, errors)
        if errors:
            raise InvalidProblem(errors)
        return cls(asked.get("cell", default_cell), picks, asked["targets"], asked["policy"], lines)

    def to_json(self) -> dict[str, Any]:
        """Returns it in the shape of `POST /jobs`, a grid as the list of its picks."""
        lines = {"approach_m": self.lines.approach_m, "line_speed_m_s": self.lines.speed_m_s}
        return {"cell": self.cell, "picks": self.picks, "targets": self.targets, "policy": dict(self.policy), **lines}

    def pose(self, pick: int | None) -> dict[str, Any] | None:
        """Returns the pose of a pick; None of none."""
        return None if pick is None else self.picks[pick]["pose"]

    def target(self, turn: int) -> int:
        """Returns the number of the target that has a turn."""
        return turn % len(self.targets)


def _grid_picks(grid: Mapping[str, Any], errors: list[FieldError]) -> list[dict[str, Any]]:
    """Returns the picks of a grid, row by row."""
    columns, rows = grid["columns"], grid["rows"]
    if columns * rows > PICKS_MAX:
        errors.append(FieldError("picks.grid", f"has {columns * rows} picks; a job may have at most {PICKS_MAX}"))
        return []
    for name, count in (("along_m", columns), ("across_m", rows)):
        if count > 1 and not any(grid[name]):
            errors.append(
                FieldError(f"picks.grid.{name}", f"is no step: the {count} picks along it would be one place")
            )
    corner = grid["corner"]
    picks = []
    for row in range(rows):
        for column in range(columns):
            steps = zip(corner["position"], grid["along_m"], grid["across_m"], strict=True)
            position = [p + column * along + row * across for p, along, across in steps]
            picks.append({"pose": {**corner, "position": position}})
    return picks


def _check_targets(targets: list[dict[str, Any]], errors: list[FieldError]) -> None:
    """Refuses targets that move, or may, as they are tracked."""
    for i, target in enumerate(targets):
        if isinstance(target["position"], dict):
            errors.append(FieldError(f"targets[{i}].position", f"a target {STANDS}"))
        if any(target.get("velocity", ())):
            errors.append(FieldError(f"targets[{i}].velocity", f"a target {STANDS}"))


def _check_lines(lines: PickLines, errors: list[FieldError]) -> None:
    """Refuses lines that are shorter than what the tool brakes on."""
    least = 2.0 * lines.brake_m
    if lines.approach_m < least:
        reason = f"{lines.approach_m:g} m is too low for {lines.speed_m_s:g} m/s: it must be at least {least:.3g} m"
        errors.append(FieldError("approach_m", reason))

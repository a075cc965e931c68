"""Checks of passages: states at their samples, lines at every instant, times, outputs, and the end that is asked for.

A line goes on evenly from its begin: the tool's place less that of the line is a Taylor model in time, and so are
orientation and both velocities. Where the line is comes from its ends to 1e-15, far below `SHARE` of a tolerance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.cell import Cell
from verifier.arm import JOINTS, ArmPieces
from verifier.elementary import ROUNDING, Array
from verifier.finding import Finding, Rooms, Status, judged, prove
from verifier.grippers import OWN, gripper_names, seen_by
from verifier.motion_parts import MotionPart
from verifier.passage_demands import ToldEdge, ToldPassage
from verifier.pieces import all_pieces
from verifier.plan_document import COMMAND_TIME, Demands, SampledMotion
from verifier.release_checks import orientation, state_findings
from verifier.taylor import TaylorModel, dot

NAME = "passage"
LINE = 1e-5  # [m, rad] of a line at any time. source: docs/how-to/passages.md
LINE_SPEED = 1e-4  # [m/s, rad/s] likewise
SHARE = 1e-6  # [-] of these by which they may be exceeded
TICK = 1e-6  # [-] of a tick, 2 ns: a time that is off by less is on it
# Outputs that a controller has. source: RTDE guide of Universal Robots, "digital outputs"
OUTPUTS = {"standard_digital": 8, "configurable_digital": 8, "tool_digital": 2}
EDGE_S = 1e-6  # [s] of an output's times: a controller switches on ticks of 2 ms
ITEMS = ("place", "orientation", "velocity", "angular velocity")


def passage_findings(cell: Cell, motion: SampledMotion, parts: Sequence[MotionPart]) -> Iterator[Finding]:
    """Returns the findings about passages; none where none are asked for.

    States and lines are the own gripper's; the end is that of the one that lets go first.
    """
    demands = parts[0].demands
    if not demands.passages:
        return
    own = seen_by(cell, OWN)
    yield from _in_order(motion, demands)
    for each in demands.passages:
        yield from _in_time(motion, each)
        if each.line is not None:
            yield from _on_line(own, motion, demands, each)
        elif each.state is not None and not each.releases:  # that of a release has checks of its own
            yield from state_findings(own, motion, demands, each.state, each.index, (NAME, NAME), f"{each.name}: ")
    yield from _outputs(cell, motion, demands)
    yield from _end(parts[0].cell, motion, demands)


def _wrong(at_s: float | None, detail: str) -> Finding:
    return Finding(NAME, Status.VIOLATED, at_s, detail)


def _in_order(motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Returns the findings about passages that do not follow one another, or let go elsewhere than the plan does.

    The plan's release is the first.
    """
    ended = 0
    first = next((each for each in demands.passages if each.releases), None)
    for each in demands.passages:
        at_s = each.index / motion.rate_hz
        if each.index <= ended:
            yield _wrong(at_s, f"{each.name}: begins no later than the one before ends")
        if each is first and each.index != motion.release:
            yield _wrong(at_s, f"{each.name}: the object is let go elsewhere")
        if each.line is None and each.end_index != each.index:
            yield _wrong(at_s, f"{each.name}: a state that lasts")
        ended = each.end_index


def _in_time(motion: SampledMotion, told: ToldPassage) -> Iterator[Finding]:
    """Returns the finding about a passage's time, where one is asked for: in ticks."""
    at_s, not_before_s = (told.asked.get(key) for key in ("at_s", "not_before_s"))
    if at_s is not None:
        room = 0.5 + TICK - abs(told.index - float(at_s) * motion.rate_hz)
        yield judged(NAME, room, room, told.index / motion.rate_hz, f"{told.name}: ticks off its time")
    if not_before_s is not None:
        room = told.index - float(not_before_s) * motion.rate_hz + TICK
        yield judged(NAME, room, room, told.index / motion.rate_hz, f"{told.name}: ticks before its time")


@dataclass(frozen=True, eq=False)
class EvenLine:
    """A line in the world.

    Attributes:
        p: its begin (3,) [m].
        v: its velocity (3,) [m/s].
        R: the tool's axes at its begin (3, 3).
        axis: about which the tool turns (3,).
        rate: at which it does [rad/s].
        lasts_s: from its begin to its end [s].
    """

    p: Array
    v: Array
    R: Array
    axis: Array
    rate: float
    lasts_s: float

    def axes(self, t: TaylorModel) -> TaylorModel:
        """Returns the tool's axes (3, 3, n) at times (n,) after its begin [s]. Source: Rodrigues' formula."""
        x, y, z = self.axis
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        s, c = (t * self.rate).sine_cosine()
        along, across = (K @ self.R)[:, :, None], (K @ K @ self.R)[:, :, None]
        return s * along + (1.0 - c) * across + self.R[:, :, None]


def even_line(asked: Mapping[str, Any], demands: Demands) -> EvenLine:
    """Returns a line of a request."""
    p, q = (demands.place(asked[end]["position"]) for end in ("from", "to"))
    R, S = (demands.R_WR @ orientation(asked[end]) for end in ("from", "to"))
    lasts_s = float(np.linalg.norm(q - p)) / float(asked["speed_m_s"])
    D = S @ R.T
    twice = np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])  # 2 sin(angle) times the axis
    size = float(np.linalg.norm(twice))
    angle = math.atan2(0.5 * size, 0.5 * (float(np.trace(D)) - 1.0))
    axis = twice / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
    return EvenLine(p, (q - p) / lasts_s, R, axis, angle / lasts_s, lasts_s)


def _on_line(cell: Cell, motion: SampledMotion, demands: Demands, told: ToldPassage) -> Iterator[Finding]:
    """Returns the findings about a line: that it goes on to the first tick that is not before its end, and is kept."""
    assert told.line is not None
    line = even_line(told.line, demands)
    beyond = told.end_index - told.index - line.lasts_s * motion.rate_hz  # [ticks]
    room = min(beyond, 1.0 - beyond) + TICK
    yield judged(NAME, room, room, told.end_index / motion.rate_hz, f"{told.name}: ticks at its end")
    pieces = all_pieces(motion)
    along = (pieces.tick >= told.index) & (pieces.tick < told.end_index)
    items = [f"{told.name}: {item}, squared" for item in ITEMS]
    yield prove(NAME, ArmPieces(cell, pieces.chosen(along)), _kept(line, told.index), items)


def _kept(line: EvenLine, first: int) -> Rooms:
    """Returns the rooms of the squared deviations from a line that begins at a sample."""
    place, speed = ((x * (1.0 + SHARE)) ** 2 for x in (LINE, LINE_SPEED))
    # Turned by an angle, a matrix is 2 sqrt(2) sin(angle / 2) away in the sum of squares.
    most = np.array([place, 2.0 * place, speed, speed])[:, None]
    w = line.axis * line.rate

    def rooms(arm: ArmPieces) -> tuple[Array, Array]:
        pieces = arm.pieces
        middle = ((pieces.tick - first) + 0.5 * (pieces.begin + pieces.end)) / pieces.motion.rate_hz
        half = 0.5 * (pieces.end - pieces.begin) / pieces.motion.rate_hz
        t = TaylorModel(middle, half, np.zeros_like(half), 8.0 * ROUNDING * (middle + half))
        apart = arm.p_WT - (t * line.v[:, None] + line.p[:, None])
        turn = arm.R_WT - line.axes(t)
        squares = [
            dot(apart, apart),
            dot(turn[:, 0], turn[:, 0]) + dot(turn[:, 1], turn[:, 1]) + dot(turn[:, 2], turn[:, 2]),
        ]
        for off in (arm.v_WT - line.v[:, None], arm.turning[JOINTS][0] - w[:, None]):
            squares.append(dot(off, off))
        return most - np.array([x.upper for x in squares]), most - np.array([x.lower for x in squares])

    return rooms


def _outputs(cell: Cell, motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Returns the findings about outputs: their times, and that no two edges of one are closer than a tick."""
    edges: dict[tuple[str, int], list[float]] = {}
    for told in demands.passages:
        for edge in told.edges:
            edges.setdefault(edge.line, []).append(edge.edge_s)
            yield _on_time(cell, motion, demands, told, edge)
            yield from _not_free(cell, told, edge)
    for (kind, number), times in edges.items():
        closest = float(np.diff(sorted(times)).min(initial=math.inf)) * motion.rate_hz
        if math.isfinite(closest):
            room = closest - 1.0 + TICK
            yield judged(NAME, room, room, min(times), f"ticks between two edges of {kind} {number}")


def _not_free(cell: Cell, told: ToldPassage, edge: ToldEdge) -> Iterator[Finding]:
    """Returns the finding about an output that a passage cannot switch: there is none such, or a gripper listens."""
    kind, number = edge.line
    own = set()
    for gripper in (seen_by(cell, name).gripper for name in gripper_names(cell)):
        if gripper.link is None:
            own.add((gripper.output, gripper.index))
        if gripper.second is not None:
            own.add((gripper.second.output, gripper.second.index))
    if not 0 <= number < OUTPUTS.get(kind, 0):
        yield _wrong(edge.edge_s, f"{told.name}: there is no output {kind} {number}")
    elif edge.line in own:
        yield _wrong(edge.edge_s, f"{told.name}: {kind} {number} is a gripper's own output")


def _on_time(cell: Cell, motion: SampledMotion, demands: Demands, told: ToldPassage, edge: ToldEdge) -> Finding:
    """Returns the finding about an edge: it is where it is asked for, and commanded its delay and the lag before."""
    after_s = float(edge.asked.get("offset_s") or 0.0)
    if (along_m := edge.asked.get("offset_m")) is not None:
        if told.line is None:
            return _wrong(edge.edge_s, f"{told.name}: an output along a line, of a state")
        speed = float(told.line["speed_m_s"])
        if float(along_m) > even_line(told.line, demands).lasts_s * speed * (1.0 + SHARE):
            return _wrong(edge.edge_s, f"{told.name}: an output beyond the end of its line")
        after_s += float(along_m) / speed
    named = (each.delay_s for each in cell.outputs.values() if (each.output, each.index) == edge.line)
    early_s = next(named, 0.0) + cell.timing.lag_s
    edge_s = told.index / motion.rate_hz + after_s
    off = abs(edge.edge_s - edge_s)
    if COMMAND_TIME not in demands.not_covered:
        off = max(off, abs(edge.command_s - (edge_s - early_s)))
    return judged(NAME, EDGE_S - off, EDGE_S - off, edge.edge_s, f"{told.name}: time of {edge.line[0]} {edge.line[1]}")


def _end(cell: Cell, motion: SampledMotion, demands: Demands) -> Iterator[Finding]:
    """Returns the findings about where the motion comes to rest; none of an end that may be anywhere."""
    kind = demands.end.get("kind", "rest")
    if kind == "rest":
        return
    state: dict[str, Any] = {"kind": "joint", "positions": cell.home.tolist(), "velocities": [0.0] * 6}
    if kind == "joint":
        state["positions"] = demands.end["positions"]
    elif kind == "pose":
        still = {"linear": [0.0] * 3, "angular": [0.0] * 3}
        state = {"kind": "pose", "pose": demands.end["pose"], "twist": still}
    yield from state_findings(cell, motion, demands, state, len(motion.q) - 1, (NAME, NAME), "end: ")

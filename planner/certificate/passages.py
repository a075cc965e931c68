"""Check of the passages: states at their samples, lines at every instant, outputs apart from each other."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from planner.arrays import Array
from planner.certificate.bounds import Rates, joint_rates, point_bound
from planner.certificate.certificate import Check, at_least, at_most
from planner.certificate.release import (
    RELEASE_POSITION_TOLERANCE,
    RELEASE_VELOCITY_TOLERANCE,
    position_at,
    velocity_at,
)
from planner.certificate.samples import MotionSamples
from planner.passages import crowded_edges, output_edges, passed_until
from planner.problem import ThrowProblem
from planner.releases import Release, SteadyLine
from planner.trajectory import Trajectory

LINE_STEP_S = 0.001  # [s] largest spacing of the instants at which a line is evaluated; bounds hold in between


def passage(motion: MotionSamples) -> Check | None:
    """Checks that every passage has its state, in time and after the one before, and the end what is asked for.

    A line is proven between samples, too.

    The detail names the one that is kept least; None where no passages are asked for.
    """
    problem = motion.problem
    trajectory = motion.trajectory
    if not problem.passages:
        return None
    wrong = wrong_order(problem, trajectory) or crowded_outputs(problem, trajectory)
    if wrong is not None:
        return wrong
    until = passed_until(problem.passages, trajectory)
    spans = zip(problem.passages, trajectory.passed, until, strict=True)
    demands = [(each.name, each.state, first, last) for each, first, last in spans]
    if problem.end is not None:
        last = len(trajectory.q) - 1
        demands.append(("end", problem.end, last, last))
    found = [check for demand in demands for check in _kept(motion, *demand)]
    return min(found, key=lambda check: (check.ok, check.margin), default=None)


def _kept(motion: MotionSamples, name: str, state: Release, first: int, last: int) -> list[Check]:
    """Returns the checks of a state at a sample, or of a line from one to another."""
    if isinstance(state, SteadyLine):
        return _along_line(motion, name, state, first, last)
    checks = (position_at("passage", motion, state, first), velocity_at("passage", motion, state, first))
    return [replace(each, detail=f"{name}: {each.detail or each.unit}") for each in checks if each is not None]


def wrong_order(problem: ThrowProblem, trajectory: Trajectory) -> Check | None:
    """Returns the failed check of passages that are not where or when they are asked for; None for those that are."""
    passed = trajectory.passed
    ends = passed_until(problem.passages, trajectory) if len(passed) == len(problem.passages) else [len(trajectory.q)]
    if ends[-1] >= len(trajectory.q) or not all(end < begun for end, begun in zip((0, *ends), passed, strict=False)):
        return at_most("passage", math.inf, 0.0, "1", None, "they are not passed one after another")
    first = next((each for each in problem.passages if each.releases), None)
    for each, index in zip(problem.passages, passed, strict=True):
        at_s = index / trajectory.sample_rate_hz
        if each is first and index != trajectory.release_index:
            return at_most("passage", math.inf, 0.0, "1", at_s, f"{each.name}: the object is let go elsewhere")
        if not each.is_in_time(index, trajectory.sample_rate_hz):
            limit = each.not_before_s if each.at_s is None else each.at_s
            return at_most("passage", at_s, limit, "s", at_s, f"{each.name}: time").provided(False)
    return None


def crowded_outputs(problem: ThrowProblem, trajectory: Trajectory) -> Check | None:
    """Returns the failed check of an output that would switch twice within a tick; None where none does."""
    edges = output_edges(problem.cell, problem.passages, trajectory)
    crowded = crowded_edges(edges, trajectory.dt)
    if crowded is None:
        return None
    one, other = crowded
    names = " and ".join(dict.fromkeys(problem.passages[each.passage].name for each in crowded))
    detail = f"{names}: between two edges of {other.switch.output} {other.switch.index}"
    apart_s = other.edge_time_s - one.edge_time_s
    return at_least("passage", apart_s, trajectory.dt, "s", other.edge_time_s, detail).provided(False)


def _along_line(motion: MotionSamples, name: str, line: SteadyLine, first: int, last: int) -> list[Check]:
    """Returns the checks of a line from sample `first` to `last`: place, orientation and both velocities, at any time.

    Of a deviation e between two instants h apart, |e''| is at most that at one of them, and sup|e''''| h^2/8 more; |e'|
    at most that at the nearer one, and sup|e''| h/2 more; and so is |e|. The angle between two orientations changes no
    faster than the difference of their angular velocities.
    """
    trajectory = motion.trajectory
    parts = math.ceil(trajectory.dt / LINE_STEP_S)
    steps = np.arange(parts * (last - first) + 1, dtype=np.float64)
    h = trajectory.dt / parts
    t = (parts * first + steps) / (parts * trajectory.sample_rate_hz)
    arm = motion.at(t)
    X_WT = line.poses(h * steps)
    half_sine = np.linalg.norm(arm.R_WT - X_WT[:, :3, :3], axis=(1, 2)) / math.sqrt(8.0)
    turned = 2.0 * np.arcsin(np.minimum(1.0, half_sine))
    w_WT = arm.links.angular_velocity[:, 5]
    dw_WT = arm.links.angular_acceleration[:, 5]
    rates = joint_rates(trajectory, np.arange(first, last + 1))
    deviations = {  # with the first two derivatives of both
        ("position", "m"): (_length(arm.p_WT - X_WT[:, :3, 3].T), arm.v_WT - line.V_WT[:3, None], arm.a_WT),
        ("orientation", "rad"): (turned, w_WT - line.V_WT[3:, None], dw_WT),
    }
    bounds = point_bound(motion.body.tool_lever, rates, 4), _spin_bound(rates)  # on the fourth
    found = []
    for ((what, unit), (off, off_rate, acceleration)), bound in zip(deviations.items(), bounds, strict=True):
        fastest = _larger(_length(acceleration)) + np.repeat(bound, parts) * (h * h / 8.0)
        rate = _larger(_length(off_rate)) + fastest * (h / 2.0)
        place = _larger(off) + rate * (h / 2.0)
        pairs = ((place, RELEASE_POSITION_TOLERANCE, unit), (rate, RELEASE_VELOCITY_TOLERANCE, f"{unit}/s"))
        for values, limit, per in pairs:
            k = int(values.argmax())
            detail = f"{name}: {what} [{per}], {min(h * k * line.speed_m_s, line.length_m):.3f} m along the line"
            found.append(at_most("passage", float(values[k]), limit, per, float(t[k]), detail))
    return found


def _length(v: Array) -> Array:
    """Returns the lengths (k,) of vectors (3, k)."""
    return np.sqrt((v * v).sum(axis=0))


def _larger(values: Array) -> Array:
    """Returns the larger of each two neighbours (k-1,) of values (k,)."""
    return np.maximum(values[:-1], values[1:])


def _spin_bound(rates: Rates) -> Array:
    """Returns bounds (m,) on the third derivative of the tool's angular velocity [rad/s^4].

    The angular velocity is the sum of qd z over the joints. In a tick the jerk is constant, and an axis z is fixed in
    the link before its joint: the third derivative of qd z is 3 jerk z' + 3 qdd z'' + qd z'''.
    """
    (first, second, third, _) = rates.totals[:, :-1]
    return (3.0 * rates.jerk[1:] * first + 3.0 * rates.qdd[1:] * second + rates.qd[1:] * third).sum(axis=0)

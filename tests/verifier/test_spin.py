"""The rotation of bodies in flight holds what an integration of Euler's equations comes to, between samples too."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.landing_orientation import OBJECTS, cell_with
from planner.cell import Cell, ThrownBody
from planner.geometry import tool_state
from verifier.bodies import BallReleases
from verifier.drag import releases_of
from verifier.flights import release_pieces
from verifier.plan_document import SampledMotion
from verifier.spin import FreeSpin, RoundSpin, half_turn, spin_of
from verifier.taylor import TaylorModel

INTEGRATED = 1e-8  # [-] by which the integration may be off
TIMES = np.array([0.0, 0.003, 0.016, 0.25, 0.7])
SHARES = (-1.0, -0.4, 0.0, 0.7, 1.0)  # [-] of a piece


@cache
def body(name: str) -> Cell:
    return cell_with(OBJECTS[name])


def motion(cell: Cell) -> SampledMotion:
    """A motion of constant jerk that turns the tool fast."""
    rate_hz = cell.robot.sample_rate_hz
    t = np.arange(12)[:, None] / rate_hz
    jerk = np.array([30.0, -20.0, 50.0, 80.0, -40.0, 60.0])
    qdd = np.array([2.0, 3.0, -4.0, 1.0, 5.0, -3.0]) + jerk * t
    qd = np.array([1.0, -1.5, 2.0, 2.0, -3.0, 4.0]) + t * (qdd - 0.5 * jerk * t)
    start = np.array([2.0, 3.0, -4.0, 1.0, 5.0, -3.0])
    q = cell.home + t * np.array([1.0, -1.5, 2.0, 2.0, -3.0, 4.0]) + t * t * start / 2.0 + t**3 * jerk / 6.0
    return SampledMotion(rate_hz, q, qd, qdd, 6)


def turned_at(cell: Cell, q: np.ndarray, qd: np.ndarray, at_s: float) -> np.ndarray:
    """Axes of a body (3, 3) at a time after a release."""
    return turned(cell, q, qd, np.array([0.0, at_s]))[0][-1]


def turned(cell: Cell, q: np.ndarray, qd: np.ndarray, times: np.ndarray = TIMES) -> tuple[np.ndarray, np.ndarray]:
    """Axes of a body (k, 3, 3) at times after a release, by an eighth-order integration, and its first ones."""
    thing = cell.object
    assert isinstance(thing, ThrownBody)
    tool = tool_state(cell, q, qd)
    R_WO = tool.X_WT[:3, :3] @ thing.R_TO
    moments = thing.inertia_kg_m2

    def rates(_: float, state: np.ndarray) -> np.ndarray:
        axes, w = state[:9].reshape(3, 3), state[9:]
        skew = np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])
        return np.concatenate([(axes @ skew).ravel(), np.cross(moments * w, w) / moments])

    begin = np.concatenate([R_WO.ravel(), R_WO.T @ tool.V_WT[3:]])
    found = solve_ivp(rates, (0.0, times[-1]), begin, "DOP853", times, rtol=1e-11, atol=1e-12)
    return found.y[:9].T.reshape(-1, 3, 3), R_WO


def at_share(moved: SampledMotion, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    tick = min(int(time_s * moved.rate_hz), len(moved.q) - 2)
    t = time_s - tick / moved.rate_hz
    jerk = (moved.qdd[tick + 1] - moved.qdd[tick]) * moved.rate_hz
    q = moved.q[tick] + t * (moved.qd[tick] + t * (moved.qdd[tick] / 2.0 + t * jerk / 6.0))
    return q, moved.qd[tick] + t * (moved.qdd[tick] + t * jerk / 2.0)


@pytest.mark.parametrize(("name", "kind"), [("rod across", RoundSpin), ("box", RoundSpin), ("brick", FreeSpin)])
def test_axes_hold_what_an_integration_comes_to(name: str, kind: type):
    cell = body(name)
    moved = motion(cell)
    pieces = release_pieces(moved, 0.003)
    spin = spin_of(cell, pieces)
    assert isinstance(spin, kind)
    rows = np.repeat(np.arange(len(pieces.tick)), len(TIMES))
    axes = spin.axes(rows, np.tile(TIMES, len(pieces.tick)), (0, 1, 2))
    for share in SHARES:
        shares = 0.5 * (pieces.begin + pieces.end) + 0.5 * share * (pieces.end - pieces.begin)
        times = (pieces.tick + shares) / moved.rate_hz
        there = np.array([turned(cell, *at_share(moved, float(t)))[0] for t in times]).reshape(-1, 3, 3)
        for k in range(3):
            off = np.abs(axes[k].c0 + axes[k].c1 * share + axes[k].c2 * share**2 - there[:, :, k].T)
            assert (off <= axes[k].r + INTEGRATED).all()
            assert axes[k].r.max() < 1e-3


@pytest.mark.parametrize("name", ["rod", "rod across", "box", "brick"])
def test_lowest_points_hold_those_of_the_turned_shape(name: str):
    cell = body(name)
    moved = motion(cell)
    pieces = release_pieces(moved, 0.0)
    releases = BallReleases(cell, pieces, 1, releases_of(cell, pieces))
    times = TIMES[:-1]
    low, high = releases.lowest(np.zeros(len(times), np.intp), times)
    centre = releases.centre.at(np.zeros(len(times), np.intp), times)[2].c0
    assert moved.release is not None
    there, _ = turned(cell, moved.q[moved.release], moved.qd[moved.release])
    thing = cell.object
    assert isinstance(thing, ThrownBody)
    half = 0.5 * thing.size_m
    corner = np.stack(np.meshgrid(*([-h, h] for h in half)), -1).reshape(-1, 3)
    if thing.kind == "cylinder":
        angle = np.linspace(0.0, 2.0 * np.pi, 20_000)
        rim = np.stack([half[0] * np.cos(angle), half[0] * np.sin(angle), np.full_like(angle, half[2])], -1)
        corner = np.concatenate([rim, -rim])
    lowest = centre + np.array([(R[2] @ corner.T).min() for R in there[: len(times)]])
    assert (low - 1e-8 <= lowest).all() and (lowest <= high + 1e-8).all()
    assert (high - low).max() < 1e-5


def test_half_turns_are_those_of_the_rotation_vector():
    x = np.array([[0.0, 1e-9, 0.1, 3.0, -9.0], [0.0, 0.0, 0.2, 4.0, 2.0], [0.0, 0.0, -0.1, 0.5, 6.0]])
    zero = np.zeros_like(x)
    a, v = half_turn(TaylorModel(x, zero, zero, zero))
    angle = np.linalg.norm(x, axis=0)
    assert (np.abs(a.c0 - np.cos(angle)) <= a.r + 1e-15).all()
    assert (np.abs(v.c0 - x * np.sinc(angle / np.pi)) <= v.r + 1e-15).all()
    assert a.r.max() < 1e-10


def test_no_body_turns_faster_than_is_told():
    cell = body("brick")
    moved = motion(cell)
    spin = spin_of(cell, release_pieces(moved, 0.0))
    thing = cell.object
    assert isinstance(thing, ThrownBody) and moved.release is not None
    tool = tool_state(cell, moved.q[moved.release], moved.qd[moved.release])
    w = (tool.X_WT[:3, :3] @ thing.R_TO).T @ tool.V_WT[3:]

    def rates(_: float, w: np.ndarray) -> np.ndarray:
        return np.cross(thing.inertia_kg_m2 * w, w) / thing.inertia_kg_m2

    found = solve_ivp(rates, (0.0, 5.0), w, "DOP853", rtol=1e-10, max_step=0.01).y
    assert np.linalg.norm(found, axis=0).max() <= spin.turn_rate[0]
    slower = replace(cell, object=replace(thing, inertia_kg_m2=np.array([1.0, 1.0, 2.0])))
    assert isinstance(spin_of(slower, release_pieces(moved, 0.0)), RoundSpin)

"""Plans as objects: the same as their document, from the library and from a service alike."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import fling

REPR_MAX = 300  # characters: a few lines of a terminal


@pytest.fixture(scope="module")
def throw() -> fling.Plan:
    return fling.plan(fling.Target([1.2, 0.3, 0.0], opening=fling.Bin(0.1, 0.1)), "ur5e-sim", release_window_s=0.002)


@pytest.fixture(scope="module")
def answered(throw: fling.Plan) -> fling.Plan:
    """The same plan as a service answers it: JSON, and nothing else."""
    return fling.Plan(json.loads(json.dumps(throw.document)))


def test_a_plan_says_what_it_is_in_a_line(throw: fling.Plan):
    assert len(repr(throw)) < REPR_MAX
    for word in ("ur5e-sim", "target", f"{throw.release_time_s:.3f} s", "(1.200, 0.300, 0.000) m", "valid"):
        assert word in repr(throw)
    assert max(len(repr(part)) for part in (throw.flight, throw.trajectory)) < REPR_MAX


def test_a_cell_says_what_it_is_in_a_line():
    shown = repr(fling.open_cell("ur5e-sim"))
    assert len(shown) < REPR_MAX
    assert shown.startswith("<Cell ur5e-sim: ur5e with a tool of ")


def test_its_release_is_the_sample_of_its_trajectory(throw: fling.Plan):
    release = throw.release
    motion = throw.trajectory
    assert np.array_equal(release.q, motion.q[release.index])
    assert np.array_equal(release.qd, motion.qd[release.index])
    assert release.time_s == motion.release_time_s == release.index / 500
    cell = fling.open_cell("ur5e-sim")
    X_WT = cell.X_WB @ fling.kinematics.forward(cell.robot, release.q, cell.tool.X_FT)
    assert release.position == pytest.approx(X_WT[:3, 3], abs=1e-12)
    assert fling.rotations.rotation_vector_to_matrix(release.rotation_vector) == pytest.approx(X_WT[:3, :3], abs=1e-9)


def test_its_flight_is_a_parabola_from_the_release_to_the_target(throw: fling.Plan):
    flight = throw.flight
    assert flight is not None
    T = flight.time_of_flight_s
    falls = np.array([0.0, 0.0, -0.5 * 9.81 * T**2])
    assert throw.release.position + T * throw.release.linear + falls == pytest.approx(flight.landing_point, abs=1e-9)
    assert flight.path[0] == pytest.approx(throw.release.position)
    assert flight.path[-1] == pytest.approx(flight.landing_point)
    assert flight.window[:, 1].max() <= flight.landing_tolerance_m
    assert flight.speed_m_s == pytest.approx(throw.release.speed_m_s)


def test_a_plan_of_a_service_is_the_same(throw: fling.Plan, answered: fling.Plan):
    assert repr(answered) == repr(throw)
    assert answered.certificate == throw.certificate
    assert np.array_equal(answered.trajectory.q, throw.trajectory.q)
    assert answered.trajectory.joint_names == throw.trajectory.joint_names
    assert answered._repr_html_() == throw._repr_html_()
    with pytest.raises(ValueError, match=r"fling\.problem"):
        answered.problem  # noqa: B018
    assert fling.certify(fling.problem(answered.request, "ur5e-sim"), answered.trajectory).valid
    assert answered.attempts == throw.attempts


def test_what_a_service_left_out_is_named(throw: fling.Plan):
    short = fling.Plan({key: value for key, value in throw.document.items() if key != "trajectory"})
    with pytest.raises(ValueError, match="trajectory=False"):
        short.trajectory  # noqa: B018
    assert "<svg" not in short._repr_html_()


def test_a_notebook_shows_facts_and_picture(throw: fling.Plan):
    shown = ElementTree.fromstring(throw._repr_html_())
    assert [row.findtext("th") for row in shown.iter("tr")] == ["Cell", "Release", "Landing", "Certificate", "Found by"]
    svg = "{http://www.w3.org/2000/svg}"
    assert {line.get("class") for line in shown.iter(f"{svg}polyline")} >= {"arm release", "flight", "launch", "bin"}


def test_odds_are_those_of_the_service(throw: fling.Plan):
    assert throw.odds is None
    odds = {"value": 0.93, "interval": [0.8, 0.97], "radius_m": 0.02, "profile": "p1"}
    plan = fling.Plan({**throw.document, "hit_probability": odds})
    assert plan.odds is not None
    assert (plan.odds.value, plan.odds.radius_m, plan.odds.profile) == (0.93, 0.02, "p1")
    assert "hits within 20 mm with 93%" in repr(plan)
    unknown = fling.Plan({**throw.document, "hit_probability": {**odds, "profile": None}})
    assert "timing unknown" in repr(unknown)
    assert "93%" not in repr(unknown)


def test_a_move_that_ends_at_rest_throws_nothing():
    home = fling.open_cell("ur5e-sim").home
    move = fling.plan(fling.Joint(home, np.zeros(6)), "ur5e-sim", backend="ruckig")
    assert (move.flight, move.odds, move.release.command_time_s) == (None, None, None)
    assert "lands" not in repr(move)


def test_samples_as_a_table_and_as_a_file(throw: fling.Plan, tmp_path: Path):
    motion = throw.trajectory
    frame = motion.to_frame()
    assert frame.index.to_numpy() == pytest.approx(motion.t)
    assert np.array_equal(frame["elbow_joint_velocity_rad_s"].to_numpy(), motion.qd[:, 2])
    motion.to_csv(tmp_path / "motion.csv")
    with (tmp_path / "motion.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["time_s", *frame.columns]
    assert [float(row["wrist_3_joint_acceleration_rad_s2"]) for row in rows] == motion.qdd[:, 5].tolist()


def test_a_figure_marks_the_release(throw: fling.Plan):
    figure = throw.trajectory.plot()
    position, velocity, acceleration = figure.axes
    assert (position.get_ylabel(), velocity.get_ylabel()) == ("position [rad]", "velocity [rad/s]")
    *joints, release = acceleration.lines
    assert np.array_equal([np.asarray(line.get_ydata()) for line in joints], throw.trajectory.qdd.T)
    assert np.asarray(release.get_xdata())[0] == throw.release_time_s

"""The public face: what it names exists, costs nothing to import, and does what its docstrings say."""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import fling

REQUEST = {"release": {"kind": "joint", "positions": [0.25, -1.45, 1.45, -1.5, -1.45, 0.1],
                       "velocities": [1.2, 0.6, -0.6, 0.3, 0.5, 0.2]}, "backend": "ruckig"}  # fmt: skip
HEAVY = ("numpy", "casadi", "ruckig", "httpx2", "planner", "click")
# source: common_interfaces of ROS 2, trajectory_msgs/msg; builtin_interfaces/msg
MESSAGE = {"header", "joint_names", "points"}
POINT = {"positions", "velocities", "accelerations", "effort", "time_from_start"}


@pytest.fixture(scope="module")
def answer() -> fling.Plan:
    return fling.plan(REQUEST, "ur5e-sim")


def test_every_public_name_exists():
    assert [name for name in fling.__all__ if getattr(fling, name, None) is None] == []
    assert set(fling.__all__) <= set(dir(fling))
    with pytest.raises(AttributeError, match="frobnicate"):
        fling.frobnicate  # noqa: B018


def test_importing_it_loads_nothing():
    script = f"import sys, fling; print([name for name in {HEAVY!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_clone_that_is_called_fling_hides_nothing(tmp_path: Path):
    (tmp_path / "fling" / "fling").mkdir(parents=True)  # as the clone's own folder lies in it
    script = "import fling; print(fling.plan.__name__)"
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "plan", done.stderr


def test_a_plan_is_certified_and_certifies_again(answer: fling.Plan):
    assert answer.certificate.valid
    assert fling.certify(answer.problem, answer.trajectory).valid
    with pytest.raises(TypeError, match="in this order, not Trajectory and ThrowProblem"):
        fling.certify(answer.trajectory, answer.problem)  # type: ignore[arg-type]
    k = answer.trajectory.release_index
    assert answer.trajectory.qd[k] == pytest.approx(REQUEST["release"]["velocities"], abs=1e-9)


def test_a_cell_by_name_by_file_and_by_request(root: Path, answer: fling.Plan):
    by_file = fling.open_cell(root / "cells" / "ur5e-sim.toml")
    assert by_file.sha256 == fling.open_cell("ur5e-sim").sha256 == answer.problem.cell.sha256
    assert fling.problem({**REQUEST, "cell": "ur10e-sim"}).cell.robot.name == "ur10e"
    with pytest.raises(fling.CellError, match=r"'nowhere'.* is not one of .*ur5e-sim.* \(FLING_CELLS\)"):
        fling.open_cell("nowhere")


def test_a_request_takes_the_cells_that_open_cell_takes(root: Path):
    by_keys = fling.problem(REQUEST, {"robot": "ur3e", "link": {"kind": "sim"}})
    assert by_keys.cell.robot.name == "ur3e"
    assert fling.problem(REQUEST, root / "cells" / "ur10e-sim.toml").cell.robot.name == "ur10e"
    with pytest.raises(fling.CellError, match="must be a name, the path of a file, or the keys of one"):
        fling.problem(REQUEST, 7)  # type: ignore[arg-type]


def test_a_cell_in_a_notebook(answer: fling.Plan):
    bench = fling.open_cell({"name": "bench", "robot": "ur5e", "link": {"kind": "sim"}})
    slow = bench.with_limits(joint_velocity_rad_s=1.5).with_obstacles(
        {"lower_m": [0.6, 0.6, 0.0], "upper_m": [0.8, 0.8, 0.5]}
    )
    plan = fling.plan(REQUEST, slow)
    assert plan.document["cell_sha256"] == slow.sha256 != bench.sha256
    assert np.abs(plan.trajectory.qd).max() <= 1.5
    assert plan.release_time_s >= answer.release_time_s
    with pytest.raises(fling.CellError, match="home_rad"):
        fling.open_cell({"robot": "ur5e", "link": {"kind": "sim"}, "home_rad": [0.0, 1.5, 0.0, 0.0, 0.0, 0.0]})


def test_code_refuses_a_home_with_the_words_of_a_file():
    keys = {"robot": "ur5e", "link": {"kind": "sim"}}
    cell = fling.open_cell(keys)
    thick = {"capsules": [{"from_m": [0.0, 0.0, 0.0], "to_m": [0.0, 0.0, 0.1], "radius_m": 0.3}]}
    box = {"lower_m": [-0.5, -1.0, 0.2], "upper_m": [1.0, 1.0, 1.0]}
    still = {"joint_position_upper_rad": [3.0, -2.0, 3.0, 3.0, 3.0, 3.0]}
    changes = [
        ({"tool": thick}, lambda cell: cell.with_tool(**thick)),
        ({"surroundings": {"keep_out": [box]}}, lambda cell: cell.with_obstacles(box)),
        ({"limits": still}, lambda cell: cell.with_limits(**still)),
    ]
    for more, change in changes:
        with pytest.raises(fling.CellError) as of_file:
            fling.open_cell({**keys, **more})
        for opened in (cell, cell.with_limits(joint_velocity_rad_s=2.0), pickle.loads(pickle.dumps(cell))):
            with pytest.raises(fling.CellError) as of_code:
                change(opened)
            assert str(of_code.value) == str(of_file.value)
        with pytest.raises(fling.CellError):
            change(fling.open_cell("ur5e-sim"))


def test_refusals_name_what_stands_in_the_way():
    with pytest.raises(fling.InvalidProblem, match=r"release\.positions"):
        fling.plan({"release": {**REQUEST["release"], "positions": [0.0]}})
    with pytest.raises(fling.Infeasible) as refused:
        fling.plan({**REQUEST, "release": {**REQUEST["release"], "velocities": [9.0, 0, 0, 0, 0, 0]}})
    assert refused.value.violations[0].constraint == "joint_velocity"
    with pytest.raises(fling.InvalidProblem, match=r"request: must be a release, or a mapping .* not 5"):
        fling.plan(5)  # type: ignore[arg-type]
    with pytest.raises(fling.CellError, match="is not one of"):
        fling.plan({**REQUEST, "cell": ""})
    with pytest.raises(fling.CellError, match="is not one of"):
        fling.plan({**REQUEST, "cell": 400 * "long"})
    with pytest.raises(TypeError, match=r"a problem and a trajectory .*, in this order, not int and str"):
        fling.certify(7, "motion")  # type: ignore[arg-type]
    for cell in (7, None):
        with pytest.raises(fling.CellError, match="must be a name, the path of a file"):
            fling.open_cell(cell)  # type: ignore[arg-type]
    target = {"kind": "target", "position": [1.2, 0.3, 0.0]}
    with pytest.raises(fling.InvalidProblem, match="min_hit_probability: odds are reckoned by"):
        fling.plan({"release": target, "min_hit_probability": 0.9})
    for position in ([True, 0.3, 0.0], [[1.0], [2.0, 3.0], 4.0], ["1.2", 0.3, 0.0], np.array(1.0)):
        with pytest.raises(
            fling.InvalidProblem, match=r"release\.position(\[0\])?: must be a (list of 3 numbers|number)"
        ):
            fling.plan({"release": {**target, "position": position}})
    with pytest.raises(fling.InvalidProblem, match=r"release\.position\[0\]: must be at least -1000000"):
        fling.problem({"release": {**target, "position": [-(2**63), 0, 0]}})
    with pytest.raises(fling.InvalidProblem, match="singularity_distance_min"):
        fling.plan({**REQUEST, "singularity_distance_min": 10**20})


def test_degrees_are_asked_about():
    degrees = {"positions": [90, -90, 90, -90, -90, 0]}
    with pytest.raises(fling.Infeasible, match="shoulder_pan_joint at the release: degrees"):
        fling.plan({"release": {**REQUEST["release"], **degrees}})
    with pytest.raises(fling.InvalidProblem, match=r"start\.positions\[0\]: 90 rad .*: degrees"):
        fling.plan({**REQUEST, "start": degrees})
    with pytest.raises(fling.Infeasible, match=r"elbow_joint at the release\)$"):
        fling.plan({"release": {**REQUEST["release"], "positions": [0.0, -1.5, 3.3, -1.5, -1.5, 0.0]}})


def test_a_release_at_the_start_is_there_at_once():
    home = fling.open_cell("ur5e-sim").home.tolist()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        answer = fling.plan({"release": {"kind": "joint", "positions": home, "velocities": [0.0] * 6}})
    assert answer.trajectory.release_time_s == pytest.approx(0.006)
    assert {attempt.backend for attempt in answer.attempts} == {"ruckig"}


def test_the_document_of_a_plan_is_read_back(answer: fling.Plan):
    from planner.answer import plan_from_document

    document = answer.document
    problem, trajectory = plan_from_document(document, answer.problem.cell)
    assert fling.certify(problem, trajectory).valid
    assert document["request"]["release"]["kind"] == "joint"


def test_a_window_without_a_tolerance_is_none(answer: fling.Plan):
    made = fling.plan({**REQUEST, "release_window_s": 0.01}, "ur5e-sim")
    flight = made.flight
    assert flight is not None
    assert (flight.release_window_s, flight.landing_tolerance_m) == (0.0, 0.0)
    assert "landing_window" not in {check.name for check in made.certificate.checks}
    assert np.array_equal(made.trajectory.q, answer.trajectory.q)
    with pytest.raises(fling.Infeasible, match="landing_window"):
        fling.plan({**REQUEST, "release_window_s": 0.01, "landing_tolerance_m": 1e-6}, "ur5e-sim")


def test_a_joint_trajectory_has_the_fields_of_the_ros_message(answer: fling.Plan):
    message = fling.as_joint_trajectory(answer, frame_id="base_link")
    assert set(message) == MESSAGE
    assert {frozenset(point) for point in message["points"]} == {frozenset(POINT)}
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "base_link"}
    assert message["joint_names"][0] == "shoulder_pan_joint"
    times = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in message["points"]]
    assert times == pytest.approx(answer.trajectory.t, abs=1e-9)
    assert np.array([p["positions"] for p in message["points"]]) == pytest.approx(answer.trajectory.q)
    assert fling.as_joint_trajectory(answer.document, frame_id="base_link") == message


def test_names_of_a_driver_with_a_prefix(answer: fling.Plan):
    names = [f"left_{i}" for i in range(6)]
    assert fling.as_joint_trajectory(answer, names)["joint_names"] == names
    with pytest.raises(ValueError, match="5 joint_names"):
        fling.as_joint_trajectory(answer, names[:5])
    with pytest.raises(ValueError, match="no trajectory"):
        fling.as_joint_trajectory({"id": "x"})

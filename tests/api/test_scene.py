"""The model of a cell and the curves of a plan, against the planner and the certificate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from api.scene import cell_model
from api.schemas.scene import CellModel
from planner.cell_folder import load_cell
from planner.kinematics import link_poses
from tests.api.conftest import RunningService
from tests.api.test_bad_input import problem_of
from tests.planner.problems import cell

TARGET = {"kind": "target", "position": [1.2, 0.3, 0.0]}


def turned(angle: float) -> np.ndarray:
    c = math.cos(angle)
    s = math.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.mark.parametrize("name", ["ur5e-sim", "real"])
def test_the_chain_of_the_model_gives_the_planners_link_poses(service: RunningService, cells, name: str):
    model = service.client.get(f"/cells/{name}/model").json()
    cell = load_cell(cells / f"{name}.toml")
    assert (model["sha256"], model["link_kind"]) == (cell.sha256, cell.link.kind)
    for q in np.random.default_rng(3).uniform(-3.0, 3.0, (5, 6)):
        X = np.array(model["base_in_world"])
        expected = link_poses(cell.robot, q, cell.X_WB)
        for i in range(6):
            X = X @ turned(q[i]) @ np.array(model["chain"][i])
            assert np.allclose(X, expected[i + 1], atol=1e-12)


def test_the_capsules_of_the_model_cover_arm_tool_and_object(service: RunningService):
    model = service.client.get("/cells/ur5e-sim/model").json()
    assert [c["part"] for c in model["capsules"]] == ["arm"] * 12 + ["tool", "object"]
    thing = model["capsules"][-1]
    tool = np.array(model["tool_in_flange"])
    assert thing["from_m"] == thing["to_m"] == tool[:3, 3].tolist()
    assert (thing["frame"], thing["radius_m"]) == (6, model["object"]["radius_m"])
    pairs = {tuple(pair) for pair in model["colliding_pairs"]}
    assert all(i < j < len(model["capsules"]) for i, j in pairs)


@pytest.fixture(scope="module")
def thrown(shared: RunningService) -> dict[str, Any]:
    return shared.plan(release=TARGET, release_window_s=0.0)


@pytest.fixture(scope="module")
def curves(shared: RunningService, thrown: dict[str, Any]) -> dict[str, Any]:
    response = shared.client.get(f"/plans/{thrown['id']}/curves")
    assert response.status_code == 200, response.text
    return response.json()


def test_the_curves_of_the_joints_are_the_trajectory(thrown: dict[str, Any], curves: dict[str, Any]):
    assert np.allclose(curves["time_from_start"]["motion"], thrown["trajectory"]["time_from_start"], atol=1e-8)
    found = {curve["name"]: curve for curve in curves["curves"]}
    for name, key in (("joint_position", "positions"), ("joint_velocity", "velocities")):
        values = np.array([series["values"] for series in found[name]["series"]]).T
        assert np.allclose(values, thrown["trajectory"][key], rtol=1e-8, atol=1e-8)
    assert [series["name"] for series in found["joint_torque"]["series"]] == thrown["trajectory"]["joint_names"]


def test_no_curve_leaves_its_limits(curves: dict[str, Any]):
    """The certificate proved that at every instant."""
    for curve in curves["curves"]:
        t = np.array(curves["time_from_start"][curve["clock"]])
        first, last = curve["limited_s"] or (t[0], t[-1])
        inside = (t >= first - 1e-9) & (t <= last + 1e-9)
        for series in curve["series"]:
            values = np.array(series["values"], float)[inside]
            values = values[np.isfinite(values)]
            assert series["lower"] is None or (values >= series["lower"] - 1e-6).all(), curve["name"]
            assert series["upper"] is None or (values <= series["upper"] * (1.0 + 1e-6)).all(), curve["name"]
            assert curve["name"] == "singularity_distance" or len(values) > 0


# Checks that bound their curve between its samples; the others are signed otherwise.
BOUNDED = (
    "joint_acceleration", "joint_torque", "tcp_speed", "elbow_speed", "momentum", "power", "stopping_time",
    "stopping_distance", "floor", "self_collision", "singularity_distance", "grip_acceleration",
)  # fmt: skip


@pytest.mark.parametrize("name", BOUNDED)
def test_a_curve_passes_its_check(thrown: dict[str, Any], curves: dict[str, Any], name: str):
    check = next(check for check in thrown["certificate"]["checks"] if check["name"] == name)
    curve = next(curve for curve in curves["curves"] if curve["name"] == name)
    t = np.array(curves["time_from_start"]["motion"])
    values = np.abs([np.interp(check["at_s"], t, np.array(series["values"], float)) for series in curve["series"]])
    limits = {limit for series in curve["series"] for limit in (series["lower"], series["upper"])}
    assert check["limit"] in {limit for limit in limits if limit is not None}
    assert np.abs(values - check["value"]).min() < 1e-2 * abs(check["value"]), (values, check)


def test_the_clearance_in_flight_is_that_of_the_certificate_or_more(thrown: dict[str, Any], curves: dict[str, Any]):
    """The check is a lower bound over the flight, at most 1 cm below it where it is small."""
    flight = next(curve for curve in curves["curves"] if curve["clock"] == "flight")
    t = np.array(curves["time_from_start"]["flight"])
    values = flight["series"][0]["values"]
    assert t[0] == pytest.approx(thrown["release_time_s"])
    assert 0.0 < thrown["release_time_s"] + thrown["flight"]["time_of_flight_s"] - t[-1] < 0.05  # touches, not lands
    check = next(c for c in thrown["certificate"]["checks"] if c["name"] == "flight_clearance")
    assert min(values) >= check["value"] - 1e-9


def test_curves_of_an_earlier_cell_file_are_refused(service: RunningService, cells):
    plan = service.plan(cell="changing")
    file = cells / "changing.toml"
    before = file.read_text()
    file.write_text(before + "# moved the table\n")
    problem = problem_of(service.client.get(f"/plans/{plan['id']}/curves"), 409, "cell-changed")
    assert problem["cell"] == "changing"
    file.write_text(before)
    assert service.client.get(f"/plans/{plan['id']}/curves").status_code == 200


def test_models_and_curves_have_the_documented_shape(service: RunningService, curves: dict[str, Any]):
    from api.schemas import CellModel, PlanCurves

    PlanCurves.model_validate(curves, strict=False)
    CellModel.model_validate(service.client.get("/cells/ur5e-sim/model").json())
    problem_of(service.client.get("/cells/nothing/model"), 404, "not-found")
    problem_of(service.client.get("/plans/nothing/curves"), 404, "not-found")


def test_the_model_tells_boxes_and_shapes_with_pose_and_extent():
    here = cell().with_obstacles(
        {"lower_m": [1, 1, 0], "upper_m": [1.2, 1.4, 0.6]},
        {
            "name": "pipe",
            "shape": "capsule",
            "pose": {"position_m": [0, -1, 1], "rotation_vector_rad": [0, np.pi / 2, 0]},
            "radius_m": 0.1,
            "length_m": 0.6,
            "clearance_m": 0.03,
        },
    )
    box, pipe = CellModel.model_validate(cell_model(here)).surroundings.keep_out
    assert (box.name, box.shape, box.clearance_m) == ("box 0", "box", 0.02)
    np.testing.assert_allclose(np.array(box.pose)[:3, 3], [1.1, 1.2, 0.3])
    np.testing.assert_allclose(box.extent_m, [0.2, 0.4, 0.6])
    assert (pipe.name, pipe.shape, pipe.clearance_m) == ("pipe", "capsule", pytest.approx(0.03))
    np.testing.assert_allclose(pipe.extent_m, [0.2, 0.2, 0.8])
    np.testing.assert_allclose([pipe.lower_m, pipe.upper_m], [[-0.4, -1.1, 0.9], [0.4, -0.9, 1.1]], atol=1e-12)
    np.testing.assert_allclose(np.array(pipe.pose)[:3, 2], [1.0, 0.0, 0.0], atol=1e-12)

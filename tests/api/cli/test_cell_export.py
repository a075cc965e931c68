"""`fling cell export`: Pinocchio and MuJoCo open what it writes, and agree with the planner and with each other."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from click.testing import CliRunner

from api.cli import main
from planner.cell import Cell, load_cell
from planner.geometry import body_model, tool_pose

ROOT = Path(__file__).parents[3]
SHAPES = """
[[surroundings.keep_out]]
name = "tcp"
shape = "box"
size_m = [0.6, 0.4, 0.1]
pose = { position_m = [1.4, 0.2, 0.3], rotation_vector_rad = [0.1, 0.2, 0.7] }
[[surroundings.keep_out]]
shape = "cylinder"
radius_m = 0.05
length_m = 0.8
pose = { position_m = [-1.4, 0.1, 0.4], rotation_vector_rad = [0.0, 1.5707963267948966, 0.0] }
[[surroundings.keep_out]]
shape = "capsule"
radius_m = 0.05
length_m = 0.6
pose = { position_m = [0.1, 1.4, 0.4], rotation_vector_rad = [0.4, 0.0, 0.0] }
[[surroundings.keep_out]]
shape = "sphere"
radius_m = 0.1
pose = { position_m = [0.0, -1.4, 0.4] }
"""


@pytest.fixture(params=["ur5e-sim", "ur10e-sim", "ur5-sim"])
def cell(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cell:
    text = (ROOT / "cells" / f"{request.param}.toml").read_text().replace("keep_out = []", "") + SHAPES
    (tmp_path / "lab.toml").write_text(text)
    monkeypatch.setenv("FLING_CELLS", str(tmp_path))
    return load_cell(tmp_path / "lab.toml")


def exported(kind: str) -> str:
    done = CliRunner().invoke(main, ["cell", "export", "--cell", "lab", f"--{kind}"])
    assert done.exit_code == 0, done.output
    return done.stdout


def test_pinocchio_and_mujoco_have_the_tool_where_the_planner_has_it_and_the_same_torques(cell: Cell) -> None:
    arm = pinocchio.buildModelFromXML(exported("urdf"))
    data = arm.createData()
    model = mujoco.MjModel.from_xml_string(exported("mjcf"))
    state = mujoco.MjData(model)
    assert list(arm.names)[1:] == list(cell.robot.joint_names)
    masses = sum(link.mass for link in cell.robot.links) + cell.tool.mass_kg
    assert pinocchio.computeTotalMass(arm) == pytest.approx(masses)
    assert model.body_mass.sum() == pytest.approx(masses)
    arm.gravity.linear = np.array([0.0, 0.0, -cell.surroundings.gravity_m_s2])
    rng = np.random.default_rng(6)
    for q in rng.uniform(-2.0, 2.0, (5, 6)):
        X_WT = tool_pose(cell, q)
        pinocchio.framesForwardKinematics(arm, data, q)
        assert np.abs(data.oMf[arm.getFrameId("tcp")].homogeneous - X_WT).max() < 1e-9
        state.qpos = q
        state.qvel = rng.uniform(-1.0, 1.0, 6)
        mujoco.mj_forward(model, state)
        assert np.abs(state.site("tcp").xpos - X_WT[:3, 3]).max() < 1e-9
        tau = pinocchio.rnea(arm, data, q, state.qvel, np.zeros(6))
        assert state.qfrc_bias == pytest.approx(tau, abs=1e-5)
    assert arm.lowerPositionLimit == pytest.approx(cell.limits.q_lower)
    assert model.jnt_range[:, 1] == pytest.approx(cell.limits.q_upper)


def test_its_shapes_stand_where_the_cell_has_them(cell: Cell) -> None:
    """By the distance of a small ball in many places from all that stands still, and from the arm at home."""
    urdf = exported("urdf")
    arm = pinocchio.buildModelFromXML(urdf)
    geometry = pinocchio.buildGeomFromUrdfString(arm, urdf, pinocchio.GeometryType.COLLISION)
    data = arm.createData()
    placed = geometry.createData()
    pinocchio.updateGeometryPlacements(arm, data, geometry, placed, cell.home)
    named = {}
    for thing, X in zip(geometry.geometryObjects, placed.oMg, strict=True):
        named.setdefault(thing.name.rsplit("_", 1)[0], []).append((thing.geometry, X))
    around = cell.surroundings
    model = mujoco.MjModel.from_xml_string(exported("mjcf"))
    for name, shape in zip(around.keep_out_names, around.keep_out, strict=True):
        parts = named["keep_out tcp" if name == "tcp" else name]  # the tool centre point is a link of that name
        X = parts[0][1].homogeneous
        geom = model.geom(name)
        assert np.abs(X - shape.X_WC).max() < 1e-9
        assert np.abs(geom.pos - shape.X_WC[:3, 3]).max() < 1e-9
        radius = 0.5 * shape.extent[0]
        sizes = {
            "box": 0.5 * shape.extent,
            "sphere": [radius, 0.0, 0.0],
            "cylinder": [radius, 0.5 * shape.extent[2], 0.0],
            "capsule": [radius, 0.5 * shape.extent[2] - radius, 0.0],
        }
        assert geom.size == pytest.approx(sizes[shape.kind])
        assert len(parts) == (3 if shape.kind == "capsule" else 1)
    state = mujoco.MjData(model)
    state.qpos = cell.home
    mujoco.mj_kinematics(model, state)
    body = body_model(cell)
    ends = body.end_points(body.link_poses(cell.home[None]))[: body.object, :, :, 0]
    found = [i for i in range(model.ngeom) if model.geom(i).bodyid[0] != 0]
    middles = np.array([state.geom_xpos[i] for i in found])
    for middle, radius in zip(ends.mean(axis=1), body.radii[: body.object], strict=True):
        apart = np.linalg.norm(middles - middle, axis=1)
        assert apart.min() < 1e-9
        assert any(model.geom_size[found[k]][0] == pytest.approx(radius) for k in np.flatnonzero(apart < 1e-9))


def test_it_says_which_formats_there_are() -> None:
    done = CliRunner().invoke(main, ["cell", "export"])
    assert done.exit_code != 0
    assert "--urdf or --mjcf" in done.output

"""The examples of docs/how-to/passages.md, run as they stand there."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fling

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "passages.md"


@pytest.fixture(scope="module")
def plans() -> list[fling.Plan]:
    """The plans of the page's examples, in their order."""
    made = []
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S):
        exec(block, names)
        made.append(names["plan"])
    return made


def tool(plan: fling.Plan) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 3) [m] and velocities (N, 3) [m/s] of the tool centre point at the samples, by the kinematics."""
    cell = plan.problem.cell
    q, qd = plan.trajectory.q, plan.trajectory.qd
    p = (cell.X_WB @ fling.kinematics.forward(cell.robot, q, cell.tool.X_FT))[:, :3, 3]
    J = fling.kinematics.jacobian(cell.robot, q, cell.tool.X_FT)
    return p, (J @ qd[..., None])[:, :3, 0] @ cell.X_WB[:3, :3].T


def test_each_part_of_the_row_has_its_flash_in_passing(plans: list[fling.Plan]) -> None:
    row = plans[0]
    assert row.release is None
    assert row.release_time_s is None
    assert row.flight is None
    assert [passed.name for passed in row.passages] == [f"part {i}" for i in range(5)]
    p, v = tool(row)
    for number, passed in enumerate(row.passages):
        assert p[passed.index] == pytest.approx([0.5, 0.12 * number - 0.24, 0.35], abs=1e-5)
        assert v[passed.index] == pytest.approx([0.0, 0.8, 0.0], abs=1e-4)
        assert passed.linear == pytest.approx([0.0, 0.8, 0.0], abs=1e-4)
        on, off = passed.edges
        assert (on.level, off.level) == (True, False)
        assert on.edge_time_s == pytest.approx(passed.time_s)
        assert off.edge_time_s - on.edge_time_s == pytest.approx(0.02)
    assert all(a.time_s < b.time_s for a, b in pairwise(row.passages))
    assert "passages after" in repr(row)
    assert "passages at" in repr(row.trajectory)
    assert row.trajectory.passage_indices == tuple(passed.index for passed in row.passages)
    assert "<svg" in row._repr_html_()
    assert "straight" not in row._repr_html_().partition("<svg")[2]


def test_the_bead_begins_and_ends_in_passing(plans: list[fling.Plan]) -> None:
    bead = plans[1]
    (passed,) = bead.passages
    opens, closes = passed.edges
    assert (opens.offset_m, closes.offset_m) == (0.02, 0.38)
    assert closes.edge_time_s - opens.edge_time_s == pytest.approx(0.36 / 0.4)
    assert opens.edge_time_s == pytest.approx(passed.time_s + 0.05)
    assert passed.end_index - passed.index == 500
    motion = bead.trajectory
    assert motion.q.shape[0] > passed.end_index
    p, v = tool(bead)
    glued = (motion.t >= opens.edge_time_s) & (motion.t <= closes.edge_time_s)
    assert np.abs(np.linalg.norm(v[glued], axis=1) - 0.4).max() < 1e-4
    assert np.abs(p[glued][:, [0, 2]] - [0.5, 0.25]).max() < 1e-5
    assert "straight" in bead._repr_html_()


def test_the_picture_is_taken_before_the_release(plans: list[fling.Plan]) -> None:
    throw = plans[2]
    assert throw.release is not None
    (passed,) = throw.passages
    assert passed.time_s == throw.release.time_s
    assert [edge.offset_s for edge in passed.edges] == [-0.06, -0.04, 0.0, 0.6]
    assert passed.edges[0].edge_time_s == pytest.approx(throw.release.time_s - 0.06)
    assert throw.flight is not None

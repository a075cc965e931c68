"""The way to the plan's start where a straight joint move would hit something."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from planner.geometry import body_model
from tests.system.rig import Rig

LEFT, RIGHT = ([side, -1.2, 1.6, -1.9, -1.57, 0.0] for side in (0.55, -0.55))
BOX = "keep_out = [{lower_m = [-0.656, -0.194, 0.07], upper_m = [-0.536, -0.074, 0.19]}]"  # half way, at the tool


@pytest.fixture(scope="module")
def boxed_rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    rig = Rig(tmp_path_factory.mktemp("boxed"), replace={"keep_out = []": BOX})
    rig.start()
    yield rig
    rig.stop()


def move(to: list[float]) -> dict:
    """A move that ends at rest, a little further on."""
    return {"kind": "joint", "positions": [to[0] + 0.02, *to[1:]], "velocities": [0.0] * 6}


def test_what_stands_in_the_straight_way_is_gone_around(boxed_rig: Rig) -> None:
    rig = boxed_rig
    straight = np.array(LEFT) + np.linspace(0.0, 1.0, 100)[:, None] * (np.array(RIGHT) - LEFT)
    assert body_model(rig.cell).clearances(straight).least.min() < 0.0
    assert rig.throw(move(LEFT)).outcome == "completed"
    go_around(rig, RIGHT, "speedj")
    go_around(rig, LEFT, "servoj")
    id = queue(rig, RIGHT, "speedj")
    row = rig.abort_approaching(id)
    assert row.outcome == "aborted", row.reason
    assert max(map(abs, rig.state()["qd"])) < 1e-3
    assert not rig.is_latched()


def queue(rig: Rig, start: list[float], mode: str) -> str:
    """Queues a small move that starts at `start`; returns its id."""
    plan = rig.plan(move(start), start={"positions": start})
    return rig.store.queue_execution(plan, "rig", mode, False, "test").id


def go_around(rig: Rig, start: list[float], mode: str) -> None:
    """Executes a small move that starts behind the box; the arm truly keeps clear."""
    id, seen = queue(rig, start, mode), [rig.state()["q"]]

    def over() -> bool:
        seen.append(rig.state()["q"])
        return rig.row(id).state == "finished"

    rig.until(over)
    row = rig.row(id)
    assert row.outcome == "completed", row.reason
    assert body_model(rig.cell).clearances(np.array(seen)).least.min() > 0.0
    assert rig.state()["q"] == pytest.approx(move(start)["positions"], abs=1e-3)

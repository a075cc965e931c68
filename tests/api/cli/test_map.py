"""`fling map` on its own store: files after each level, going on, Ctrl-C, and what it refuses before planning."""

from __future__ import annotations

import json
from contextlib import contextmanager

import pytest
from click.testing import CliRunner

from api.cli import main
from store import Store
from tests.jobs.maps.planners import fake_solve, plan_all

EXTENT = ["--extent", "-0.4", "0.4", "0.3", "0.9", "--resolution", "0.1"]


@pytest.fixture
def fling(tmp_path, monkeypatch):
    """Runs the command with a planner that answers at once; returns exit status, output and errors."""
    monkeypatch.setenv("FLING_DATABASE_URL", f"sqlite:///{tmp_path / 'map.db'}")
    solves = [fake_solve]

    class Pool:
        plan_all = staticmethod(plan_all(lambda job: solves[-1](job)))

    @contextmanager
    def open_pool(*arguments, **options):
        yield Pool

    monkeypatch.setattr("jobs.driver.open_pool", open_pool)

    def run(*arguments: str, solve=fake_solve):
        solves.append(solve)
        return CliRunner().invoke(main, ["map", *map(str, arguments)])

    return run


def test_it_writes_all_files_into_a_folder_and_says_what_it_found(fling, tmp_path):
    pytest.importorskip("zarr", reason="make setup")
    done = fling(*EXTENT, "--out", tmp_path / "floor")
    assert done.exit_code == 0, done.output
    assert {path.name for path in (tmp_path / "floor").iterdir()} == {"map.png", "map.html", "map.zarr"}
    assert "finished: 24 of 48 landing cells planned and certified" in done.output
    assert "refused: 16 proven, 8 not found" in done.output


def test_it_goes_on_after_ctrl_c_and_ends_with_the_same_map(fling, tmp_path, monkeypatch):
    left = [20]

    def interrupted(job):
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        return fake_solve(job)

    first = fling(*EXTENT, solve=interrupted)
    assert first.exit_code == 130 and "20 landing cells are stored; the same command resumes" in first.output
    second = fling(*EXTENT)
    assert second.exit_code == 0 and "20 landing cells are answered already" in second.output
    resumed = json.loads(fling(*EXTENT, "--json").stdout)
    monkeypatch.setenv("FLING_DATABASE_URL", f"sqlite:///{tmp_path / 'other.db'}")
    calm = json.loads(fling(*EXTENT, "--json").stdout)
    assert (calm["sha256"], calm["counts"]) == (resumed["sha256"], resumed["counts"])
    assert calm["id"] != resumed["id"] and calm["state"] == "finished"


def test_a_finished_map_is_not_planned_again(fling):
    def never(job):
        raise AssertionError

    assert fling(*EXTENT).exit_code == 0
    assert fling(*EXTENT, solve=never).exit_code == 0


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--cell", "nothing"], "no cell 'nothing'; there are"),
        (["--resolution", "7"], "resolution_m: 7 m is not between"),
        (["--plane", "9"], "out of the arm's range, proven"),
        (["--extent", "1", "0", "0", "1"], "extent_m: x from 1 m to 0 m"),
        (["--plane", "0", "--volume", "0", "1"], "not both"),
    ],
)
def test_what_makes_no_map_is_refused_before_anything_is_planned(fling, tmp_path, arguments, says):
    refused = fling(*arguments)
    assert refused.exit_code == 1 and says in refused.output
    store = Store.open(f"sqlite:///{tmp_path / 'map.db'}")
    assert store.maps_of_cell("ur5e-sim") == []
    store.close()

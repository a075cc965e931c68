"""A map is the same to the bit in whatever order its answers come, and however often its maker is killed."""

from __future__ import annotations

import time
import uuid

import pytest

from jobs import driver, writer
from jobs.maps import DrivenMap, LandingState, MapInputs, Step, map_table
from planner.cell import CellSource
from store import Retention, Store
from tests.jobs.maps.planners import Killed, begun, cut_off, cut_short, definition, plan_all

INPUTS = MapInputs(CellSource("c", b"text"))


def made(store: Store, of, planner=None, times: int = 1):
    """Makes a map; `times` is how often it was killed before."""
    row = begun(store, of)
    driver.drive(DrivenMap(store, row, INPUTS), planner or plan_all())
    return map_table(store.map(row.id), store.landing_cells(row.id))


@pytest.fixture
def calm(tmp_path):
    """The map that nothing disturbs."""
    with_store = Store.open(f"sqlite:///{tmp_path / 'calm.db'}")
    table = made(with_store, definition())
    with_store.close()
    return table


def test_every_landing_cell_is_answered_and_every_yes_has_its_own_stored_plan(store, calm):
    assert calm.count_of(LandingState.UNKNOWN) == 0
    table = made(store, definition())
    ids = table.plan_ids[table.state == LandingState.YES].tolist()
    assert len(set(ids)) == len(ids) == table.count_of(LandingState.YES) > 0
    assert all(store.plan_summary(id) is not None and uuid.UUID(id).version == 7 for id in ids)
    assert set(table.plan_ids[table.state != LandingState.YES]) == {""}


def test_landing_cells_without_a_plan_are_tried_from_their_neighbours_step_by_step(calm):
    x, y = calm.centres_m
    state = calm.state[0]
    assert (state[y > 0.7] == LandingState.PROVEN).all()
    assert (state[(y > 0.6) & (y < 0.7)] == LandingState.NOT_FOUND).all()
    assert (state[y < 0.6] == LandingState.YES).all()  # beyond x = 0 only from neighbours, row by row
    named = {calm.reasons[k] for k in calm.reason[calm.state == LandingState.NOT_FOUND]}
    assert {constraint for constraint, _ in named} == {"joint_jerk"}  # its own search's, not the neighbours'
    assert calm.reasons[calm.reason[0][-1, 0]] == ("reach", "0.85 m against a limit of 0.7 m (too far)")
    assert (x > 0.2).any()


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_the_answers_does_not_matter(store, calm, seed):
    assert made(store, definition(), plan_all(seed=seed)).sha256 == calm.sha256


def test_a_killed_map_that_goes_on_is_the_same_wherever_it_is_killed(tmp_path, calm):
    for kill_after in (7, 30, 58, 75):  # in a level, at its end, in the rounds, at the end
        store = Store.open(f"sqlite:///{tmp_path / f'{kill_after}.db'}")
        of = definition()
        kills = 0
        row = begun(store, of)
        while True:
            try:
                driver.drive(DrivenMap(store, row, INPUTS), plan_all(seed=kills, kill_after=[kill_after]))
                break
            except Killed:
                kills += 1
        table = map_table(store.map(row.id), store.landing_cells(row.id))
        assert table.sha256 == calm.sha256
        assert len(store.plans(200)[0]) == table.count_of(LandingState.YES)  # none twice, none for nothing
        assert kills >= 1
        store.close()


def test_the_same_definition_is_the_same_map_and_another_one_is_not(store):
    first = begun(store, definition())
    assert begun(store, definition()).id == first.id
    assert begun(store, definition(robust=True)).id != first.id
    assert [row.id for row in store.maps_of_cell("c")][-1] == first.id


@pytest.mark.parametrize("planner", [cut_off, cut_short])
def test_a_search_that_was_cut_off_is_no_answer_and_is_tried_again(store, calm, planner):
    cut = made(store, definition(), plan_all(planner))
    assert (cut.row.state, cut.count_of(LandingState.UNKNOWN)) == ("cancelled", 1)
    assert made(store, definition()).sha256 == calm.sha256


def test_a_map_is_cancelled_and_goes_on(store, calm, monkeypatch):
    monkeypatch.setattr(writer, "GROUP", 1)
    row = begun(store, definition())
    seen = []

    def report(step, done, total):
        seen.append(done)
        time.sleep(0.02)  # a plan takes longer
        if len(seen) == 20:
            store.request_map_cancel(row.id)

    driver.drive(DrivenMap(store, row, INPUTS, report), plan_all())
    assert store.map(row.id).state == "cancelled"
    assert 20 <= store.landing_cell_count(row.id) < 63
    assert made(store, definition()).sha256 == calm.sha256


def test_retention_keeps_the_plans_of_a_map(store):
    table = made(store, definition())
    assert store.retain(Retention(plans=1, plans_days=1e-9)) == (0, 0)
    assert len(store.plans(200)[0]) == table.count_of(LandingState.YES)


def test_progress_counts_up_by_level_to_all(store):
    seen = {}
    row = begun(store, definition((20, 20)))

    def report(step: Step, done: int, total: int) -> None:
        seen[step.round, step.level_m] = total

    driver.drive(DrivenMap(store, row, INPUTS, report), plan_all())
    assert list(seen)[:2] == [(0, 0.2), (0, 0.1)]
    assert sum(total for (round, _), total in seen.items() if round == 0) == 400

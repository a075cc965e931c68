"""Objects that have to be picked up: what closing takes, when a place is filled again, and where each object is."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from planner.geometry import tool_state
from simulator.control_operations import fed_objects
from simulator.physics.feeder import Feeder
from simulator.truth import CameraNoise, ObjectFeed, load_truth
from tests.simulator.conftest import Driven, make_cell

PLACES = ((0.5, 0.1, 0.02), (0.6, 0.1, 0.02))
SENSED = "gripper = { grip_input = 4 }\n"


def feed(**changes: object) -> ObjectFeed:
    fields = {"places": PLACES, "reach_m": 0.03, "scatter_m": 0.0, "refill_s": None, "missed": 0.0}
    return ObjectFeed(**{**fields, **changes})


def test_closing_takes_the_nearest_object_within_reach_and_no_other() -> None:
    feeder = Feeder(feed(), 1)
    assert feeder.take(1.0, (0.5, 0.1, 0.0501)) is None  # 30.1 mm above it
    assert feeder.take(1.0, (0.585, 0.1, 0.02)) == 2
    assert feeder.take(1.0, (0.585, 0.1, 0.02)) is None  # 85 mm from the other
    assert feeder.take(1.0, (0.5, 0.129, 0.02)) == 1
    assert feeder.on_places == {}
    assert feeder.take(1.0, (0.5, 0.1, 0.02)) is None
    feeder.cycle(1e6)
    assert feeder.on_places == {}  # without refill_s never again


def test_a_place_is_filled_again_in_time_by_another_object() -> None:
    feeder = Feeder(feed(refill_s=0.5), 1)
    assert feeder.take(1.0, PLACES[0]) == 1
    feeder.cycle(1.498)
    assert sorted(feeder.on_places) == [1]
    feeder.cycle(1.5)
    assert {place: each.number for place, each in feeder.on_places.items()} == {1: 2, 0: 3}


def test_objects_scatter_about_their_places_as_told_and_alike_for_a_seed() -> None:
    places = tuple((0.1 * i, 0.0, 0.02) for i in range(1000))
    lying = [Feeder(feed(places=places, scatter_m=0.004), seed).on_places for seed in (7, 7, 8)]
    assert lying[0] == lying[1] != lying[2]
    off = [(a - b) for i, place in enumerate(places) for a, b in zip(lying[0][i].position_m, place, strict=True)]
    for axis in (0, 1):
        assert math.sqrt(sum(x * x for x in off[axis::3]) / 1000) == pytest.approx(0.004, rel=0.1)  # 4 deviations
    assert not any(off[2::3])


def test_a_share_of_the_grips_misses_and_leaves_the_object() -> None:
    feeder = Feeder(feed(refill_s=0.0, missed=0.3), 1)
    taken = 0
    for i in range(2000):
        taken += feeder.take(float(i), PLACES[0]) is not None
        assert len(feeder.on_places) + len(feeder._due) == len(PLACES)
        feeder.cycle(float(i))
    assert taken / 2000 == pytest.approx(0.7, abs=0.04)  # four standard deviations


def test_a_camera_sees_the_places_with_its_noise_and_tells_no_numbers() -> None:
    feeder = Feeder(feed(), 1, CameraNoise(0.003))
    looks = [feeder.look() for _ in range(500)]
    assert {frozenset(each) for look in looks for each in look} == {frozenset(("position_m", "std_m"))}
    off = [
        min((math.dist(each["position_m"], place), place, each["position_m"]) for place in PLACES)[1:]
        for look in looks
        for each in look
    ]
    assert len(off) == 1000
    for axis in (0, 1):
        rms = math.sqrt(sum((seen[axis] - place[axis]) ** 2 for place, seen in off) / len(off))
        assert rms == pytest.approx(0.003, rel=0.1)
    assert all(seen[2] == place[2] for place, seen in off)
    first = [look[0]["position_m"][0] < 0.55 for look in looks]
    assert 0.4 < sum(first) / 500 < 0.6  # in no order
    feeder.take(1.0, PLACES[0])
    assert [round(each["position_m"][0], 1) for each in feeder.look()] == [0.6]


def test_looking_moves_nothing() -> None:
    looked, left = (Feeder(feed(scatter_m=0.002, refill_s=0.0, missed=0.5), 1, CameraNoise(0.003)) for _ in range(2))
    for i in range(30):
        looked.look()
        assert looked.take(float(i), PLACES[0]) == left.take(float(i), PLACES[0])
        looked.cycle(float(i))
        left.cycle(float(i))
    assert looked.on_places == left.on_places


@pytest.fixture
def picking(tmp_path) -> Driven:
    """A controller at home, with an object at its tool, one far off, and an input that shows a held one."""
    cell = make_cell(tables=SENSED)
    at_home = tool_state(cell, cell.home, 0.0 * cell.home).p_WT.tolist()
    truth = tmp_path / "truth.toml"
    truth.write_text(f"[feeder]\nplaces = [[3.0, 0.0, 0.0], {at_home}]\nrefill_s = 2.0\n")
    return Driven(cell, truth=load_truth(truth, cell))


def states(driven: Driven) -> dict[int, str]:
    found = fed_objects(driven.controller.workcell, 0)
    assert [each["object"] for each in found] == sorted({each["object"] for each in found})  # none in two places
    return {each["object"]: each["state"] for each in found}


def switch(driven: Driven, opens: bool, cycles: int = 60) -> None:
    driven.set(tool_digital_output_mask=1, tool_digital_output=int(opens))
    driven.cycle(cycles)


def test_an_object_is_on_its_place_held_flying_and_landed(picking: Driven) -> None:
    workcell = picking.controller.workcell
    assert (workcell.gripper.open, workcell.gripper.holds, workcell.input_bits) == (True, None, 0)
    assert workcell.outputs.bits & 1 << 16  # open from the start: nobody has to be told
    assert states(picking) == {1: "on its place", 2: "on its place"}
    switch(picking, False)
    assert (workcell.gripper.holds, workcell.input_bits) == (2, 1 << 4)
    assert states(picking) == {1: "on its place", 2: "held"}
    switch(picking, True)
    assert (workcell.gripper.holds, workcell.input_bits) == (None, 0)
    assert states(picking) == {1: "on its place", 2: "flying"}
    picking.cycle(500)
    assert states(picking) == {1: "on its place", 2: "landed"}
    switch(picking, False)
    assert workcell.gripper.holds is None  # the place is still empty
    assert workcell.input_bits == 0
    picking.cycle(1000)
    assert states(picking) == {1: "on its place", 2: "landed", 3: "on its place"}
    assert workcell.gripper.holds is None  # a closed gripper takes nothing that comes later
    switch(picking, True)
    switch(picking, False)
    assert states(picking) == {1: "on its place", 2: "landed", 3: "held"}


def test_an_object_that_slips_out_leaves_the_input_low(picking: Driven) -> None:
    switch(picking, False)
    picking.controller.workcell.lose_object(picking.controller.timeline.t)
    picking.cycle()
    assert picking.controller.workcell.input_bits == 0
    assert states(picking)[2] == "flying"


def test_without_a_feeder_the_gripper_has_an_object_and_the_input_shows_it() -> None:
    driven = Driven(make_cell(tables=SENSED))
    workcell = driven.controller.workcell
    assert (workcell.gripper.holds, workcell.input_bits, workcell.feeder) == (1, 1 << 4, None)
    switch(driven, True)
    assert (workcell.gripper.holds, workcell.input_bits) == (None, 0)
    switch(driven, False)
    assert (workcell.gripper.holds, workcell.input_bits) == (2, 1 << 4)


def test_a_seed_takes_and_misses_the_same(tmp_path) -> None:
    truth = feed(refill_s=0.0, missed=0.5)
    runs = []
    for seed in (3, 3, 4):
        feeder = Feeder(truth, seed)
        taken = []
        for i in range(50):
            taken.append(feeder.take(float(i), PLACES[0]))
            feeder.cycle(float(i))
        runs.append(taken)
    assert runs[0] == runs[1] != runs[2]
    numbers = [number for number in runs[0] if number is not None]
    assert all(a < b for a, b in pairwise(numbers))

from __future__ import annotations

import itertools
import tracemalloc

import pytest

from jobs.batches import BatchRequests, BatchSpecification, CellUse
from jobs.batches.specification import plan_id, problem_sha256
from planner.errors import InvalidProblem
from store import new_id

TEMPLATE = {"release": {"kind": "target", "position": [1.0, 0.0, 0.0]}, "cell": None}


def grid(**axes):
    return BatchRequests(template=TEMPLATE, grid={path.replace("__", "."): axis for path, axis in axes.items()})


def test_a_grid_is_the_product_of_its_axes():
    axes = {
        "release.position[0]": [0.1, 0.5, 0.1],
        "release.position[1]": [1, -1, -1],
        "backend": {"values": ["a", "b"]},
    }
    requests = BatchRequests(template=TEMPLATE, grid=axes)
    expected = list(itertools.product([0.1, 0.2, 0.3, 0.4, 0.5], [1.0, 0.0, -1.0], ["a", "b"]))
    found = [(*request["release"]["position"][:2], request["backend"]) for request in requests]
    assert found == expected
    assert len(requests) == len(expected)
    assert all("cell" not in request for request in requests)  # null is absent
    assert TEMPLATE["release"]["position"] == [1.0, 0.0, 0.0]


def test_what_a_table_says_of_a_request_are_the_values_of_the_axes():
    axes = {
        "release.position[1]": [0, 1, 0.5],
        "backend": {"values": ["auto", None]},
        "limits.jerk": {"values": [9, [1]]},
    }
    requests = BatchRequests(template=TEMPLATE, grid=axes)
    for number, values in enumerate(itertools.product([0.0, 0.5, 1.0], ["auto", "null"], ["9", "[1]"])):
        assert list(requests.parameters(number).items()) == list(zip(axes, values, strict=True))
    assert BatchRequests([TEMPLATE]).parameters(0) == {}


def test_a_grid_sets_fields_that_the_template_lacks():
    requests = BatchRequests(template={"release": {"kind": "joint"}}, grid={"limits.jerk": [100, 300, 100]})
    assert [request["limits"]["jerk"] for request in requests] == [100.0, 200.0, 300.0]


@pytest.mark.parametrize(
    ("path", "axis", "reason"),
    [
        ("release.position[3]", [0, 1, 1], "no element 3"),
        ("release.kind.x", [0, 1, 1], "no object there"),
        ("release.position[0", [0, 1, 1], "is no path"),
        ("[0]", [0, 1, 1], "is no path"),
        ("", [0, 1, 1], "is no path"),
        ("backend", [0, 1], "has 2 entries; an axis is [from, to, step]"),
        ("backend", [0, 1, True], "step must be a number; it is true"),
        ("backend", {"values": []}, "with at least one value"),
        ("backend", {"values": [1], "more": 1}, "has other fields"),
        ("backend", [0, 1, 0], "a step of 0 does not lead from 0 to 1"),
        ("backend", [0, 1, -1], "a step of -1 does not lead"),
        ("backend", [0, 1, 1e-9], "values; an axis may have"),
        ("backend", [0, float("inf"), 1], "to must be a finite number"),
    ],
)
def test_a_wrong_axis_is_named(path, axis, reason):
    with pytest.raises(InvalidProblem) as caught:
        BatchRequests(template=TEMPLATE, grid={path: axis})
    (error,) = caught.value.errors
    assert error.field == f"grid.{path}"
    assert reason in error.reason


def test_the_size_is_bounded():
    axis = [0, 1, 0.001]
    with pytest.raises(InvalidProblem, match="grid: 1003003001 requests; a batch has 1 to 1000000"):
        BatchRequests(template=TEMPLATE, grid={f"release.position[{k}]": axis for k in range(3)})
    with pytest.raises(InvalidProblem, match="requests: 0 requests"):
        BatchRequests([])


def test_the_values_of_long_axes_are_reckoned_when_they_are_asked_for():
    """Ninety axes of 900,000 values would be three gigabytes, before their product is refused."""
    grid = {f"a{k}": [0.0, 1e6, 1.1] for k in range(90)}
    tracemalloc.start()
    with pytest.raises(InvalidProblem, match="a batch has 1 to 1000000"):
        BatchRequests(template=TEMPLATE, grid=grid)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


def test_a_step_next_to_nothing_is_refused():
    with pytest.raises(InvalidProblem, match="an axis may have 1000000"):
        BatchRequests(template=TEMPLATE, grid={"release.position[0]": [0.0, 1e6, 5e-324]})


def test_a_grid_names_its_first_wrong_axes():
    with pytest.raises(InvalidProblem) as caught:
        BatchRequests(template=TEMPLATE, grid={f"no path {k}": [0, 1, 1] for k in range(40_000)})
    assert len(caught.value.errors) == 20


def test_a_specification_survives_the_store():
    cells = {"one": CellUse(3, "profile"), "two": CellUse(1, None)}
    whole = BatchSpecification(BatchRequests([{"value": 1}, {"value": 2, "cell": "two"}]), "one", cells)
    read = BatchSpecification.unpack(whole.pack())
    assert list(read.numbered()) == [(0, {"value": 1, "cell": "one"}), (1, {"value": 2, "cell": "two"})]
    assert read.cells == cells
    assert read.requests.cells("one") == {"one", "two"}
    gridded = BatchSpecification(BatchRequests(template=TEMPLATE, grid={"cell": {"values": ["a", "b"]}}), "one", cells)
    assert BatchSpecification.unpack(gridded.pack()).requests.cells("one") == {"a", "b"}


def test_a_problem_is_the_same_however_it_is_written():
    one = problem_sha256({"release": {"kind": "target", "position": [1, 0, 0]}, "backend": "auto"}, "cell", None)
    assert one == problem_sha256(
        {"backend": "auto", "release": {"position": [1.0, 0.0, 0.0], "kind": "target"}}, "cell", None
    )
    others = [
        problem_sha256({"release": {"kind": "target", "position": [1, 0, 1e-9]}, "backend": "auto"}, "cell", None),
        problem_sha256({"release": {"kind": "target", "position": [1, 0, 0]}, "backend": "auto"}, "other", None),
        problem_sha256({"release": {"kind": "target", "position": [1, 0, 0]}, "backend": "auto"}, "cell", "profile"),
    ]
    assert len({one, *others}) == 4


def test_ids_of_plans_are_uuids_that_anybody_computes_alike():
    batch = new_id()
    ids = {plan_id(batch, f"{number:064x}") for number in range(1000)}
    assert len(ids) == 1000
    one = plan_id(batch, "a")
    assert one == plan_id(batch, "a") != plan_id(new_id(), "a")
    assert one[:13] == batch[:13]
    assert one[14] == "7"
    assert one[19] in "89ab"

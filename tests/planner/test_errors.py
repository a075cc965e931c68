"""Errors cross process borders: every class of the tree survives pickling."""

import pickle

import pytest

from jobs.pool.worker import PlannerBug
from planner.backends.casadi_nlp import SeedFailed
from planner.backends.casadi_nlp.solver import TooLate
from planner.errors import (
    BackendUnavailable,
    CellError,
    FieldError,
    FileRefused,
    IncompleteRobot,
    Infeasible,
    InvalidProblem,
    PlannerError,
    SolverFailed,
    UnknownRobot,
    Violation,
    nothing_found,
)
from planner.seeds import NoCandidates

EXAMPLES = [
    PlannerError("something else"),
    UnknownRobot("kr16", ["ur3e", "ur5e"]),
    IncompleteRobot("ur8long", ("joint_velocity_deg_s",)),
    CellError("limits.joint_velocity_rad_s", [4.0, 3.0], "is beyond the arm's own limit of 3.14159"),
    CellError("file", None, "is missing"),
    FileRefused("requests.json", "is a pipe, not a file"),
    InvalidProblem([FieldError("frame", '\'moon\' is not "world" or "base"'), FieldError("start", "is missing")]),
    Infeasible(
        [Violation("joint_torque", 160.0, 150.0, "N m", 0.8, "elbow_joint"), Violation("reach", 1.2, 0.9, "m")],
        {"release": {"kind": "point", "position": [0.4, 0.1, 0.5], "velocity": [0.0, 0.0, 0.0]}},
        [{"backend": "ruckig", "result": "refused", "duration_s": 0.01}],
    ),
    Infeasible([]),
    NoCandidates([Violation("keep_out", -0.01, 0.02, "m")], "48 release states: none clear of everything"),
    SolverFailed("iteration limit", 80, [{"backend": "casadi", "result": "iteration limit", "duration_s": 0.4}]),
    TooLate("would release after 0.3 s", 12),
    PlannerBug("KeyError: 'q'"),
    SeedFailed("fatrop: gave up in 71 iterations", 71, is_late=True),
    BackendUnavailable("toppra", "toppra"),
]


def tree(kind):
    return {kind}.union(*(tree(child) for child in kind.__subclasses__()))


@pytest.mark.parametrize("error", EXAMPLES, ids=lambda error: type(error).__name__)
@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_an_error_survives_pickling_with_all_its_fields(error, protocol):
    copy = pickle.loads(pickle.dumps(error, protocol))
    assert type(copy) is type(error)
    assert str(copy) == str(error)
    assert vars(copy) == vars(error)


def test_every_class_of_the_tree_has_an_example():
    assert {type(error) for error in EXAMPLES} == tree(PlannerError)


def test_a_violation_says_what_was_not_found_where_there_is_nothing_to_measure():
    refusal = Infeasible([nothing_found("motion", "none was tried"), Violation("reach", 1.2, 0.9, "m")])
    assert str(refusal) == "motion: none was tried; reach: 1.2 m against a limit of 0.9 m"
    assert (refusal.violations[0].value, refusal.violations[0].limit) == (None, None)


def deep(levels):
    value = 1
    for _ in range(levels):
        value = [value]
    return value


WIDE = [10**6000, deep(100_000), "x" * 10**6, list(range(10**6)), {"a": deep(500)}]


@pytest.mark.parametrize("value", WIDE, ids=["digits", "deep", "long", "list", "object"])
def test_a_cell_error_quotes_any_value_in_a_line(value):
    assert len(str(CellError("home_rad", value, "must be a list of 6 numbers"))) < 400


def test_a_request_with_many_faults_has_its_first_ones_named():
    error = InvalidProblem([FieldError(f"field_{i}", "is unknown") for i in range(90_000)])
    assert [refused.field for refused in error.errors] == [f"field_{i}" for i in range(20)]
    assert len(str(error)) < 1000

"""Why a request has no plan, as a record that can be stored: the planner's error in plain JSON."""

from __future__ import annotations

from typing import Any

import orjson

from planner.errors import Infeasible, InvalidProblem, PlannerError, SolverFailed


def refusal_of(error: PlannerError) -> dict[str, Any]:
    """Returns the record of an error of the planner, in JSON types alone.

    Its `name` is that of the service's problem type: `infeasible`, `solver-failed` or `invalid-request`; `detail` is
    the error in words. An infeasible request and one whose planning timed out carry `violations` and `nearest`, an
    invalid one `errors`. The log of the search is left out: it is many times larger than the rest.
    """
    record: dict[str, Any] = {"name": _name(error), "detail": str(error)}
    if isinstance(error, Infeasible | SolverFailed):
        record |= {"violations": [vars(one) for one in error.violations], "nearest": error.nearest}
    if isinstance(error, SolverFailed):
        record["solver"] = {"status": error.status, "iterations": error.iterations}
    if isinstance(error, InvalidProblem):
        record["errors"] = [vars(one) for one in error.errors]
    return orjson.loads(orjson.dumps(record, option=orjson.OPT_SERIALIZE_NUMPY))  # infinity becomes null


def _name(error: PlannerError) -> str:
    if isinstance(error, Infeasible):
        return "infeasible"
    return "solver-failed" if isinstance(error, SolverFailed) else "invalid-request"

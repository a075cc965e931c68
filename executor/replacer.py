"""Between clients who want to replace a running plan and the run: requests come from the store, answers go there.

A thread of its own, which waits while the certifying process works.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from executor.execution import Execution
from executor.logs import log
from executor.preflight import ExecutionRefused, verify_content
from executor.replacement import CannotJoin, Certifier
from executor.worker import Worker
from store import PlanRow, Store

ASKED_S = 0.02  # [s] between two looks for a request, as for a queued execution


class Replacer(Worker):
    """Answers the requests of one run, from its start until its end."""

    def __init__(
        self,
        execution: Execution,
        store: Store,
        attempt: Callable[[Callable[[], Any]], Any],
        certifier: Certifier,
    ) -> None:
        """Prepares it; arguments as of `executor.publisher.Publisher`, and the process that certifies."""
        super().__init__("replacer")
        self.execution = execution
        self.store = store
        self._attempt = attempt
        self._certifier = certifier
        self._answers: dict[str, tuple[float | None, str]] = {}

    def run(self) -> None:
        """Answers until the run has ended, and then what is still open."""
        run = self.execution.run
        assert run is not None
        while not run.wait(ASKED_S):
            self._look()
        self._look()

    def _look(self) -> None:
        """Answers the open request, if there is one; one whose answer could not be stored is not obeyed again."""
        id = self.execution.row.id
        row = self._attempt(lambda: self.store.execution(id))
        request = None if row is None else row.open_replacement
        if request is None:
            return
        if request["id"] not in self._answers:
            self._answers[request["id"]] = self._answer(request)
        answer = self._answers[request["id"]]
        self._attempt(lambda: self.store.answer_replacement(id, request, *answer))

    def _answer(self, request: Mapping[str, Any]) -> tuple[float | None, str]:
        """Returns when the plan joins [s], None where it does not, and why not."""
        plan = self._attempt(lambda: self.store.plan(request["plan_id"]))
        joins_s = None
        reason = ""
        try:
            joins_s = self._replace(plan)
        except CannotJoin as error:
            reason = str(error)
        said = reason or f"joins at {joins_s:.3f} s"
        who = request["requested_by"]
        self.execution.note(f"replacement by plan {request['plan_id']}: {said}")
        log("replace", execution=self.execution.row.id, plan=request["plan_id"], who=who, answer=said)
        return joins_s, reason

    def _replace(self, plan: PlanRow | None) -> float:
        """Goes on with a plan; returns when it joins [s].

        Raises:
            CannotJoin: it does not.
        """
        if plan is None:
            raise CannotJoin("there is no such plan, or the database did not give it")
        try:
            verify_content(plan)
        except ExecutionRefused as error:
            raise CannotJoin(str(error)) from error
        return self.execution.replace(plan.document, self._certifier)

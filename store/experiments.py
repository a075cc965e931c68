"""Experiments: series of executions under one name, with what was observed of their landings."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from sqlalchemy import insert, select

from store.database import Repository, writing
from store.idempotency_and_audit import take_key, write_audit
from store.plans import SUMMARY_COLUMNS
from store.rows import AuditLine, ExecutionRow, ExperimentRow, IdempotencyKey, LandingRow, PlanRow, new_id
from store.tables import executions, experiments, landings, plans


class ExperimentRepository(Repository):
    """Table `experiments`, and the executions that belong to one."""

    def add_experiment(
        self,
        name: str,
        created_by: str,
        settings: Mapping[str, Any],
        key: IdempotencyKey | None = None,
        audit: AuditLine | None = None,
    ) -> ExperimentRow:
        """Stores a new experiment.

        Args:
            name: For people.
            created_by: Who created it.
            settings: What the client wants to keep with it, such as targets and repetitions.
            key: Idempotency key of the request.
            audit: Who creates it.

        Raises:
            KeyTaken: `key` is bound to another experiment; nothing is stored.
        """
        row = ExperimentRow(new_id(), time.time(), name, created_by, dict(settings))
        with writing(self._engine) as connection:
            take_key(connection, key, row.id, row.created_at)
            connection.execute(insert(experiments).values(**vars(row)))
            write_audit(connection, audit, f"/experiments/{row.id}")
        return row

    def experiment(self, id: str) -> ExperimentRow | None:
        """Returns one experiment."""
        return self._row(ExperimentRow, select(experiments).where(experiments.c.id == id))

    def experiments(self, limit: int = 50, cursor: str | None = None) -> tuple[list[ExperimentRow], str | None]:
        """Returns experiments, newest first, and the cursor of the next page (None after the last)."""
        return self._page(ExperimentRow, select(experiments), experiments, limit, cursor)

    def executions_of_experiment(self, id: str) -> list[ExecutionRow]:
        """Returns the executions of an experiment, in the order of their requests."""
        query = select(executions).where(executions.c.experiment_id == id)
        return self._rows(ExecutionRow, query.order_by(executions.c.id))

    def landings_of_experiment(self, id: str) -> list[LandingRow]:
        """Returns what was observed of the landings of an experiment, oldest first."""
        query = select(landings).join(executions, executions.c.id == landings.c.execution_id)
        query = query.where(executions.c.experiment_id == id, landings.c.withdrawn_at.is_(None))
        return self._rows(LandingRow, query.order_by(landings.c.id))

    def plans_of_experiment(self, id: str) -> list[PlanRow]:
        """Returns the plans of an experiment without their trajectories."""
        thrown = select(executions.c.plan_id).where(executions.c.experiment_id == id)
        return self._rows(PlanRow, select(*SUMMARY_COLUMNS).where(plans.c.id.in_(thrown)))

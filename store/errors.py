"""Errors of the store.

::

    StoreError
    ├── StoreUnavailable   the database does not answer, is locked, full or broken
    ├── CellBusy           the cell already has an execution that is not finished
    ├── KeyTaken           the idempotency key already stands for a resource
    ├── UnknownPlan        no plan of this id
    └── UnknownExecution   no execution of this id
"""

from __future__ import annotations


class StoreError(Exception):
    """Root of everything the store raises on purpose."""


class StoreUnavailable(StoreError):
    """The database does not answer, is locked for too long, full or broken; the cause is the driver's own error."""

    def __init__(self, cause: Exception) -> None:
        super().__init__(f"the database cannot be used: {getattr(cause, 'orig', None) or cause}")


class CellBusy(StoreError):
    """One execution a cell at a time."""

    def __init__(self, cell: str) -> None:
        super().__init__(f"cell {cell!r} already has an execution that is not finished")
        self.cell = cell


class KeyTaken(StoreError):
    """The idempotency key stands for a resource already; `body_sha256` is that of the body that made it."""

    def __init__(self, resource_id: str, body_sha256: str) -> None:
        super().__init__(f"this idempotency key already stands for {resource_id}")
        self.resource_id = resource_id
        self.body_sha256 = body_sha256


class UnknownPlan(StoreError):
    """No plan of this id."""

    def __init__(self, plan_id: str) -> None:
        super().__init__(f"no plan {plan_id!r}")
        self.plan_id = plan_id


class UnknownExecution(StoreError):
    """No execution of this id."""

    def __init__(self, execution_id: str) -> None:
        super().__init__(f"no execution {execution_id!r}")
        self.execution_id = execution_id

"""Errors of the store.

::

    StoreError
    ├── StoreUnavailable   the database does not answer, is locked, full or corrupt
    ├── CellBusy           the cell has an unfinished execution
    ├── KeyTaken           the idempotency key is bound to a resource
    ├── UnknownPlan        no plan has this id
    └── UnknownExecution   no execution has this id
"""

from __future__ import annotations


class StoreError(Exception):
    """Root of the errors raised by the store."""


class StoreUnavailable(StoreError):
    """The database does not answer, is locked for too long, full or corrupt. The cause is the driver's error."""

    def __init__(self, cause: Exception) -> None:
        super().__init__(f"the database cannot be used: {getattr(cause, 'orig', None) or cause}")


class CellBusy(StoreError):
    """The cell has an unfinished execution; each cell runs one at a time."""

    def __init__(self, cell: str) -> None:
        super().__init__(f"cell {cell!r} already has an execution that is not finished")
        self.cell = cell


class KeyTaken(StoreError):
    """The idempotency key is bound to a resource, which was created from the body with hash `body_sha256`."""

    def __init__(self, resource_id: str, body_sha256: str) -> None:
        super().__init__(f"this idempotency key is bound to {resource_id}")
        self.resource_id = resource_id
        self.body_sha256 = body_sha256


class UnknownPlan(StoreError):
    """No plan has this id."""

    def __init__(self, plan_id: str) -> None:
        super().__init__(f"no plan {plan_id!r}")
        self.plan_id = plan_id


class UnknownExecution(StoreError):
    """No execution has this id."""

    def __init__(self, execution_id: str) -> None:
        super().__init__(f"no execution {execution_id!r}")
        self.execution_id = execution_id

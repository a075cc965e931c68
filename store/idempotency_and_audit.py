"""Idempotency keys and the audit trail."""

from __future__ import annotations

import time
from typing import Any

from sqlalchemy import Connection, insert, select

from store.database import Repository, StoreError, insert_if_new, reading, writing
from store.rows import AuditLine, IdempotencyKey
from store.tables import audit, idempotency


class KeyTaken(StoreError):
    """The idempotency key is bound to a resource, which was created from the body with hash `body_sha256`."""

    def __init__(self, resource_id: str, body_sha256: str) -> None:
        super().__init__(f"this idempotency key is bound to {resource_id}")
        self.resource_id = resource_id
        self.body_sha256 = body_sha256

    def resource_of(self, key: IdempotencyKey | None) -> str:
        """Returns the id of the resource that the same request made before.

        Raises:
            KeyTaken: Another body made it.
        """
        if key is None or self.body_sha256 != key.body_sha256:
            raise self
        return self.resource_id


def take_key(connection: Connection, key: IdempotencyKey | None, resource_id: str, at: float) -> None:
    """Binds `key` to a new resource within the caller's transaction.

    Raises:
        KeyTaken: The key is bound to a resource already.
    """
    if key is None:
        return
    row = {"scope": key.scope, "key": key.key, "body_sha256": key.body_sha256, "resource_id": resource_id}
    unless_taken = insert_if_new(connection, idempotency, **row, created_at=at)  # waits for the same key's request
    if connection.execute(unless_taken.returning(idempotency.c.key)).first() is not None:
        return
    taken = _find(connection, key)
    assert taken is not None  # keys are deleted by retention only, which never deletes young ones
    raise KeyTaken(*taken)


def write_audit(connection: Connection, line: AuditLine | None, resource: str) -> None:
    """Appends a line to the audit trail within the transaction of the act.

    Args:
        connection: The act's transaction.
        line: Who does what; None where nobody is named, as in tests.
        resource: Path of what was acted on.
    """
    if line is not None:
        connection.execute(insert(audit).values(**{**vars(line), "resource": resource, "at": time.time()}))


class ClientRepository(Repository):
    """Tables `idempotency` and `audit`."""

    def resource_of_key(self, key: IdempotencyKey) -> str | None:
        """Returns the id of the resource created with `key`, or None.

        Raises:
            KeyTaken: The key was used with another body.
        """
        with reading(self._engine) as connection:
            found = _find(connection, key)
        if found is not None and found[1] != key.body_sha256:
            raise KeyTaken(*found)
        return None if found is None else found[0]

    def add_audit(self, line: AuditLine) -> None:
        """Appends a line to the audit trail about what changed nothing: a refused act. Acts write theirs themselves."""
        with writing(self._engine) as connection:
            write_audit(connection, line, line.resource)

    def audit_lines(self, limit: int = 100) -> list[dict[str, Any]]:
        """Returns the latest lines of the audit trail, newest first."""
        return self._rows(dict, select(audit).order_by(audit.c.id.desc()).limit(limit))


def _find(connection: Connection, key: IdempotencyKey) -> tuple[str, str] | None:
    query = select(idempotency.c.resource_id, idempotency.c.body_sha256)
    where = (idempotency.c.scope == key.scope) & (idempotency.c.key == key.key)
    row = connection.execute(query.where(where)).one_or_none()
    return None if row is None else (row.resource_id, row.body_sha256)

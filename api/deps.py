"""What an endpoint is given: the store, the cells, the workers, and who is asking."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import Depends, Header, Request
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer

from api.errors import Problem
from api.metrics import Metrics
from api.settings import Settings
from api.shelf import CellShelf
from api.tokens import Client, StoredToken, find_client
from api.workers import Workers
from planner.cell import Cell
from store import IdempotencyKey, Store

KEY_LENGTH_MAX = 255
ANYBODY = Client("local", frozenset({"plan", "operate"}))  # without tokens: whoever is on this machine
BEARER = HTTPBearer(auto_error=False, description="From `fling token create`; not needed where there are no tokens.")


@dataclass(frozen=True)
class Service:
    """Everything that lives as long as the service."""

    settings: Settings
    store: Store
    shelf: CellShelf
    workers: Workers
    tokens: tuple[StoredToken, ...]
    metrics: Metrics

    def cell(self, name: str) -> Cell:
        """Returns a cell by name.

        Raises:
            Problem: there is none.
            CellError: its file is refused.
        """
        cell = self.shelf.cell(name)
        if cell is None:
            raise Problem("not-found", f"no cell {name!r}; there are {', '.join(self.shelf.names())}")
        return cell


def service(request: Request) -> Service:
    """Returns what `create_app` put together."""
    return request.app.state.service


ServiceDep = Annotated[Service, Depends(service)]
Credentials = Annotated[HTTPAuthorizationCredentials | None, Depends(BEARER)]


def client(service: ServiceDep, credentials: Credentials) -> Client:
    """Returns who is asking.

    Raises:
        Problem: no token or a wrong one, where tokens are used.
    """
    if not service.tokens:
        return ANYBODY
    found = None if credentials is None else find_client(service.tokens, credentials.credentials)
    if found is None:
        detail = "a bearer token is needed" if credentials is None else "this token is not known"
        raise Problem("unauthenticated", detail, headers={"WWW-Authenticate": "Bearer"})
    return found


ClientDep = Annotated[Client, Depends(client)]


def _with_scope(scope: str) -> Callable[[Client], Client]:
    def scoped(client: ClientDep) -> Client:
        if scope not in client.scopes:
            raise Problem("forbidden", f"the token {client.name!r} has no scope {scope!r}")
        return client

    return scoped


PlannerClient = Annotated[Client, Depends(_with_scope("plan"))]
OperatorClient = Annotated[Client, Depends(_with_scope("operate"))]


def _key_for(path: str) -> Callable[..., Coroutine[Any, Any, IdempotencyKey | None]]:
    async def key(
        request: Request,
        client: ClientDep,
        idempotency_key: Annotated[str | None, Header(description="Same key and body: same resource.")] = None,
    ) -> IdempotencyKey | None:
        if idempotency_key is None:
            return None
        if not 0 < len(idempotency_key) <= KEY_LENGTH_MAX:
            reason = f"must have 1 to {KEY_LENGTH_MAX} characters"
            errors = [{"field": "Idempotency-Key", "reason": reason}]
            raise Problem("invalid-request", f"Idempotency-Key {reason}", errors=errors)
        body = hashlib.sha256(await request.body()).hexdigest()
        return IdempotencyKey(f"{client.name} {path}", idempotency_key, body)

    return key


PlanKey = Annotated[IdempotencyKey | None, Depends(_key_for("/plan"))]
ExecuteKey = Annotated[IdempotencyKey | None, Depends(_key_for("/execute"))]


def remote(request: Request) -> str:
    """Returns the address a request came from."""
    return request.client.host if request.client else "unknown"


Remote = Annotated[str, Depends(remote)]

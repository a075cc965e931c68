"""FastAPI dependencies of the endpoints: the service, the caller and the scopes, idempotency keys, names in paths.

They are coroutines, none of which waits: the framework runs other functions in threads, which a stop had to wait for.
"""

from __future__ import annotations

import asyncio
import hashlib
import re
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Header, Path, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from pydantic import BeforeValidator

from api.cell_repository import CellRepository
from api.execution_feed import ExecutionFeeds
from api.http import Caller, ProblemDetails, TokenRegistry, WrongTokens, client_address, invalid_fields
from api.leads import Leads
from api.metrics import Metrics
from api.planning import BatchDrivers, MapDrivers, PlanningLine
from api.replanning import Replanning
from api.schemas import ID_PATTERN
from api.settings import ServiceSettings
from api.stopping import Stopping
from api.store_probe import StoreProbe
from planner.cell import Cell, CellSource
from planner.errors import ERRORS_MAX
from planner.fields import did_you_mean, short_name
from store import AuditLine, IdempotencyKey, KeyTaken, Store

Row = TypeVar("Row")
KEY_LENGTH_MAX = 255
LOCAL_CALLER = Caller("local", frozenset({"plan", "operate"}))  # anyone on this machine, if there are no tokens
INTEGER = re.compile(r"-?[0-9]+", re.ASCII)
BEARER = HTTPBearer(auto_error=False, description="From `fling token create`; not needed where there are no tokens.")


@dataclass(frozen=True)
class Service:
    """Everything that lives as long as the service."""

    settings: ServiceSettings
    store: Store
    cells: CellRepository
    line: PlanningLine
    batch_drivers: BatchDrivers
    map_drivers: MapDrivers
    tokens: TokenRegistry
    metrics: Metrics
    feeds: ExecutionFeeds
    stopping: Stopping
    probe: StoreProbe
    leads: Leads = field(default_factory=Leads)
    replan_leads: Leads = field(default_factory=Leads)  # of throws that wait for a tracked target
    replanning: Replanning = field(default_factory=Replanning)
    wrong_tokens: WrongTokens = field(default_factory=WrongTokens)

    def cell(self, name: str) -> Cell:
        """Returns a cell by name.

        Raises:
            UnknownCell: There is no such cell.
            CellError: Its file is refused.
        """
        return self.cells.required(name)[1]

    def cell_version(self, name: str) -> int | None:
        """Returns the version of a cell's files as they are now, and notes it; None where there is no such cell."""
        source = self.cells.source(name)
        return None if source is None else self.note_cell_version(source)

    def note_cell_version(self, source: CellSource) -> int:
        """Returns the version of a cell's files, and notes it."""
        files = source.sha256, source.text, source.calibration
        return self.store.note_cell_version(source.name, *files, "service", source.meshes)


async def service(request: Request) -> Service:
    """Returns the service that `create_app` assembled.

    This and what else an abort depends on is `async`: FastAPI gives all other functions to threads that a database
    without an answer may hold.
    """
    return request.app.state.service


ServiceDep = Annotated[Service, Depends(service)]
Credentials = Annotated[HTTPAuthorizationCredentials | None, Depends(BEARER)]


async def caller(request: Request, service: ServiceDep, credentials: Credentials) -> Caller:
    """Returns the caller of a request.

    Raises:
        ProblemDetails: The service uses tokens and the request has none, or one that is unknown or has expired.
    """
    if not service.tokens.is_guarded:
        request.state.caller = LOCAL_CALLER.name
        request.state.is_allowed = lambda: True
        return LOCAL_CALLER
    if credentials is None:
        raise _unauthenticated("no bearer token came with the request")
    found = service.tokens.find(credentials.credentials)
    if found is None or found.has_expired:
        await asyncio.sleep(service.wrong_tokens.delay_s(client_address(request.scope)))
        raise _unauthenticated("this token is not known" if found is None else "this token has expired")
    request.state.caller = found.caller.name
    request.state.is_allowed = partial(service.tokens.is_in_force, credentials.credentials)  # for streams
    return found.caller


def _unauthenticated(why: str) -> ProblemDetails:
    detail = f"{why}; commands take one from FLING_TOKEN or --token, and 'fling token create' makes it"
    return ProblemDetails("unauthenticated", detail, headers={"WWW-Authenticate": "Bearer"})


AnyCaller = Annotated[Caller, Depends(caller)]


def _with_scope(scope: str) -> Callable[[Caller], Awaitable[Caller]]:
    async def scoped(caller: AnyCaller) -> Caller:
        if scope not in caller.scopes:
            raise ProblemDetails("forbidden", f"the token {caller.name!r} has no scope {scope!r}")
        return caller

    return scoped


PlanCaller = Annotated[Caller, Depends(_with_scope("plan"))]
OperateCaller = Annotated[Caller, Depends(_with_scope("operate"))]


async def conditional(
    if_none_match: Annotated[str | None, Header(description="ETags that the client has.", max_length=4096)] = None,
) -> str | None:
    """Returns the `If-None-Match` of a request."""
    return if_none_match


IfNoneMatch = Annotated[str | None, Depends(conditional)]


async def idempotency_key(
    request: Request,
    caller: AnyCaller,
    idempotency_key: Annotated[
        str | None, Header(min_length=1, max_length=KEY_LENGTH_MAX, description="Same key and body: same resource.")
    ] = None,
) -> IdempotencyKey | None:
    """Returns the idempotency key of a request; its scope is the caller and the path."""
    if idempotency_key is None:
        return None
    body = hashlib.sha256(await request.body()).hexdigest()
    return IdempotencyKey(f"{caller.name} {request.url.path}", idempotency_key, body)


Key = Annotated[IdempotencyKey | None, Depends(idempotency_key)]


@dataclass(frozen=True)
class RequestOrigin:
    """Where a request came from: the client's address, and the request's id."""

    remote: str
    request_id: str

    def act(self, caller: Caller, action: str) -> AuditLine:
        """Returns the line of the audit trail for an action of `caller`; the store adds the resource."""
        return AuditLine(caller.name, action, self.remote, self.request_id)


async def request_origin(request: Request) -> RequestOrigin:
    """Returns where a request came from."""
    return RequestOrigin(client_address(request.scope), request.state.request_id)


Origin = Annotated[RequestOrigin, Depends(request_origin)]


def find(thing: str, id: str, read: Callable[[str], Row | None], page: Callable[[int], tuple[list[Any], Any]]) -> Row:
    """Returns a row of the store by its id or `latest`.

    Args:
        thing: that it is.
        id: of it.
        read: returns the row of an id.
        page: returns the newest rows.

    Raises:
        ProblemDetails: There is none.
    """
    if id == "latest":
        id = next((row.id for row in page(1)[0]), id)
    row = read(id)
    if row is None:
        raise ProblemDetails("not-found", f"no {thing} {id!r}")
    return row


def make_once(store: Store, key: IdempotencyKey | None, make: Callable[[], str]) -> str:
    """Returns the id of what a request makes; that of the first one where its key was used already.

    Args:
        store: knows the keys.
        key: of the request.
        make: makes and stores it; returns its id.

    Raises:
        KeyTaken: The key belongs to another body.
    """
    existing = None if key is None else store.resource_of_key(key)
    if existing is not None:
        return existing
    try:
        return make()
    except KeyTaken as taken:
        return taken.resource_of(key)


def name_in_path(description: str, key: str, value: str, summary: str) -> Any:
    """Returns a path parameter of at most 64 characters; `key` names its example `value` in OpenAPI."""
    return Path(description=description, max_length=64, openapi_examples={key: {"summary": summary, "value": value}})


async def client_gone(request: Request) -> AsyncIterator[asyncio.Event]:
    """Yields what is set once the client of a request has left, whose body was read before."""
    gone = asyncio.Event()

    async def watch() -> None:
        while (await request.receive())["type"] != "http.disconnect":
            pass
        gone.set()

    watching = asyncio.create_task(watch())
    try:
        yield gone
    finally:
        watching.cancel()


Gone = Annotated[asyncio.Event, Depends(client_gone)]


async def known_query(request: Request) -> None:
    """Refuses query parameters that the route does not have, or that are given twice: a slip would be without effect.

    Raises:
        ProblemDetails: Every such parameter, with the one that was meant.
    """
    route = request.scope.get("route")
    if not isinstance(route, APIRoute) or not route.include_in_schema:  # pages take what their scripts read
        return
    known = sorted(_query_names(route.dependant))
    counts = Counter(name for name, _ in request.query_params.multi_items())
    unknown = islice((name for name in counts if name not in known), ERRORS_MAX)
    errors = [{"field": f"query.{short_name(name)}", "reason": _unknown_query(name, known)} for name in unknown]
    errors += [{"field": f"query.{name}", "reason": "is given twice"} for name in known if counts[name] > 1]
    if errors:
        raise invalid_fields(errors)


def _query_names(dependant: Dependant) -> set[str]:
    """Returns the names of the query parameters of a route and of everything that it depends on."""
    own = {str(parameter.alias) for parameter in dependant.query_params}
    return own.union(*(_query_names(inner) for inner in dependant.dependencies))


def _unknown_query(name: str, known: Sequence[str]) -> str:
    there = f"; there are {', '.join(known)}" if known else "; there is none here"
    return f"there is no such parameter{did_you_mean(name, known) or there}"


def _plain_integer(text: object) -> object:
    """Returns a parameter that is no text other than an integer's: "+0.0" is taken for one otherwise."""
    if isinstance(text, str) and not INTEGER.fullmatch(text):
        raise ValueError("must be an integer")
    return text


PLAIN = BeforeValidator(_plain_integer)


def id_in_path(thing: str) -> Any:
    """Returns a path parameter that is a UUID, or `latest`."""
    return Path(
        description=f"Id of the {thing}, or `latest`.",
        pattern=ID_PATTERN,
        openapi_examples={"latest": {"summary": f"the newest {thing}", "value": "latest"}},
    )

"""Bodies of requests as JSON that means one thing; the event loop never reads a large one."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from typing import Any

from anyio import to_thread
from fastapi import Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute

from planner.documents import parse_json

LARGE_BYTES = 20_000  # [byte] from here on a body is read in a thread: smaller ones take less than ten milliseconds


class StrictJsonRoute(APIRoute):
    """A route that refuses ambiguous JSON before its models read it, and says which model refused a body."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Returns the handler, with the check in front of it."""
        handler = super().get_route_handler()
        if self.body_field is None:
            return handler
        model = self.body_field.field_info.annotation

        async def checked(request: Request) -> Response:
            asked = ReadRequest(request.scope, request.receive)
            await asked.read()
            try:
                return await handler(asked)
            except RequestValidationError as error:
                error.model = model  # type: ignore[attr-defined]  # for suggestions
                raise

        return checked


class ReadRequest(Request):
    """A request whose body has been read as JSON before the framework asks for it."""

    _document: Any = None

    async def read(self) -> None:
        """Reads the body.

        Raises:
            InvalidProblem: It is no JSON that means one thing.
        """
        body = await self.body()
        if len(body) >= LARGE_BYTES:
            self._document = await to_thread.run_sync(parse_json, body, limiter=self.app.state.lanes.large)
        elif body:
            self._document = parse_json(body)

    async def json(self) -> Any:
        """Returns the document."""
        return self._document

"""Bodies of requests as JSON that means one thing: no key twice, no text that a database or an answer cannot hold."""

from __future__ import annotations

import json
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from fastapi import Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute

from api.http.errors import invalid_fields


class StrictJsonRoute(APIRoute):
    """A route that refuses ambiguous JSON before its models read it, and says which model refused a body."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Returns the handler, with the check in front of it."""
        handler = super().get_route_handler()

        async def checked(request: Request) -> Response:
            if self.body_field is not None:
                refuse_ambiguous(await request.body())
            try:
                return await handler(request)
            except RequestValidationError as error:
                if self.body_field is not None:
                    error.model = self.body_field.field_info.annotation  # type: ignore[attr-defined]  # for suggestions
                raise

        return checked


def refuse_ambiguous(body: bytes) -> None:
    """Refuses JSON with a key twice, or with text that is not Unicode or has a NUL; what is no JSON passes.

    Raises:
        ProblemDetails: Every such field.
    """
    twice: list[str] = []

    def read(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        seen: set[str] = set()
        for key, _ in pairs:
            if key in seen:
                twice.append(key)
            seen.add(key)
        return dict(pairs)

    try:
        document = json.loads(body, object_pairs_hook=read)
    except (ValueError, RecursionError):
        return  # FastAPI says what is wrong with it
    errors = [{"field": _shown(key), "reason": "is given twice"} for key in twice]
    errors += [{"field": field, "reason": "has a character that is no text"} for field in _unprintable(document, "")]
    if errors:
        raise invalid_fields(errors)


def _unprintable(value: Any, path: str) -> Iterator[str]:
    """Yields the paths of keys and values with a NUL or half a surrogate pair, which PostgreSQL and UTF-8 refuse."""
    if isinstance(value, str) and not _is_text(value):
        yield path or "body"
    elif isinstance(value, dict):
        for key, entry in value.items():
            inner = f"{path}.{_shown(key)}" if path else _shown(key)
            yield from _unprintable(entry, inner) if _is_text(key) else [inner]
    elif isinstance(value, list):
        for i, entry in enumerate(value):
            yield from _unprintable(entry, f"{path}[{i}]")


def _is_text(value: str) -> bool:
    return not any(character == "\0" or "\ud800" <= character <= "\udfff" for character in value)


def _shown(key: str) -> str:
    return key if _is_text(key) else ascii(key)

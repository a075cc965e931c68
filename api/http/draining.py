"""Draining: a service that was asked to end refuses new work and answers everything else."""

from __future__ import annotations

import re

from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.http.errors import RESTART_S, problem_response
from api.problems import ProblemDetails, retry_after

NEW_WORK = re.compile(r"/(plan|execute|batches|experiments|cells/[^/]+/map)")


class DrainingMiddleware:
    """ASGI middleware: once `app.state.is_draining`, new work is answered 503, and connections close after an answer.

    Requests that came before go on: plans are finished and stored. Reading, aborting and reporting go on to the end.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuses a request or passes it on."""
        if scope["type"] != "http" or not scope["app"].state.is_draining:
            await self.app(scope, receive, send)
        elif scope["method"] == "POST" and NEW_WORK.fullmatch(scope["path"]):
            scope.setdefault("state", {})["problem"] = problem = shutting_down()
            await problem_response(problem, scope["path"])(scope, receive, _closing(send))
        else:
            await self.app(scope, receive, _closing(send))


def shutting_down() -> ProblemDetails:
    """Returns the problem of work that comes too late."""
    detail = "the service is shutting down and takes no new work"
    return ProblemDetails("shutting-down", detail, headers=retry_after(RESTART_S))


def _closing(send: Send) -> Send:
    async def send_and_close(message: Message) -> None:
        if message["type"] == "http.response.start":
            MutableHeaders(scope=message)["Connection"] = "close"
        await send(message)

    return send_and_close

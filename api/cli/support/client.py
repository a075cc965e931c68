"""HTTP client of the service, for the commands that need a running one."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from types import TracebackType
from typing import IO, Any, Self

import click
import httpx2

from api.cli.support.exit_status import exit_status

TIMEOUT_S = 150.0  # [s] a plan may take its whole time limit
PROBLEM_TYPE = "application/problem+json"


class ServiceError(click.ClickException):
    """The service refused a request or cannot be reached; exit status 2 where it is infeasible, 3 where time ended."""

    def __init__(self, problem: dict[str, Any]) -> None:
        super().__init__(describe(problem))
        self.problem = problem

    def show(self, file: IO[Any] | None = None) -> None:
        """Writes the problem to standard error and exits with the status of its type."""
        super().show(file)
        sys.exit(exit_status(str(self.problem.get("type", "")).rpartition("/")[2]))


class ServiceClient:
    """Calls a running service.

    Args:
        url: Base URL of the service.
        token: Bearer token.

    Raises:
        ServiceError: From every call that does not succeed.
    """

    def __init__(self, url: str, token: str | None = None) -> None:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._http = httpx2.Client(base_url=url, headers=headers, timeout=TIMEOUT_S, trust_env=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._http.close()

    def get(self, path: str) -> dict[str, Any]:
        """Returns the JSON of a GET."""
        return self._call("GET", path)

    def text(self, path: str, media_type: str = "*/*") -> str:
        """Returns the text of a GET, of the media type asked for."""
        return self._response("GET", path, headers={"Accept": media_type}).text

    def post(self, path: str, body: Any = None) -> dict[str, Any]:
        """Returns the JSON of a POST."""
        return self._call("POST", path, body)

    def events(self, execution_id: str) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yields (kind, data) of every event of an execution until its end."""
        kind = "message"
        try:
            with self._http.stream("GET", f"/executions/{execution_id}/events") as response:
                _check(response)
                for line in response.iter_lines():
                    name, _, value = line.partition(": ")
                    if name == "event":
                        kind = value
                    elif name == "data":
                        yield kind, json.loads(value)
        except httpx2.TransportError as error:
            raise _unreachable(self._http, error) from error

    def _call(self, method: str, path: str, body: Any = None) -> dict[str, Any]:
        return self._response(method, path, **({} if body is None else {"json": body})).json()

    def _response(self, method: str, path: str, **more: Any) -> httpx2.Response:
        try:
            response = self._http.request(method, path, **more)
        except httpx2.TransportError as error:
            raise _unreachable(self._http, error) from error
        _check(response)
        return response


def describe(problem: dict[str, Any]) -> str:
    """Returns a problem as text: what stands in the way, a line each, and the nearest request that is feasible."""
    title, violations = problem.get("title", "refused"), problem.get("violations") or ()
    lines = [f"{title}:" if violations else f"{title}: {problem.get('detail', '')}"]
    lines += [f"  {_violation_text(violation)}" for violation in violations]
    if problem.get("nearest"):
        lines.append(f"  {_nearest_text(problem['nearest']['release'])}")
    return "\n".join(lines)


def _violation_text(violation: dict[str, Any]) -> str:
    value, limit = (_figure(violation[key]) for key in ("value", "limit"))
    detail = f" ({violation['detail']})" if violation.get("detail") else ""
    proven = "; proven: no motion avoids it" if violation.get("proven") else ""
    return f"{violation['constraint']}: {value} {violation['unit']} against a limit of {limit}{detail}{proven}"


def _figure(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _nearest_text(release: dict[str, Any]) -> str:
    if release["kind"] != "target":
        return f"the nearest feasible release: {json.dumps(release)}"
    return f"the nearest feasible target: {' '.join(f'{x:.6g}' for x in release['position'])}"


def _check(response: httpx2.Response) -> None:
    if response.status_code < 400:
        return
    response.read()
    if response.headers.get("content-type", "").startswith(PROBLEM_TYPE):
        raise ServiceError(response.json())
    raise ServiceError({"title": "unexpected answer", "detail": response.text[:200], "status": response.status_code})


def _unreachable(http: httpx2.Client, error: Exception) -> ServiceError:
    detail = f"no service at {http.base_url} ({error}); start one with 'fling up'"
    return ServiceError({"title": "no service", "detail": detail, "status": 0})

"""HTTP client of a running service."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, Unpack

import httpx2

from fling import stop_socket
from fling.requests import Options, Request, plain_values, request_of
from fling.this_machine import executors_folder, is_loopback_host
from fling.tracing import trace_context
from planner.progress import Observer, Progress

if TYPE_CHECKING:
    from fling.plans import Plan

EVENTS = "text/event-stream"
SILENCE_S = 20.0  # [s] a service answers within one on a quiet machine, and sends events at least every ten
ABORT_S = 10.0  # [s] an abort is answered within one, and within six where a locked database alone could note it
UNREACHABLE = 0  # status of the problem of a service that does not answer
RETURN_S = 30.0  # [s] within which a service that is started again answers
PAGE = 200  # results of a job read at once
RETRY_S = 0.5  # [s] between two attempts to reach it
PROBLEM_TYPE = "application/problem+json"
DEFAULT_PORT = "8000"  # of this machine, unless FLING_URL or FLING_PORT name another service


class ServiceRefusal(Exception):
    """The service refused a request, or cannot be reached.

    Attributes:
        problem: the answer, `application/problem+json`; of a service that cannot be reached `status` is 0.
    """

    def __init__(self, problem: dict[str, Any]) -> None:
        super().__init__(f"{problem.get('title', 'refused')}: {problem.get('detail', '')}".rstrip(": "))
        self.problem = problem

    @property
    def name(self) -> str:
        """The problem's type without its path, such as `infeasible`."""
        return str(self.problem.get("type", "")).rpartition("/")[2]


class Client:
    """Calls a running service: `with fling.Client() as client: client.plan({...})`.

    Args:
        url: Base URL of the service; default: FLING_URL, or this machine at FLING_PORT, or 8000.
        token: Bearer token; default: FLING_TOKEN.

    Raises:
        ServiceRefusal: From every call that does not succeed; at once for a URL without http:// or https://.
    """

    refusal: type[Exception] = ServiceRefusal  # what the calls raise

    def __init__(self, url: str | None = None, token: str | None = None) -> None:
        url = url or os.environ.get("FLING_URL") or f"http://127.0.0.1:{os.environ.get('FLING_PORT') or DEFAULT_PORT}"
        if not url.startswith(("http://", "https://")):
            detail = f"{url!r} has no http:// or https:// before it"
            raise self.refusal({"title": "no service", "detail": detail, "status": UNREACHABLE})
        token = token or os.environ.get("FLING_TOKEN")
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._http = httpx2.Client(base_url=url, headers=headers, timeout=SILENCE_S, trust_env=False)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._http.close()

    def plan(
        self,
        request: Request,
        cell: str | None = None,
        trajectory: bool = True,
        progress: Observer | None = None,
        **options: Unpack[Options],
    ) -> Plan:
        """Returns the stored plan of a request. An exception meanwhile, such as Ctrl-C, ends the search at the service.

        Args:
            request: a release such as `fling.Target`, a list of `fling.Passage`, or all of it as `POST /plan` takes it.
            cell: name of the cell; by default the one that the request names, or the service's.
            trajectory: whether the answer has the samples.
            progress: called with a `Progress` several times a second; what it raises ends the search.
            options: what the request states beside the release, such as `release_window_s=0.01`.

        Raises:
            TypeError: `cell` is no name: the service has files of its own.
        """
        if cell is not None and not isinstance(cell, str):
            raise TypeError(f"a service plans for the cells in its folder: give the name of one, not {cell!r:.60}")
        asked = request_of(request, options)
        body = dict(asked) if cell is None else {**asked, "cell": cell}
        from fling.plans import Plan  # loads the planner, which other calls do without

        return Plan(self.planned(body, trajectory, progress))

    def planned(
        self, request: Mapping[str, Any], trajectory: bool = True, progress: Observer | None = None
    ) -> dict[str, Any]:
        """Returns the document of the stored plan of a request, as `POST /plan` takes it; see `plan`.

        The progress is asked for in any case: a search may take long, and what is no service is silent.
        """
        path = f"/plan?trajectory={str(trajectory).lower()}"
        for _, kind, data in self._streamed("POST", path, {"Accept": EVENTS}, json=request):
            if kind == "plan":
                return data
            if kind == "problem":
                raise self.refusal(data)
            if progress is not None:
                progress(Progress(**data))
        raise self._unreachable(ConnectionError("the answer has no end"))

    def execute(self, plan: Plan | str = "latest", mode: str = "speedj", dry_run: bool = False) -> dict[str, Any]:
        """Queues an execution of a plan, or of the plan with an id, and returns it; `finished` waits for its end.

        Raises:
            ValueError: `fling.plan` made the plan, which no service has.
        """
        if not isinstance(plan, str) and plan.planned is not None:
            raise ValueError("the library made this plan, and no service has it: execute client.plan(plan.request)")
        plan_id = plan if isinstance(plan, str) else plan.id
        return self.post("/execute", {"plan_id": plan_id, "mode": mode, "dry_run": dry_run})

    def finished(
        self, execution_id: str, on_event: Callable[[str, dict[str, Any]], object] | None = None
    ) -> dict[str, Any]:
        """Waits for the end of an execution and returns it, with outcome and metrics.

        A service that ends meanwhile may come back within half a minute: the executor goes on without it.

        Args:
            execution_id: of the execution.
            on_event: called with kind and data of each event.

        Raises:
            ServiceRefusal: the service stays away; the refusal names the execution.
        """
        last_id = 0
        away_since = None
        while True:
            try:
                for event_id, kind, data in self._events(execution_id, last_id):
                    last_id = event_id
                    if on_event is not None:
                        on_event(kind, data)
                found = self.get(f"/executions/{execution_id}")
                away_since = None
                if found["outcome"] is not None:
                    return found
            except self.refusal as error:
                if getattr(error, "problem", {}).get("status") != UNREACHABLE:
                    raise
                away_since = away_since or time.monotonic()
                if time.monotonic() - away_since > RETURN_S:
                    raise self._lost(execution_id) from error
            time.sleep(RETRY_S)

    def replace(self, execution_id: str, plan: Plan | str) -> dict[str, Any]:
        """Goes on with a plan that begins on the running motion of an execution, and returns that.

        Raises:
            ServiceRefusal: it does not join, and the running plan goes on untouched.
        """
        plan_id = plan if isinstance(plan, str) else plan.id
        return self.post(f"/executions/{execution_id}/replace", {"plan_id": plan_id})

    def retarget(self, cell: str, request: Request, **options: Unpack[Options]) -> Plan:
        """Gives the running motion of a cell another target, and returns the plan that has joined it.

        Args:
            cell: name of the cell.
            request: as of `plan`, without cell and start.
            options: what the request states beside the release.

        Raises:
            ServiceRefusal: nothing joins, and the running plan goes on untouched.
        """
        from fling.plans import Plan

        return Plan(self.post(f"/cells/{cell}/retarget", dict(request_of(request, options))))

    def abort(self, execution_id: str = "latest") -> dict[str, Any]:
        """Asks for the brake and returns the execution. Not a safety function.

        An executor of this machine is asked directly, before the service is: it brakes where that does not answer.

        Args:
            execution_id: of the execution; `latest`: the newest that runs on this machine, or that the service knows.
        """
        run = self._stop_here(execution_id)
        path = f"/executions/{execution_id if run is None else run['id']}/abort"
        try:
            return self._response("POST", path, timeout=ABORT_S).json()
        except self.refusal:
            if run is None:
                raise
            return run

    def _stop_here(self, execution_id: str) -> dict[str, Any] | None:
        """Asks the executors of this machine; None where none of them runs what is meant."""
        data = executors_folder(os.environ)
        if execution_id != "latest":
            return stop_socket.stop(data, execution_id, "a client on this machine")
        return stop_socket.stop_newest(data, "a client on this machine") if self._is_here() else None

    def _is_here(self) -> bool:
        return is_loopback_host(self._http.base_url.host)

    def landed(self, execution_id: str, position: Sequence[float], std_m: float) -> dict[str, Any]:
        """Reports where the object of an execution landed (3,) [m], measured with a standard deviation `std_m` [m]."""
        return self.post(f"/executions/{execution_id}/landing", plain_values({"position": position, "std_m": std_m}))

    def track(
        self, cell: str, position: Sequence[float], std_m: float, observed_at_s: float, **more: Any
    ) -> dict[str, Any]:
        """Begins to track a target of a cell, seen at a place (3,) [m] at a time of the controller's clock [s].

        Args:
            cell: name of the cell.
            position: in the world (3,) [m].
            std_m: standard deviation along each axis [m].
            observed_at_s: when it was there [s].
            more: `velocity` (3,) [m/s] with `velocity_std_m_s`, `drift_m_s`.

        Returns:
            What is known of it, with its `id` for `observe`, and for a target whose position is that `target`.
        """
        return self.post(f"/cells/{cell}/targets", _observation(position, std_m, observed_at_s, more))

    def observe(
        self, target: Mapping[str, Any], position: Sequence[float], std_m: float, observed_at_s: float, **more: Any
    ) -> dict[str, Any]:
        """Adds an observation of a target that is tracked; returns what is known of it. Arguments as of `track`.

        Raises:
            ServiceRefusal: it is no later than the last one, or far from what was expected.
        """
        path = f"/cells/{target['cell']}/targets/{target['id']}/observations"
        return self.post(path, _observation(position, std_m, observed_at_s, more))

    def order_job(self, order: Mapping[str, Any]) -> dict[str, Any]:
        """Queues picks and throws, as `POST /jobs` takes them, and returns the job; `job_progress` follows it."""
        return self.post("/jobs", plain_values(order))

    def job_progress(self, job_id: str) -> Iterator[dict[str, Any]]:
        """Yields a job whenever it has changed, the last time once it is finished.

        A service that ends meanwhile may come back within half a minute: its next instance goes on with the job.

        Raises:
            ServiceRefusal: there is no such job, or the service stays away.
        """
        last_id = 0
        away_since = None
        while True:
            try:
                path = f"/jobs/{job_id}/events"
                for event_id, _, document in self._streamed("GET", path, {"Last-Event-ID": str(last_id)}):
                    last_id = event_id
                    away_since = None
                    yield document
                    if document["state"] == "finished":
                        return
            except self.refusal as error:
                if getattr(error, "problem", {}).get("status") != UNREACHABLE:
                    raise
                away_since = away_since or time.monotonic()
                if time.monotonic() - away_since > RETURN_S:
                    raise
            time.sleep(RETRY_S)

    def job_results(self, job_id: str) -> list[dict[str, Any]]:
        """Returns what became of every object of a job, in the order of the picks."""
        results: list[dict[str, Any]] = []
        cursor = -1
        while cursor is not None:
            page = self.get(f"/jobs/{job_id}/results?limit={PAGE}&cursor={cursor}")
            results += page["results"]
            cursor = page["next_cursor"]
        return results

    def get(self, path: str) -> dict[str, Any]:
        """Returns the JSON of a GET."""
        return self._response("GET", path).json()

    def text(self, path: str, media_type: str = "*/*") -> str:
        """Returns the text of a GET, of the media type asked for."""
        return self._response("GET", path, headers={"Accept": media_type}).text

    def post(self, path: str, body: Any = None) -> dict[str, Any]:
        """Returns the JSON of a POST."""
        return self._response("POST", path, **({} if body is None else {"json": body})).json()

    def events(self, execution_id: str) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yields (kind, data) of every event of an execution until its end."""
        for _, kind, data in self._events(execution_id):
            yield kind, data

    def _events(self, execution_id: str, after_id: int = 0) -> Iterator[tuple[int, str, dict[str, Any]]]:
        """Yields (id, kind, data) of every event after `after_id`."""
        yield from self._streamed("GET", f"/executions/{execution_id}/events", {"Last-Event-ID": str(after_id)})

    def _streamed(
        self, method: str, path: str, headers: Mapping[str, str], **more: Any
    ) -> Iterator[tuple[int, str, dict[str, Any]]]:
        """Yields (id, kind, data) of the events of an answer; closing the iterator closes the connection."""
        id = 0
        kind = "message"
        try:
            with self._http.stream(method, path, headers={**headers, **trace_context()}, **more) as response:
                self._check(response)
                for line in response.iter_lines():
                    name, _, value = line.partition(": ")
                    if name == "id":
                        id = int(value)
                    elif name == "event":
                        kind = value
                    elif name == "data":
                        yield id, kind, json.loads(value)
        except httpx2.TransportError as error:
            raise self._unreachable(error) from None

    def _response(self, method: str, path: str, **more: Any) -> httpx2.Response:
        try:
            headers = {**more.pop("headers", {}), **trace_context()}  # the caller's trace goes on in the service
            response = self._http.request(method, path, headers=headers, **more)
        except httpx2.TransportError as error:
            raise self._unreachable(error) from None
        self._check(response)
        return response

    def _check(self, response: httpx2.Response) -> None:
        if response.status_code < 400:
            return
        response.read()
        if response.headers.get("content-type", "").startswith(PROBLEM_TYPE):
            raise self.refusal(response.json())
        unexpected = {"title": "unexpected answer", "detail": response.text[:200], "status": response.status_code}
        raise self.refusal(unexpected)

    def _unreachable(self, error: Exception) -> Exception:
        if isinstance(error, httpx2.ReadTimeout | httpx2.RemoteProtocolError):
            detail = f"what listens at {self._http.base_url} does not answer as one ({error})"
        elif self._is_here() and stop_socket.is_executor_here(executors_folder(os.environ)):
            detail = (
                f"there is none at {self._http.base_url} ({error}), though an executor runs here: 'fling up' starts "
                f"its service again within seconds; without it, start one with 'fling serve'"
            )
        else:
            detail = f"there is none at {self._http.base_url} ({error}); start one with 'fling up'"
        return self.refusal({"title": "no service", "detail": detail, "status": UNREACHABLE})

    def _lost(self, execution_id: str) -> Exception:
        detail = (
            f"the one at {self._http.base_url} has been away for {RETURN_S:g} s. Execution {execution_id} goes on "
            f"without it, unless its executor was ended, too: GET /executions/{execution_id} once it is back"
        )
        document = {"title": "no service", "detail": detail, "status": UNREACHABLE, "execution_id": execution_id}
        return self.refusal(document)


def _observation(
    position: Sequence[float], std_m: float, observed_at_s: float, more: Mapping[str, Any]
) -> dict[str, Any]:
    return plain_values({"position": position, "std_m": std_m, "observed_at_s": observed_at_s, **more})

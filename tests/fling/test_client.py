"""The client against a small HTTP server of the test's own."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fling
from fling import stop_socket

PROBLEM = {"type": "/problems/infeasible", "title": "Infeasible", "detail": "too far", "status": 422}
EVENTS = [
    'id: 1\nevent: state\ndata: {"state": "queued"}\n\n',
    'id: 2\nevent: state\ndata: {"state": "streaming"}\n\n',
    'id: 3\nevent: state\ndata: {"state": "finished"}\n\n',
]


TOLD = {"stage": "search", "candidates": 2, "best_release_time_s": 0.5, "elapsed_s": 1.0}
PROGRESS = f"id: 1\nevent: progress\ndata: {json.dumps(TOLD)}\n\n"


class EchoingService(BaseHTTPRequestHandler):
    """Answers what the paths of the client ask for, and echoes what was posted."""

    cuts = 0  # streams that still end in the middle

    def do_GET(self) -> None:
        if self.path.endswith("/events"):
            return self.answer(200, "text/event-stream", self.events())
        outcome = None if EchoingService.cuts >= 0 else "completed"
        return self.answer(200, "application/json", json.dumps({"path": self.path, "outcome": outcome}))

    def events(self) -> str:
        """Returns the events after the last one that the client has; the first alone of a stream that is cut."""
        EchoingService.cuts -= 1
        rest = EVENTS[int(self.headers["Last-Event-ID"]) :]
        return "".join(rest[:1] if EchoingService.cuts >= 0 else rest)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if b"far" in body and b"frame" not in body:
            return self.answer(422, "application/problem+json", json.dumps(PROBLEM))
        if b"html" in body:
            return self.answer(502, "text/html", "<p>a proxy")
        asked = json.loads(body) if body else None
        if self.headers["Accept"] == "text/event-stream":
            sent = {"path": self.path, "body": asked, "token": self.headers.get("Authorization")}
            end = {"far": f"problem\ndata: {json.dumps(PROBLEM)}", "cut": ""}.get(
                asked.get("frame"), f"plan\ndata: {json.dumps(sent)}"
            )
            return self.answer(200, "text/event-stream", PROGRESS + (end and f"id: 2\nevent: {end}\n\n"))
        sent = {"path": self.path, "body": asked, "token": self.headers.get("Authorization")}
        return self.answer(201, "application/json", json.dumps(sent))

    def answer(self, status: int, kind: str, text: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text.encode())

    def log_message(self, *_: object) -> None:
        """Says nothing."""


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    server = HTTPServer(("127.0.45.1", 0), EchoingService)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.45.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_calls_and_their_bodies(url: str):
    with fling.Client(url, "secret") as client:
        planned = client.plan({"frame": "base"}, trajectory=False).document
        assert planned == {"path": "/plan?trajectory=false", "body": {"frame": "base"}, "token": "Bearer secret"}
        typed = client.plan(fling.Target([1.2, 0.3, 0.0]), "ur5e-sim", release_window_s=0.0).document
        release = {"kind": "target", "position": [1.2, 0.3, 0.0]}
        assert typed["body"] == {"release": release, "release_window_s": 0.0, "cell": "ur5e-sim"}
        assert client.execute("p", dry_run=True)["body"] == {"plan_id": "p", "mode": "speedj", "dry_run": True}
        assert client.landed("e", (1, 2, 3), 0.01)["body"] == {"position": [1, 2, 3], "std_m": 0.01}
        measured: Any = np.array([1, 2, 3], np.float32)
        assert client.landed("e", measured, measured[0] / 2)["body"] == {"position": [1, 2, 3], "std_m": 0.5}
        assert client.abort("e")["path"] == "/executions/e/abort"


def test_a_plan_whose_progress_is_followed(url: str):
    told = []
    with fling.Client(url) as client:
        assert client.plan({"frame": "base"}, progress=told.append).document["body"] == {"frame": "base"}
        assert told == [fling.Progress("search", 2, 0.5, 1.0)]
        with pytest.raises(fling.ServiceRefusal, match="Infeasible: too far"):
            client.plan({"frame": "far"}, progress=told.append)
        with pytest.raises(fling.ServiceRefusal, match="no end"):
            client.plan({"frame": "cut"}, progress=told.append)


def test_latest_is_what_runs_here_where_the_service_is_here(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Every address of the loopback network is this machine."""
    monkeypatch.setenv("FLING_DATA", str(tmp_path))
    folder = stop_socket.executor_folder(tmp_path, "a cell")
    folder.mkdir(parents=True)
    asked = []
    with stop_socket.listen(folder) as listener:
        listener.setblocking(True)

        def answer() -> None:
            for _ in range(2):  # which runs, and the stop
                with listener.accept()[0] as connection:
                    asked.append(json.loads(connection.recv(stop_socket.MESSAGE_BYTES))["ask"])
                    connection.send(b'{"id": "e7"}')

        threading.Thread(target=answer, daemon=True).start()
        with fling.Client(url) as client:
            assert client.abort("latest")["path"] == "/executions/e7/abort"
    assert asked == ["running", "stop"]


def test_a_service_that_is_started_again_is_not_one_to_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Where an executor runs here, 'fling up' most likely does, and brings its service back."""
    monkeypatch.setenv("FLING_DATA", str(tmp_path))
    with fling.Client("http://127.0.45.1:9") as client:
        with pytest.raises(fling.ServiceRefusal, match="start one with 'fling up'"):
            client.get("/cells")
        folder = stop_socket.executor_folder(tmp_path, "a cell")
        folder.mkdir(parents=True)
        with stop_socket.listen(folder) as listener:
            listener.setblocking(True)

            def answer() -> None:
                with listener.accept()[0] as connection:
                    connection.recv(stop_socket.MESSAGE_BYTES)
                    connection.send(b"null")  # it runs nothing

            threading.Thread(target=answer, daemon=True).start()
            with pytest.raises(fling.ServiceRefusal, match="'fling up' starts its service again"):
                client.get("/cells")


def test_events_until_the_end(url: str):
    with fling.Client(url) as client:
        assert [data["state"] for _, data in client.events("e")] == ["queued", "streaming", "finished"]
        assert client.finished("e") == {"path": "/executions/e", "outcome": "completed"}


def test_an_execution_is_waited_for_although_its_stream_ends_before(url: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("fling.client.RETRY_S", 0.0)
    EchoingService.cuts = 2
    seen = []
    with fling.Client(url) as client:
        done = client.finished("e", lambda kind, data: seen.append(data["state"]))
    assert (done["outcome"], seen) == ("completed", ["queued", "streaming", "finished"])


def test_a_service_that_stays_away_is_told_with_the_execution(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("fling.client.RETRY_S", 0.0)
    monkeypatch.setattr("fling.client.RETURN_S", 0.05)
    with fling.Client("http://127.0.45.1:9") as client, pytest.raises(fling.ServiceRefusal) as refused:
        client.finished("e7")
    assert refused.value.problem["execution_id"] == "e7"
    assert "Execution e7 goes on without it" in str(refused.value)
    assert "GET /executions/e7 once it is back" in str(refused.value)


def test_refusals_carry_the_problem(url: str):
    with fling.Client(url) as client:
        with pytest.raises(fling.ServiceRefusal, match="Infeasible: too far") as refused:
            client.plan({"release": "far"})
        assert (refused.value.name, refused.value.problem) == ("infeasible", PROBLEM)
        with pytest.raises(fling.ServiceRefusal, match="unexpected answer: <p>a proxy"):
            client.plan({"release": "html"})
    with fling.Client("http://127.0.45.1:9") as nobody, pytest.raises(fling.ServiceRefusal, match="start one with"):
        nobody.get("/healthz")


def test_an_address_that_is_none_says_why(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("fling.client.SILENCE_S", 0.1)
    monkeypatch.setattr("fling.client.ABORT_S", 0.1)
    for url in ("127.0.45.1:8000", "localhost:8000", "robots.example"):
        with pytest.raises(fling.ServiceRefusal, match=f"'{url}' has no http://"):
            fling.Client(url)
    with socket.create_server(("127.0.45.1", 0)) as silent:
        port = silent.getsockname()[1]
        with fling.Client(f"http://127.0.45.1:{port}") as client:
            calls: list[Callable[[], object]] = [
                lambda: client.get("/healthz"),
                lambda: client.text("/healthz"),
                lambda: client.post("/execute", {}),
                lambda: client.plan({"frame": "base"}),
                client.abort,
            ]
            for call in calls:
                with pytest.raises(fling.ServiceRefusal, match=rf"what listens at .*:{port} does not answer"):
                    call()


def test_what_a_service_cannot_have_is_told_before_it_is_asked():
    cell = fling.open_cell("ur5e-sim")
    joint = fling.Joint(cell.home, np.zeros(6))
    made = fling.plan(joint, cell, backend="ruckig")
    with fling.Client("http://127.0.45.1:9") as nobody:
        with pytest.raises(ValueError, match=r"the library made this plan.* client\.plan\(plan\.request\)"):
            nobody.execute(made)
        for given in (cell, Path("cells/ur5e-sim.toml")):
            with pytest.raises(TypeError, match="give the name of one"):
                nobody.plan(joint, given)  # type: ignore[arg-type]


def test_the_service_is_where_the_environment_says(url: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("FLING_URL", raising=False)
    monkeypatch.setenv("FLING_PORT", "9")
    with fling.Client() as nobody, pytest.raises(fling.ServiceRefusal, match=r"127\.0\.0\.1:9") as refused:
        nobody.get("/healthz")
    assert refused.value.__cause__ is None  # its traceback ends at the call
    assert refused.value.__suppress_context__
    monkeypatch.setenv("FLING_URL", url)
    with fling.Client() as client:
        assert client.get("/healthz")["path"] == "/healthz"

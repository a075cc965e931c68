"""The client against a small HTTP server of the test's own."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

import fling

PROBLEM = {"type": "/problems/infeasible", "title": "Infeasible", "detail": "too far", "status": 422}
EVENTS = 'event: state\ndata: {"state": "queued"}\n\nevent: state\ndata: {"state": "finished"}\n\n'


class EchoingService(BaseHTTPRequestHandler):
    """Answers what the paths of the client ask for, and echoes what was posted."""

    def do_GET(self) -> None:
        if self.path.endswith("/events"):
            return self.answer(200, "text/event-stream", EVENTS)
        return self.answer(200, "application/json", json.dumps({"path": self.path}))

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        if b"far" in body:
            return self.answer(422, "application/problem+json", json.dumps(PROBLEM))
        if b"html" in body:
            return self.answer(502, "text/html", "<p>a proxy")
        asked = json.loads(body) if body else None
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
        planned = client.plan({"frame": "base"}, trajectory=False)
        assert planned == {"path": "/plan?trajectory=false", "body": {"frame": "base"}, "token": "Bearer secret"}
        assert client.execute("p", dry_run=True)["body"] == {"plan_id": "p", "mode": "speedj", "dry_run": True}
        assert client.landed("e", (1, 2, 3), 0.01)["body"] == {"position": [1, 2, 3], "std_m": 0.01}
        assert client.abort("e")["path"] == "/executions/e/abort"


def test_events_until_the_end(url: str):
    with fling.Client(url) as client:
        assert [data["state"] for _, data in client.events("e")] == ["queued", "finished"]
        assert client.finished("e") == {"path": "/executions/e"}


def test_refusals_carry_the_problem(url: str):
    with fling.Client(url) as client:
        with pytest.raises(fling.ServiceRefusal, match="Infeasible: too far") as refused:
            client.plan({"release": "far"})
        assert (refused.value.name, refused.value.problem) == ("infeasible", PROBLEM)
        with pytest.raises(fling.ServiceRefusal, match="unexpected answer: <p>a proxy"):
            client.plan({"release": "html"})
    with fling.Client("http://127.0.45.1:9") as nobody, pytest.raises(fling.ServiceRefusal, match="start one with"):
        nobody.get("/healthz")

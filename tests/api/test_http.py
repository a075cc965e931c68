"""HTTP in general: conditional requests, compression, HEAD, origins, and what the server itself refuses."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator

import pytest
import uvicorn

from api.server import server_config
from tests.api.conftest import FakeExecutor, RunningService
from tests.api.test_bad_input import problem_of
from tests.waiting import until

CHANGING = ("/metrics", "/cells", "/cells/ur5e-sim/state")  # between two requests


def test_a_plan_is_not_sent_twice(service: RunningService, plan):
    for path in (f"/plans/{plan['id']}", "/plans/latest", f"/plans/{plan['id']}/trajectory"):
        first = service.client.get(path)
        tag = first.headers["etag"]
        again = service.client.get(path, headers={"If-None-Match": f'"other", {tag}'})
        assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", tag)
        assert service.client.get(path, headers={"If-None-Match": '"other"'}).content == first.content
    path = f"/plans/{plan['id']}"
    tags = {service.client.get(path, params={"trajectory": flag}).headers["etag"] for flag in ("true", "false")}
    tags |= {
        service.client.get(f"{path}/trajectory", headers={"Accept": a}).headers["etag"] for a in ("text/csv", "*/*")
    }
    assert len(tags) == 4


def test_plans_are_compressed_for_clients_that_read_it(service: RunningService, plan):
    path = f"/plans/{plan['id']}"
    plain = service.client.get(path, headers={"Accept-Encoding": "identity"})
    packed = service.client.get(path, headers={"Accept-Encoding": "gzip"})
    assert "content-encoding" not in plain.headers
    assert packed.headers["content-encoding"] == "gzip"
    assert "accept-encoding" in packed.headers["vary"].lower()
    assert int(packed.headers["content-length"]) < len(plain.content) / 2
    assert packed.json() == plain.json()


@pytest.mark.parametrize(
    "path",
    ["/", "/docs", "/healthz", "/readyz", "/metrics", "/openapi.json", "/cells", "/cells/ur5e-sim/state", "/plans",
     "/plans/latest", "/plans/latest/trajectory", "/plans/latest/curves", "/executions"],
)  # fmt: skip
def test_head_is_get_without_the_content(service: RunningService, plan, path: str):
    head = service.client.head(path)
    get = service.client.get(path)
    assert (head.status_code, head.content) == (200, b"")
    for name in ("content-type", "content-length", "etag"):
        if path not in CHANGING or name == "content-type":
            assert head.headers.get(name) == get.headers.get(name), name


def test_head_of_problems_and_streams(service: RunningService, executor: FakeExecutor, plan):
    missing = service.client.head("/plans/nothing")
    assert (missing.status_code, missing.content) == (404, b"")
    assert missing.headers["content-type"] == "application/problem+json"
    id = service.client.post("/execute", json={"plan_id": plan["id"]}).json()["id"]
    watched = service.client.head(f"/executions/{id}/events")  # the execution goes on; the answer does not
    assert (watched.status_code, watched.content) == (200, b"")
    assert watched.headers["content-type"].startswith("text/event-stream")


def test_a_media_type_that_there_is_not(service: RunningService, executor: FakeExecutor, plan):
    service.client.post("/experiments", json={"name": "none"})
    offers = ["application/json", "text/csv"]
    for path, more in (
        (f"/plans/{plan['id']}/trajectory", []),
        ("/experiments/latest", ["application/vnd.apache.parquet"]),
    ):
        problem = problem_of(service.client.get(path, headers={"Accept": "image/png"}), 406, "not-acceptable")
        assert problem["offers"] == offers + more


@pytest.mark.parametrize(
    ("origin", "host", "own"),
    [
        ("http://127.0.0.1:8000", "127.0.0.1:8000", True),
        ("https://localhost", "localhost", True),
        ("https://localhost", "localhost:443", True),
        ("http://LOCALHOST:80", "localhost", True),
        ("http://[::1]:8000", "[::1]:8000", True),
        ("http://localhost:8001", "localhost:8000", False),
        ("http://localhost", "localhost:443", False),
        ("null", "localhost", False),
        ("", "localhost", False),
        ("localhost", "localhost", False),
        ("evil://localhost", "localhost", False),
        ("http://evil.example/://localhost", "localhost", False),
        ("http://localhost@evil.example", "localhost", False),
        ("http://evil.example@localhost", "localhost", False),
        ("http://localhost/", "localhost", False),
        ("http://localhost:x", "localhost", False),
    ],
)
def test_pages_of_another_origin_change_nothing(service: RunningService, origin: str, host: str, own: bool):
    headers = {"Origin": origin, "Host": host}
    response = service.client.post("/executions/nothing/abort", headers=headers)
    problem_of(response, *((404, "not-found") if own else (403, "forbidden")))
    assert service.client.get("/healthz", headers=headers).status_code == 200


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """Yields the port of a server that answers every request with 'here'."""

    async def app(scope, receive, send) -> None:
        assert scope["type"] == "http"
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"4")]})
        await send({"type": "http.response.body", "body": b"here"})

    config = server_config(app, "127.0.41.1", 0)
    config.lifespan = "off"
    config.log_level = "critical"
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    until(lambda: server.started)
    yield server.servers[0].sockets[0].getsockname()[1]
    server.should_exit = True
    thread.join()


def exchange(port: int, sent: bytes) -> tuple[str, bytes]:
    with socket.create_connection(("127.0.41.1", port), 5.0) as connection:
        connection.sendall(sent)
        received = b""
        while part := connection.recv(65536):
            received += part
    head, _, body = received.partition(b"\r\n\r\n")
    return head.decode().lower(), body


@pytest.mark.parametrize(
    "sent",
    [
        b"hello\r\n\r\n",
        b"GET / HTTP/1.1\r\n\r\n",  # no Host
        b"GET / HTTP/1.1\r\nHost: a\r\nContent-Length: x\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",  # TLS
    ],
)
def test_what_is_no_http_is_answered_with_a_problem(port: int, sent: bytes):
    head, body = exchange(port, sent)
    assert head.startswith("http/1.1 400 ")
    assert "content-type: application/problem+json" in head
    assert "connection: close" in head
    assert json.loads(body)["type"] == "/problems/bad-request"


def test_a_request_for_websocket_is_answered_as_the_request_it_is(port: int):
    upgrade = b"Connection: Upgrade, close\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    head, body = exchange(port, b"GET / HTTP/1.1\r\nHost: a\r\n" + upgrade + b"Sec-WebSocket-Key: eA==\r\n\r\n")
    assert head.startswith("http/1.1 200 ")
    assert body == b"here"

"""The server on a real socket: slow clients are cut, and the end is in order. Times are shortened."""

from __future__ import annotations

import asyncio
import json
import signal
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from api.dependencies import client_gone
from api.http import DrainingMiddleware, SecurityMiddleware, event_stream, install_error_handlers, middleware
from api.plan_events import plan_events
from api.server import DrainingServer, ImpatientProtocol, server_config
from planner.progress import Observer
from tests.waiting import until_true

HOST = "127.0.42.9"
GET = b"GET /%s HTTP/1.1\r\nHost: 127.0.42.9\r\n\r\n"
POST = (
    b"POST /%s HTTP/1.1\r\nHost: 127.0.42.9\r\nContent-Type: application/json\r\nContent-Length: %d\r\n"
    b"Connection: close\r\n\r\n"
)
HUGE = 20_000_000  # [byte] more than the kernel buffers of a connection


class QuickProtocol(ImpatientProtocol):
    headers_s = 1.0  # a busy machine takes tenths between two pieces
    stall_s = 0.3


class RunningServer:
    """A server with a small application, which answers /slow after `answer` is set, and /left to nobody."""

    def __init__(self, proxies: Sequence[str] = ()) -> None:
        self.answer, self.drained, self.left = asyncio.Event(), asyncio.Event(), asyncio.Event()
        routes = [
            Route("/quick", self._quick),
            Route("/slow", self._slow),
            Route("/huge", self._huge),
            Route("/who", self._who),
            Route("/plan", self._body, methods=["POST"]),
            Route("/abort", self._body, methods=["POST"]),
            Route("/left", self._left, methods=["POST"]),
            Route("/search", self._search, methods=["POST"]),
        ]
        self.app = Starlette(routes=routes)
        self.app.state.is_draining = False
        self.app.add_middleware(DrainingMiddleware)
        self.app.add_middleware(SecurityMiddleware, local_only=True)
        install_error_handlers(self.app)  # type: ignore[arg-type]
        config = server_config(self.app, HOST, 0, proxies)
        config.http = QuickProtocol
        self.server = DrainingServer(config, self._drain)

    @property
    def port(self) -> int:
        return self.server.servers[0].sockets[0].getsockname()[1]

    async def _quick(self, request: Request) -> Response:
        return JSONResponse({"query": request.url.query} if request.url.query else {})

    async def _who(self, request: Request) -> Response:
        assert request.client is not None
        return JSONResponse({"client": request.client.host})

    async def _slow(self, _: Request) -> Response:
        await self.answer.wait()
        return JSONResponse({"slow": True})

    async def _huge(self, _: Request) -> Response:
        async def chunks() -> AsyncIterator[bytes]:
            for _ in range(20):
                yield bytes(HUGE // 20)

        return StreamingResponse(chunks())

    async def _body(self, request: Request) -> Response:
        return JSONResponse({"bytes": len(await request.body())})

    async def _left(self, request: Request) -> Response:
        await request.body()
        async with asynccontextmanager(client_gone)(request) as gone:
            await gone.wait()
        self.left.set()
        return JSONResponse({})

    async def _search(self, request: Request) -> Response:
        async def endless(observer: Observer) -> Response:
            try:
                await asyncio.Event().wait()
            finally:
                self.left.set()
            return Response()

        await request.body()
        return event_stream(plan_events(request, endless), lambda: True)

    async def _drain(self) -> None:
        self.app.state.is_draining = True
        await self.drained.wait()


@asynccontextmanager
async def serving(proxies: Sequence[str] = ()) -> AsyncIterator[RunningServer]:
    running = RunningServer(proxies)
    running.server.config.load()
    task = asyncio.create_task(running.server._serve())
    await until_true(lambda: running.server.started)
    yield running
    running.answer.set()
    running.drained.set()
    running.server.handle_exit(signal.SIGTERM, None)
    await asyncio.wait_for(task, 30.0)


def run(test: Callable[[RunningServer], Awaitable[None]], proxies: Sequence[str] = ()) -> None:
    async def whole() -> None:
        async with serving(proxies) as running:
            await test(running)

    asyncio.run(whole())


async def answer_to(running: RunningServer, data: bytes) -> tuple[int, dict[str, str], Any]:
    """Returns status, headers and JSON of what the server answers until it closes; status 0: nothing."""
    reader, writer = await asyncio.open_connection(HOST, running.port)
    writer.write(data)
    answered = await asyncio.wait_for(reader.read(), 30.0)
    writer.close()
    if not answered:
        return 0, {}, None
    head, _, body = answered.partition(b"\r\n\r\n")
    first, *lines = head.decode().split("\r\n")
    headers = {name.lower(): value for name, value in (line.split(": ", 1) for line in lines)}
    return int(first.split()[1]), headers, json.loads(body)


def test_headers_that_do_not_end_are_answered_408_and_cut():
    async def test(running: RunningServer) -> None:
        status, headers, problem = await answer_to(running, b"GET /quick HTTP/1.1\r\nHost: 127.0.42.9\r\nX-Slow: ")
        assert (status, problem["type"], problem["status"]) == (408, "/problems/request-timeout", 408)
        assert (headers["content-type"], headers["connection"]) == ("application/problem+json", "close")

    run(test)


def test_a_connection_without_a_request_is_cut():
    async def test(running: RunningServer) -> None:
        assert (await answer_to(running, b""))[0] == 0

    run(test)


def test_headers_may_come_in_pieces_and_answers_take_their_time():
    async def test(running: RunningServer) -> None:
        reader, writer = await asyncio.open_connection(HOST, running.port)
        request = GET % b"slow"
        writer.write(request[:20])
        await asyncio.sleep(0.1)
        writer.write(request[20:])
        await asyncio.sleep(2 * QuickProtocol.headers_s)
        running.answer.set()
        assert b"200 OK" in await reader.readuntil(b"}")
        writer.write(GET % b"quick")  # on the same connection
        assert b"200 OK" in await reader.readuntil(b"{}")
        writer.close()

    run(test)


def test_a_body_that_does_not_end_is_answered_408(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(middleware, "BODY_S", 0.3)

    async def test(running: RunningServer) -> None:
        head = (
            b"POST /plan HTTP/1.1\r\nHost: 127.0.42.9\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n{"
        )
        status, headers, problem = await answer_to(running, head)
        assert (status, problem["type"]) == (408, "/problems/request-timeout")
        assert headers["connection"] == "close"

    run(test)


def test_headers_beyond_their_bound_are_refused_however_they_arrive():
    """Whole at once, they were never incomplete, which is all that the library bounds."""

    async def test(running: RunningServer) -> None:
        for size, status in ((60_000, 200), (66_000, 400)):
            head = GET.replace(b"\r\n\r\n", b"\r\nConnection: close\r\nX-Long: %s\r\n\r\n" % (b"x" * size))
            assert (await answer_to(running, head % b"quick"))[0] == status
        target = b"quick?" + b"x" * 66_000
        assert (await answer_to(running, GET % target))[0] == 400
        many = b"".join(b"x%d: y\r\n" % i for i in range(9000))
        status, _, problem = await answer_to(running, GET.replace(b"\r\n\r\n", b"\r\n" + many + b"\r\n") % b"quick")
        assert (status, problem["type"]) == (400, "/problems/bad-request")
        assert problem["detail"] == "The headers are larger than 65536 bytes. The connection is closed."

    run(test)


def test_a_body_in_countless_parts_is_refused():
    """A megabyte in chunks of one byte would keep the event loop busy for seconds."""

    async def test(running: RunningServer) -> None:
        head = (POST % (b"plan", 0)).replace(b"Content-Length: 0", b"Transfer-Encoding: chunked")
        assert (await answer_to(running, head + 1900 * b"1\r\nx\r\n" + b"0\r\n\r\n"))[2] == {"bytes": 1900}
        reader, writer = await asyncio.open_connection(HOST, running.port)
        writer.write(head + 2001 * b"1\r\nx\r\n")
        problem = (await asyncio.wait_for(reader.read(), 30.0)).partition(b"\r\n\r\n")[2]
        assert json.loads(problem)["detail"] == "The body comes in more than 2000 parts. The connection is closed."
        writer.close()

    run(test)


@pytest.mark.parametrize(
    ("target", "path", "query"),
    [
        (b"http://127.0.42.9/quick", "/quick", ""),
        (b"HTTP://127.0.42.9:80/quick?a=b://c", "/quick", "a=b://c"),
        (b"http://127.0.42.9/quick?x/y", "/quick", "x/y"),
        (b"https://127.0.42.9", "/", ""),
        (b"http://127.0.42.9?a=1", "/", "a=1"),
    ],
)
def test_an_absolute_target_is_its_path(target: bytes, path: str, query: str):
    """RFC 9112, section 3.2.2: a server must accept it, and its authority stands for `Host`."""

    async def test(running: RunningServer) -> None:
        request = b"GET %s HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n" % target
        status, _, answer = await answer_to(running, request)
        if path == "/quick":
            assert (status, answer) == (200, {"query": query} if query else {})
        else:
            assert (status, answer["instance"]) == (404, "/")

    run(test)


@pytest.mark.parametrize("target", [b"http://evil.example/quick", b"http://127.0.42.9@evil.example/quick"])
def test_the_host_of_an_absolute_target_is_checked(target: bytes):
    async def test(running: RunningServer) -> None:
        request = b"GET %s HTTP/1.1\r\nHost: 127.0.42.9\r\nConnection: close\r\n\r\n" % target
        assert (await answer_to(running, request))[0] == 403

    run(test)


@pytest.mark.parametrize(
    ("proxies", "client"),
    [((), "127.0.0.1"), (("10.0.0.0/8",), "127.0.0.1"), (("127.0.0.0/8",), "192.0.2.7")],
)
def test_a_client_s_address_is_its_own_word_through_a_trusted_proxy_alone(proxies: tuple[str, ...], client: str):
    async def test(running: RunningServer) -> None:
        forged = b"\r\nConnection: close\r\nX-Forwarded-For: 192.0.2.7\r\n\r\n"
        assert (await answer_to(running, GET.replace(b"\r\n\r\n", forged) % b"who"))[2] == {"client": client}

    run(test, proxies)


def test_a_client_that_leaves_within_its_body_is_no_bug(caplog: pytest.LogCaptureFixture):
    async def test(running: RunningServer) -> None:
        _, writer = await asyncio.open_connection(HOST, running.port)
        writer.write(POST % (b"plan", 9) + b"{")
        await asyncio.sleep(0.1)
        writer.close()
        await asyncio.sleep(0.1)

    run(test)
    assert not [record for record in caplog.records if record.levelname == "ERROR"]


def test_a_client_that_does_not_read_is_cut():
    async def test(running: RunningServer) -> None:
        reader, writer = await asyncio.open_connection(HOST, running.port, limit=1)
        writer.write(GET % b"huge")
        await asyncio.sleep(0.1)
        await until_true(lambda: not running.server.server_state.connections)
        received = 0
        with suppress(ConnectionError):
            while chunk := await reader.read(1_000_000):
                received += len(chunk)
        assert received < HUGE
        writer.close()

    run(test)


def test_a_search_ends_whose_reader_has_left():
    async def test(running: RunningServer) -> None:
        reader, writer = await asyncio.open_connection(HOST, running.port)
        writer.write(POST % (b"search", 2) + b"{}")
        assert b"event: progress" in await reader.readuntil(b"progress")
        assert not running.left.is_set()
        writer.close()
        await asyncio.wait_for(running.left.wait(), 30.0)

    run(test)


def test_it_is_noticed_at_once_that_a_client_has_left():
    async def test(running: RunningServer) -> None:
        _, writer = await asyncio.open_connection(HOST, running.port)
        writer.write(POST % (b"left", 2) + b"{}")
        await asyncio.sleep(0.1)
        assert not running.left.is_set()
        writer.close()
        await asyncio.wait_for(running.left.wait(), 30.0)

    run(test)


def test_draining_refuses_new_work_and_answers_the_rest():
    async def test(running: RunningServer) -> None:
        slow = asyncio.create_task(answer_to(running, GET % b"slow"))
        await asyncio.sleep(0.1)
        running.server.handle_exit(signal.SIGTERM, None)
        await until_true(lambda: running.app.state.is_draining)
        status, headers, problem = await answer_to(running, POST % (b"plan", 2) + b"{}")
        assert (status, problem["type"]) == (503, "/problems/shutting-down")
        assert int(headers["retry-after"]) > 0
        assert (await answer_to(running, POST % (b"abort", 2) + b"{}"))[2] == {"bytes": 2}
        assert (await answer_to(running, GET % b"quick"))[0] == 200
        running.drained.set()  # the server ends now, and what was begun is still answered
        running.answer.set()
        assert (await slow)[2] == {"slow": True}

    run(test)

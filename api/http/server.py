"""What the HTTP server itself refuses, as problem documents: bytes that are no HTTP, and upgrades of a connection."""

from __future__ import annotations

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from api.http.errors import ProblemDetails, problem_response

# [s] an idle connection is kept, and with it longer than every `Retry-After` that is given (`RETRY_MAX_S` of the pool):
# who waits as told finds it open.
KEEP_ALIVE_S = 75


class ProblemProtocol(H11Protocol):
    """HTTP/1.1 whose own refusals are problem documents; a request for WebSocket is answered as the request it is."""

    def send_400_response(self, msg: str) -> None:
        """Answers bytes that are no HTTP, unless an answer is under way, and ends the connection."""
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
            self.transport.close()
            return
        self.refuse(ProblemDetails("bad-request", f"{msg} The connection is closed."))
        self.transport.close()

    def refuse(self, problem: ProblemDetails) -> None:
        """Answers a request that the application never saw; it is the connection's last."""
        response = problem_response(problem, "/")
        headers = [*response.raw_headers, (b"connection", b"close")]
        for event in (
            h11.Response(status_code=response.status_code, headers=headers),
            h11.Data(data=bytes(response.body)),
            h11.EndOfMessage(),
        ):
            self.transport.write(self.conn.send(event) or b"")

    def _should_upgrade(self) -> bool:
        return False

"""Client of a simulated controller's control port: releases, landings and counters that no real robot reports.

Used by the daemon only, and only where the cell's link is "sim"; the streaming process treats both alike.
"""

from __future__ import annotations

import json
import socket
from typing import Any

PORT = 29900
TIMEOUT_S = 2.0  # [s]


def request(host: str, op: str, **parameters: Any) -> dict[str, Any]:
    """Returns the simulator's answer to one request.

    Raises:
        OSError: no connection, or no answer in time.
        ValueError: the request was refused.
    """
    with socket.create_connection((host, PORT), TIMEOUT_S) as connection:
        connection.sendall(json.dumps({"op": op, **parameters}).encode() + b"\n")
        with connection.makefile("rb") as stream:
            line = stream.readline()
    if not line:
        raise ConnectionError("the simulator closed the connection")
    answer = json.loads(line)
    if not answer.get("ok"):
        raise ValueError(answer.get("error", "refused"))
    return answer

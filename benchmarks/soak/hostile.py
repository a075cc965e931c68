"""Hostile clients, in a process of their own: large, deep, wrong, in countless parts. `URL SECONDS CLIENTS`."""

from __future__ import annotations

import asyncio
import json
import os
import random
import sys
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from urllib.parse import urlsplit

NOBODY = "00000000-0000-7000-8000-000000000000"
MANY = {f"{i:05d}": 1 for i in range(75_000)}
NICENESS = 10  # they would be on other machines, and leave this one its processors
LONG_S = 120.0  # [s] for an answer
TARGET = {"release": {"kind": "target", "position": [1.0, 0.3, 0.0]}}


def requests(host: str) -> list[bytes]:
    """Returns whole requests, as they go over the wire."""
    documents = {
        "unknown fields": ("/plan", MANY),
        "unknown fields of a part": ("/plan", {**TARGET, "start": MANY}),
        "wrong numbers": ("/plan", {"release": {"kind": "joint", "positions": ["x"] * 190_000}}),
        "no text": ("/plan", ["\ud800"] * 60_000),
        "fields to execute": ("/execute", MANY),
        "a landing": (f"/executions/{NOBODY}/landing", {"position": ["x"] * 190_000}),
        "requests": ("/batches", {"requests": [{f"{i}": 1 for i in range(90)} for _ in range(900)]}),
        "axes": ("/batches", {"template": TARGET, "grid": {f"a{i}": [0, 1e6, 1.1] for i in range(90)}}),
        "planes": ("/cells/soak/map", {"resolution_m": 0.005, "volume_m": [-100, 100]}),
    }
    bodies = {name: (path, json.dumps(document).encode()) for name, (path, document) in documents.items()}
    bodies["deep"] = ("/plan", b"[" * 400_000)
    bodies["twice"] = ("/plan", b"{" + b",".join([b'"a":1'] * 150_000) + b"}")
    bodies["parameters"] = ("/plan?" + "&".join(f"q{i}=1" for i in range(6000)), b"{}")
    head = f"Host: {host}\r\nContent-Type: application/json\r\nConnection: close\r\n"
    found = [
        f"POST {path} HTTP/1.1\r\n{head}Content-Length: {len(body)}\r\n\r\n".encode() + body
        for path, body in bodies.values()
    ]
    chunked = f"POST /plan HTTP/1.1\r\n{head}Transfer-Encoding: chunked\r\n\r\n".encode()
    found.append(chunked + b"1\r\nx\r\n" * 100_000)
    found += [f"GET {path} HTTP/1.1\r\n{head}\r\n".encode() for path in ("/plans?limit=200", "/plans/latest/curves")]
    return found


async def ask(host: str, port: int, request: bytes) -> int:
    """Returns the status of an answer; 0 where the connection was cut."""
    status = 0
    with suppress(OSError, asyncio.IncompleteReadError, TimeoutError):
        reader, writer = await asyncio.open_connection(host, port)
        writer.write(request)
        async with asyncio.timeout(LONG_S):
            head = await reader.readexactly(12)
            status = int(head[9:])
            while await reader.read(1 << 20):
                pass
        writer.close()
    return status


async def attack(url: str, seconds: float, clients: int) -> Mapping[int, int]:
    """Returns how often each status was answered."""
    place = urlsplit(url)
    assert place.hostname is not None and place.port is not None
    asked = requests(place.netloc)
    ends_at = time.monotonic() + seconds
    statuses: Counter[int] = Counter()

    async def one(seed: int) -> None:
        chance = random.Random(seed)
        while time.monotonic() < ends_at:
            statuses[await ask(str(place.hostname), int(place.port or 0), chance.choice(asked))] += 1

    await asyncio.gather(*(one(seed) for seed in range(clients)))
    return statuses


if __name__ == "__main__":
    os.nice(NICENESS)
    print(json.dumps(asyncio.run(attack(sys.argv[1], float(sys.argv[2]), int(sys.argv[3])))))

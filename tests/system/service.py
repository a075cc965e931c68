"""The service as a process of its own, on a rig's store."""

from __future__ import annotations

import socket
import subprocess
import sys
from typing import Self

import httpx2

from tests.system.rig import ROOT, Rig

START_S = 120.0  # [s] for a busy machine to load the service: five seconds of its own


class RigService:
    """A running service."""

    def __init__(self, rig: Rig) -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            port = server.getsockname()[1]
        environment = {**rig.environment, "FLING_PORT": str(port), "FLING_PLANNER_WORKERS": "1",
                       "FLING_DEFAULT_CELL": "rig"}  # fmt: skip
        self.process = subprocess.Popen([sys.executable, "-m", "api"], cwd=ROOT, env=environment)
        self.http = httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=60.0, trust_env=False)
        rig.until(self._answers, within_s=START_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def _answers(self) -> bool:
        try:
            return self.http.get("/healthz").status_code == 200
        except httpx2.TransportError:
            return False

    def end(self) -> None:
        """Ends the process, if it runs, and the connection to it."""
        self.http.close()
        self.process.terminate()
        self.process.wait(30.0)

    def execute(self, plan_id: str) -> str:
        """Queues an execution over HTTP; returns its id."""
        response = self.http.post("/execute", json={"plan_id": plan_id})
        assert response.status_code == 202, response.text
        return response.json()["id"]

"""`fling job` against a small service of the test's own, which tells of a job that another part of it carries out."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest
from click.testing import CliRunner, Result

from api.cli import main

ORDER = {"picks": [{"pose": {"position": [0.4, 0.0, 0.1], "rotation_vector": [3.14, 0.0, 0.0]}}], "targets": []}
TOML = "targets = []\n[[picks]]\npose = { position = [0.4, 0.0, 0.1], rotation_vector = [3.14, 0.0, 0.0] }\n"
RECORD = {
    "hits": 1,
    "landings_seen": 2,
    "hit_interval": [0.09, 0.91],
    "misses": {"miss": 1},
    "cycles_per_hour": 1200.0,
    "cycle_time_s": 3.0,
}
HEAD = {"id": "j", "total": 2, "reason": None, "record": RECORD}
TOLD = [
    {**HEAD, "state": "running", "outcome": None, "done": 1},
    {**HEAD, "state": "finished", "outcome": "completed", "done": 2},
]
COMMON = {"object": None, "target": 0, "reason": None}
DONE = [
    {**COMMON, "pick": 0, "result": "hit", "error_m": 0.012, "object_at": "thrown at target 0", "object": "ball"},
    {**COMMON, "pick": 1, "result": "miss", "error_m": 0.2, "object_at": "thrown at target 0"},
]


class ToldJob(BaseHTTPRequestHandler):
    """Answers as the service does."""

    orders: ClassVar[list[Any]] = []
    ends: ClassVar[dict[str, Any]] = {}

    def do_POST(self) -> None:
        self.orders.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.answer("application/json", json.dumps(TOLD[0]))

    def do_GET(self) -> None:
        if self.path.endswith("/events"):
            told = [TOLD[0], {**TOLD[1], **self.ends}][int(self.headers["Last-Event-ID"]) :]
            text = [f"id: {i + 1}\nevent: progress\ndata: {json.dumps(each)}\n\n" for i, each in enumerate(told)]
            return self.answer("text/event-stream", "".join(text))
        return self.answer("application/json", json.dumps({"results": DONE, "next_cursor": None}))

    def answer(self, media: str, text: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", media)
        self.end_headers()
        self.wfile.write(text.encode())

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def url(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setattr(ToldJob, "orders", [])
    monkeypatch.setattr(ToldJob, "ends", {})
    server = HTTPServer(("127.0.0.1", 0), ToldJob)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["job", *arguments])


@pytest.mark.parametrize(("name", "text"), [("job.json", json.dumps(ORDER)), ("job.toml", TOML)])
def test_a_file_is_ordered_followed_and_summed_up(url: str, tmp_path: Path, name: str, text: str):
    file = tmp_path / name
    file.write_text(text)
    done = run(str(file), "--url", url)
    assert done.exit_code == 0, done.output
    assert ToldJob.orders == [ORDER]
    assert done.stdout.splitlines() == [
        "pick 0 (ball): hit, 12 mm from target 0; thrown at target 0",
        "pick 1: miss, 200 mm from target 0; thrown at target 0",
        "job j: completed; 2 of 2 picks done",
        "hits: 1 of 2 seen (9% to 91%)",
        "misses: 1 miss",
        "1200 cycles an hour, 3.00 s each",
    ]


def test_a_job_that_stopped_is_status_4_with_its_reason(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(ToldJob, "ends", {"outcome": "stopped", "reason": "nothing was gripped at pick 0"})
    file = tmp_path / "job.json"
    file.write_text(json.dumps(ORDER))
    done = run(str(file), "--url", url, "--json")
    assert done.exit_code == 4
    assert json.loads(done.stdout)["outcome"] == "stopped"
    assert "job j: stopped: nothing was gripped at pick 0" in done.stderr


def test_a_file_that_is_no_toml_is_refused(tmp_path: Path):
    file = tmp_path / "job.toml"
    file.write_text("picks = [")
    done = run(str(file))
    assert done.exit_code == 1
    assert "is not TOML" in done.stderr

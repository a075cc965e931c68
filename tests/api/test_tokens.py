from __future__ import annotations

import stat
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from click.testing import CliRunner

from api.app import create_app
from api.cli import main
from api.http import TokenRegistry, WrongTokens, create_token, find_token, read_tokens, revoke_token
from api.settings import ServiceSettings
from store import PlanRow, new_id
from tests.api.conftest import NO_ID, REQUEST, ROOT, RunningService, beat_as, running
from tests.api.test_bad_input import problem_of


@pytest.fixture(scope="module")
def tokens(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    file = tmp_path_factory.mktemp("tokens") / "tokens.toml"
    made = {
        name: create_token(file, name, scopes)
        for name, scopes in (("planner", ("plan",)), ("operator", ("operate",)), ("both", ("plan", "operate")))
    }
    return file, made


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory, cells: Path, tokens) -> Iterator[RunningService]:
    url = f"sqlite:///{tmp_path_factory.mktemp('data') / 'fling.db'}"
    settings = ServiceSettings(database_url=url, cells=cells, tokens_file=tokens[0], host="0.0.0.0", planner_workers=1)
    with pytest.MonkeyPatch.context() as patch, running(settings) as service:
        patch.setattr("api.http.wrong_tokens.DELAY_MAX_S", 0.0)  # these tests send many
        yield service


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_the_file_holds_hashes_and_is_its_owner_s(tokens):
    file, made = tokens
    assert not any(token in file.read_text() for token in made.values())
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    stored = read_tokens(file)
    assert find_token(stored, made["both"]).caller.name == "both"
    assert find_token(stored, made["both"] + "x") is None
    with pytest.raises(ValueError, match="already"):
        create_token(file, "both", ("plan",))


@pytest.mark.parametrize(
    "text",
    [
        "nonsense",
        "token = 7",
        "[[token]]\nname = 'x'",
        "[[token]]\nname='x'\nsha256='x'\nscopes=['plan']",
        f"[[token]]\nname='x'\nsha256='{'0' * 64}'\nscopes=['admin']",
        f"[[token]]\nname='x'\nsha256='{'0' * 64}'\nscopes=[{{}}]",
        "token = " + "[" * 5000,
        "token" + ".a" * 100_000 + " = 1",
    ],
)
def test_a_file_that_is_wrong_is_refused(tmp_path: Path, text: str):
    file = tmp_path / "tokens.toml"
    file.write_text(text)
    with pytest.raises(ValueError):
        read_tokens(file)
    with pytest.raises(ValueError):
        read_tokens(tmp_path / "missing.toml")
    with pytest.raises(ValueError, match="is a device"):
        read_tokens(Path("/dev/zero"))


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/plans"),
        ("GET", "/cells"),
        ("GET", "/executions"),
        ("GET", "/metrics"),
        ("POST", "/executions/latest/abort"),
    ],
)
def test_without_a_token_or_with_a_wrong_one(guarded: RunningService, method: str, path: str):
    for value in (None, b"Bearer wrong", "Bearer é".encode(), b"Basic eDp5", b"Bearer", b""):
        headers = {} if value is None else {b"Authorization": value}
        response = guarded.client.request(method, path, headers=headers)
        assert "FLING_TOKEN or --token" in problem_of(response, 401, "unauthenticated")["detail"]
        assert response.headers["www-authenticate"] == "Bearer"


def test_open_to_all(guarded: RunningService):
    for path in ("/healthz", "/openapi.json", "/docs", "/", "/problems/forbidden"):
        assert guarded.client.get(path).status_code == 200


def test_scopes(guarded: RunningService, tokens):
    made = tokens[1]
    problem_of(guarded.client.post("/plan", json=REQUEST, headers=bearer(made["operator"])), 403, "forbidden")
    body = {"plan_id": NO_ID}
    problem_of(guarded.client.post("/execute", json=body, headers=bearer(made["planner"])), 403, "forbidden")
    problem_of(guarded.client.post("/execute", json=body, headers=bearer(made["operator"])), 404, "not-found")
    acknowledge = guarded.client.post("/cells/ur5e-sim/acknowledge", headers=bearer(made["planner"]))
    problem_of(acknowledge, 403, "forbidden")
    assert guarded.client.get("/plans", headers=bearer(made["operator"])).status_code == 200


def test_with_tokens_a_real_arm_may_move_by_the_plan_s_own_id_alone(guarded: RunningService, tokens):
    headers = bearer(tokens[1]["both"])
    plan = guarded.client.post("/plan", json={**REQUEST, "cell": "real"}, headers=headers).json()
    assert "id" in plan, plan
    beat_as(guarded.store, "fake", "real", "ur")
    problem_of(guarded.client.post("/execute", json={"plan_id": "latest"}, headers=headers), 403, "forbidden")
    response = guarded.client.post("/execute", json={"plan_id": plan["id"]}, headers=headers)
    assert response.status_code == 202
    assert response.json()["requested_by"] == "both"
    assert guarded.store.audit_lines(1)[0]["who"] == "both"


def test_a_name_of_any_host_is_fine_with_tokens(guarded: RunningService):
    assert guarded.client.get("/healthz", headers={"Host": "fling.example"}).status_code == 200


def test_a_file_that_names_no_token_opens_nothing(tmp_path: Path, cells: Path):
    file = tmp_path / "tokens.toml"
    for text in ("", "# later\n", "token = []\n"):
        file.write_text(text)
        with pytest.raises(ValueError, match="names no token"):
            TokenRegistry(file)
        with pytest.raises(ValueError, match="names no token"):
            create_app(ServiceSettings(cells=cells, tokens_file=file))


def test_tokens_are_read_again_when_the_file_changes(guarded: RunningService, tokens):
    file = tokens[0]
    before = tokens[0].read_text()
    new = create_token(file, "guest", ("plan",))
    assert guarded.client.get("/plans", headers=bearer(new)).status_code == 200
    revoke_token(file, "guest")
    problem_of(guarded.client.get("/plans", headers=bearer(new)), 401, "unauthenticated")
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert read_tokens(file) == read_tokens(_written(file, before))
    assert guarded.client.get("/plans", headers=bearer(tokens[1]["both"])).status_code == 200
    with pytest.raises(ValueError, match="no token named"):
        revoke_token(file, "guest")


def _written(file: Path, text: str) -> Path:
    file.write_text(text)
    return file


def test_a_file_that_breaks_leaves_the_tokens_of_before(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    file = tmp_path / "tokens.toml"
    token = create_token(file, "a", ("operate",))
    registry = TokenRegistry(file)
    file.write_text("nonsense")
    assert registry.find(token) is not None
    file.unlink()
    assert registry.find(token) is not None
    assert [record.levelname for record in caplog.records] == ["ERROR", "ERROR"]  # once a change
    other = create_token(file, "b", ("operate",))
    assert registry.find(token) is None
    assert registry.find(other) is not None
    file.write_text("")
    assert registry.find(other) is None  # every token was revoked


def test_a_token_expires(guarded: RunningService, tokens):
    ended = datetime.now(UTC) - timedelta(seconds=1)
    old = create_token(tokens[0], "old", ("plan",), ended)
    problem = problem_of(guarded.client.get("/plans", headers=bearer(old)), 401, "unauthenticated")
    assert "expired" in problem["detail"]
    young = create_token(tokens[0], "young", ("plan",), ended + timedelta(hours=1))
    assert guarded.client.get("/plans", headers=bearer(young)).status_code == 200


def queued(service: RunningService) -> str:
    id = new_id()
    service.store.add_plan(PlanRow(id, 1.0, "ur5e-sim", "s", "b", b"{}"))
    return service.store.queue_execution(id, "ur5e-sim").id


@pytest.mark.parametrize("watched", ["execution", "batch"])
def test_a_stream_ends_with_its_token(guarded: RunningService, tokens, watched: str):
    """Nothing that happens after its revocation is sent."""
    token = create_token(tokens[0], f"watcher-{watched}", ("plan",))
    if watched == "execution":
        id = queued(guarded)
        path = f"/executions/{id}/events"
    else:
        id = guarded.store.add_batch(b"", 10, "who", "nobody").id
        path = f"/batches/{id}/events"
    with ThreadPoolExecutor(1) as watcher:
        stream = watcher.submit(guarded.client.get, path, headers=bearer(token))
        time.sleep(0.5)
        revoke_token(tokens[0], f"watcher-{watched}")
        if watched == "execution":
            guarded.store.add_event(id, "telemetry", {"clock_s": 1234.5})
            time.sleep(0.5)
            guarded.store.finish_execution(id, "completed")
        else:
            guarded.store.cancel_batch(id)
        answer = stream.result(60.0)
    assert answer.status_code == 200
    assert "1234.5" not in answer.text
    assert '"finished"' not in answer.text
    problem_of(guarded.client.get(path, headers=bearer(token)), 401, "unauthenticated")


@pytest.mark.parametrize("ends", ["'tomorrow'", "2027-01-01", "2027-01-01T00:00:00"])
def test_an_end_must_be_an_instant(tmp_path: Path, ends: str):
    file = tmp_path / "tokens.toml"
    file.write_text(f"[[token]]\nname='x'\nsha256='{'0' * 64}'\nscopes=['plan']\nexpires_at = {ends}\n")
    with pytest.raises(ValueError, match="'x' expires at no instant"):
        read_tokens(file)


def test_repeated_wrong_tokens_wait_longer_and_are_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr("api.http.wrong_tokens.DELAY_MAX_S", 8.0)  # the service of other tests does not delay
    wrong = WrongTokens()
    assert [wrong.delay_s("10.0.0.1") for _ in range(7)] == [0.0, 0.0, 0.0, 0.25, 0.5, 1.0, 2.0]
    assert max(wrong.delay_s("10.0.0.1") for _ in range(100)) == 8.0
    assert wrong.delay_s("10.0.0.2") == 0.0
    assert "10.0.0.1, number 64 in a row" in caplog.text
    assert len(caplog.records) == 8  # 1, 2, 4, … 64, and the other address's first
    now[0] += 61.0
    assert wrong.delay_s("10.0.0.1") == 0.0
    for i in range(2000):
        wrong.delay_s(f"10.1.{i // 250}.{i % 250}")
    assert len(wrong._seen) == 1000


def test_tokens_on_the_command_line(tmp_path: Path):
    file = str(tmp_path / "tokens.toml")
    run = CliRunner().invoke
    made = run(main, ["token", "create", "--name", "lab", "--scope", "plan", "--days", "2", "--file", file])
    assert made.exit_code == 0, made.output
    assert find_token(read_tokens(Path(file)), made.output.strip()).caller.name == "lab"
    listed = run(main, ["token", "list", "--file", file]).output
    assert listed.startswith("lab: plan; expires 20")
    assert run(main, ["token", "revoke", "lab", "--file", file]).exit_code == 0
    again = run(main, ["token", "revoke", "lab", "--file", file])
    assert (again.exit_code, "no token named 'lab'" in again.output) == (1, True)


@pytest.mark.parametrize(
    ("variable", "value", "sentence"),
    [
        ("FLING_PORT", "abc", "FLING_PORT: must be a whole number; it is 'abc'"),
        ("FLING_PORT", "70000", "FLING_PORT: must be at most 65535; it is '70000'"),
        ("FLING_REQUEST_LOG", "maybe", "FLING_REQUEST_LOG: must be on or off; it is 'maybe'"),
        ("FLING_PLANNER_WORKERS", "0", "FLING_PLANNER_WORKERS: must be at least 1; it is '0'"),
        ("FLING_CELLS", "/nowhere", "FLING_CELLS = '/nowhere': there is no such folder"),
        (
            "FLING_TRUSTED_PROXIES",
            "10.0.0.1, proxy",
            "FLING_TRUSTED_PROXIES: 'proxy' is no address or network",
        ),
        ("FLING_DEFAULT_CELL", "moon", "FLING_DEFAULT_CELL: no cell 'moon' in "),
    ],
)
def test_a_wrong_setting_is_one_sentence(monkeypatch: pytest.MonkeyPatch, variable: str, value: str, sentence: str):
    monkeypatch.setenv(variable, value)
    result = CliRunner().invoke(main, ["serve"])
    assert result.exit_code == 1
    assert f"fling: {sentence}" in result.output
    assert len(result.output.splitlines()) == 1


@pytest.mark.parametrize(
    ("variable", "value", "sentence"),
    [
        ("FLING_TOKENS_FILE", "empty.toml", "names no token"),
        ("FLING_TOKENS_FILE", "absent.toml", "cannot be read"),
        ("FLING_HOST", "0.0.0.0", "can be reached from other machines"),
        ("FLING_DATABASE_URL", "nonsense", "Could not parse"),
    ],
)
def test_a_service_that_cannot_start_says_why_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, variable: str, value: str, sentence: str
):
    (tmp_path / "empty.toml").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FLING_CELLS", str(ROOT / "cells"))
    monkeypatch.setenv("FLING_DATABASE_URL", f"sqlite:///{tmp_path / 'fling.db'}")
    monkeypatch.setenv("FLING_PORT", "0")
    monkeypatch.setenv(variable, value)
    result = CliRunner().invoke(main, ["serve"])
    assert (result.exit_code, len(result.output.splitlines())) == (1, 1), result.output
    assert sentence in result.output

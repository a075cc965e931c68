from __future__ import annotations

import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from api.http import create_token, find_caller, read_tokens
from api.settings import ServiceSettings
from tests.api.conftest import REQUEST, RunningService, running
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
    with running(settings) as service:
        yield service


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_the_file_holds_hashes_and_is_its_owner_s(tokens):
    file, made = tokens
    assert not any(token in file.read_text() for token in made.values())
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    stored = read_tokens(file)
    assert find_caller(stored, made["both"]).name == "both"
    assert find_caller(stored, made["both"] + "x") is None
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
    ],
)
def test_a_file_that_is_wrong_is_refused(tmp_path: Path, text: str):
    file = tmp_path / "tokens.toml"
    file.write_text(text)
    with pytest.raises(ValueError):
        read_tokens(file)
    with pytest.raises(ValueError):
        read_tokens(tmp_path / "missing.toml")


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
        problem_of(response, 401, "unauthenticated")
        assert response.headers["www-authenticate"] == "Bearer"


def test_open_to_all(guarded: RunningService):
    for path in ("/healthz", "/openapi.json", "/docs", "/", "/problems/forbidden"):
        assert guarded.client.get(path).status_code == 200


def test_scopes(guarded: RunningService, tokens):
    made = tokens[1]
    problem_of(guarded.client.post("/plan", json=REQUEST, headers=bearer(made["operator"])), 403, "forbidden")
    body = {"plan_id": "nothing"}
    problem_of(guarded.client.post("/execute", json=body, headers=bearer(made["planner"])), 403, "forbidden")
    problem_of(guarded.client.post("/execute", json=body, headers=bearer(made["operator"])), 404, "not-found")
    acknowledge = guarded.client.post("/cells/ur5e-sim/acknowledge", headers=bearer(made["planner"]))
    problem_of(acknowledge, 403, "forbidden")
    assert guarded.client.get("/plans", headers=bearer(made["operator"])).status_code == 200


def test_with_tokens_a_real_arm_may_move_by_the_plan_s_own_id_alone(guarded: RunningService, tokens):
    headers = bearer(tokens[1]["both"])
    plan = guarded.client.post("/plan", json={**REQUEST, "cell": "real"}, headers=headers).json()
    assert "id" in plan, plan
    guarded.store.record_heartbeat("real", "fake", "ur")
    problem_of(guarded.client.post("/execute", json={"plan_id": "latest"}, headers=headers), 403, "forbidden")
    response = guarded.client.post("/execute", json={"plan_id": plan["id"]}, headers=headers)
    assert response.status_code == 202
    assert response.json()["requested_by"] == "both"
    assert guarded.store.audit_lines(1)[0]["who"] == "both"


def test_a_name_of_any_host_is_fine_with_tokens(guarded: RunningService):
    assert guarded.client.get("/healthz", headers={"Host": "fling.example"}).status_code == 200

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
from click.testing import CliRunner

from api.cli import COMMANDS, main
from tests.api.conftest import JOINT, REQUEST

HEAVY = ("numpy", "pydantic", "fastapi", "sqlalchemy", "httpx2", "orjson", "planner", "store", "learning")


def fling(*arguments: str, **environment: str):
    return CliRunner().invoke(main, arguments, env=environment or None)


@pytest.fixture
def request_file(tmp_path: Path) -> Path:
    file = tmp_path / "request.json"
    file.write_text(json.dumps(REQUEST))
    return file


def test_help_loads_nothing_heavy():
    script = f"""
import sys
from api.cli import main
try:
    main(["--help"])
except SystemExit:
    pass
print([name for name in {HEAVY!r} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself(name: str):
    result = fling(name, "--help")
    assert result.exit_code == 0, result.output
    assert "Usage:" in result.output


def test_an_unknown_command():
    assert fling("frobnicate").exit_code == 64


def test_plan_writes_the_plan(request_file: Path, root: Path):
    result = fling("plan", str(request_file), "--cells", str(root / "cells"))
    assert result.exit_code == 0, result.output
    plan = json.loads(result.stdout)
    assert plan["certificate"]["valid"] is True
    assert plan["cell"] == "ur5e-sim"
    assert "checks passed" in result.stderr


@pytest.mark.parametrize(
    ("change", "name", "status"),
    [
        ({"release": {**JOINT, "velocities": [9.0, 0, 0, 0, 0, 0]}}, "infeasible", 2),
        ({"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "time_limit_s": 1e-9}, "solver-failed", 3),
        ({"frame": "moon"}, "invalid-request", 1),
        ({"cell": "nowhere"}, "invalid-request", 1),
        ({"start": {"current": True}}, "invalid-request", 1),
    ],
)
def test_plan_gives_the_problem_and_its_status(request_file: Path, root: Path, change: dict, name: str, status: int):
    request_file.write_text(json.dumps({**REQUEST, **change}))
    result = fling("plan", str(request_file), "--cells", str(root / "cells"))
    assert result.exit_code == status
    assert json.loads(result.stderr)["type"] == f"/problems/{name}"
    assert result.stdout == ""


@pytest.mark.slow
@pytest.mark.parametrize(("option", "is_json"), [([], False), (["--json"], True)])
def test_plan_gives_the_problem_in_sentences_on_a_terminal(
    request_file: Path, root: Path, option: list[str], is_json: bool
):
    request_file.write_text(json.dumps({**REQUEST, "release": {**JOINT, "velocities": [9.0, 0, 0, 0, 0, 0]}}))
    command = ["plan", str(request_file), "--cells", str(root / "cells"), *option]
    mine, its = os.openpty()
    done = subprocess.run([sys.executable, "-c", "from api.cli import main; main()", *command], stderr=its, check=False)
    os.close(its)
    said = os.read(mine, 65536).decode()
    os.close(mine)
    assert done.returncode == 2
    if is_json:
        assert json.loads(said)["type"] == "/problems/infeasible"
    else:
        assert "joint_velocity: 9 rad/s against a limit of 3 rad/s" in said
        assert "a release near it that works:" in said


def test_plan_refuses_a_file_with_a_key_twice(request_file: Path):
    request_file.write_text('{"release": {"kind": "target", "position": [1.2, 0.3, 0], "position": [1.3, 0.3, 0]}}')
    result = fling("plan", str(request_file))
    assert result.exit_code == 1
    assert json.loads(result.stderr)["detail"] == "position: is given twice"


@pytest.mark.parametrize("content", [b"\xff\xfe{}", b'{"cell": "\xe9"}'])
def test_plan_of_a_file_that_is_not_utf_8_is_one_sentence(request_file: Path, content: bytes):
    request_file.write_bytes(content)
    for result in (fling("plan", str(request_file)), CliRunner().invoke(main, ["plan", "-"], input=content)):
        assert result.exit_code == 1
        assert json.loads(result.stderr)["detail"] == "body: is not UTF-8"
        assert result.stdout == ""


def test_cell_check(root: Path, tmp_path: Path):
    good = fling("cell", "check", str(root / "cells" / "ur5e-sim.toml"))
    assert (good.exit_code, "good" in good.output) == (0, True)
    bad = tmp_path / "bad.toml"
    bad.write_text('robot = "ur5e"\nsurprise = 1\n[link]\nkind = "sim"\n')
    result = fling("cell", "check", str(bad))
    assert result.exit_code == 1
    assert "surprise" in result.output
    assert fling("cell", "check", str(tmp_path / "missing.toml")).exit_code == 1


def test_token_create(tmp_path: Path):
    file = tmp_path / "tokens.toml"
    result = fling("token", "create", "--scope", "plan", "--name", "me", "--file", str(file))
    assert result.exit_code == 0
    assert result.output.strip() not in file.read_text()
    assert fling("token", "create", "--scope", "plan", "--name", "me", "--file", str(file)).exit_code == 1
    assert fling("token", "create", "--scope", "root", "--name", "you", "--file", str(file)).exit_code == 64


def test_db_upgrade(tmp_path: Path):
    empty = f"sqlite:///{tmp_path / 'fling.db'}"  # not the shared service's, which may have been upgraded by then
    assert "from 0" in fling("db", "upgrade", FLING_DATABASE_URL=empty).output
    assert "as before" in fling("db", "upgrade", FLING_DATABASE_URL=empty).output


def test_version():
    assert fling("version").output.startswith("fling ")


def test_no_service_says_how_to_start_one():
    result = fling("throw", "1.2", "-0.3", "0", "--url", "http://127.0.0.1:9")
    assert result.exit_code == 1
    assert "fling up" in result.output


WRONG_FIELDS = '{"release": {"kind": "target", "position": [1.0, 2.0]}, "frob": 1}'


@pytest.mark.slow
@pytest.mark.parametrize("content", ['{"release": ', "[" * 900, '{"a": 1, "a": 2}', "{}", WRONG_FIELDS])
def test_a_slip_in_a_file_is_refused_without_loading_the_service(request_file: Path, content: str):
    request_file.write_text(content)
    script = f"""
import sys
from api.cli import main
try:
    main(["plan", {str(request_file)!r}])
except SystemExit as end:
    assert end.code == 1
print([name for name in ("pydantic", "fastapi", "sqlalchemy", "httpx2", "casadi", "store") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert json.loads(done.stderr)["type"] == "/problems/invalid-request"


def test_plan_has_the_option_json(request_file: Path, root: Path):
    assert "--json" in fling("plan", "--help").output
    good = fling("plan", str(request_file), "--cells", str(root / "cells"), "--json")
    assert json.loads(good.stdout)["certificate"]["valid"] is True
    assert good.stderr == ""
    request_file.write_text("{}")
    refused = json.loads(fling("plan", str(request_file), "--json").stderr)
    assert (refused["type"], refused["exit_status"]) == ("/problems/invalid-request", 1)


def test_cell_check_tells_as_what_a_mesh_is_kept_out(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    entries = [
        f'{{ {name}shape = "mesh", file = "{file}", scale = 0.001, pose = {{ position_m = [1.5, {y}, 0.5] }} }}'
        for name, file, y in (('name = "block", ', "box.stl", 1.5), ("", "open.obj", -1.5))
    ]
    text = (root / "cells" / "ur5e-sim.toml").read_text().replace("keep_out = []", f"keep_out = [{', '.join(entries)}]")
    (tmp_path / "lab.toml").write_text(text)
    (tmp_path / "box.stl").write_bytes(trimesh.creation.box((400.0, 300.0, 200.0)).export(file_type="stl"))
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 300 0 0\nv 0 300 200\nf 1 2 3\n")
    told = fling("cell", "check", str(tmp_path / "lab.toml"))
    assert told.exit_code == 0
    assert re.search(
        r"block: box\.stl, [\d.]+ × [\d.]+ × [\d.]+ m, as a box, at most 10\.4 mm beyond it\n", told.output
    )
    assert re.search(
        r"mesh 1: open\.obj, [^;]+ m, as \d+ boxes, at most [\d.]+ mm beyond it; (.*; )?its surface is not closed",
        told.output,
    )
    document = json.loads(fling("cell", "check", str(tmp_path / "lab.toml"), "--json").output)
    assert len(document["meshes"]) == 2

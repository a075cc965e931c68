"""Who may import whom: the contracts hold, and each of them bites."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOMS = ("planner", "store", "api", "executor", "benchmarks")

# Packages that others enter by `__init__` alone: nothing deeper is imported, nothing outside `__all__`.
FACES = (
    "store",
    "api.cli",
    "api.http",
    "api.planning",
    "api.report",
    "api.routes",
    "api.schemas",
    "benchmarks.audit",
    "benchmarks.peers",
    "benchmarks.problem_sets",
    "benchmarks.report",
    "benchmarks.streaming",
)
FUNCTION_LINES_MAX = 40
MODULE_LINES_MAX = 250

# contract: (file of the copy, the import planted there)
PLANTED = {
    "rooms": ("api/routes/plans.py", "import executor.stream_job"),
    "planner-levels": ("planner/certificate/__init__.py", "import planner.backends.ruckig_otg"),
    "backends-apart": ("planner/backends/ruckig_otg/__init__.py", "import planner.backends.profiles"),
    "planner-pure": ("planner/cell/model.py", "import sqlalchemy"),
    "executor-no-solver": ("executor/stream_job.py", "import planner.planning"),
    "api-no-robot": ("api/routes/plans.py", "import rtde_control"),
    "executor-levels": ("executor/realtime.py", "import executor.settings"),
    "executor-streaming-levels": ("executor/streaming/safety.py", "import executor.streaming.loop"),
    "executor-robot-levels": ("executor/robot/monitor.py", "import executor.robot.session"),
    "executor-records-levels": ("executor/records/journal.py", "import executor.records.metrics"),
    "streaming-alone": ("executor/shared_memory.py", "import numpy"),
    "ur-rtde-in-streaming": ("executor/supervision.py", "import rtde_control"),
    "sql-in-store": ("executor/daemon.py", "import sqlalchemy"),
    "benchmarks-alone": ("planner/planning.py", "import benchmarks.results"),
    "benchmarks-layers": ("benchmarks/problem_sets/task.py", "import benchmarks.suite"),
    "store-layers": ("store/clients.py", "import store.plans"),
    "api-layers": ("api/report/picture.py", "import api.http"),
    "api-routes": ("api/routes/plans.py", "import api.routes.executions"),
    "api-http": ("api/http/errors.py", "import api.http.middleware"),
    "api-planning": ("api/planning/worker.py", "import api.planning.pool"),
    "api-report": ("api/report/picture.py", "import api.report.page"),
    "api-schemas": ("api/schemas/plans.py", "import api.schemas.requests"),
    "api-cli": ("api/cli/client.py", "import api.cli.processes"),
    "simulator-alone": ("executor/daemon.py", "import executor.simulator.interfaces"),
    "simulator-levels": (
        "executor/simulator/interfaces/dashboard_server.py", "import executor.simulator.controller"
    ),
    "simulator-program-levels": (
        "executor/simulator/program/control_program.py", "import executor.simulator.program.runner"
    ),
    "simulator-physics-levels": ("executor/simulator/physics/arm.py", "import executor.simulator.physics.workcell"),
    "simulator-interfaces-levels": (
        "executor/simulator/interfaces/rtde_server.py", "import executor.simulator.interfaces.script_server"
    ),
    "simulator-clock-levels": ("executor/simulator/clock/statistics.py", "import executor.simulator.clock.pacing"),
    "simulator-no-arm-in-interfaces": ("executor/simulator/interfaces/recipes.py", "import executor.simulator.physics"),
    "simulator-no-socket-in-program": ("executor/simulator/program/runner.py", "import socket"),
}  # fmt: skip


def lint(folder: Path, contract: str | None = None) -> subprocess.CompletedProcess[str]:
    """Runs import-linter on the packages in `folder`, not on the installed ones."""
    program = "import sys; sys.path.insert(0, sys.argv.pop(1)); from importlinter.cli import *; lint_imports_command()"
    arguments = ["--config", str(folder / "pyproject.toml"), "--no-cache"]
    arguments += ["--contract", contract] if contract else []
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", program, str(folder), *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    folder = tmp_path_factory.mktemp("copy")
    root = request.config.rootpath
    for room in ROOMS:
        shutil.copytree(root / room, folder / room, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(root / "pyproject.toml", folder)
    return folder


def test_the_contracts_hold(root: Path):
    result = lint(root)
    assert result.returncode == 0, result.stdout


def test_every_contract_is_tried(root: Path):
    contracts = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    assert {contract["id"] for contract in contracts} == set(PLANTED)


@pytest.mark.parametrize("contract", PLANTED)
def test_a_contract_bites(copy: Path, contract: str):
    name, line = PLANTED[contract]
    file = copy / name
    before = file.read_text()
    file.write_text(before + f"\n{line}\n")
    try:
        result = lint(copy, contract)
    finally:
        file.write_text(before)
    assert result.returncode == 1, result.stdout + result.stderr
    assert "BROKEN" in result.stdout


def test_a_module_outside_every_layer_fails(copy: Path, root: Path):
    contracts = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    exhaustive = [contract for contract in contracts if contract.get("exhaustive")]
    strays = [copy / container.replace(".", "/") / "stray.py" for c in exhaustive for container in c["containers"]]
    for stray in strays:
        stray.write_text("")
    try:
        result = lint(copy)
    finally:
        for stray in strays:
            stray.unlink()
    assert result.stdout.count("BROKEN") == len(exhaustive), result.stdout


def module_of(file: Path, root: Path) -> str:
    return ".".join(file.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


def public_names(face: str, root: Path) -> set[str]:
    body = ast.parse((root / face.replace(".", "/") / "__init__.py").read_text()).body
    for node in body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return set(ast.literal_eval(node.value))
    return set()


def test_packages_are_entered_by_their_face(root: Path):
    public = {face: public_names(face, root) for face in FACES}
    assert all(public.values())
    found = []
    for file in sources(root):
        module = module_of(file, root)
        for node in ast.walk(ast.parse(file.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for face in (face for face in FACES if not f"{module}.".startswith(f"{face}.")):
                found += [f"{module}: {name}" for name in names if name.startswith(f"{face}.")]
                if isinstance(node, ast.ImportFrom) and node.module == face:
                    found += [f"{module}: {face}.{a.name}" for a in node.names if a.name not in public[face]]
    assert found == []


def test_the_planner_costs_numpy_alone():
    modules = "planner.cell_folder, planner.problem, planner.trajectory, planner.certificate, planner.plan_document"
    script = f"""
import sys
import {modules}
heavy = ("casadi", "ruckig", "toppra", "scipy", "matplotlib", "pydantic", "sqlalchemy", "fastapi", "rtde_control")
print([name for name in heavy if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def sources(root: Path) -> list[Path]:
    return [file for room in ROOMS for file in sorted((root / room).rglob("*.py"))]


def test_modules_and_functions_stay_short(root: Path):
    long = []
    for file in sources(root):
        text = file.read_text()
        lines = len(text.splitlines())
        if lines > MODULE_LINES_MAX and "# long:" not in text:
            long.append(f"{file.relative_to(root)}: {lines} lines")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or node.lineno) - node.body[0].lineno + 1
                if length > FUNCTION_LINES_MAX and "# long:" not in (ast.get_source_segment(text, node) or ""):
                    long.append(f"{file.relative_to(root)}: {node.name} has {length} lines")
    assert long == []


def test_nothing_catches_everything(root: Path):
    """`except Exception` only where a `finally` stops the robot, in the executor; and then it says so."""
    found = []
    for file in sources(root):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.ExceptHandler):
                kinds = [node.type] if not isinstance(node.type, ast.Tuple) else node.type.elts
                names = {kind.id if isinstance(kind, ast.Name) else "" for kind in kinds if kind is not None}
                if node.type is None or names & {"Exception", "BaseException"}:
                    found.append(f"{file.relative_to(root)}:{node.lineno}")
    assert [place for place in found if not place.startswith("executor/")] == []

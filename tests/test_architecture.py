"""The structure of the project: import contracts hold, and fail when broken; short modules, unique, current names."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tomllib
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOMS = (
    "fling",
    "planner",
    "store",
    "learning",
    "jobs",
    "api",
    "executor",
    "simulator",
    "verifier",
    "audit",
    "benchmarks",
)
FOLDERS = (*ROOMS, "tests", "docs")  # that hold code of this project
# contract: (module of the copy, the module that a forbidden import of it names). One line each.
PLANTED = {
    "rooms": ("api/routes/plans.py", "executor.stream_job"),
    "planner": ("planner/certificate/__init__.py", "planner.backends.ruckig_otg"),
    "back-ends": ("planner/backends/ruckig_otg/__init__.py", "planner.backends.profiles"),
    "certificate": ("planner/backends/profiles.py", "planner.certificate"),
    "verifier": ("verifier/joint_checks.py", "planner.certificate"),
    "audit": ("audit/judge/checks.py", "planner.certificate"),
    "pure": ("planner/cell/model.py", "pydantic"),
    "library": ("fling/planning.py", "store"),
    "executor": ("executor/stream_job.py", "planner.planning"),
    "streaming": ("executor/shared_memory.py", "numpy"),
    "robot-client": ("executor/daemon.py", "rtde_control"),
    "sql": ("executor/daemon.py", "sqlalchemy"),
    "simulator": ("executor/daemon.py", "simulator.interfaces"),
    "benchmarks": ("planner/planning.py", "benchmarks.results"),
    "peers": ("benchmarks/peers/arm.py", "planner.kinematics"),
}

# Packages that other packages enter by `__init__` alone: they import nothing deeper, and nothing outside `__all__`.
FACES = (
    "fling",
    "planner.refusal",
    "planner.search",
    "planner.backends.casadi_nlp",
    "planner.backends.ruckig_otg",
    "planner.backends.toppra_path",
    "planner.approach",
    "planner.timing",
    "planner.certificate",
    "planner.seeds",
    "planner.geometry",
    "planner.kinematics",
    "planner.cell",
    "store",
    "store.many",
    "verifier",
    "audit.judge",
    "audit.problems",
    "learning",
    "jobs.planning",
    "jobs.maps",
    "jobs.pool",
    "jobs.batches",
    "jobs.cycles",
    "api.cli",
    "api.http",
    "api.planning",
    "api.report",
    "api.routes",
    "api.scene",
    "api.schemas",
    "benchmarks.problem_sets",
    "benchmarks.report",
    "benchmarks.streaming",
    "benchmarks.throwbench",
)


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    """Runs import-linter on the packages in `folder`, not on the installed ones."""
    program = "import sys; sys.path.insert(0, sys.argv.pop(1)); from importlinter.cli import *; lint_imports_command()"
    arguments = ["--config", str(folder / "pyproject.toml"), "--no-cache"]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "200"}
    command = [sys.executable, "-c", program, str(folder), *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


def contracts(root: Path) -> list[dict]:
    return tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Path:
    folder = tmp_path_factory.mktemp("copy")
    root = request.config.rootpath
    linter = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["importlinter"]
    for package in linter["root_packages"]:
        shutil.copytree(root / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(root / "pyproject.toml", folder)
    return folder


def test_the_contracts_hold(root: Path):
    result = lint(root)
    assert result.returncode == 0, result.stdout


def test_every_contract_has_a_planted_import(root: Path):
    assert {contract["id"] for contract in contracts(root)} == set(PLANTED)


PLANTS = {"plain": "import {}", "type checking": "if TYPE_CHECKING:\n    import {}"}


@pytest.fixture(scope="module", params=PLANTS)
def findings(copy: Path, request: pytest.FixtureRequest) -> dict[str, str]:
    """What import-linter finds of each contract where all forbidden imports are planted at once."""
    before = {name: (copy / name).read_text() for name, _ in PLANTED.values()}
    planted = defaultdict(str)
    for name, module in PLANTED.values():
        planted[name] += f"{PLANTS[request.param].format(module)}\n"
    for name, lines in planted.items():
        (copy / name).write_text(f"{before[name]}\nfrom typing import TYPE_CHECKING\n{lines}")
    try:
        result = lint(copy)
    finally:
        for name, text in before.items():
            (copy / name).write_text(text)
    assert result.returncode == 1, result.stdout + result.stderr
    details = result.stdout.split("Broken contracts", 1)[1]
    names = {contract["id"]: contract["name"] for contract in contracts(copy)}
    starts = {id: details.find(f"\n{name}\n---") for id, name in names.items()}
    ends = sorted([*starts.values(), len(details)])
    return {id: details[at : ends[ends.index(at) + 1]] for id, at in starts.items() if at >= 0}


@pytest.mark.parametrize("contract", PLANTED)
def test_a_contract_bites(findings: dict[str, str], contract: str):
    name, module = PLANTED[contract]
    importer = ".".join(Path(name).with_suffix("").parts).removesuffix(".__init__")
    assert f"{importer} -> {module}" in findings.get(contract, "kept")


def test_a_module_outside_every_layer_is_found(copy: Path, root: Path):
    """A file planted in every package that has an exhaustive contract, `planner/planted.py` among them."""
    containers = [container for c in contracts(root) if c.get("exhaustive") for container in c["containers"]]
    strays = [copy / container.replace(".", "/") / "planted.py" for container in containers]
    for stray in strays:
        stray.write_text("")
    try:
        result = lint(copy)
    finally:
        for stray in strays:
            stray.unlink()
    assert copy / "planner" / "planted.py" in strays
    assert [c for c in containers if f"- {c}.planted\n" not in result.stdout] == [], result.stdout


def test_the_planner_costs_numpy_alone():
    modules = "planner.cell_folder, planner.problem, planner.trajectory, planner.certificate, planner.answer"
    script = f"""
import sys
import {modules}
heavy = ("casadi", "ruckig", "toppra", "scipy", "matplotlib", "pydantic", "sqlalchemy", "fastapi", "rtde_control")
print([name for name in heavy if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_streaming_process_runs_without_numpy():
    """At run time, beside the contract: what its main module has loaded once it is imported."""
    script = """
import sys
import executor.streaming.__main__
print([name for name in ("numpy", "store", "sqlalchemy", "orjson", "planner.cell") if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def sources(root: Path) -> list[Path]:
    return [file for room in ROOMS for file in sorted((root / room).rglob("*.py"))]


def modules_in(folder: Path) -> list[Path]:
    """The modules and packages of a folder that hold code, its `__init__` left out."""
    packages = [child for child in folder.iterdir() if (child / "__init__.py").is_file()]
    return [file for file in folder.glob("*.py") if file.name != "__init__.py"] + packages


def module_name(file: Path, root: Path) -> str:
    return ".".join(file.relative_to(root).with_suffix("").parts).removesuffix(".__init__")


def public_names(face: str, root: Path) -> set[str]:
    file = root / face.replace(".", "/") / "__init__.py"
    for node in parsed(file).body if file.is_file() else ():
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return set(ast.literal_eval(node.value))
    return set()


@cache
def parsed(file: Path) -> ast.Module:
    """Returns the syntax tree of a file, which nobody changes."""
    return ast.parse(file.read_text())


@cache
def imports(file: Path) -> list[tuple[str, tuple[str, ...]]]:
    """Every imported module of a file, with the names that are taken from it."""
    found: list[tuple[str, tuple[str, ...]]] = []
    for node in ast.walk(parsed(file)):
        if isinstance(node, ast.ImportFrom):
            found.append((node.module or "", tuple(alias.name for alias in node.names)))
        elif isinstance(node, ast.Import):
            found += [(alias.name, ()) for alias in node.names]
    return found


@pytest.mark.parametrize("face", FACES)
def test_a_package_is_entered_by_its_face(root: Path, face: str):
    public = public_names(face, root)
    found = []
    assert public
    for file in sources(root):
        module = module_name(file, root)
        if f"{module}.".startswith(f"{face}."):
            continue
        for imported, names in imports(file):
            if imported.startswith(f"{face}."):
                found.append(f"{module}: {imported}")
            elif imported == face:
                found += [f"{module}: {face}.{name}" for name in names if name not in public]
    assert found == []


def test_a_class_name_is_used_once(root: Path):
    """One class a name in the whole project: a search for it finds one thing.

    The public face is apart: its views have the names that users know.
    """
    places = defaultdict(list)
    for folder in (name for name in FOLDERS if name != "fling"):
        for file in sorted((root / folder).rglob("*.py")):
            for node in parsed(file).body:
                if isinstance(node, ast.ClassDef):
                    places[node.name].append(str(file.relative_to(root)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_nothing_catches_everything(root: Path):
    """`except Exception` only where a `finally` stops the robot, in the executor; and then it says so."""
    found = []
    for file in sources(root):
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.ExceptHandler):
                kinds = [node.type] if not isinstance(node.type, ast.Tuple) else node.type.elts
                names = {kind.id if isinstance(kind, ast.Name) else "" for kind in kinds if kind is not None}
                if node.type is None or names & {"Exception", "BaseException"}:
                    found.append(f"{file.relative_to(root)}:{node.lineno}")
    assert [place for place in found if not place.startswith("executor/")] == []


# source: ur_rtde 1.6.5, what RTDEControlInterface moves the arm with beyond one command; speedJ and servoJ, which the
# watchdog ends, and their stops are what is left
OUTLIVING = {
    "moveJ", "moveJ_IK", "moveL", "moveL_FK", "movePath", "moveUntilContact", "stopJ", "stopL", "speedL", "servoL",
    "servoC", "jogStart", "forceMode", "teachMode", "freedriveMode", "startContactDetection", "contactDetection",
}  # fmt: skip


def test_the_executor_sends_no_motion_that_outlives_it(root: Path):
    found = {
        node.attr
        for file in (root / "executor").rglob("*.py")
        for node in ast.walk(parsed(file))
        if isinstance(node, ast.Attribute)
    }
    assert found & OUTLIVING == set()
    assert {"speedJ", "servoJ", "setWatchdog"} <= found

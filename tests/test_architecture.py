"""The structure of the project: import contracts hold, and fail when broken; short modules, unique, current names."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOMS = ("fling", "planner", "store", "learning", "batch", "api", "executor", "benchmarks")
FOLDERS = (*ROOMS, "tests", "docs")  # that hold code of this project
FUNCTION_LINES_MAX = 40
MODULE_LINES_MAX = 400
FOLDER_MODULES_MAX = 15

# contract: (module of the copy, the module that a forbidden import of it names). One line each; every wing has one.
PLANTED = {
    "rooms": ("api/routes/plans.py", "executor.stream_job"),
    "fling-levels": ("fling/ros.py", "fling.planning"),
    "fling-without-service": ("fling/planning.py", "store"),
    "learning-levels": ("learning/recordings.py", "learning.timing"),
    "learning-without-web": ("learning/recordings.py", "casadi"),
    "planner-levels": ("planner/certificate/__init__.py", "planner.backends.ruckig_otg"),
    "planner-search-levels": ("planner/search/incumbent.py", "planner.search.nearest"),
    "backends-apart": ("planner/backends/ruckig_otg/__init__.py", "planner.backends.profiles"),
    "backends-uncertified": ("planner/backends/profiles.py", "planner.certificate"),
    "planner-casadi-levels": ("planner/backends/casadi_nlp/layout.py", "planner.backends.casadi_nlp.answer"),
    "planner-casadi-symbols-levels": (
        "planner/backends/casadi_nlp/symbols/terms.py",
        "planner.backends.casadi_nlp.symbols.rows",
    ),
    "planner-ruckig-levels": ("planner/backends/ruckig_otg/library.py", "planner.backends.ruckig_otg.motions"),
    "planner-toppra-levels": ("planner/backends/toppra_path/paths.py", "planner.backends.toppra_path.motions"),
    "planner-approach-levels": ("planner/approach/rrt_connect.py", "planner.approach.approach"),
    "planner-timing-levels": ("planner/timing/grid.py", "planner.timing.smoothing"),
    "planner-certificate-levels": ("planner/certificate/joints.py", "planner.certificate.tool"),
    "planner-certificate-flight-levels": (
        "planner/certificate/flight/flights.py",
        "planner.certificate.flight.clearance",
    ),
    "planner-dynamics-levels": ("planner/dynamics/inverse_dynamics.py", "planner.dynamics.safety"),
    "planner-seeds-levels": ("planner/seeds/velocity_allocation.py", "planner.seeds.candidates"),
    "planner-geometry-levels": ("planner/geometry/distances.py", "planner.geometry.body"),
    "planner-kinematics-levels": ("planner/kinematics/singularities.py", "planner.kinematics.inverse_kinematics"),
    "planner-kernel-levels": ("planner/kernel/library.py", "planner.kernel.twin"),
    "planner-calibration-levels": ("planner/calibration/chain.py", "planner.calibration.driver_file"),
    "planner-cell-levels": ("planner/cell/model.py", "planner.cell.file"),
    "planner-pure": ("planner/cell/model.py", "sqlalchemy"),
    "executor-no-solver": ("executor/stream_job.py", "planner.planning"),
    "api-no-robot": ("api/routes/plans.py", "rtde_control"),
    "sql-in-store": ("executor/daemon.py", "sqlalchemy"),
    "simulator-alone": ("executor/daemon.py", "executor.simulator.interfaces"),
    "executor-levels": ("executor/realtime.py", "executor.settings"),
    "executor-streaming-levels": ("executor/streaming/state_checks.py", "executor.streaming.loop"),
    "executor-robot-levels": ("executor/robot/dashboard.py", "executor.robot.session"),
    "executor-records-levels": ("executor/records/journal.py", "executor.records.metrics"),
    "streaming-alone": ("executor/shared_memory.py", "numpy"),
    "ur-rtde-in-streaming": ("executor/supervision.py", "rtde_control"),
    "benchmarks-alone": ("planner/planning.py", "benchmarks.results"),
    "benchmarks-audit": ("benchmarks/audit/distances.py", "benchmarks.audit.checks"),
    "benchmarks-peers": ("benchmarks/peers/sdu_method.py", "benchmarks.peers.drake_spline"),
    "benchmarks-peers-alone": ("benchmarks/peers/arm.py", "planner.kinematics"),
    "benchmarks-throwbench": ("benchmarks/throwbench/judge.py", "benchmarks.throwbench.run"),
    "benchmarks-consistency": ("benchmarks/consistency/loosened.py", "benchmarks.consistency.report"),
    "benchmarks-problem-sets": ("benchmarks/problem_sets/task.py", "benchmarks.problem_sets.named_sets"),
    "benchmarks-report": ("benchmarks/report/pictures.py", "benchmarks.report.page"),
    "benchmarks-streaming": ("benchmarks/streaming/throws.py", "benchmarks.streaming.report"),
    "benchmarks-learning": ("benchmarks/learning/recorded_arms.py", "benchmarks.learning.hidden_timing"),
    "benchmarks-batches": ("benchmarks/batches/problems.py", "benchmarks.batches.runs"),
    "benchmarks-maps": ("benchmarks/maps/runs.py", "benchmarks.maps.truth"),
    "benchmarks-page": ("benchmarks/page/report_browser.py", "benchmarks.page.frames"),
    "benchmarks-layers": ("benchmarks/problem_sets/task.py", "benchmarks.suite"),
    "store-many": ("store/many/maps.py", "store.many.batches"),
    "store-layers": ("store/idempotency_and_audit.py", "store.plans"),
    "api-layers": ("api/report/picture.py", "api.http"),
    "api-routes": ("api/routes/plans.py", "api.routes.executions"),
    "api-http": ("api/http/errors.py", "api.http.middleware"),
    "batch-without-web": ("batch/jobs/odds.py", "fastapi"),
    "batch-maps": ("batch/maps/definition.py", "batch.maps.table"),
    "batch-jobs": ("batch/jobs/aiming.py", "batch.jobs.work"),
    "batch-levels": ("batch/jobs/duration.py", "batch.pool"),
    "batch-runs": ("batch/runs/specification.py", "batch.runs.driver"),
    "batch-pool": ("batch/pool/results.py", "batch.pool.dispatch"),
    "api-planning": ("api/planning/compilation.py", "api.planning.pool"),
    "api-report": ("api/report/picture.py", "api.report.page"),
    "api-scene": ("api/scene/cell_model.py", "api.scene.plan_curves"),
    "api-schemas": ("api/schemas/requests.py", "api.schemas.responses"),
    "api-cli": ("api/cli/support/client.py", "api.cli.throw"),
    "api-cli-support": ("api/cli/support/client.py", "api.cli.support.processes"),
    "simulator-levels": ("executor/simulator/interfaces/dashboard_server.py", "executor.simulator.controller"),
    "simulator-program-levels": ("executor/simulator/program/control_program.py", "executor.simulator.program.runner"),
    "simulator-urscript-levels": ("executor/simulator/urscript/parser.py", "executor.simulator.urscript.interpreter"),
    "simulator-physics-levels": ("executor/simulator/physics/arm.py", "executor.simulator.physics.workcell"),
    "simulator-interfaces-levels": (
        "executor/simulator/interfaces/rtde_server.py",
        "executor.simulator.interfaces.dashboard_server",
    ),
    "simulator-clock-levels": ("executor/simulator/clock/timeline.py", "executor.simulator.clock.pacing"),
    "simulator-no-arm-in-interfaces": ("executor/simulator/interfaces/recipes.py", "executor.simulator.physics"),
    "simulator-no-socket-in-program": ("executor/simulator/program/runner.py", "socket"),
}

# Packages that other packages enter by `__init__` alone: they import nothing deeper, and nothing outside `__all__`.
FACES = (
    "fling",
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
    "learning",
    "batch.jobs",
    "batch.maps",
    "batch.pool",
    "batch.runs",
    "api.cli",
    "api.http",
    "api.planning",
    "api.report",
    "api.routes",
    "api.scene",
    "api.schemas",
    "benchmarks.audit",
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


def test_every_package_has_an_exhaustive_contract(root: Path):
    layered = {container for c in contracts(root) if c.get("exhaustive") for container in c["containers"]}
    packages = {module_name(file, root) for file in sources(root) if file.name == "__init__.py"}
    several = {p for p in packages if len(modules_in(root / p.replace(".", "/"))) > 1}
    assert several - layered == set()


def test_the_planner_costs_numpy_alone():
    modules = "planner.cell_folder, planner.problem, planner.trajectory, planner.certificate, planner.plan_document"
    script = f"""
import sys
import {modules}, planner.plan_reading
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
    for node in ast.parse(file.read_text()).body if file.is_file() else ():
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return set(ast.literal_eval(node.value))
    return set()


def imports(file: Path) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Every imported module of a file, with the names that are taken from it."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            yield node.module or "", tuple(alias.name for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, ()) for alias in node.names)


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


def test_modules_and_functions_stay_short(root: Path):
    """`# long:` and a reason, in the module or the function, excuse one that is longer."""
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


def test_no_folder_is_crowded(root: Path):
    folders = {file.parent for file in sources(root)}
    counts = {str(folder.relative_to(root)): len(list(folder.glob("*.py"))) for folder in folders}
    modules = {folder: n - (root / folder / "__init__.py").is_file() for folder, n in counts.items()}
    assert {folder: n for folder, n in modules.items() if n > FOLDER_MODULES_MAX} == {}


def test_a_class_name_is_used_once(root: Path):
    """One class a name in the whole project: a search for it finds one thing."""
    places = defaultdict(list)
    for folder in FOLDERS:
        for file in sorted((root / folder).rglob("*.py")):
            for node in ast.parse(file.read_text()).body:
                if isinstance(node, ast.ClassDef):
                    places[node.name].append(str(file.relative_to(root)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def retired_names(root: Path) -> dict[str, str]:
    """Patterns and module paths of docs/retired-names.txt, with their replacements."""
    lines = (root / "docs" / "retired-names.txt").read_text().splitlines()
    rows = [line.split("  ", 1) for line in lines if line and not line.startswith("#")]
    return {name: replacement for name, replacement in rows}


def test_no_retired_name_is_left(root: Path):
    names = {re.compile(name): new for name, new in retired_names(root).items() if not name.endswith(".py")}
    lines = [(file, i, line) for file in texts(root) for i, line in enumerate(file.read_text().splitlines(), 1)]
    found = [
        f"{file.relative_to(root)}:{i}: {name.pattern} is now {new}"
        for file, i, line in lines
        for name, new in names.items()
        if name.search(line)
    ]
    assert found == []


def test_no_retired_module_is_left(root: Path):
    modules = {name: new for name, new in retired_names(root).items() if name.endswith(".py")}
    assert [name for name in modules if (root / name).exists()] == []
    found = []
    for file in texts(root):
        text = file.read_text()
        found += [f"{file.relative_to(root)}: {name}" for name in modules if re.search(rf"(?<![\w/]){name}\b", text)]
        for imported, names in imports(file) if file.suffix == ".py" else ():
            public = public_names(imported, root)
            full = {imported, *(f"{imported}.{name}" for name in names if name not in public)}
            paths = {name.replace(".", "/") for name in full if not (root / name.replace(".", "/")).is_dir()}
            found += [f"{file.relative_to(root)}: {path}" for path in paths if f"{path}.py" in modules]
    assert found == []


def texts(root: Path) -> list[Path]:
    """Code, settings and documentation, without the list of retired names, this test and the history."""
    kinds = ("*.py", "*.md", "*.toml")
    files = [file for folder in FOLDERS for kind in kinds for file in sorted((root / folder).rglob(kind))]
    files += [file for kind in kinds for file in sorted(root.glob(kind)) if file.name != "CHANGELOG.md"]
    return [file for file in files if file != Path(__file__)]


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

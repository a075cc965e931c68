"""The wheel holds what runs, and nothing else."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import casadi
from packaging.requirements import Requirement


def test_the_wheel_holds_every_module_and_data_file(wheel: Path, checkout: Path):
    packages = ("fling", "planner", "store", "learning", "jobs", "api", "executor", "simulator", "verifier", "audit")
    kinds = (".py", ".toml", ".html", ".css", ".js", ".svg", ".txt", ".yaml")
    expected = {
        str(file.relative_to(checkout)) for p in packages for file in (checkout / p).rglob("*") if file.suffix in kinds
    }
    held = {
        name for name in zipfile.ZipFile(wheel).namelist() if not name.split("/")[0].endswith((".dist-info", ".data"))
    }
    assert expected - held == set()
    assert {name.split("/")[0] for name in held} == set(packages)


def test_the_wheel_holds_the_compiled_c_for_every_python(wheel: Path):
    """It is linked to casadi's fatrop where casadi is installed beside it, and to nothing of the machine it is from."""
    assert "-cp311-abi3-" in wheel.name
    archive = zipfile.ZipFile(wheel)
    libraries = {name for name in archive.namelist() if name.endswith(".so")}
    assert libraries == {f"planner/native/{name}.abi3.so" for name in ("kernel", "optimiser")}
    optimiser = archive.read("planner/native/optimiser.abi3.so")
    assert b"$ORIGIN/../../casadi\0" in optimiser
    assert str(Path(casadi.__file__).parent).encode() not in optimiser


def test_without_a_compiler_building_from_source_says_so(checkout: Path, tmp_path: Path):
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(checkout)]
    environment = {**os.environ, "PATH": str(tmp_path)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "building Fling from source needs a C compiler" in done.stdout + done.stderr


def test_the_source_archive_holds_what_it_is_built_from(source_archive: Path, checkout: Path):
    packages = ("fling", "planner", "store", "learning", "jobs", "api", "executor", "simulator", "verifier", "audit")
    kinds = (".py", ".toml", ".c", ".h", ".html", ".css", ".js", ".svg", ".txt", ".in")
    folders = [checkout / name for name in ("cells", "requirements", *packages)]
    files = [file for folder in folders for file in folder.rglob("*") if file.suffix in kinds]
    expected = {str(file.relative_to(checkout)) for file in files}
    expected |= {"setup.py", "pyproject.toml", "LICENSE", "README.md"}
    with tarfile.open(source_archive) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    assert expected - held == set()


def test_the_bill_of_materials_names_every_requirement(root: Path):
    """Against a reader of its own: pip's."""
    command = [sys.executable, str(root / "requirements" / "sbom.py")]
    document = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert (document["bomFormat"], document["specVersion"]) == ("CycloneDX", "1.6")
    lines = (root / "requirements" / "run.txt").read_text().replace("\\\n", " ").splitlines()
    pinned = [Requirement(line.partition("--hash")[0]) for line in lines if line.strip()]
    components = document["components"]
    assert [(c["name"], f"=={c['version']}") for c in components] == [(r.name, str(r.specifier)) for r in pinned]
    hashes = [len(c["externalReferences"][0]["hashes"]) for c in components]
    assert hashes == [line.count("--hash=sha256:") for line in lines if line.strip()]
    assert len({c["bom-ref"] for c in components}) == len(components)

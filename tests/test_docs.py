"""Links, commands and paths in the documents exist."""

from __future__ import annotations

import pkgutil
import re
import tokenize
import tomllib
from itertools import pairwise
from pathlib import Path

import pytest
from click import Context

import fling
from api.cli import COMMANDS
from api.cli.serve import executor, serve
from api.cli.simulator import FAULTS as FAULTS_HELP
from api.settings import ServiceSettings
from planner.robots import INCOMPLETE_NAMES, ROBOT_NAMES, missing_numbers, published_number, robot
from simulator.faults import FAULTS

ROOT = Path(__file__).parent.parent
PACKAGES = ("fling", "planner", "api", "store", "learning", "jobs", "executor", "simulator", "benchmarks")
WRITTEN_BY_COMMANDS = {
    "fault-matrix.md",
    "script-mode.md",
    "streaming.md",
    "same-answers.md",
    "operations.md",
    "http.md",
    "maps.md",
    "page.md",
    "arm-capsules.md",
}
NAMES = {file.name for folder in (*PACKAGES, "docs", "tests") for file in (ROOT / folder).rglob("*.*")} | {
    file.name for file in ROOT.glob("*.*")
}
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])


def anchor(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path):
    prose = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(), flags=re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)", prose):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, part = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        assert file.exists(), target
        if part:
            assert part in [anchor(line.lstrip("#")) for line in file.read_text().splitlines() if line.startswith("#")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_that_are_named_exist(page: Path):
    for name in re.findall(r"`(?:\.venv/bin/)?fling ([a-z]+)", page.read_text()):
        assert name in COMMANDS, name


@pytest.mark.parametrize("folder", ["", "docs", *PACKAGES, "tests"], ids=lambda folder: folder or "top")
def test_documents_and_tests_that_are_named_exist(folder: str):
    """In the text of pages, and in the comments and strings of code."""
    files = [f for f in sorted((ROOT / folder).glob("**/*" if folder else "*")) if f.suffix in (".md", ".py")]
    for file in files:
        for name in re.findall(r"(?<![\w*])(?:[\w-]+\.md|test_\w+\.py)\b", _prose(file)):
            assert name in NAMES | WRITTEN_BY_COMMANDS, f"{file}: {name}"


def _prose(file: Path) -> str:
    """The text of a page; of code its comments and strings, docstrings among them."""
    if file.suffix == ".md":
        return file.read_text()
    with file.open("rb") as code:
        kinds = (tokenize.COMMENT, tokenize.STRING)
        return "\n".join(token.string for token in tokenize.tokenize(code.readline) if token.type in kinds)


def test_no_file_names_an_index_or_a_place_on_one_machine():
    for file in [*(ROOT / "requirements").iterdir(), ROOT / "pyproject.toml", ROOT / "Makefile", *PAGES]:
        text = file.read_text()
        assert "--index-url" not in text, file
        assert "--find-links" not in text, file
        assert not re.search(r"(^|[\s\"'(])/(root|work|opt)/", text), file


def test_every_pinned_requirement_has_its_hashes():
    for name in ("run", "dev", "docs", "verify", "bench", "ray"):
        text = (ROOT / "requirements" / f"{name}.txt").read_text()
        for block in re.split(r"\n(?=\S)", text.strip()):
            assert re.match(r"[a-z0-9][a-z0-9.\-\[\]]*==", block), block
            assert "--hash=sha256:" in block, block


def test_the_version_has_its_changelog_section_and_upgrade_notes():
    """What is left of a release is its tag."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    sections = re.findall(r"^## (\S+) - \d{4}-\d\d-\d\d$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert version == sections[0] or ".dev" in version
    minor = [".".join(section.split(".")[:2]) for section in sections]
    notes = re.findall(r"^## From (\S+) to (\S+)$", (ROOT / "docs" / "how-to" / "upgrade.md").read_text(), re.M)
    assert notes == [(before, after) for after, before in pairwise(dict.fromkeys(minor))]


def test_the_reference_of_the_library_has_what_its_face_has():
    text = (ROOT / "docs" / "reference" / "library.md").read_text()
    directive = r"^\.\. auto(module|class|function|exception):: (\S+)\n((?:   :.*\n)*)"
    named = []
    for kind, path, options in re.findall(directive, text, re.M):
        listed = re.search(r":members: (.+)", options)
        if kind != "module":
            named.append(path)
        elif listed is not None and path.rpartition(".")[2] not in fling.__all__:
            named += [f"{path}.{name}" for name in listed[1].split(", ")]
        elif path != "fling":
            named.append(path)
    assert sorted(path.rpartition(".")[2] for path in named) == sorted({*fling.__all__} - {"__version__"})
    for path in named:
        assert pkgutil.resolve_name(path) is getattr(fling, path.rpartition(".")[2]), path


def test_the_help_lists_every_fault_of_the_simulated_controller():
    assert [name for name in FAULTS if not re.search(rf"^(?:\w+, )*{name}\b", FAULTS_HELP, re.M)] == []


def test_the_help_lists_every_setting():
    service = {f"FLING_{name.removesuffix('_days').upper()}" for name in ServiceSettings.model_fields}
    told = {
        name for command in (serve, executor) for name in re.findall(r"FLING_\w+", command.get_help(Context(command)))
    }
    read = set(re.findall(r'"(FLING_\w+)"', (ROOT / "executor" / "settings.py").read_text()))
    assert sorted((service | read) - told) == []


def test_the_table_of_arms_is_what_the_data_say():
    text = (ROOT / "docs" / "cells.md").read_text()
    table = text.partition("## Arms\n")[2].partition("\n## ")[0]
    rows = {}
    for line in table.splitlines():
        if line.startswith("| `"):
            names, *cells = (cell.strip() for cell in line.strip("|").split("|"))
            rows |= {name.strip("`"): cells for name in names.split()}
    assert sorted(rows) == sorted((*ROBOT_NAMES, *INCOMPLETE_NAMES))
    for name, (kinematics, limits, masses, payload, capsules) in rows.items():
        missing = missing_numbers(name)
        for cell, key in ((kinematics, "dh_a_m"), (limits, "joint_velocity_deg_s"), (masses, "link_mass_kg")):
            assert (cell == "**missing**") == (key in missing), (name, key)
        assert (payload == "missing") == (published_number(name, "payload_kg") is None), name
        if name in ROBOT_NAMES:
            assert (capsules == "estimate") == robot(name).shape.is_estimate, name
            assert (capsules == "measured") == (robot(name).shape.of == name), name

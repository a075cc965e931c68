"""Every example of the documentation runs as it stands there, against a running `fling up`."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
DEFAULT_URL = "http://127.0.0.1:8000"
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs" / "tutorial").glob("*.md")),
    *sorted((ROOT / "docs" / "how-to").glob("*.md")),
]
BLOCK = re.compile(r"^( *)```(python|console)\n(.*?)^\1```", re.M | re.S)
STATUS = re.compile(r"# exit status (\d+)")
# Commands of a terminal session that are tested elsewhere, and where.
ELSEWHERE = {
    "make demo": "tests/system, and CI by hand: it is `fling demo`",
    "make test": "CI",
    "make up": "this test runs `fling up`",
}
BUSY = 4  # exit status of a throw that was late: the machine is busy, so it is repeated
TRIES = 4
SMALL_MAP = "--extent 1.0 1.4 0.1 0.5 --resolution 0.2"  # the pages' own have thousands of landing cells


def blocks(page: Path, kind: str) -> list[str]:
    """The examples of one kind, without the indentation of a list."""
    found = [(indent, text) for indent, language, text in BLOCK.findall(page.read_text()) if language == kind]
    return ["\n".join(line.removeprefix(indent) for line in text.splitlines()) for indent, text in found]


def commands(page: Path) -> list[str]:
    """The commands of a page's terminal sessions."""
    text = "\n".join(blocks(page, "console")).replace("\\\n", "")
    return [line[2:].replace(".venv/bin/", "") for line in text.splitlines() if line.startswith("$ ")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_examples_of_a_page(page: Path, place: Path, environment: dict[str, str]):
    for command in commands(page):
        if any(command.startswith(known) for known in ELSEWHERE):
            continue
        run(command, place, environment)
    code = "\n".join(blocks(page, "python"))
    if code:
        done = subprocess.run(
            [sys.executable, "-P", "-c", code], cwd=place, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


def run(command: str, place: Path, environment: dict[str, str]) -> None:
    """Runs a command until it ends as the page says; a throw that was late is repeated."""
    expected = int(found[1]) if (found := STATUS.search(command)) else 0
    shortened = command.replace(DEFAULT_URL, environment["FLING_URL"]).replace("--repeat 10 --load enter", "--repeat 1")
    shortened = re.sub(r"fling map [^#]*", rf"\g<0> {SMALL_MAP} ", shortened)  # the last of two options counts
    for _ in range(TRIES):
        done = subprocess.run(["bash", "-c", shortened], cwd=place, env=environment, capture_output=True, text=True,
                              check=False, stdin=subprocess.DEVNULL)  # fmt: skip
        if done.returncode != BUSY:
            break
        subprocess.run(["fling", "acknowledge"], cwd=place, env=environment, capture_output=True, check=False)
        time.sleep(1.0)
    assert done.returncode == expected, f"{command}\n{done.stdout}{done.stderr}"
    assert '"type":"/problems/' not in done.stdout, f"{command}\n{done.stdout}"


def test_there_are_examples():
    assert sum(len(commands(page)) for page in PAGES) > 15
    assert sum(len(blocks(page, "python")) for page in PAGES) > 6

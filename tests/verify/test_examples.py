"""Every example of the documentation runs as it stands there, against a running `fling up`."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
HOST = "127.0.45.4"
DEFAULT_URL = "http://127.0.0.1:8000"
UP_WITHIN_S = 240.0  # [s] a busy machine
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


def blocks(page: Path, kind: str) -> list[str]:
    """The examples of one kind, without the indentation of a list."""
    found = [(indent, text) for indent, language, text in BLOCK.findall(page.read_text()) if language == kind]
    return ["\n".join(line.removeprefix(indent) for line in text.splitlines()) for indent, text in found]


def commands(page: Path) -> list[str]:
    """The commands of a page's terminal sessions."""
    text = "\n".join(blocks(page, "console")).replace("\\\n", "")
    return [line[2:].replace(".venv/bin/", "") for line in text.splitlines() if line.startswith("$ ")]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as a user's: cells, and what the examples write."""
    folder = tmp_path_factory.mktemp("examples")
    shutil.copytree(ROOT / "cells", folder / "cells")
    cell = folder / "cells" / "ur5e-sim.toml"
    cell.write_text(re.sub(r'host = "127[^"]*"', f'host = "{HOST}"', cell.read_text()))
    (folder / "corners.txt").write_text("1.2 0.3 0.0\n")
    return folder


@pytest.fixture(scope="module")
def environment(place: Path) -> Iterator[dict[str, str]]:
    """The environment of a user beside a running `fling up`."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    found = {
        **os.environ, "FLING_DATABASE_URL": f"sqlite:///{place / 'fling.db'}", "FLING_DATA": str(place),
        "FLING_PLANNER_WORKERS": "1", "FLING_PORT": str(port), "FLING_URL": f"http://127.0.0.1:{port}",
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
    }  # fmt: skip
    log = place / "up.log"
    with log.open("w") as output:
        process = subprocess.Popen(["fling", "up"], cwd=place, env=found, stdout=output, stderr=output)
    try:
        deadline = time.monotonic() + UP_WITHIN_S
        while "Fling is up" not in log.read_text():
            assert process.poll() is None and time.monotonic() < deadline, log.read_text()
            time.sleep(0.2)
        yield found
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60)


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

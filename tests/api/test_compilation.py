"""Compiling beside the service: to its end while nothing is executed, never during an execution."""

from __future__ import annotations

import asyncio
import sys
import time
from pathlib import Path

from api.planning import compile_when_idle

# Stands for a compiler: notes that it began, and a while later that it has ended.
COMPILES = (
    "import sys, time; f = open(sys.argv[1], 'a'); f.write('begun\\n'); f.flush(); time.sleep({}); f.write('done\\n')"
)


def command(notes: Path, seconds: float) -> tuple[str, ...]:
    return sys.executable, "-c", COMPILES.format(seconds), str(notes)


def test_nothing_is_compiled_before_the_execution_ends(tmp_path: Path):
    notes = tmp_path / "notes"
    freed = time.monotonic() + 0.5
    assert asyncio.run(compile_when_idle(lambda: time.monotonic() > freed, command(notes, 0.0)))
    assert notes.read_text() == "begun\ndone\n"
    assert time.monotonic() > freed


def test_an_execution_ends_the_compiler_which_begins_again_after_it(tmp_path: Path):
    notes = tmp_path / "notes"
    begun = time.monotonic()

    def is_idle() -> bool:
        executing = notes.exists() and "begun" in notes.read_text() and time.monotonic() < begun + 1.5
        return not executing

    assert asyncio.run(compile_when_idle(is_idle, command(notes, 0.6)))
    assert notes.read_text() == "begun\nbegun\ndone\n"


def test_a_compiler_that_fails_is_not_tried_again(tmp_path: Path):
    fails = (sys.executable, "-c", "raise SystemExit(1)")
    assert not asyncio.run(compile_when_idle(lambda: True, fails))


def test_the_compiler_ends_with_the_service(tmp_path: Path):
    notes = tmp_path / "notes"

    async def ended() -> None:
        task = asyncio.create_task(compile_when_idle(lambda: True, command(notes, 1.0)))
        while not notes.exists():
            await asyncio.sleep(0.05)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(ended())
    time.sleep(1.2)
    assert "done" not in notes.read_text()

"""A child process: its end, and its freezing."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from executor.supervision import ChildProcess


def sleeping(tmp_path: Path) -> ChildProcess:
    return ChildProcess(["sleep", "60"], (), tmp_path / "log")


def test_a_killed_child_is_known_to_have_been_killed(tmp_path: Path) -> None:
    child = sleeping(tmp_path)
    assert not child.ends_within(0.0)
    assert not child.is_frozen()
    assert child.poll() is None
    child.kill()
    assert child.ends_within(60.0)
    assert child.was_killed
    child.reap()
    assert not child.is_frozen()


def test_a_frozen_child_is_seen_and_can_be_killed(tmp_path: Path) -> None:
    child = sleeping(tmp_path)
    os.kill(child.pid, signal.SIGSTOP)
    while not child.is_frozen():
        pass
    assert not child.ends_within(0.0)
    child.kill()
    child.reap()
    assert child.poll() == -signal.SIGKILL


def test_a_child_that_fails_by_itself_leaves_its_last_line(tmp_path: Path) -> None:
    child = ChildProcess([sys.executable, "-c", "raise SystemExit('it broke')"], (), tmp_path / "log")
    assert child.ends_within(60.0)
    child.reap()
    assert not child.was_killed
    assert child.last_line() == ["it broke"]

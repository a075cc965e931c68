"""Keeping a processor awake: at which priority, where, and for how long at most."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from executor import awake
from tests.executor.simulator.fault_client import wait

CORE = max(os.sched_getaffinity(0))


def wakers() -> list[psutil.Process]:
    """Returns the processes of this one that keep a processor awake."""
    return [c for c in psutil.Process().children() if any("awake.py" in word for word in c.cmdline())]


@pytest.fixture
def virtual(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A virtual machine without a quota, whatever this one is."""
    (tmp_path / "cpuinfo").write_text("flags\t: fpu hypervisor lahf_lm\n")
    monkeypatch.setattr(awake, "PROCESSORS", tmp_path / "cpuinfo")
    monkeypatch.setattr(awake, "QUOTA", tmp_path / "none")


@pytest.mark.usefixtures("virtual")
def test_it_stays_on_its_processor_gives_way_to_everybody_and_ends():
    with awake.kept(CORE):
        (waker,) = wakers()
        assert wait(lambda: os.sched_getscheduler(waker.pid) == os.SCHED_IDLE)
        assert os.sched_getaffinity(waker.pid) == {CORE}
    assert not psutil.pid_exists(waker.pid)


@pytest.mark.usefixtures("virtual")
def test_an_exception_ends_it_too():
    found = []

    def fail() -> None:
        with awake.kept(CORE):
            found.extend(wakers())
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert len(found) == 1
    assert not psutil.pid_exists(found[0].pid)


def test_it_ends_when_its_parent_was_killed():
    code = ("from executor import awake; awake.is_virtual = lambda: True; awake.has_quota = lambda: False\n"
            f"with awake.kept({CORE}):\n  print(flush=True); import time; time.sleep(60)")  # fmt: skip
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert parent.stdout is not None
    parent.stdout.readline()
    (waker,) = psutil.Process(parent.pid).children()
    assert wait(lambda: os.sched_getscheduler(waker.pid) == os.SCHED_IDLE)
    parent.kill()
    parent.communicate()
    assert wait(lambda: not waker.is_running() or waker.status() == psutil.STATUS_ZOMBIE)


@pytest.mark.usefixtures("virtual")
def test_nothing_is_done_without_a_processor_or_with_a_quota(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    with awake.kept(awake.ANY):
        assert not wakers()
    (tmp_path / "cpu.max").write_text("50000 100000\n")
    monkeypatch.setattr(awake, "QUOTA", tmp_path / "cpu.max")
    with awake.kept(CORE):
        assert not wakers()


def test_a_real_machine_is_asked_only_where_that_is_permitted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(awake, "PROCESSORS", tmp_path / "none")
    monkeypatch.setattr(awake, "LATENCY", tmp_path / "cpu_dma_latency")
    with awake.kept(CORE):
        assert not wakers()
    (tmp_path / "cpu_dma_latency").touch()
    assert awake.may_ask()


def test_a_real_machine_is_asked_for_no_latency_and_the_request_is_held(tmp_path: Path):
    latency = tmp_path / "cpu_dma_latency"
    latency.touch()
    code = (f"from pathlib import Path; from executor import awake; awake.LATENCY = Path({str(latency)!r})\n"
            f"awake.is_virtual = lambda: False; awake.stay_awake({CORE}, {os.getpid()})")  # fmt: skip
    asking = subprocess.Popen([sys.executable, "-c", code])
    try:
        assert wait(lambda: latency.read_bytes() == bytes(4))
        held = [Path(os.readlink(entry)) for entry in Path(f"/proc/{asking.pid}/fd").iterdir()]
        assert latency in held
    finally:
        asking.kill()
        asking.wait()

"""Keeping a processor awake, and a thread's use of its time."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from executor import realtime
from tests.processes import children_with
from tests.simulator.fault_client import wait

CORE = max(os.sched_getaffinity(0))


def wakers() -> list[psutil.Process]:
    """Returns the processes of this one that keep a processor awake."""
    return children_with("realtime.py")


ENABLED = Path("/proc/sys/kernel/sched_autogroup_enabled")
HAS_AUTOGROUPS = ENABLED.exists() and ENABLED.read_text().strip() == "1"


@pytest.fixture
def virtual(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A virtual machine without a quota, where real-time priority is permitted, whatever this one is."""
    (tmp_path / "cpuinfo").write_text("flags\t: fpu hypervisor lahf_lm\n")
    monkeypatch.setattr(realtime, "PROCESSORS", tmp_path / "cpuinfo")
    monkeypatch.setattr(realtime, "QUOTA", tmp_path / "none")
    monkeypatch.setattr(realtime, "is_permitted", lambda: True)


@pytest.mark.usefixtures("virtual")
def test_it_stays_on_its_processor_gives_way_to_everybody_and_ends():
    with realtime.keep_awake(CORE):
        (waker,) = wakers()
        assert wait(lambda: os.sched_getscheduler(waker.pid) == os.SCHED_IDLE)
        assert os.sched_getaffinity(waker.pid) == {CORE}
        autogroup = Path(f"/proc/{waker.pid}/autogroup")
        if HAS_AUTOGROUPS and autogroup.read_text():  # empty in a container's own group
            assert wait(lambda: autogroup.read_text().strip().endswith("nice 19"))
    assert not psutil.pid_exists(waker.pid)


@pytest.mark.usefixtures("virtual")
def test_an_exception_ends_it_too():
    found = []

    def fail() -> None:
        with realtime.keep_awake(CORE):
            found.extend(wakers())
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert len(found) == 1
    assert not psutil.pid_exists(found[0].pid)


def test_it_ends_when_its_parent_was_killed():
    code = ("from executor import realtime; realtime.is_virtual = realtime.may_keep_busy = lambda: True\n"
            f"with realtime.keep_awake({CORE}):\n  print(flush=True); import time; time.sleep(60)")  # fmt: skip
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
    with realtime.keep_awake(realtime.ANY_CORE):
        assert not wakers()
    (tmp_path / "cpu.max").write_text("50000 100000\n")
    monkeypatch.setattr(realtime, "QUOTA", tmp_path / "cpu.max")
    with realtime.keep_awake(CORE):
        assert not wakers()


@pytest.mark.usefixtures("virtual")
def test_no_processor_is_kept_busy_beside_a_stream_at_ordinary_priority(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(realtime, "is_permitted", lambda: False)
    with realtime.keep_awake(CORE):
        assert not wakers()


def test_a_real_machine_is_asked_only_where_that_is_permitted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(realtime, "PROCESSORS", tmp_path / "none")
    monkeypatch.setattr(realtime, "LATENCY", tmp_path / "cpu_dma_latency")
    with realtime.keep_awake(CORE):
        assert not wakers()
    (tmp_path / "cpu_dma_latency").touch()
    assert realtime.may_set_latency()


def test_a_real_machine_is_asked_for_no_latency_and_the_request_is_held(tmp_path: Path):
    latency = tmp_path / "cpu_dma_latency"
    latency.touch()
    code = (f"from pathlib import Path; from executor import realtime; realtime.LATENCY = Path({str(latency)!r})\n"
            f"realtime.is_virtual = lambda: False; realtime.stay_awake({CORE}, {os.getpid()})")  # fmt: skip
    asking = subprocess.Popen([sys.executable, "-c", code])
    try:
        assert wait(lambda: latency.read_bytes() == bytes(4))
        held = [Path(os.readlink(entry)) for entry in Path(f"/proc/{asking.pid}/fd").iterdir()]
        assert latency in held
    finally:
        asking.kill()
        asking.wait()


def test_a_sleep_is_counted():
    before = realtime.sleep_count()
    time.sleep(0.001)
    assert realtime.sleep_count() > before


def test_waiting_for_a_processor_is_measured_and_sleeping_is_not():
    delay = realtime.RunDelay()
    before = delay.total_s()
    time.sleep(0.05)
    assert 0.0 <= delay.total_s() - before < 0.05

"""The doctor: can this machine stream, and is the link good? Measures for ten seconds, advises, gives a verdict.

Wake-ups are measured as the stream has them: SCHED_FIFO where permitted, an absolute schedule of one tick. The link is
looked at with receive-only packages of the controller's own rate. Bands: libfranka's 0.95 and 0.90 of ticks in time.
"""

from __future__ import annotations

import os
import platform
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from executor import awake
from executor.monitor import PORT, TIMEOUT_S, Receiver
from executor.settings import PRIORITY
from executor.streaming import realtime
from planner.cell import Cell

DURATION_S = 10.0  # [s] of wake-ups
LINK_S = 5.0  # [s] of packages
LATE_S = 1e-3  # [s] a wake-up later than half an e-Series tick may miss it
GOOD_SHARE, BAD_SHARE = 0.95, 0.90  # [-] of ticks in time; source: libfranka, communication_test (faults.md, 1.1)
STAT = Path("/proc/stat")
STOLEN = 8  # column of a processor's line; source: proc(5)
GAP_MAX_S = 0.020  # [s] a gap after which the stream gives up as late


@dataclass(frozen=True)
class Finding:
    """One thing looked at: `grade` is "ok", "warning" or "bad"."""

    name: str
    grade: str
    text: str
    advice: str = ""


def examine(cell: Cell, duration_s: float = DURATION_S) -> list[Finding]:
    """Returns what was found about this machine and the link to the cell's controller."""
    dt = 1.0 / cell.robot.sample_rate_hz
    before, began = stolen_s(), time.monotonic()
    late = measure_wakeups(dt, duration_s)
    stolen = (stolen_s() - before) / (time.monotonic() - began) / (os.cpu_count() or 1)
    findings = [*_permissions(), _kernel(), judge_sleep(awake.is_virtual(), awake.may_ask(), stolen)]
    return [*findings, judge_jitter(late, dt), _link(cell, min(duration_s, LINK_S))]


def report(cell: Cell, findings: list[Finding]) -> tuple[str, int]:
    """Returns the report and the exit code: 0 fit, 1 fit with warnings, 2 unfit."""
    marks = {"ok": "ok     ", "warning": "warning", "bad": "BAD    "}
    lines = [f"Doctor: {cell.name}, {cell.robot.name} at {cell.link.host}"]
    for finding in findings:
        lines.append(f"  {marks[finding.grade]}  {finding.name}: {finding.text}")
        if finding.advice:
            lines.append(f"           -> {finding.advice}")
    code = max({"ok": 0, "warning": 1, "bad": 2}[finding.grade] for finding in findings)
    verdict = ("fit to stream", "fit for simulation; for a real arm see to the warnings", "unfit to stream")[code]
    return "\n".join([*lines, f"Verdict: {verdict}."]), code


def measure_wakeups(dt: float, duration_s: float) -> list[float]:
    """Returns how late each wake-up of a loop of period `dt` was [s], measured in a process like the stream's."""
    code = ("import sys; from executor.doctor import wake_up; "
            "print(*wake_up(float(sys.argv[1]), float(sys.argv[2])))")  # fmt: skip
    command = [sys.executable, "-c", code, repr(dt), repr(duration_s)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1])
    return [float(word) for word in answer.stdout.split()]


def wake_up(dt: float, duration_s: float) -> list[float]:
    """Returns how late each wake-up was [s]; run in a process of its own, whose scheduling it changes."""
    realtime.prepare(-1, PRIORITY)
    realtime.freeze_memory()
    late = [0.0] * int(duration_s / dt)
    due = time.monotonic()
    for i in range(len(late)):
        due += dt
        rest = due - time.monotonic()
        if rest > 0.0:
            time.sleep(rest)
        late[i] = time.monotonic() - due
    return late


def _permissions() -> list[Finding]:
    refused = subprocess.run(
        [sys.executable, "-c", "from executor.streaming import realtime; print(*realtime.prepare(-1, 50), sep='; ')"],
        capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1],
    ).stdout.strip()  # fmt: skip
    if not refused:
        return [Finding("real time", "ok", "SCHED_FIFO is permitted, memory can be locked")]
    advice = "in /etc/security/limits.conf: '@realtime - rtprio 99' and '@realtime - memlock unlimited', join the group"
    return [Finding("real time", "warning", refused, advice)]


def _kernel() -> Finding:
    text = f"{platform.system()} {platform.release()}, {os.cpu_count()} processors"
    if Path("/sys/kernel/realtime").exists():
        return Finding("kernel", "ok", f"{text}, PREEMPT_RT")
    advice = "a real-time kernel (Debian linux-image-rt-amd64, Ubuntu linux-lowlatency) keeps the worst case short"
    return Finding("kernel", "warning", f"{text}, not a real-time kernel", advice)


def stolen_s() -> float:
    """Returns how long processors of this virtual machine were ready to run while its host ran something else [s]."""
    try:
        total = STAT.read_text().splitlines()[0].split()
        return int(total[STOLEN]) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError, ValueError):
        return 0.0


def judge_sleep(is_virtual: bool, may_ask: bool, stolen: float) -> Finding:
    """Returns the finding about processors that sleep; `stolen` is the share of them that a host has taken."""
    if is_virtual:
        text = f"a virtual machine; its host took {stolen:.1%} of the processors' time meanwhile"
        return Finding("processors", "warning", text, "stream to a real arm from a machine of its own")
    if may_ask:
        return Finding("processors", "ok", "they are asked to stay awake while it streams")
    advice = 'a udev rule: KERNEL=="cpu_dma_latency", GROUP="realtime", MODE="0660"'
    return Finding("processors", "warning", f"idle, they may sleep deeply: {awake.LATENCY} is not permitted", advice)


def judge_jitter(late: list[float], dt: float) -> Finding:
    """Returns the finding about wake-ups `late` [s] of a loop of period `dt` [s]."""
    ordered = sorted(late)
    share = sum(x < min(LATE_S, dt / 2.0) for x in late) / len(late)
    p50, p99, most = (ordered[min(len(late) - 1, int(p * len(late)))] * 1e6 for p in (0.5, 0.99, 1.0))
    text = f"wake-ups late by {p50:.0f} us (p50), {p99:.0f} us (p99), {most:.0f} us (max); {share:.2%} in time"
    advice = "end what else runs here, wire the network, set the performance governor"
    if share < BAD_SHARE or most > 2.0 * GAP_MAX_S * 1e6:
        return Finding("jitter", "bad", text, advice)
    if share < GOOD_SHARE or most > GAP_MAX_S * 1e6:
        return Finding("jitter", "warning", text, advice)
    return Finding("jitter", "ok", text)


def _link(cell: Cell, duration_s: float) -> Finding:
    advice = "is the controller on, the address right, and nothing between the two but one cable?"
    try:
        with socket.create_connection((cell.link.host, PORT), TIMEOUT_S) as connection:
            stamps = Receiver(connection, cell.robot.sample_rate_hz).stamps(duration_s)
    except (OSError, ValueError) as error:
        return Finding("link", "bad", f"{cell.link.host}: {error}", advice)
    dt = 1.0 / cell.robot.sample_rate_hz
    lost = sum(round((b - a) / dt) - 1 for (_, a), (_, b) in pairwise(stamps))
    gap = max(b - a for (a, _), (b, _) in pairwise(stamps))
    share = 1.0 - lost / max(len(stamps) + lost, 1)
    mean = (stamps[-1][0] - stamps[0][0]) / (len(stamps) - 1)
    text = f"{len(stamps)} packages, period {mean * 1e3:.3f} ms, longest gap {gap * 1e3:.1f} ms, {lost} lost"
    grade = "ok" if share >= GOOD_SHARE and gap <= GAP_MAX_S else "warning" if share >= BAD_SHARE else "bad"
    return Finding("link", grade, text, "" if grade == "ok" else advice)

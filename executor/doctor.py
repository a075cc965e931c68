"""The doctor: measures whether this machine can stream and whether the link is good, and advises.

Wake-ups are measured under the stream's conditions: SCHED_FIFO where permitted, an absolute schedule of one tick. The
link is measured with receive-only packages at the controller's rate.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from executor import realtime
from executor.preflight import (
    KINEMATICS_M,
    difference_from,
    gripper_is_open,
    kinematics_refusals,
    serial_refusals,
    state_refusals,
    told_models,
)
from executor.robot import FoundRobot, KinematicsInfo, RobotState, receive_timestamps
from learning import cell_in_use, pooled_document, timing_runs
from planner.cell import Cell
from store import Store, StoreError, StoreUnavailable

DURATION_S = 10.0  # [s] of wake-ups
LINK_S = 5.0  # [s] of packages
LATE_S = 1e-3  # [s] a wake-up later than half an e-Series tick may miss it
GOOD_SHARE = 0.95
BAD_SHARE = 0.90  # [-] of ticks in time; source: libfranka's communication_test
GAP_MAX_S = 0.020  # [s] a gap after which the stream gives up as late
GAP_WARNING_S = GAP_MAX_S / 2.0  # [s] half of it: ten seconds have not seen the longest
STAT = Path("/proc/stat")
STOLEN = 8  # column of a processor's line; source: proc(5)
ROOT = Path(__file__).parents[1]
START_IT = "fling sim --cell {0} starts it, fling up --cell {0} all there is"
SIMULATED_LATE = "end other programs: the simulated controller is late, not a cable"
CHECK_LINK = "check that the controller is on, that its address is right, and that one cable connects it directly"
MARKS = {"ok": "ok     ", "warning": "warning", "bad": "BAD    "}
CODES = {"ok": 0, "warning": 1, "bad": 2}
VERDICTS = (
    "ready to stream",
    "ready for simulation; resolve the warnings before using a real arm",
    "cannot stream",
)


@dataclass(frozen=True)
class DoctorFinding:
    """Result of one check: `grade` is "ok", "warning" or "bad"."""

    name: str
    grade: str
    text: str
    advice: str = ""


def examine(cell: Cell, found: FoundRobot) -> list[DoctorFinding]:
    """Returns the findings about the robot that was found, the link to it and this machine, in this order."""
    dt = 1.0 / cell.robot.sample_rate_hz
    before = stolen_s()
    began = time.monotonic()
    late = measure_wakeups(dt, DURATION_S)
    stolen = (stolen_s() - before) / (time.monotonic() - began) / (os.cpu_count() or 1)
    sleep = grade_sleep(realtime.is_virtual(), realtime.may_set_latency(), stolen)
    machine = [_permissions(), _kernel(), sleep, grade_jitter(late, dt)]
    if not found.is_there:  # what it would tell is missing for this reason alone
        return [_absent(cell), *machine]
    return [_link(cell), *_robot(cell, found), *machine]


def report(cell: Cell, found: FoundRobot, findings: list[DoctorFinding]) -> tuple[str, int]:
    """Returns the report and the exit code: 0 fit, 1 fit with warnings, 2 unfit.

    It begins with what was found, what is missing and the next step.
    """
    lines = [f"Doctor: {cell.name}, {cell.robot.name} at {cell.link.host}", f"Found: {found_words(cell, found)}"]
    worst_first = sorted(findings, key=lambda finding: -CODES[finding.grade])
    missing = [finding for finding in worst_first if finding.grade != "ok"]
    lines.append(f"Missing or wrong: {', '.join(finding.name for finding in missing) or 'nothing'}")
    step = next((finding.advice for finding in missing if finding.advice), None)
    lines += [f"Next: {step or f'fling throw X Y Z --cell {cell.name} --dry-run: all of a throw but its motion'}", ""]
    for finding in findings:
        lines.append(f"  {MARKS[finding.grade]}  {finding.name}: {finding.text}")
        if finding.advice:
            lines.append(f"           -> {finding.advice}")
    code = max(CODES[finding.grade] for finding in findings)
    return "\n".join([*lines, f"Verdict: {VERDICTS[code]}."]), code


def report_document(cell: Cell, found: FoundRobot, findings: list[DoctorFinding]) -> dict[str, Any]:
    """Returns the report as JSON."""
    code = max(CODES[finding.grade] for finding in findings)
    head = {"cell": cell.name, "robot": cell.robot.name, "host": cell.link.host, "found": found_words(cell, found)}
    return {
        **head,
        "findings": [asdict(finding) for finding in findings],
        "verdict": VERDICTS[code],
        "exit_status": code,
    }


def found_words(cell: Cell, found: FoundRobot) -> str:
    """Returns which arm, serial number, PolyScope and gripper were found, in words."""
    if not found.is_there:
        return f"nothing answers at {cell.link.host}"
    models = () if found.kinematics is None else told_models(cell, found.kinematics)
    arm = f"a {' or '.join(models)}" if models else "an arm of which nothing is known"
    serial = "no serial number" if found.serial is None else f"serial number {found.serial}"
    software = "an unknown PolyScope" if found.polyscope is None else f"PolyScope {found.polyscope}"
    return f"{arm}, {serial}, {software}; {_gripper_words(cell, found.state)}"


def _gripper_words(cell: Cell, state: RobotState | None) -> str:
    if cell.gripper.link is not None:  # its state is not among the controller's
        return f"gripper of the kind {cell.gripper.kind}"
    opens = f"gripper on {cell.gripper.output} {cell.gripper.index}"
    if state is None:
        return opens
    return f"{opens}, {'open' if gripper_is_open(cell, state) else 'closed'}"


def measure_wakeups(dt: float, duration_s: float) -> list[float]:
    """Returns the lateness of each wake-up of a loop of period `dt` [s], in a process like the stream's."""
    code = "import sys; from executor.doctor import wake_up; print(*wake_up(*map(float, sys.argv[1:])))"
    return [float(word) for word in _run_python(code, repr(dt), repr(duration_s)).split()]


def wake_up(dt: float, duration_s: float) -> list[float]:
    """Returns the lateness of each wake-up [s]; changes the scheduling of its process."""
    realtime.prepare_stream(realtime.ANY_CORE, realtime.STREAM_PRIORITY)
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


def stolen_s() -> float:
    """Returns the time that the host of a virtual machine has taken from its processors [s]; 0 where unknown."""
    try:
        total = STAT.read_text().splitlines()[0].split()
        return int(total[STOLEN]) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError, ValueError):
        return 0.0


def grade_sleep(is_virtual: bool, may_set_latency: bool, stolen: float) -> DoctorFinding:
    """Returns the finding about sleeping processors; `stolen` is the share taken by a virtual machine's host [-]."""
    if is_virtual:
        text = f"a virtual machine; its host took {stolen:.1%} of the processors' time meanwhile"
        return DoctorFinding("processors", "warning", text, "stream to a real arm from a physical machine")
    if may_set_latency:
        return DoctorFinding("processors", "ok", "kept awake during an execution")
    advice = 'a udev rule: KERNEL=="cpu_dma_latency", GROUP="realtime", MODE="0660"'
    text = f"idle processors may sleep deeply: no permission to write {realtime.LATENCY}"
    return DoctorFinding("processors", "warning", text, advice)


def grade_jitter(late: list[float], dt: float) -> DoctorFinding:
    """Returns the finding about the lateness of wake-ups [s] of a loop of period `dt` [s]."""
    ordered = sorted(late)
    share = sum(x < min(LATE_S, dt / 2.0) for x in late) / len(late)
    p50, p99, most = (ordered[min(len(late) - 1, int(p * len(late)))] * 1e6 for p in (0.5, 0.99, 1.0))
    text = f"wake-ups late by {p50:.0f} us (p50), {p99:.0f} us (p99), {most:.0f} us (max); {share:.2%} in time"
    advice = "end other programs, use a wired network, set the performance governor"
    if share < BAD_SHARE or most > 2.0 * GAP_MAX_S * 1e6:
        return DoctorFinding("jitter", "bad", text, advice)
    if share < GOOD_SHARE or most > GAP_WARNING_S * 1e6:
        return DoctorFinding("jitter", "warning", text, advice)
    return DoctorFinding("jitter", "ok", text)


def known_timing(cell: Cell, database_url: str) -> dict[str, Any] | None:
    """Returns the timing of the arm pooled over the cell's executions, beside the lag that plans assume.

    None without any executions, or without a store. `profile` is the id of the profile that the cell uses.
    """
    try:
        store = Store.open(database_url)
    except StoreError:
        return None
    try:
        used, profile = cell_in_use(store, cell)
        pooled = pooled_document([timing for _, timing in timing_runs(store, cell)], used.timing.lag_s)
        return None if pooled is None else {**pooled, "profile": profile}
    except StoreUnavailable:
        return None
    finally:
        store.close()


def grade_lag(cell: Cell, pooled: dict[str, Any] | None) -> DoctorFinding:
    """Returns the finding about the arm's lag, from its timing as `known_timing` returns it."""
    if pooled is None:
        advice = f"fling calibrate lag --cell {cell.name}"
        return DoctorFinding("lag", "warning", "not measured yet: no execution of this cell shows it", advice)
    text = f"{1e3 * pooled['lag_s']:.1f} ± {1e3 * pooled['lag_std_s']:.1f} ms over {pooled['runs']} runs"
    if pooled["advice"] is None:
        return DoctorFinding("lag", "ok", f"{text}, as in {'the profile' if pooled['profile'] else 'the cell file'}")
    return DoctorFinding("lag", "warning", text, pooled["advice"])


def _permissions() -> DoctorFinding:
    refused = _run_python("from executor import realtime; print(*realtime.prepare_stream(-1, 50), sep='; ')").strip()
    if not refused:
        return DoctorFinding("real time", "ok", "SCHED_FIFO is permitted, memory can be locked")
    advice = "in /etc/security/limits.conf: '@realtime - rtprio 99' and '@realtime - memlock unlimited', join the group"
    return DoctorFinding("real time", "warning", refused, advice)


def _kernel() -> DoctorFinding:
    text = f"{platform.system()} {platform.release()}, {os.cpu_count()} processors"
    if Path("/sys/kernel/realtime").exists():
        return DoctorFinding("kernel", "ok", f"{text}, PREEMPT_RT")
    advice = "a real-time kernel (Debian linux-image-rt-amd64, Ubuntu linux-lowlatency) shortens the longest delays"
    return DoctorFinding("kernel", "warning", f"{text}, not a real-time kernel", advice)


def _absent(cell: Cell) -> DoctorFinding:
    """Returns the finding about a controller that does not answer at all."""
    text = f"no controller answers at {cell.link.host}"
    return DoctorFinding("link", "bad", text, START_IT.format(cell.name) if cell.link.kind == "sim" else CHECK_LINK)


def _link(cell: Cell) -> DoctorFinding:
    try:
        stamps = receive_timestamps(cell.link.host, cell.robot.sample_rate_hz, LINK_S)
    except (OSError, ValueError) as error:
        return DoctorFinding("link", "bad", f"{cell.link.host}: {error}", CHECK_LINK)
    dt = 1.0 / cell.robot.sample_rate_hz
    lost = sum(round((b - a) / dt) - 1 for (_, a), (_, b) in pairwise(stamps))
    gap = max(b - a for (a, _), (b, _) in pairwise(stamps))
    share = 1.0 - lost / max(len(stamps) + lost, 1)
    mean = (stamps[-1][0] - stamps[0][0]) / (len(stamps) - 1)
    text = f"{len(stamps)} packages, period {mean * 1e3:.3f} ms, longest gap {gap * 1e3:.1f} ms, {lost} lost"
    grade = "ok" if share >= GOOD_SHARE and gap <= GAP_MAX_S else "warning" if share >= BAD_SHARE else "bad"
    advice = SIMULATED_LATE if cell.link.kind == "sim" else CHECK_LINK
    return DoctorFinding("link", grade, text, "" if grade == "ok" else advice)


def _robot(cell: Cell, found: FoundRobot) -> list[DoctorFinding]:
    """Returns the findings about the robot: which one it is, whether its arm is the cell's, and whether it may move."""
    findings = [grade_operation(found), grade_serial(cell, found.serial), grade_kinematics(cell, found.kinematics)]
    return findings if found.state is None else [*findings, grade_state(cell, found.state)]


def grade_operation(found: FoundRobot) -> DoctorFinding:
    """Returns the finding about the interface that powers the arm and tells who controls it."""
    name = "operation"
    if found.control is None:
        text = "neither dashboard nor Robot API answers: power, brakes and protective stops are left to the pendant"
        advice = "enable the dashboard on the pendant under Settings, Security, Services (PolyScope X has none)"
        return DoctorFinding(name, "warning", text, advice)
    text = f"by the {found.interface}"
    if found.control == "local":
        return DoctorFinding(name, "warning", f"{text}; the robot is in local control", "switch it on the pendant")
    return DoctorFinding(name, "ok", f"{text}; remote control" if found.control == "remote" else text)


def grade_state(cell: Cell, state: RobotState) -> DoctorFinding:
    """Returns the finding about what the robot's state keeps from moving."""
    if reasons := state_refusals(cell, state):
        return DoctorFinding("state", "warning", "; ".join(reasons), "set the robot up on its pendant, then ask again")
    return DoctorFinding("state", "ok", "the arm is at rest, and set up as in the cell file")


def grade_serial(cell: Cell, serial: str | None) -> DoctorFinding:
    """Returns the finding about the robot's serial number; None where its controller does not tell it."""
    name = "serial number"
    if reasons := serial_refusals(cell, serial):
        return DoctorFinding(name, "bad", reasons[0], "check the address in the cell file, and the cable")
    if serial is None:
        return DoctorFinding(name, "warning", "the controller does not tell it: another robot may be at its address")
    if cell.link.serial is None:
        return DoctorFinding(name, "ok", f'{serial}; serial = "{serial}" in [link] refuses any other robot')
    return DoctorFinding(name, "ok", f"{serial}, as in the cell file")


def grade_kinematics(cell: Cell, info: KinematicsInfo | None) -> DoctorFinding:
    """Returns the finding about the kinematics that the controller reports: the cell's, or another arm's."""
    name = "kinematics"
    advice = "fling cell kinematics --from-robot reads the controller's own"
    if reasons := kinematics_refusals(cell, info):
        wrong = info is not None and cell.robot.name not in told_models(cell, info)
        return DoctorFinding(name, "bad", reasons[0], "check `robot` and `host` in the cell file" if wrong else advice)
    if cell.calibration is not None:
        return DoctorFinding(name, "ok", f"{cell.calibration.name} belongs to this arm")
    apart = None if info is None else difference_from(cell, info)
    if apart is None or apart.largest_m <= KINEMATICS_M:
        return DoctorFinding(name, "ok", f"the arm is a {cell.robot.name} as published")
    text = f"no calibration in the cell file: this arm is off by {apart.words()}"
    return DoctorFinding(name, "warning", text, advice)


def _run_python(code: str, *arguments: str) -> str:
    """Returns the output of a fresh process; real-time scheduling must not stay with this one."""
    command = [sys.executable, "-P", "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT).stdout

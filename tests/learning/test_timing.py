"""Timing from recordings of an arm that is simulated here, independently of the estimator's own response."""

from __future__ import annotations

import csv
import io
import math

import numpy as np
import pytest

from benchmarks.learning.recorded_arms import RecordedArm
from learning import MotionRecording, RecordingError, estimate_timing, recording_from_csv
from learning.recordings import COLUMNS

WITHIN_S = 0.001  # [s] what a single run must give: the first figure


def hidden_arm(rng: np.random.Generator, **known: float) -> RecordedArm:
    lag = rng.uniform(0.005, 0.060)
    first_order = min(rng.uniform(0.0, 0.010), lag)
    return RecordedArm(lag, first_order, rng.uniform(0.96, 1.04, 6), **known)


@pytest.mark.parametrize(("rate_hz", "noise", "correlated"), [(500, 5e-4, 0.0), (125, 5e-3, 0.01)])
def test_lag_and_gains_of_hidden_arms(rate_hz: float, noise: float, correlated: float) -> None:
    rng = np.random.default_rng(20261122)
    scores = []
    for _ in range(6):
        arm = hidden_arm(rng, noise=noise, correlated=correlated)
        found = estimate_timing(arm.run(rng, rate_hz), ramp_rad_s2=math.inf)
        assert found.lag_s == pytest.approx(arm.lag_s, abs=WITHIN_S)
        gains = [(joint.gain - gain) / joint.gain_std for joint, gain in zip(found.joints, arm.gain, strict=True)]
        scores += [(found.lag_s - arm.lag_s) / found.lag_std_s, *gains]
    assert 0.4 < np.sqrt(np.mean(np.square(scores))) < 2.0  # the standard errors are the errors' size


def test_a_first_order_part_is_told_from_a_delay() -> None:
    rng = np.random.default_rng(3)
    found = estimate_timing(RecordedArm(0.030, 0.008).run(rng, 500.0), ramp_rad_s2=math.inf)
    assert found.lag_s == pytest.approx(0.030, abs=2e-4)
    assert [joint.first_order_s for joint in found.joints] == pytest.approx([0.008] * 6, abs=0.002)


def test_a_ramp_that_holds_the_arm_back_is_found_and_does_not_pass_for_a_lag() -> None:
    rng = np.random.default_rng(5)
    found = estimate_timing(RecordedArm(0.020, 0.002, ramp=6.0, noise=5e-3).run(rng, 125.0))
    assert found.ramp_rad_s2 == pytest.approx(6.0, rel=0.02)
    assert found.lag_s == pytest.approx(0.020, abs=5e-4)


def test_not_knowing_the_ramp_is_in_the_lags_standard_error() -> None:
    run = RecordedArm(0.020, 0.002, ramp=6.0, noise=5e-3).run(np.random.default_rng(8), 125.0)
    looked_for = estimate_timing(run)
    announced = estimate_timing(run, ramp_rad_s2=6.0)
    assert looked_for.ramp_rad_s2 == pytest.approx(6.0, rel=0.02)
    assert 1.2 * announced.lag_std_s < looked_for.lag_std_s < 10.0 * announced.lag_std_s
    assert abs(looked_for.lag_s - 0.020) < 3.5 * looked_for.lag_std_s


def test_no_ramp_is_made_up() -> None:
    rng = np.random.default_rng(6)
    assert estimate_timing(RecordedArm(0.020, 0.008, noise=5e-3).run(rng, 125.0)).ramp_rad_s2 is None


def test_an_overshoot_is_seen_only_where_there_is_one() -> None:
    rng = np.random.default_rng(7)
    calm = RecordedArm(0.020, 0.002, noise=2e-3).run(rng, 500.0)
    speed = np.abs(calm.measured[:, 0])
    peak = calm.time_s[np.argmax(speed)]
    kick = 0.04 * speed.max() * np.where((calm.time_s > peak) & (calm.time_s < peak + 0.05), 1.0, 0.0)
    measured = calm.measured.copy()
    measured[:, 0] += np.sign(measured[np.argmax(speed), 0]) * kick
    found = estimate_timing(MotionRecording(calm.time_s, calm.command, measured), ramp_rad_s2=math.inf)
    assert found.joints[0].overshoot == pytest.approx(0.03, abs=0.015)
    assert found.lag_s == pytest.approx(0.020, abs=WITHIN_S)
    assert sum(joint.overshoot is not None for joint in found.joints[1:]) <= 2  # of five, at two standard errors


def test_lost_rows_and_joints_at_rest() -> None:
    rng = np.random.default_rng(8)
    whole = RecordedArm(0.025, 0.002, noise=2e-3).run(rng, 125.0)
    kept = np.delete(np.arange(len(whole.time_s)), [40, 41, 42, 70])
    command = whole.command[kept].copy()
    measured = whole.measured[kept].copy()
    command[:, 5] = 0.0
    measured[:, 5] = rng.normal(0.0, 2e-3, len(kept))
    found = estimate_timing(MotionRecording(whole.time_s[kept], command, measured), ramp_rad_s2=math.inf)
    assert found.lag_s == pytest.approx(0.025, abs=2 * WITHIN_S)
    assert found.joints[5].lag_s is None
    assert found.joints[5].gain == pytest.approx(1.0, abs=found.joints[5].gain_std)


def as_csv(recording: MotionRecording) -> str:
    text = io.StringIO()
    rows = csv.writer(text)
    rows.writerow(COLUMNS)
    rows.writerows(np.column_stack([recording.time_s, recording.command, recording.measured]).tolist())
    return text.getvalue()


def test_a_csv_reads_back() -> None:
    recording = RecordedArm(0.02).run(np.random.default_rng(9), 125.0)
    read = recording_from_csv(as_csv(recording))
    assert np.array_equal(read.command, recording.command)
    assert np.array_equal(read.measured, recording.measured)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("measured_3", "speed_3"), "measured_3"),
        (lambda text: text.replace("\n", "\nx", 2), "line 2"),
        (lambda text: "\n".join(text.splitlines()[:10]), "9 rows"),
        (lambda text: "\n".join([*text.splitlines(), text.splitlines()[1]]), "does not increase"),
        (lambda text: text.replace("0.0,", "nan,"), "finite"),
        (lambda text: text.replace("measured_3", "measured_2"), "more than one column measured_2"),
        (lambda text: text.replace(text.splitlines()[3], "9" * 200_000), "is not CSV: field larger"),
        (lambda text: text.replace(text.splitlines()[3], "9" * 100_000), "line 4: "),
        (lambda text: scaled(text, 1e-9), "apart, not 0.0005 to 0.1 s"),
        (lambda text: scaled(text, 1000.0), "apart, not 0.0005 to 0.1 s"),
        (lambda text: scaled(text, 1.0, 1e6), "ticks of 0.008 s; there may be 10000"),
        (lambda text: text.replace(text.splitlines()[3], ",".join(["0.016", *["1e5"] * 12])), "no joint is faster"),
    ],
)
def test_a_csv_that_cannot_be_used_is_refused_with_the_reason(change, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        recording_from_csv(change(as_csv(RecordedArm(0.02).run(np.random.default_rng(9), 125.0))))


def scaled(text: str, factor: float, gap: float = 0.0) -> str:
    """Returns a recording with its times [s] multiplied, and the second half later by `gap`."""
    header, *rows = text.splitlines()
    cells = [row.split(",") for row in rows]
    late = [gap if i > len(rows) // 2 else 0.0 for i in range(len(rows))]
    times = [float(row[0]) * factor + more for row, more in zip(cells, late, strict=True)]
    return "\n".join([header, *(",".join([repr(t), *row[1:]]) for t, row in zip(times, cells, strict=True))])


def test_commands_that_never_change_show_no_lag() -> None:
    t = np.arange(100) * 0.008
    with pytest.raises(RecordingError, match="no command changes"):
        estimate_timing(MotionRecording(t, np.full((100, 6), 0.5), np.full((100, 6), 0.5)))


def test_a_motion_that_stands_still_has_no_lag() -> None:
    t = np.arange(100) * 0.008
    with pytest.raises(RecordingError, match="no joint"):
        estimate_timing(MotionRecording(t, np.zeros((100, 6)), np.zeros((100, 6))))


def test_a_run_that_ends_before_the_arm_follows_shows_no_lag():
    """The stream died within one lag of its first command: nothing that was measured depends on the lag."""
    t = np.arange(60) * 0.002
    command = np.where(t[:, None] > 0.112, 0.5, 0.0) * np.ones(6)
    with pytest.raises(RecordingError, match="ends before any joint follows"):
        estimate_timing(MotionRecording(t, command, np.zeros((60, 6))), 40.0)

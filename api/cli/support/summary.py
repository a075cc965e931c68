"""Plans, executions and profiles in a few lines of text, for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from planner.errors import CUT_SHORT

# What a cell file says of the release's timing; source: `learning.release.PRIOR_STD`
UNKNOWN_TIMING = "timing unknown: ±20 ms"
# Words in which the executor says that this machine was late or silent; web/src/state/words.ts has the same.
BUSY_WORDS = ("was silent for", "no command for", "was frozen", "ticks lost so far", "the gripper command was")
BY_LINK = "the link lost them"  # source: executor/streaming/clock.py
BUSY_HINT = "this machine was probably too busy: end other programs; 'fling doctor' judges its timing"
BOX = "keep_out"  # beginning of `landed_on` where the object met a box, on its side or on its top


def plan_text(plan: dict[str, Any]) -> str:
    """Returns a summary of a plan in a few lines."""
    from planner.answer import passing_text  # loads numpy, which other texts do without

    solver = plan["solver"]
    flight = plan["flight"]
    lines = [
        f"planned by {plan['backend']} in {1000 * solver['solve_time_s']:.0f} ms: {passing_text(plan)}; "
        f"{_checked_text(plan['certificate'])}"
    ]
    if flight:
        lines.append(f"leaves at {flight['speed_m_s']:.2f} m/s, flies {flight['time_of_flight_s']:.2f} s")
        lines.append(f"{_window_text(flight)}; 10 ms early or late moves the landing by {_shift_text(flight)}")
    if odds := plan.get("hit_probability"):
        lines.append(_odds_text(odds))
    if solver["status"].endswith(CUT_SHORT):
        lines.append("its time limit ended the search: with more time the release may be sooner, or the aim better")
    return "\n  ".join(lines)


def landing_text(execution: dict[str, Any], observed: Sequence[dict[str, Any]] = ()) -> str:
    """Returns missed ticks, landing point and what the object landed on, of an execution that was completed.

    Args:
        execution: as of `GET /executions/{id}`.
        observed: its reported landings, oldest first; the newest position counts where the true landing is not known.
    """
    metrics = execution["metrics"] or {}
    text = f"{metrics.get('ticks')} ticks, {metrics.get('missed_ticks')} missed"
    if execution.get("dry_run"):
        return f"dry run: every check passed and nothing moved; {text}"
    if metrics.get("release_velocity_error_share") is not None:
        text += f"; joint velocity at the release within {100 * metrics['release_velocity_error_share']:.2f} %"
    point = metrics.get("landing_point")
    error = metrics.get("landing_error_m")
    if point is None or error is None:
        return f"{text}\n{_observed_text(observed, execution.get('id', 'latest'))}"
    place = ", ".join(f"{value:.4f}" for value in point)
    return f"{text}\n{_landed_text(metrics.get('landed_on'))} at ({place}) m, {_length(error)} from where the plan said"


def outcome_text(document: dict[str, Any]) -> str:
    """Returns the outcome of an execution, a batch or a job, with its reason where it has one."""
    return ": ".join(filter(None, [document["outcome"], document["reason"]]))


def ending_text(execution: dict[str, Any]) -> str:
    """Returns outcome and reason of an execution that was not completed, and the hint that a busy machine asks for."""
    reason = execution["reason"] or "no reason was given"
    said = f"{execution['outcome']}: {reason}"
    was_busy = any(words in reason for words in BUSY_WORDS) and BY_LINK not in reason
    return f"{said}; {BUSY_HINT}" if was_busy else said


def _checked_text(certificate: dict[str, Any]) -> str:
    """Returns how many checks passed, and the names of what was not checked."""
    passed = f"{len(certificate['checks'])} checks passed"
    unchecked = certificate.get("not_checked", ())
    return f"{passed}; {len(unchecked)} not checked: {', '.join(unchecked)}" if unchecked else passed


def _odds_text(odds: dict[str, Any]) -> str:
    """Returns how likely the throw hits; of a cell that is not calibrated, why nobody knows."""
    if odds["profile"] is None:
        return f"{UNKNOWN_TIMING}. Calibrate (3 minutes): fling calibrate gripper"
    low, high = odds["interval"]
    return f"hits within {_length(odds['radius_m'])} with {odds['value']:.0%} ({low:.0%} to {high:.0%})"


def _observed_text(observed: Sequence[dict[str, Any]], execution: str) -> str:
    """Returns where the object was last seen to land."""
    seen = [row for row in observed if row["position"] is not None]
    if not seen:
        return f"nobody has seen where it landed yet: fling landing {execution} X Y Z"
    place = ", ".join(f"{value:.3f}" for value in seen[-1]["position"])
    return f"seen to land at ({place}) m, within {_length(seen[-1]['std_m'])}, by {seen[-1]['source']}"


def _window_text(flight: dict[str, Any]) -> str:
    """Returns what the plan holds for a release that is not on time."""
    if flight["release_window_s"] <= 0.0 or flight["landing_tolerance_m"] <= 0.0:
        return "planned for the release on time alone"
    window_ms = 1000 * flight["release_window_s"]
    tolerance_mm = 1000 * flight["landing_tolerance_m"]
    return f"a release up to {window_ms:.3g} ms early or late lands within {tolerance_mm:.3g} mm"


def _shift_text(flight: dict[str, Any]) -> str:
    shifts = flight["landing_shift_10ms_m"]
    return " / ".join("an unknown distance" if s is None else _length(s) for s in (shifts["early"], shifts["late"]))


def _landed_text(surface: str | None) -> str:
    """Returns how a throw ended; a box that the object met may be a wall, or what the target is on."""
    if surface is not None and surface.startswith(BOX):
        return f"met {surface}"
    if surface == "bin wall":
        return f"stopped by {surface}"
    return "landed in the bin" if surface == "bin" else "landed"


def _length(value_m: float) -> str:
    """Returns a length in millimetres, with a decimal below a centimetre."""
    return f"{1000 * value_m:.{1 if value_m < 0.01 else 0}f} mm"


def numbers_text(row: dict[str, Any]) -> str:
    """Returns lag, delay and jitter of a profile in a line."""
    lag = "" if row["lag_std_s"] is None else f" ± {1e3 * row['lag_std_s']:.1f}"
    return (
        f"lag {1e3 * row['lag_s']:.1f}{lag} ms, delay {1e3 * row['delay_s']:.1f} ± {1e3 * row['delay_std_s']:.1f} ms, "
        f"jitter {1e3 * row['jitter_s']:.1f} ± {1e3 * row['jitter_std_s']:.1f} ms"
    )


def outputs_text(row: dict[str, Any]) -> list[str]:
    """Returns delay and jitter of each output that a profile has learnt, a line each."""
    return [
        f"{name}: delay {1e3 * each['delay_s']:.2f} ± {1e3 * each['delay_std_s']:.2f} ms, "
        f"jitter {1e3 * each['jitter_s']:.2f} ± {1e3 * each['jitter_std_s']:.2f} ms, from {each['edges']} edges"
        for name, each in row.get("outputs", {}).items()
    ]


def profile_text(row: dict[str, Any]) -> str:
    """Returns a profile in a few lines, beside what the cell file says."""
    file = row["cell_file"]
    offset = row["landing_offset_m"]
    spread = row["landing_offset_std_m"]
    seen = {name: len(ids) for name, ids in row["evidence"].items()}
    lines = [
        f"profile {row['id']} of {row['cell']}, {row['created_at']} by {row['created_by']}"
        + ("; in use" if row["adopted"] else ""),
        f"  from {seen['throws']} throws with {seen['landings']} landings, {seen['timing']} runs that show the timing",
        *(f"  not used: {row['execution_id']}: {row['reason']}" for row in row["evidence"].get("not_used", ())),
        f"  {numbers_text(row)}",
        f"  the cell file: lag {1e3 * file['lag_s']:.1f} ms, delay {1e3 * file['delay_s']:.1f} ms, "
        f"jitter {1e3 * file['jitter_s']:.1f} ms",
        f"  speed of the object over the tool's {row['speed_factor']:.3f} ± {row['speed_factor_std']:.3f}; "
        f"{_drag_text(row)}",
        f"  base {1e3 * offset[0]:.1f} ± {1e3 * spread[0]:.1f}, {1e3 * offset[1]:.1f} ± {1e3 * spread[1]:.1f} mm off, "
        f"turned by {1e3 * row['base_turn_rad']:.1f} ± {1e3 * row['base_turn_std_rad']:.1f} mrad",
    ]
    return "\n".join([*lines, *(f"  output {line}" for line in outputs_text(row)), *_explained_text(row)])


def _drag_text(row: dict[str, Any]) -> str:
    """Returns the drag with its uncertainty where throws have shown it, else the cell file's, which has none."""
    from learning import is_drag_learnt

    text = f"drag coefficient {row['drag_coefficient']:.2f}"
    std = float(row["drag_coefficient_std"])
    return f"{text} ± {std:.2f}" if is_drag_learnt(std) else f"{text}, the cell file's: throws do not show it"


def _explained_text(row: dict[str, Any]) -> list[str]:
    """Returns how far the observed landings were from the plans, and are from what the profile expects."""
    before = row.get("landing_error_before_m")
    after = row.get("landing_error_after_m")
    if before is None or after is None:
        return []
    return [
        f"  landings {1e3 * before:.0f} mm from where they were planned in the median, {1e3 * after:.0f} mm from where "
        "this profile expects them"
    ]

"""HTTP client of the service, for the commands that need a running one."""

from __future__ import annotations

import json
import time
from typing import Any

import click

from fling import Client
from planner.errors import TIME_LIMIT, figures

OPERATE_TIMEOUT_S = 30.0  # [s] an arm powers on within 10 s or so
ACKNOWLEDGE_TIMEOUT_S = 5.0  # [s] the executor acknowledges at its next heartbeat


class ServiceError(click.ClickException):
    """The service refused a request or cannot be reached; exit status 2 where it is infeasible, 3 where time ended."""

    def __init__(self, problem: dict[str, Any]) -> None:
        super().__init__(describe(problem))
        self.problem = problem

    @property
    def is_unreachable(self) -> bool:
        """Whether no service answered: there is no status then."""
        return not self.problem.get("status")


class ServiceClient(Client):
    """The client of `fling`, whose errors are those of the command line."""

    refusal = ServiceError

    def acknowledge(self, cell: str) -> dict[str, Any]:
        """Clears the fault that a cell's executor latched, and returns the answer once it has, or after a while."""
        answer = self.post(f"/cells/{cell}/acknowledge")
        deadline = time.monotonic() + ACKNOWLEDGE_TIMEOUT_S
        while self.get(f"/cells/{cell}/state")["fault"] is not None and time.monotonic() < deadline:
            time.sleep(0.1)
        return answer

    def operate(self, cell: str, action: str) -> dict[str, Any]:
        """Asks for a robot's power, brakes or unlocking; returns what became of it, or of a newer request."""
        answer = self.post(f"/cells/{cell}/robot", {"action": action})
        deadline = time.monotonic() + OPERATE_TIMEOUT_S
        while answer["state"] == "waiting" and time.monotonic() < deadline:
            time.sleep(0.1)
            answer = self.get(f"/cells/{cell}/state")["robot_request"]
        return answer


def describe(problem: dict[str, Any], as_request: bool = False) -> str:
    """Returns a problem as text: what stands in the way, a line each, and a request near it that works.

    Args:
        problem: its document.
        as_request: whether a request (JSON) was refused, so that its keys are named, not the options of `fling throw`.
    """
    title = problem.get("title", "refused")
    violations = problem.get("violations") or []
    is_late = _is_late(problem)
    if [violation["constraint"] for violation in violations] == ["hit_probability"]:
        return _odds_text(problem, violations[0], as_request)
    title = "The time limit ended the search, which had not found a motion yet" if is_late else title
    lines = [f"{title}:" if violations else f"{title}: {problem.get('detail', '')}"]
    lines += [f"  {_violation_text(violation, is_late)}" for violation in violations]
    attempts = [attempt for attempt in problem.get("attempts") or [] if attempt["backend"] != "nearest"]
    if any(not violation.get("proven") for violation in violations) and attempts:
        lines.append(f"  tried: {_tried_text(attempts)}")
    if problem.get("nearest"):
        lines.append(f"  {_nearest_text(problem['nearest'], as_request)}{_more_time_text(problem)}")
    elif violations:
        lines.append("  no feasible request was found near it")
    if _is_nearest_cut_short(problem):
        lines.append("  the time limit passed before every nearer request was tried: more time may find one")
    return "\n".join(lines)


def _is_late(problem: dict[str, Any]) -> bool:
    """Returns whether the time limit ended the search, so that nothing is known of what was not tried."""
    return (problem.get("solver") or {}).get("status") == TIME_LIMIT


def _more_time_text(problem: dict[str, Any]) -> str:
    """Returns the time limit of the nearest request, which may be the same but for it."""
    limit_s = problem["nearest"].get("time_limit_s")
    is_raised = _is_late(problem) or _is_nearest_cut_short(problem)
    return f", with a time limit of {limit_s:g} s" if is_raised and limit_s is not None else ""


def _is_nearest_cut_short(problem: dict[str, Any]) -> bool:
    """Returns whether the time limit passed in the search for the nearest request, of one that was not late itself."""
    return not _is_late(problem) and any(each["backend"] == "nearest" for each in problem.get("attempts") or [])


def _odds_text(problem: dict[str, Any], violation: dict[str, Any], as_request: bool) -> str:
    """Returns a refusal for odds alone: the arm can throw there, and does not hit often enough."""
    nearest = problem.get("nearest") or {}
    wider = "landing_tolerance_m" if as_request else "--tolerance"
    lines = [
        f"No throw of those tried hits often enough: {violation['value']:.0%} {violation['detail']}, "
        f"{violation['limit']:.0%} were asked for.",
        f"  A wider {wider} makes more throws a hit; `fling calibrate gripper` teaches how the cell really throws.",
    ]
    lines += ["  The time limit ended the search: more time may give more."] if _is_late(problem) else []
    return "\n".join([*lines, f"  {_nearest_text(nearest, as_request)}"] if nearest else lines)


def _violation_text(violation: dict[str, Any], is_late: bool) -> str:
    """Returns what stands in the way; of a search that the time limit ended, without a word on others."""
    proven = "; proven: no motion avoids it" if violation.get("proven") else ""
    if violation["value"] is None and violation["limit"] is None:  # nothing was found that has a value
        return f"{violation['constraint']}: {violation['detail']}{proven}"
    unit = "" if violation["unit"] in ("-", "1") else f" {violation['unit']}"
    numbers = [number for number in (violation["value"], violation["limit"]) if number is not None]
    if len(numbers) < 2:  # one is not finite: an object that never lands has an infinite error
        value, limit = (
            "infinite" if number is None else f"{number:.4g}{unit}"
            for number in (violation["value"], violation["limit"])
        )
    else:
        value, limit = (f"{number}{unit}" for number in figures(*numbers))
    detail = f" ({violation['detail']})" if violation.get("detail") else ""
    unproven = "" if is_late or proven else "; not proven: no other motion was found"
    return f"{violation['constraint']}: {value} against a limit of {limit}{detail}{proven or unproven}"


def _tried_text(attempts: list[dict[str, Any]]) -> str:
    """Returns what the one attempt of a search came to, or how many there were and how long they took."""
    if len(attempts) == 1:
        return str(attempts[0]["result"])
    return f"{len(attempts)} attempts in {sum(attempt['duration_s'] for attempt in attempts):.2g} s"


def _nearest_text(nearest: dict[str, Any], as_request: bool) -> str:
    if nearest.get("min_hit_probability"):
        return f"the best odds found: {nearest['min_hit_probability']:.3g}"
    release = nearest["release"]
    window = _window_text(nearest, as_request)
    if release["kind"] != "target":
        return f"a release near it that works: {json.dumps(release)}{window}"
    place = " ".join(f"{x:.6g}" for x in release["position"])
    return f"a target near it that works: {place}{window}"


def _window_text(nearest: dict[str, Any], as_request: bool) -> str:
    """Returns the release window that goes with the nearest request, and how to ask for it."""
    window_s = nearest.get("release_window_s")
    asked = nearest["release"]["kind"] == "target" or nearest.get("landing_tolerance_m", 0.0) > 0.0
    if window_s is None or not asked:
        return ""
    key = f'"release_window_s": {window_s:.9g}'
    if window_s == 0.0:
        return f", without a release window ({key if as_request else '--soonest'})"
    option = key if as_request else f"--window {window_s:.9g}"
    return f", with a release window of {1e3 * window_s:.3g} ms ({option})"

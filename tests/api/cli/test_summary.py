"""What the command line prints of a plan and an execution."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from click.testing import CliRunner

from api.cli import main
from api.cli.support.client import describe
from api.cli.support.exit_status import Interrupted
from api.cli.support.progress import execute_plan, make_plan
from api.cli.support.summary import ending_text, landing_text, plan_text
from planner.errors import CUT_SHORT
from planner.progress import Progress

SOLVER = {"solve_time_s": 0.02, "status": "fatrop: solved in 31 iterations"}


def plan(window_s: float, early_m: float | None) -> dict[str, Any]:
    """Returns a plan's document with the fields that the summary reads."""
    flight = {
        "speed_m_s": 3.0,
        "time_of_flight_s": 0.8,
        "release_window_s": window_s,
        "landing_tolerance_m": 0.02,
        "landing_shift_10ms_m": {"early": early_m, "late": 0.0243},
    }
    own = {"backend": "casadi", "release_time_s": 0.25, "duration_s": 0.5, "solver": SOLVER}
    return {**own, "certificate": {"checks": [{}] * 14}, "flight": flight}


@pytest.mark.parametrize(
    ("window_s", "early_m", "said"),
    [
        (
            0.005,
            0.0042,
            "up to 5 ms early or late lands within 20 mm; 10 ms early or late moves the landing by 4.2 mm / 24 mm",
        ),
        (0.0, 0.18, "on time alone; 10 ms early or late moves the landing by 180 mm / 24 mm"),
        (0.0, None, "moves the landing by an unknown distance / 24 mm"),
    ],
)
def test_a_plan_says_in_metres_what_10_ms_do(window_s: float, early_m: float | None, said: str):
    assert said in plan_text(plan(window_s, early_m))


def test_a_plan_says_that_its_time_limit_ended_the_search():
    found = plan(0.0, 0.18)
    assert "time limit" not in plan_text(found)
    found["solver"] = {**SOLVER, "status": f"{SOLVER['status']}; {CUT_SHORT}"}
    assert "its time limit ended the search" in plan_text(found)


def test_a_plan_names_what_was_not_checked():
    found = plan(0.0, 0.18)
    assert found["certificate"].setdefault("not_checked", []) == []
    assert "14 checks passed\n" in plan_text(found)
    found["certificate"]["not_checked"] = ["arm_shape", "payload"]
    assert "14 checks passed; 2 not checked: arm_shape, payload\n" in plan_text(found)


@pytest.mark.parametrize(
    ("outcome", "reason", "is_busy"),
    [
        ("link_lost", "the streaming process was silent for 102 ms", True),
        ("executor_lost", "the executor was frozen", True),
        ("late", "no command for 31 ms: the controller's watchdog stopped the program", True),
        ("late", "9 ticks lost so far, 9 in a row just now: this machine was busy", True),
        ("late", "9 ticks lost so far, 9 in a row just now: the link lost them", False),
        ("link_lost", "no new state for 40 ms", False),
        ("protective_stop", None, False),
    ],
)
def test_an_ending_of_a_busy_machine_says_what_to_do(outcome: str, reason: str | None, is_busy: bool):
    said = ending_text({"outcome": outcome, "reason": reason})
    assert said.startswith(f"{outcome}: {reason or 'no reason was given'}")
    assert ("end other programs" in said and "fling doctor" in said) is is_busy


@pytest.mark.parametrize(
    ("surface", "said"),
    [
        ("floor", "landed at"),
        (None, "landed at"),
        ("bin", "landed in the bin at"),
        ("bin wall", "stopped by bin wall at"),
        ("keep_out[0]", "met keep_out[0] at"),
    ],
)
def test_a_landing_says_what_stopped_the_object(surface: str | None, said: str):
    metrics = {"ticks": 9, "missed_ticks": 0, "landing_point": [1, 0, 0], "landing_error_m": 0.3, "landed_on": surface}
    assert f"{said} (1.0000, 0.0000, 0.0000) m, 300 mm from" in landing_text({"metrics": metrics})


def test_soonest_and_a_window_contradict_each_other():
    result = CliRunner().invoke(main, ["throw", "1", "0", "0", "--soonest", "--window", "0.01"])
    assert result.exit_code == 64
    assert "--soonest" in result.stderr


NO_WINDOW = {"release_window_s": 0.0, "landing_tolerance_m": 0.0}  # as of a release that none was asked for


def test_a_refusal_says_each_constraint_once_and_what_to_try():
    rows = [
        {"constraint": "tcp_speed", "value": 5.133770122, "limit": 4.0, "unit": "m/s", "detail": "", "proven": True},
        {"constraint": "keep_out", "value": -0.01, "limit": 0.02, "unit": "m", "detail": "forearm and box 0"},
    ]
    nearest = {"release": {"kind": "target", "position": [0.8893799999999998, 0.0, -0.1]}}
    text = describe({"title": "The arm cannot do this", "detail": "long", "violations": rows, "nearest": nearest})
    assert text.splitlines() == [
        "The arm cannot do this:",
        "  tcp_speed: 5.134 m/s against a limit of 4 m/s; proven: no motion avoids it",
        "  keep_out: -0.01 m against a limit of 0.02 m (forearm and box 0); not proven: no other motion was found",
        "  a target near it that works: 0.88938 0 -0.1",
    ]
    for window_s, as_request, said in (
        (0.0, False, ", without a release window (--soonest)"),
        (0.0012, False, ", with a release window of 1.2 ms (--window 0.0012)"),
        (0.0, True, ', without a release window ("release_window_s": 0)'),
        (0.0012, True, ', with a release window of 1.2 ms ("release_window_s": 0.0012)'),
    ):
        text = describe({"violations": rows, "nearest": {**nearest, "release_window_s": window_s}}, as_request)
        assert text.splitlines()[-1] == f"  a target near it that works: 0.88938 0 -0.1{said}"
    point = {"release": {"kind": "point"}, "release_window_s": 0.0375, "landing_tolerance_m": 0.001}
    for near, said in ((point, ", with a release window of 37.5 ms (--window 0.0375)"), ({**point, **NO_WINDOW}, "")):
        text = describe({"violations": rows, "nearest": near})
        assert text.splitlines()[-1] == f'  a release near it that works: {{"kind": "point"}}{said}'
    odds = {"release": nearest["release"], "min_hit_probability": 0.631}
    text = describe({"title": "The arm cannot do this", "violations": rows, "nearest": odds})
    assert text.splitlines()[-1] == "  the best odds found: 0.631"
    assert describe({"violations": rows, "nearest": None}).endswith("\n  no feasible request was found near it")
    states = {"backend": "candidates", "result": "48 release states: none clear of everything", "duration_s": 0.01}
    searches = [{"backend": "casadi", "result": "no", "duration_s": 0.7}] * 3
    for attempts, said in (([states], states["result"]), (searches, "3 attempts in 2.1 s")):
        assert f"\n  tried: {said}\n" in describe({"violations": rows, "nearest": nearest, "attempts": attempts})
        assert "tried:" not in describe({"violations": rows[:1], "nearest": nearest, "attempts": attempts})
    close = {**rows[0], "value": 0.019996, "limit": 0.02}
    assert "tcp_speed: 0.019996 m/s against a limit of 0.02 m/s" in describe({"violations": [close]})
    never = {**rows[1], "constraint": "landing_window", "value": None, "limit": 0.01, "detail": "never lands"}
    assert "landing_window: infinite against a limit of 0.01 m (never lands)" in describe({"violations": [never]})
    assert describe({"title": "Not found", "detail": "no cell"}) == "Not found: no cell"


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_a_coordinate_is_finite(value: str):
    result = CliRunner().invoke(main, ["throw", value, "0", "0"])
    assert result.exit_code == 64
    assert f"{value!r} is not a finite number" in result.output


@pytest.mark.parametrize("option", ["--window", "--tolerance", "--odds"])
def test_an_option_is_finite(option: str):
    assert "None" not in CliRunner().invoke(main, ["throw", "--help"]).output
    result = CliRunner().invoke(main, ["throw", "1.2", "0.3", "0", option, "nan"])
    assert result.exit_code == 64
    assert "is not a finite number" in result.output


class InterruptedThrow:
    """A service whose client is interrupted once in mid-throw."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def post(self, path: str, body: Any = None) -> dict[str, Any]:
        self.calls.append(path)
        return {"id": "x"}

    def abort(self, execution_id: str) -> None:
        self.calls.append(f"/executions/{execution_id}/abort")

    def finished(self, execution_id: str, on_event: Callable[[str, Any], object]) -> dict[str, Any]:
        on_event("state", {"state": "approaching"})
        if self.calls[-1] == "/execute":
            raise KeyboardInterrupt
        return {"id": "x", "outcome": "aborted"}


def test_an_interrupted_throw_is_braked_and_waited_for(capsys: pytest.CaptureFixture[str]):
    service = InterruptedThrow()
    assert execute_plan(service, {"id": "p"})["outcome"] == "aborted"
    assert service.calls == ["/execute", "/executions/x/abort"]
    said = capsys.readouterr()
    assert "asked to brake" in said.err
    assert said.out.count("approaching") == 1


class InterruptedSearch:
    """A service whose client is interrupted while it searches."""

    def planned(self, request: dict[str, Any], trajectory: bool, progress: Callable[[Progress], object]) -> Any:
        progress(Progress("search", 3, 0.512, 2.0))
        raise KeyboardInterrupt


@pytest.mark.parametrize("is_told", [True, False])
def test_an_interrupted_search_says_what_it_had_come_to(is_told: bool, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(Interrupted, match=r"after 2\.0 s and 3 candidates: so far best release at 0\.512 s") as ended:
        make_plan(InterruptedSearch(), {}, progress=is_told)
    assert ended.value.exit_code == 130
    assert "searching" not in capsys.readouterr().err


def test_a_dry_run_says_that_nothing_moved():
    text = landing_text({"dry_run": True, "metrics": {"ticks": 352, "missed_ticks": 0}})
    assert text == "dry run: every check passed and nothing moved; 352 ticks, 0 missed"


def test_a_search_that_the_time_limit_ended_says_so_and_what_more_time_gives():
    row = {"constraint": "landing", "value": 0.2, "limit": 0.01, "unit": "m", "proven": False}
    none = {"constraint": "motion", "value": None, "limit": None, "unit": "", "detail": "none was tried"}
    nearest = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "time_limit_s": 120.0}
    ended = {"title": "Planning timed out", "solver": {"status": "time_limit"}, "nearest": nearest}
    lines = describe({**ended, "violations": [row, none]}).splitlines()
    assert lines[0].startswith("The time limit ended the search")
    assert lines[1:3] == ["  landing: 0.2 m against a limit of 0.01 m", "  motion: none was tried"]
    assert lines[-1].endswith("1.2 0.3 0, with a time limit of 120 s")
    low = {"constraint": "hit_probability", "value": 0.3, "limit": 0.9, "unit": "-", "detail": "of landing"}
    assert "The time limit ended the search" in describe({**ended, "nearest": None, "violations": [low]})


def test_a_nearest_request_that_more_time_may_change_says_so():
    row = {"constraint": "landing", "value": 0.2, "limit": 0.01, "unit": "m", "proven": False}
    nearest = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "time_limit_s": 20.0}
    searched = {"backend": "casadi", "result": "infeasible", "duration_s": 0.5}
    cut = {"backend": "nearest", "result": "time_limit_s passed", "duration_s": 0.5}
    refused = {"title": "The arm cannot do this", "violations": [row], "nearest": nearest}
    whole = describe({**refused, "attempts": [searched]}).splitlines()
    late = describe({**refused, "attempts": [searched, cut]}).splitlines()
    assert late[-1] == "  the time limit passed before every nearer request was tried: more time may find one"
    assert late[-2].endswith("1.2 0.3 0, with a time limit of 20 s")
    assert [*whole[:-1], whole[-1] + ", with a time limit of 20 s"] == late[:-1]


def test_odds_that_no_throw_reaches_are_no_matter_of_the_arm():
    detail = "of landing within 0.02 m of the target, the best of the plans tried"
    violation = {"constraint": "hit_probability", "value": 0.0512, "limit": 0.9, "unit": "-", "detail": detail}
    text = describe(
        {"title": "The arm cannot do this", "violations": [violation], "nearest": {"min_hit_probability": 0.051}}
    )
    assert "The arm cannot" not in text
    assert text.startswith(f"No throw of those tried hits often enough: 5% {detail}, 90% were asked for.")
    assert "--tolerance" in text
    assert text.endswith("the best odds found: 0.051")

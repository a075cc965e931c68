"""The newest job of a cell on the page: what it does, its queue, the chart of its shift, and what is asked of it."""

from __future__ import annotations

import re
from typing import Any

import pytest
from playwright.sync_api import Route, expect

from api.schemas import JobAnswer, JobHead, JobList, ObjectResultList
from tests.system.browser import CHROMIUM, MISSING, Visit
from tests.web.conftest import CELL

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

FOLLOWED_MS = 20_000  # [ms] until the page has looked again, on a busy machine
HEAD: dict[str, Any] = {
    "id": "0199b1f0-0000-7000-8000-000000000001", "created_at": "2026-11-30T08:00:00Z", "created_by": "operator",
    "cell": CELL, "state": "running", "outcome": None, "reason": None, "total": 14, "pause_requested": False,
    "cancel_requested": False, "started_at": "2026-11-30T08:00:01Z", "finished_at": None,
}  # fmt: skip
RECORD: dict[str, Any] = {
    "objects": {"hit": 10, "miss": 1, "missed_grip": 1, "moving": 1, "waiting": 1}, "thrown": 11, "landings_seen": 11,
    "hits": 10, "hit_share": 10 / 11, "hit_interval": [0.623, 0.984], "misses": {"miss": 1, "missed_grip": 1},
    "cycles_per_hour": 612.3, "cycle_time_s": 5.4,
}  # fmt: skip
CURRENT = {"kind": "throw", "pick": 12, "next_pick": 13, "target": 1, "attempt": 2, "execution_id": "0199b1f0"}


def result(pick: int) -> dict[str, Any]:
    """Returns what became of one object: the third was not gripped, the fifth missed, the last two are to come."""
    name = {2: "missed_grip", 4: "miss", 12: "moving", 13: "waiting"}.get(pick, "hit")
    is_seen = name in ("hit", "miss")
    landing = [1.1, -0.3, 0.0] if is_seen else [None] * 3
    ended = pick < 12
    at = "in the bin" if name == "hit" else None
    return {
        "pick": pick, "object": f"ball {pick + 1}", "result": name, "object_at": at,
        "reason": "the gripper closed on nothing" if pick == 2 else None, "attempts": 2 if pick == 12 else 1,
        "target": pick % 2 if ended else None, "turn": pick, "outcome": "completed" if ended else None,
        "plan_id": None, "execution_id": None, "landing_x_m": landing[0], "landing_y_m": landing[1],
        "landing_z_m": landing[2], "error_m": 0.15 if name == "miss" else 0.012 if is_seen else None,
        "asked_at": f"2026-11-30T08:{pick:02}:10Z" if ended else None,
        "ended_at": f"2026-11-30T08:{pick:02}:16Z" if ended else None,
    }  # fmt: skip


@pytest.fixture
def told(guest: Visit) -> dict[str, Any]:
    """Answers of the service about a job that the page has been told of; a test changes them."""
    job = {**HEAD, "done": 12, "current": CURRENT, "record": RECORD}
    answers: dict[str, Any] = {"job": job, "asked": []}

    def answer(route: Route) -> None:
        path = route.request.url.split("/jobs", 1)[1]
        if route.request.method == "POST":
            answers["asked"].append(path.rsplit("/", 1)[1])
            route.fulfill(status=202, json={name: answers["job"][name] for name in HEAD})
        elif "/results" in path:
            results = {"results": [result(pick) for pick in range(14)], "next_cursor": None}
            route.fulfill(json=ObjectResultList(**results).model_dump())
        elif path.startswith("?"):
            head = {name: answers["job"][name] for name in HEAD}
            route.fulfill(json=JobList(jobs=[JobHead(**head)], next_cursor=None).model_dump())
        else:
            route.fulfill(json=JobAnswer(**answers["job"]).model_dump())

    guest.page.route(re.compile("/jobs"), answer)
    guest.region("Job").wait_for(timeout=FOLLOWED_MS)
    return answers


def test_a_job_is_shown_while_it_runs(guest: Visit, told: dict[str, Any]) -> None:
    job = guest.region("Job")
    expect(job.get_by_role("status")).to_have_text("Throwing from pick 12 at target 1, attempt 2, then to pick 13.")
    expect(job).to_contain_text("12 of 14 objects are done; 10 of 11 landings seen are hits (91 %; 62 % to 98 %")
    expect(job).to_contain_text("1 missed, 1 not gripped; 612 cycles an hour.")
    rows = job.get_by_role("row")
    expect(rows).to_have_count(5)  # the page of the current object: its head and picks 10 to 13
    expect(rows.nth(3)).to_contain_text("ball 13")
    job.get_by_role("button", name="Before").click()
    expect(rows).to_have_count(11)
    expect(rows.nth(3)).to_contain_text("the gripper closed on nothing")
    expect(job.get_by_role("img")).to_have_accessible_name("10 hits and 1 misses in 11.1 minutes; 1 put aside")
    assert guest.barriers() == []


@pytest.mark.slow
def test_a_job_is_paused_and_resumed(guest: Visit, told: dict[str, Any]) -> None:
    job = guest.region("Job")
    job.get_by_role("button", name="Pause").click()
    told["job"] = {**told["job"], "pause_requested": True}
    expect(job.get_by_role("status")).to_contain_text("It pauses after this motion.", timeout=FOLLOWED_MS)
    told["job"] = {**told["job"], "state": "paused", "current": None}
    expect(job.get_by_role("status")).to_have_text("The job is paused.", timeout=FOLLOWED_MS)
    job.get_by_role("button", name="Resume").click()
    told["job"] = {**told["job"], "state": "finished", "outcome": "stopped", "reason": "protective stop"}
    expect(job.get_by_role("status")).to_have_text("Stopped: protective stop", timeout=FOLLOWED_MS)
    assert told["asked"] == ["pause", "resume"]

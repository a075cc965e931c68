"""What the page says before, while and after an arm moves: what cannot run is not offered, what happened is told."""

from __future__ import annotations

import re
import time

import pytest
from playwright.sync_api import Browser, Route, expect

from tests.system.browser import CHROMIUM, MISSING, Visit, visit
from tests.web.conftest import CELL, Desk, planned

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

SOON_MS = 15_000  # [ms] the page asks for a robot's state every 400 ms; a busy machine draws slowly
FAULT = {
    "outcome": "protective_stop",
    "reason": "the controller reports a protective stop",
    "execution_id": "e1",
    "at": 1.0,
}


@pytest.mark.slow
def test_seen_from_above_the_floor_is_dragged(viewer: Visit) -> None:
    viewer.page.wait_for_timeout(1000)  # the scene is there
    viewer.page.get_by_role("group", name="Camera").get_by_role("button", name="Top").click()
    viewer.page.wait_for_timeout(500)
    x, y = viewer.middle_of("grab")
    mouse = viewer.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 20, y, steps=3)
    mouse.move(x + 40, y, steps=3)
    mouse.up()
    expect(viewer.field("x [m]")).not_to_have_value("1.2")
    expect(viewer.field("z [m]")).to_have_value("0")


@pytest.mark.slow
@pytest.mark.slow
def test_the_button_names_a_height_above_the_floor(guest: Visit) -> None:
    planned(guest)
    expect(guest.button("Throw")).to_have_text("Throw on ur5e-sim to (1.20, 0.30)")
    planned(guest, z="0.3")
    expect(guest.button("Throw")).to_have_text("Throw on ur5e-sim to (1.20, 0.30, 0.30)")


def test_a_latched_fault_disables_the_throw_and_is_acknowledged_in_its_banner(guest: Visit, desk: Desk) -> None:
    planned(guest)
    desk.executor.fault = FAULT
    expect(guest.button("Throw on")).to_be_disabled(timeout=SOON_MS)
    expect(guest.page.locator(".why")).to_contain_text("A fault is latched")
    banner = guest.page.get_by_role("alert").filter(has_text="Protective stop")
    with guest.page.expect_response(re.compile("/acknowledge")) as answer:
        banner.get_by_role("button", name="Acknowledge").click()
    assert answer.value.status == 200
    desk.executor.fault = None
    expect(banner).to_have_count(0, timeout=SOON_MS)
    expect(guest.button("Throw on")).to_be_enabled(timeout=SOON_MS)


def test_what_the_robot_refuses_is_not_offered(guest: Visit, desk: Desk) -> None:
    planned(guest)
    desk.executor.robot = {**desk.executor.robot, "refusals": ["the speed slider is at 50 %: a throw needs 100 %"]}
    expect(guest.button("Throw on")).to_be_disabled(timeout=SOON_MS)
    expect(guest.page.locator(".why")).to_contain_text("The speed slider is at 50 %")


def test_without_an_executor_nothing_is_thrown(desk: Desk, browser: Browser) -> None:
    with visit(browser, desk.url) as guest:
        guest.page.get_by_label("Cell", exact=True).select_option("far-away")
        planned(guest)
        expect(guest.button("Throw on")).to_be_disabled()
        expect(guest.page.locator(".why")).to_contain_text("has no executor")


def test_with_a_dead_service_nothing_is_thrown(guest: Visit) -> None:
    planned(guest)
    guest.context.set_offline(True)
    expect(guest.button("Throw on")).to_be_disabled(timeout=SOON_MS)
    expect(guest.page.locator(".why")).to_contain_text("The service does not answer")
    guest.context.set_offline(False)
    expect(guest.button("Throw on")).to_be_enabled(timeout=SOON_MS)


def test_a_real_arm_without_tokens_is_refused_before_anyone_is_asked(desk: Desk, browser: Browser) -> None:
    with visit(browser, desk.url) as guest:
        guest.page.get_by_label("Cell", exact=True).select_option("real")
        expect(guest.page.get_by_role("banner").get_by_text("Real arm", exact=True)).to_be_visible()
        planned(guest)
        expect(guest.button("Throw on real")).to_be_disabled()
        expect(guest.page.locator(".why")).to_contain_text("without tokens executes on simulated cells only")
        expect(guest.page.get_by_role("dialog")).to_have_count(0)


def test_a_real_arm_asks_once_more(desk: Desk, browser: Browser) -> None:
    """With tokens and an executor, as far as the page is told."""
    executor = {"id": "e", "alive": True, "heartbeat_age_s": 0.1, "read_only": False}
    ready = {"cell": "real", "executor": executor, "robot": {"connected": True, "refusals": []}, "fault": None}
    with visit(browser, desk.url) as guest:
        guest.page.route(
            re.compile("/cells/real/state$"),
            lambda route: route.fulfill(json={**ready, "execution_id": None, "not_executable": None}),
        )
        guest.page.get_by_label("Cell", exact=True).select_option("real")
        expect(guest.page.get_by_role("banner").get_by_text("Real arm", exact=True)).to_be_visible()
        planned(guest, z="0.2")
        guest.button("Throw on real").click()
        dialog = guest.page.get_by_role("dialog")
        expect(dialog).to_contain_text("A real arm will move")
        expect(dialog).to_contain_text("(1.20, 0.30, 0.20)")
        expect(dialog.get_by_role("button", name="No, keep still")).to_be_focused()
        assert guest.barriers() == []
        guest.page.keyboard.press("Escape")
        expect(dialog).to_have_count(0)
        assert desk.store.open_execution("real") is None


@pytest.mark.slow
def test_a_simulation_elsewhere_is_no_simulation_to_be_trusted(desk: Desk, browser: Browser) -> None:
    with visit(browser, desk.url) as guest:
        guest.page.get_by_label("Cell", exact=True).select_option("far-away")
        expect(guest.page.get_by_role("banner")).to_contain_text("At 8.8.8.8")
        expect(guest.page.get_by_role("banner").get_by_text("Simulated", exact=True)).to_have_count(0)
        row = guest.region("Robots").get_by_role("listitem").filter(has_text="far-away")
        expect(row).to_contain_text("not on this machine")


def test_a_stop_that_did_not_get_through_is_forgotten_once_it_did(guest: Visit, desk: Desk, plan_id: str) -> None:
    id = desk.begun(plan_id)
    guest.outcome("To the start")
    lost: list[Route] = []
    guest.page.route(re.compile("/abort$"), lambda route: (lost.append(route), route.abort()))
    guest.button("Stop").click()
    alert = guest.page.get_by_role("alert").filter(has_text="Stop did not get through")
    expect(alert).to_contain_text("se the emergency stop")
    desk.store.finish_execution(id, "aborted", None, {"released": False})
    guest.outcome("Stopped on request")
    expect(alert).to_have_count(0)
    assert lost


def test_a_stop_before_the_execution_is_known_reaches_it(guest: Visit, desk: Desk) -> None:
    planned(guest)
    held: list[Route] = []
    guest.page.route(re.compile("/execute$"), lambda route: held.append(route))
    with guest.page.expect_request(re.compile("/execute$")):
        guest.button("Throw on").click()
    guest.button("Stop").click()
    expect(guest.page.get_by_role("status").filter(has_text="Nothing is running")).to_be_visible(timeout=SOON_MS)
    with guest.page.expect_response(re.compile("/abort$"), timeout=SOON_MS):
        held[0].continue_()
    (thrown, *_) = desk.store.executions(cell=CELL)[0]
    assert thrown.abort_requested_at is not None or thrown.outcome == "aborted"


def test_a_stop_is_sent_until_it_gets_through(guest: Visit, desk: Desk, plan_id: str) -> None:
    id = desk.begun(plan_id)
    guest.outcome("To the start")
    guest.page.route(re.compile("/abort$"), lambda route: route.fulfill(status=503, body="busy"), times=1)
    guest.page.route(re.compile("/abort$"), lambda route: route.abort(), times=1)
    guest.page.route(re.compile("/state$"), lambda route: route.abort())  # nothing needs to be asked before
    guest.button("Stop").click()
    deadline = time.monotonic() + SOON_MS / 1000
    while not desk.store.abort_requested(id):
        guest.page.wait_for_timeout(50)
        assert time.monotonic() < deadline
    expect(guest.page.get_by_role("alert").filter(has_text="Stop did not get through")).to_have_count(
        0, timeout=SOON_MS
    )


@pytest.mark.slow
def test_a_dry_run_is_not_told_as_a_move(guest: Visit, desk: Desk, plan_id: str) -> None:
    desk.execution(plan_id, dry_run=True, metrics={"released": False, "missed_ticks": 0})
    row = guest.past("Dry run")
    row.wait_for(timeout=SOON_MS)
    expect(row).not_to_contain_text("Moved as planned")
    row.get_by_role("button").first.click()
    expect(guest.region("Execution").get_by_role("status")).to_contain_text("Dry run: nothing moved")


def test_a_stalled_executor_is_not_told_as_ended(guest: Visit, desk: Desk) -> None:
    planned(guest)
    desk.executor.stop()
    row = guest.region("Robots").get_by_role("listitem").filter(has_text=CELL)
    expect(row).to_contain_text("The executor is silent", timeout=SOON_MS)
    expect(row).to_contain_text(re.compile(r"last heard of \d+ s ago"))
    expect(row).to_contain_text("whether its process still runs")
    expect(row).not_to_contain_text("Start it again")
    expect(guest.button("Throw on")).to_be_disabled()


@pytest.mark.slow
def test_a_fault_of_an_executor_that_reports_asks_for_no_new_one(guest: Visit, desk: Desk) -> None:
    desk.executor.fault = {"outcome": "executor_lost", "reason": "the executor failed", "at": 1.0}
    alert = guest.page.get_by_role("alert").filter(has_text="the executor failed")
    expect(alert).to_contain_text("See that the arm stands still, then acknowledge", timeout=SOON_MS)
    expect(alert).not_to_contain_text("start the executor")


@pytest.mark.slow
@pytest.mark.slow
def test_a_machine_that_fell_silent_is_told_from_a_lost_link(guest: Visit, desk: Desk) -> None:
    planned(guest)
    reason = "the streaming process was silent for 102 ms"
    desk.executor.fault = {"outcome": "link_lost", "reason": reason, "at": 1.0}
    alert = guest.page.get_by_role("alert").filter(has_text=reason)
    expect(alert).to_contain_text("The streaming process was silent for 102 ms. This machine was probably too busy")
    expect(alert).not_to_contain_text("Connection")
    expect(guest.page.locator(".why")).to_have_text(
        "A fault is latched: look at the arm, then acknowledge it above.", timeout=SOON_MS
    )


@pytest.mark.slow
def test_lateness_is_told_by_what_was_late(guest: Visit, desk: Desk, thrown_id: str) -> None:
    late = {"released": True, "missed_ticks": 0, "gripper_command_late_s": 0.012, "period_max_s": 0.0021}
    desk.execution(
        thrown_id, "late", reason="the gripper command was 12 ms late: the landing moves by 40 mm", metrics=late
    )
    guest.past("Thrown, but the gripper was told too late").get_by_role("button").first.click(timeout=SOON_MS)
    numbers = guest.region("Execution").locator(".key-numbers")
    expect(numbers).to_contain_text("Gripper command late")
    expect(numbers).to_contain_text("12 ms")
    expect(numbers).not_to_contain_text("Missed ticks")
    silent = {"released": False, "missed_ticks": 0, "gripper_command_late_s": None, "period_max_s": 0.031}
    desk.execution(
        thrown_id, "late", reason="no command for 31 ms: the controller's watchdog stopped the program", metrics=silent
    )
    guest.past("Stopped: commands came too late").get_by_role("button").first.click(timeout=SOON_MS)
    expect(numbers).to_contain_text("Longest gap")
    expect(numbers).to_contain_text("31 ms")

"""Past throws on the page: pages, filter, what a click shows, addresses, two beside each other, profiles, landings."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import Browser, expect

from store import new_id
from tests.system.browser import CHROMIUM, MISSING, PLAN_MS, Visit, visit
from tests.web.conftest import METRICS, Desk, planned, posted

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason=MISSING)]

SOON_MS = 15_000
JOINT_COLUMNS = [f"{name}_{j}_rad" for name in ("q", "planned_q") for j in range(6)]
NO_PLAN = "00000000-0000-7000-8000-000000000000"


@pytest.fixture(scope="module")
def elsewhere_id(served: Desk) -> str:
    """Id of a plan that throws at another target."""
    release = {"kind": "target", "position": [1.1, -0.4, 0.2]}
    return posted(served, {"release": release, "backend": "ruckig", "release_window_s": 0.0})


@pytest.fixture
def many(desk: Desk, thrown_id: str) -> list[str]:
    """Ids of two dozen throws, oldest first; one of them was held."""
    return [desk.execution(thrown_id, "held" if i == 3 else "completed") for i in range(24)]


def test_history_has_dates_targets_pages_and_a_filter(guest: Visit, many: list[str]) -> None:
    history = guest.region("History")
    rows = history.locator("tbody tr")
    expect(rows).to_have_count(10, timeout=SOON_MS)
    expect(rows.first).to_contain_text(re.compile(r"20\d\d"))
    expect(rows.first).to_contain_text("(1.20, 0.30)")
    history.get_by_role("button", name="Older").click()
    expect(history).to_contain_text("Page 2")
    history.get_by_role("button", name="Older").click()
    expect(history).to_contain_text("Page 3")
    expect(history.get_by_role("button", name="Newer")).to_be_enabled()
    history.get_by_role("button", name="Newer").click()
    history.get_by_role("button", name="Newer").click()
    expect(history.get_by_role("button", name="Newer")).to_be_disabled()
    history.get_by_label("Outcome").select_option("held")
    expect(rows).to_have_count(1, timeout=SOON_MS)
    expect(rows.first).to_contain_text("Kept the object")


def test_a_clicked_throw_is_shown_and_the_form_is_not_its(guest: Visit, desk: Desk, elsewhere_id: str) -> None:
    planned(guest)
    id = desk.execution(elsewhere_id)
    row = guest.region("History").locator("tbody tr").filter(has_text="(1.10, −0.40, 0.20)").first
    row.get_by_role("button").first.click(timeout=SOON_MS)
    execution = guest.region("Execution")
    expect(execution).to_contain_text("to (1.10, −0.40, 0.20)")
    expect(execution).to_contain_text(id)
    expect(guest.page).to_have_url(re.compile(f"#/execution/{id}$"))
    expect(guest.button("Throw on")).to_be_disabled()  # what it would throw is not on the screen
    expect(guest.page.locator(".why")).to_contain_text("A past throw is on the screen")
    guest.button("Back to the request").click()
    expect(guest.button("Throw on")).to_be_enabled()
    expect(guest.page).to_have_url(re.compile("#/plan/"))
    row.get_by_role("button").first.click()
    guest.button("Take its request").click()
    expect(guest.field("x [m]")).to_have_value("1.1")
    expect(guest.field("z [m]")).to_have_value("0.2")
    expect(guest.button("Throw on")).to_have_text("Throw on ur5e-sim to (1.10, −0.40, 0.20)")
    expect(guest.button("Throw on")).to_be_enabled()  # the plan answers exactly this request


def test_a_reloaded_page_has_its_plan_and_request_again(guest: Visit) -> None:
    planned(guest, x="1.15")
    assert re.search("#/plan/[0-9a-f-]{36}$", guest.page.url)
    guest.page.reload()
    expect(guest.field("x [m]")).to_have_value("1.15", timeout=SOON_MS)
    expect(guest.button("Throw on")).to_be_enabled(timeout=SOON_MS)
    guest.field("x [m]").fill("1.4")
    guest.page.reload()
    expect(guest.field("x [m]")).to_have_value("1.4", timeout=SOON_MS)
    expect(guest.page.locator(".summary.stale")).to_be_visible(timeout=SOON_MS)
    expect(guest.button("Throw")).to_be_disabled()  # the plan is that of before the edit


def test_the_address_of_a_plan_shows_it_to_others(desk: Desk, browser: Browser, elsewhere_id: str) -> None:
    with visit(browser, f"{desk.url}/#/plan/{elsewhere_id}") as other:
        expect(other.field("y [m]")).to_have_value("-0.4", timeout=SOON_MS)
        expect(other.button("Throw on")).to_be_enabled(timeout=SOON_MS)
    with visit(browser, f"{desk.url}/#/plan/{NO_PLAN}") as other:
        expect(other.page.get_by_role("alert")).to_contain_text("could not be shown", timeout=SOON_MS)


def test_a_reload_in_mid_throw_keeps_plan_and_request(guest: Visit, desk: Desk, elsewhere_id: str) -> None:
    id = desk.begun(elsewhere_id, "streaming")
    guest.outcome("Throwing")
    expect(guest.page).to_have_url(re.compile(f"#/execution/{id}$"))
    guest.page.reload()
    guest.outcome("Throwing")
    expect(guest.field("x [m]")).to_have_value("1.2")  # this tab's own form
    expect(guest.region("Timeline").get_by_role("button", name="Play")).to_be_enabled()
    expect(guest.region("Execution")).to_contain_text("to (1.10, −0.40, 0.20)")


def test_a_reloaded_past_throw_is_past_still(guest: Visit, desk: Desk, browser: Browser) -> None:
    planned(guest)
    id = desk.execution(guest.page.url[-36:], metrics={**METRICS, "landing_error_m": 0.0777})
    row = guest.region("History").locator("tbody tr").filter(has_text="77.7 mm")
    row.get_by_role("button").first.click(timeout=SOON_MS)
    expect(guest.region("Execution")).to_contain_text(id)
    guest.page.reload()
    expect(guest.region("Execution")).to_contain_text(id, timeout=SOON_MS)
    expect(guest.page.locator(".why")).to_contain_text("A past throw is on the screen", timeout=SOON_MS)
    expect(guest.button("Throw on")).to_be_disabled()  # though the plan answers the form
    guest.button("Back to the request").click()
    expect(guest.button("Throw on")).to_be_enabled(timeout=SOON_MS)
    with visit(browser, f"{desk.url}/#/execution/{id}") as other:
        expect(other.button("Take its request")).to_be_visible(timeout=SOON_MS)
        expect(other.button("Throw on")).to_be_disabled()


def test_two_throws_are_compared(guest: Visit, desk: Desk, thrown_id: str) -> None:
    first = desk.execution(thrown_id, metrics={**METRICS, "landing_error_m": 0.0123})
    second = desk.execution(thrown_id, metrics={**METRICS, "landing_error_m": 0.0456})
    rows = [f"{0.002 * i},{','.join(['0.01'] * 6 + ['0.0'] * 6)}" for i in range(50)]
    measured = "\n".join([",".join(["clock_s", *JOINT_COLUMNS]), *rows])
    csv = re.compile(f"/executions/({first}|{second})/recording")
    guest.page.route(csv, lambda route: route.fulfill(body=measured, content_type="text/csv"))
    history = guest.region("History")
    for error in ("12.3 mm", "45.6 mm"):
        history.locator("tbody tr").filter(has_text=error).first.get_by_role("checkbox").check(timeout=SOON_MS)
    comparison = guest.region("Comparison")
    row = comparison.get_by_role("row", name="Landed off by")
    expect(row.get_by_role("cell")).to_have_text(["12.3 mm", "45.6 mm"])
    expect(comparison.locator(".u-over")).to_be_visible()
    guest.button("Close the comparison").click()
    expect(comparison).to_have_count(0)


def test_what_is_past_keeps_nobody_out(guest: Visit, many: list[str], desk: Desk) -> None:
    history = guest.region("History")
    boxes = history.locator("tbody tr").get_by_role("checkbox")
    boxes.nth(0).check(timeout=SOON_MS)
    boxes.nth(1).check()
    history.get_by_text("What was learnt of this cell").click()
    guest.button("Estimate a profile").click()
    history.get_by_role("list", name="Profiles").wait_for(timeout=PLAN_MS)
    history.locator("tbody tr").first.get_by_role("button").first.click()
    expect(guest.button("Back to the request")).to_be_visible()
    desk.executor.fault = {"outcome": "late", "reason": "five ticks were lost", "at": 1.0}
    expect(guest.button("Acknowledge")).to_be_visible(timeout=SOON_MS)
    assert guest.barriers() == []


def test_a_profile_is_adopted_with_its_evidence_in_sight(guest: Visit, desk: Desk, thrown_id: str) -> None:
    for i in range(3):
        id = desk.execution(thrown_id, metrics={**METRICS, "gripper_commanded_s": 0.2})
        desk.store.add_landing(new_id(), id, 1.0, "person", "Ada", position=(1.2 + 0.01 * i, 0.3, 0.0), std_m=0.003)
    doubted = desk.execution(thrown_id, "tracking", metrics={**METRICS, "gripper_commanded_s": 0.2})
    desk.store.add_landing(new_id(), doubted, 1.0, "person", "Ada", position=(1.3, 0.3, 0.0), std_m=0.003)
    slip = desk.execution(thrown_id, metrics={**METRICS, "gripper_commanded_s": 0.2})
    desk.store.add_landing(new_id(), slip, 1.0, "person", "Ada", position=(9.0, 9.0, 9.0), std_m=0.003)
    history = guest.region("History")
    history.get_by_text("What was learnt of this cell").click()
    expect(history).to_contain_text(re.compile(r"of the newest \d+, [1-9]\d* have a reported landing"), timeout=SOON_MS)
    guest.button("Estimate a profile").click()
    profile = history.get_by_role("list", name="Profiles").locator("> li").first
    expect(profile).to_contain_text(re.compile(r"Rests on [1-9]\d* throws with [1-9]\d* landings"), timeout=PLAN_MS)
    expect(profile).to_contain_text("explains them to")
    profile.get_by_text("1 doubted").click()
    profile.get_by_role("link", name=slip[-6:]).click()
    expect(guest.region("Execution")).to_contain_text(slip)
    expect(guest.button("Back to the request")).to_be_visible()
    profile.get_by_text("not used").click()
    expect(profile).to_contain_text("its outcome is tracking")
    expect(profile).to_contain_text(doubted[-6:])
    expect(profile.get_by_role("button", name="Adopt the newest")).to_be_visible()


def test_a_far_landing_is_asked_about_named_and_withdrawn(guest: Visit, desk: Desk, elsewhere_id: str) -> None:
    id = desk.execution(elsewhere_id)
    row = guest.region("History").locator("tbody tr").filter(has_text="(1.10, −0.40, 0.20)").first
    row.get_by_role("button").first.click(timeout=SOON_MS)
    execution = guest.region("Execution")
    execution.get_by_text("Report the landing").click()
    for name in ("x", "y", "z"):
        guest.field(f"Landing {name} [m]").fill("9")
    guest.button("Report this place").click()
    asked = guest.page.get_by_role("alertdialog")
    expect(asked).to_contain_text("from where this throw was to land, (1.10, −0.40, 0.20)")
    assert desk.store.landings(id) == []
    asked.get_by_role("button", name="No").click()
    expect(asked).to_have_count(0)
    for name, value in (("x", "1.12"), ("y", "-0.4"), ("z", "0.2")):
        guest.field(f"Landing {name} [m]").fill(value)
    guest.button("Report this place").click()
    expect(guest.page.get_by_role("status").filter(has_text="Reported")).to_contain_text("to (1.10, −0.40, 0.20)")
    assert len(desk.store.landings(id)) == 1
    execution.get_by_role("button", name="Withdraw").click()
    expect(execution.get_by_role("list", name="Reports of the landing")).to_contain_text("withdrawn")
    assert desk.store.landings(id) == []
    assert desk.store.audit_lines(1)[0]["action"] == "withdraw"


@pytest.mark.parametrize("width", [1280, 390])
def test_every_column_of_the_history_is_whole(desk: Desk, browser: Browser, thrown_id: str, width: int) -> None:
    id = desk.execution(thrown_id)
    desk.store.add_landing(new_id(), id, 1.0, "person", "Ada", position=(1.2, 0.3, 0.0), std_m=0.003)  # drawn beside
    with visit(browser, desk.url, viewport={"width": width, "height": 800}) as guest:
        listed = guest.region("History").get_by_role("group", name="Past throws")
        listed.get_by_role("button", name="Download the recording as csv").first.wait_for()
        assert listed.evaluate("(around) => around.scrollWidth - around.clientWidth") <= 1


def test_a_past_throw_is_shown_where_its_scene_is(guest: Visit, desk: Desk, thrown_id: str) -> None:
    desk.execution(thrown_id)
    row = guest.past("Thrown as planned").get_by_role("button").first
    row.scroll_into_view_if_needed()
    row.click(timeout=SOON_MS)
    guest.page.wait_for_function("() => scrollY === 0", timeout=SOON_MS)

"""The page as a person uses it: Chromium on a running `fling up`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest
from click.testing import CliRunner
from playwright.sync_api import Browser, expect, sync_playwright

from api.cli import main
from tests.system.browser import CHROMIUM, MISSING, PLAN_MS, SMALL, THROW_MS, PageStack, Visit, launch, visit

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

PHONE = {"width": 390, "height": 844}
LISTENS_S = 90.0  # [s] on a busy machine
MAP_MS = 90_000  # [ms] until the first landing cells are known, on a busy machine
PNG = b"\x89PNG\r\n"
PAINTED_AND_ASKED = """() => {
  const [painted] = performance.getEntriesByName("first-contentful-paint");
  const scene = performance.getEntriesByType("resource").find(({ name }) => name.includes("/assets/scene-"));
  return painted && scene && [painted.startTime, scene.startTime];
}"""


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageStack]:
    """One `fling up` for all tests."""
    running = PageStack(tmp_path_factory.mktemp("page"))
    assert running.process.poll() is None, "`fling up` ended before it was ready"
    yield running
    if running.process.poll() is None:
        running.down()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        started = launch(playwright)
        yield started
        started.close()


@pytest.fixture
def guest(stack: PageStack, browser: Browser) -> Iterator[Visit]:
    """A fresh tab on a robot in order."""
    stack.http.post("/cells/ur5e-sim/acknowledge")
    with visit(browser, stack.url) as opened:
        opened.region("Robots").get_by_text("Ready").wait_for()
        yield opened


def test_an_edit_disarms_the_throw_until_it_is_planned_again(guest: Visit) -> None:
    expect(guest.button("Throw")).to_be_disabled()
    guest.planned()
    expect(guest.button("Throw")).to_have_text("Throw on ur5e-sim to (1.20, 0.30)")
    guest.field("y [m]").fill("0.35")
    expect(guest.button("Throw")).to_be_disabled()
    guest.planned()
    expect(guest.button("Throw")).to_have_text("Throw on ur5e-sim to (1.20, 0.35)")
    guest.page.get_by_label("Cell", exact=True).select_option("ur5e-sim")  # the same: nothing changes
    expect(guest.button("Throw")).to_be_enabled()


def test_three_js_is_asked_for_after_the_form_is_painted(guest: Visit) -> None:
    painted_ms, asked_ms = guest.page.wait_for_function(PAINTED_AND_ASKED).json_value()
    assert painted_ms < asked_ms


def test_text_that_is_no_number_is_named(guest: Visit) -> None:
    guest.field("z [m]").fill("ground")
    guest.button("Plan").click()
    expect(guest.page.get_by_role("alert")).to_contain_text('target 3: "ground" is not a number')


def test_a_throw_is_shown_to_the_landing(guest: Visit) -> None:
    guest.planned()
    certificate = guest.region("Certificate")
    certificate.get_by_role("button", name="Joint velocity").click()
    expect(guest.region("Timeline").get_by_role("slider")).not_to_have_value("0")
    guest.button("Throw on").click()
    guest.outcome("Thrown as planned")
    execution = guest.region("Execution")
    expect(execution.get_by_text("Landing error")).to_be_visible()
    expect(execution.locator(".key-numbers dd").first).to_have_text(re.compile(r"^\d+(\.\d+)? mm$"))
    expect(guest.region("History").get_by_role("row")).not_to_have_count(1)
    expect(guest.region("History").locator("circle.dot")).not_to_have_count(0)


def test_a_reloaded_page_stops_the_throw(guest: Visit, stack: PageStack) -> None:
    guest.page.get_by_text("Options", exact=True).click()
    guest.page.get_by_label("Start", exact=True).select_option("positions")
    guest.field("Start positions base [rad]").fill("2.4")  # the way to it takes seconds
    guest.planned()
    guest.button("Throw on").click()
    guest.outcome("To the start")
    guest.page.reload()
    guest.outcome("To the start")
    guest.button("Stop").click()
    guest.outcome("Stopped on request")
    phases = guest.region("Execution").locator(".phases")
    expect(phases.locator("li.later")).to_have_text(["Throwing"])
    expect(guest.region("Execution").locator(".key-numbers dd").nth(1)).to_have_text("–")  # of what was not released
    expect(guest.region("Timeline").get_by_role("button", name="Play")).to_be_visible()


def test_a_throw_of_the_command_line_is_seen_and_stopped_by_key(guest: Visit, stack: PageStack) -> None:
    stack.execute(stack.plan_far_away())
    guest.outcome("Moved as planned")
    command = [sys.executable, "-c", "from api.cli import main; main()", "throw", "1.2", "0.3", "0", "--url", stack.url]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as thrower:
        guest.outcome("To the start")
        guest.page.keyboard.press("Escape")
        guest.outcome("Stopped on request")
        assert thrower.wait(THROW_MS / 1000) == 4


def test_the_keyboard_alone_throws_and_stops(guest: Visit) -> None:
    """From the empty page to a throw to Stop; the focus is seen and kept."""
    keyboard = guest.page.keyboard
    focus = guest.page.locator(":focus-visible")
    guest.tab_to("Options")
    keyboard.press("Enter")
    guest.tab_to("Start")
    keyboard.type("joint")  # as its own list is chosen from
    guest.tab_to("Start positions base [rad]")
    keyboard.press("Control+A")
    keyboard.type("-2.4")  # the way to it takes seconds
    keyboard.press("Enter")
    guest.armed().wait_for(timeout=PLAN_MS)
    expect(focus).to_have_accessible_name("Start positions base [rad]")
    guest.tab_to("Throw on")
    keyboard.press("Enter")
    guest.outcome("To the start")
    expect(focus).to_have_accessible_name(re.compile("^Throw on"))
    keyboard.press("Escape")
    guest.outcome("Stopped on request")
    expect(focus).to_have_accessible_name(re.compile("^Throw on"))


def test_a_profile_is_adopted_and_the_plan_made_anew(guest: Visit, stack: PageStack) -> None:
    guest.planned()
    history = guest.region("History")
    history.get_by_text("What was learnt of this cell").click()
    try:
        guest.button("Estimate a profile").click()
        guest.page.get_by_text("A profile was estimated").wait_for(timeout=PLAN_MS)
        expect(guest.button("Throw on")).to_be_enabled()  # it is not in use
        guest.button("Adopt the newest").click()
        expect(history).to_contain_text("In use: lag")
        expect(guest.button("Throw on")).to_be_disabled()
        guest.planned()
        plan = stack.http.get("/plans/latest?trajectory=false").json()
        assert plan["profile"] == stack.http.get("/cells/ur5e-sim/profiles").json()["adopted"]
        guest.button("Revert").click()
        expect(history).to_contain_text("In use: the cell file's numbers")
        expect(guest.button("Throw on")).to_be_disabled()
    finally:
        stack.http.post("/cells/ur5e-sim/profiles/revert")


def test_what_is_infeasible_is_said_and_the_nearest_taken(guest: Visit) -> None:
    guest.field("x [m]").fill("4.2")
    guest.button("Plan").click()
    problem = guest.page.get_by_role("alert")
    expect(problem).to_contain_text("Tool speed", timeout=PLAN_MS)
    expect(problem).to_contain_text("against a limit of 4 m/s")
    guest.button("Take nearest").click()
    expect(guest.button("Throw on")).to_be_enabled(timeout=PLAN_MS)
    assert 1.5 < float(guest.field("x [m]").input_value()) < 4.2


def test_the_target_is_dragged(guest: Visit) -> None:
    guest.page.wait_for_timeout(1000)  # the scene is there
    x, y = guest.grasp()
    mouse = guest.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 20, y + 10, steps=4)
    with guest.page.expect_response(re.compile(r"/plan\?store=false")) as preview:
        mouse.move(x + 40, y + 20, steps=4)
    assert preview.value.status == 200
    expect(guest.page.get_by_text("Preview while dragging")).to_be_visible()
    expect(guest.button("Throw")).to_be_disabled()
    mouse.up()
    expect(guest.button("Throw on")).to_be_enabled(timeout=PLAN_MS)
    expect(guest.page.get_by_text("Preview while dragging")).to_be_hidden()
    assert guest.field("x [m]").input_value() != "1.2"


def test_a_protective_stop_and_the_way_out_of_it(guest: Visit, stack: PageStack) -> None:
    stack.execute(stack.plan_far_away())
    guest.outcome("To the start")
    stack.fault("protective_stop")
    guest.outcome("Protective stop")
    robots = guest.region("Robots")
    expect(robots).to_contain_text("Clear the protective stop on the pendant, then acknowledge")
    stack.fault("clear")
    guest.button("Acknowledge").click()
    robots.get_by_text("Ready").wait_for(timeout=THROW_MS)
    expect(guest.button("Acknowledge")).to_have_count(0)


def test_a_lost_connection_is_said_and_mended(guest: Visit) -> None:
    guest.context.set_offline(True)
    alert = guest.page.get_by_role("alert")
    expect(alert).to_contain_text("Connection to the service lost", timeout=10_000)
    guest.button("Stop").click()
    expect(alert.filter(has_text="Stop did not get through")).to_contain_text("Use the emergency stop")
    guest.context.set_offline(False)
    expect(alert.filter(has_text="Connection to the service lost")).to_have_count(0, timeout=10_000)


def test_the_token_is_asked_for_where_it_is_needed(stack: PageStack, browser: Browser, tmp_path: Path) -> None:
    port = stack.port + 1 if stack.port < 65535 else stack.port - 1
    tokens = tmp_path / "tokens.toml"
    made = CliRunner().invoke(
        main, ["token", "create", "--name", "page", "--scope", "plan", "--scope", "operate"],
        env={"FLING_TOKENS_FILE": str(tokens)},
    )  # fmt: skip
    assert made.exit_code == 0, made.output
    token = made.output.split()[-1]
    environment = {
        **os.environ, "FLING_CELLS": str(stack.folder), "FLING_DATABASE_URL": f"sqlite:///{stack.folder / 'fling.db'}",
        "FLING_TOKENS_FILE": str(tokens), "FLING_PLANNER_WORKERS": "1",
    }  # fmt: skip
    command = [sys.executable, "-c", "from api.cli import main; main()", "serve", "--port", str(port)]
    with subprocess.Popen(command, env=environment) as service:
        try:
            url = f"http://127.0.0.1:{port}"
            until_answered(url)
            with visit(browser, url) as guest:
                guest.page.get_by_role("textbox", name="Token").fill("wrong")
                guest.button("Use it").click()
                expect(guest.page.get_by_text("not known to the service")).to_be_visible()
                guest.page.get_by_role("textbox", name="Token").fill(token)
                guest.button("Use it").click()
                guest.region("Robots").get_by_text("Ready").wait_for()
                guest.page.reload()  # kept for the tab
                guest.region("Robots").get_by_text("Ready").wait_for()
                assert token not in guest.page.url
        finally:
            service.terminate()


def until_answered(url: str) -> None:
    """Waits until a service listens."""
    deadline = time.monotonic() + LISTENS_S
    with httpx2.Client(trust_env=False) as client:
        while True:
            try:
                client.get(f"{url}/healthz")
            except httpx2.TransportError:
                assert time.monotonic() < deadline
                time.sleep(0.1)
            else:
                return


def test_nothing_keeps_people_out(stack: PageStack, browser: Browser) -> None:
    with visit(browser, stack.url) as guest:
        guest.region("Robots").get_by_text("Ready").wait_for()
        assert guest.barriers() == []
        guest.page.get_by_text("Options", exact=True).click()
        guest.planned()
        assert guest.barriers() == []
        guest.field("x [m]").fill("4.2")
        guest.button("Plan").click()
        guest.button("Take nearest").wait_for(timeout=PLAN_MS)
        assert guest.barriers() == []
        guest.page.get_by_label("Cell", exact=True).select_option("example-real")
        assert guest.barriers() == []
        guest.page.set_viewport_size(PHONE)
        assert guest.barriers() == []
        for path in ("/docs", "/problems", "/problems/infeasible"):
            guest.page.goto(stack.url + path)
            assert guest.barriers() == []


@pytest.mark.parametrize("viewport", [SMALL, PHONE, {"width": 420, "height": 800}])
def test_plan_and_what_came_of_it_are_seen_without_scrolling(
    stack: PageStack, browser: Browser, viewport: dict[str, int]
) -> None:
    with visit(browser, stack.url, viewport=viewport) as guest:
        expect(guest.button("Plan")).to_be_in_viewport(ratio=1.0)
        guest.planned()
        expect(guest.button("Plan")).to_be_in_viewport(ratio=1.0)
        summary = guest.page.locator(".summary").bounding_box()
        plan = guest.button("Plan").bounding_box()
        top = guest.page.locator(".top").bounding_box()
        assert summary is not None
        assert plan is not None
        assert top is not None
        assert top["y"] + top["height"] <= summary["y"]
        assert summary["y"] + summary["height"] <= plan["y"]


def test_a_report_keeps_nobody_out(stack: PageStack, browser: Browser, tmp_path: Path) -> None:
    file = tmp_path / "report.html"
    id = stack.plan_far_away()
    made = CliRunner().invoke(main, ["report", "--plan", id, "--url", stack.url, "-o", str(file)])
    assert made.exit_code == 0, made.output
    with visit(browser, file.as_uri()) as guest:
        guest.page.wait_for_function("report.scene.statistics.draw_calls > 0")
        assert guest.barriers() == []
        with guest.page.expect_download() as saved:
            guest.button("Save Velocity as PNG").click()
        assert saved.value.path().read_bytes().startswith(PNG)
        with guest.page.expect_download() as saved:
            guest.button("SVG").first.click()
        assert "<title>Planned throw" in saved.value.path().read_text()


def test_an_example_of_the_openapi_page_runs(stack: PageStack, browser: Browser) -> None:
    with visit(browser, f"{stack.url}/docs") as guest:
        guest.page.get_by_text("List cells").click()
        guest.button("Run").click()
        expect(guest.page.get_by_label("Answer", exact=True)).to_contain_text("200 application/json")
        expect(guest.page.get_by_label("Answer", exact=True)).to_contain_text('"ur5e-sim"')


def test_a_map_lies_over_the_floor_and_a_click_plans_there(guest: Visit) -> None:
    guest.button("Show map").click()
    shown = guest.region("Throwability map")
    shown.get_by_label("Landing cells").select_option("0.5")
    guest.button("(Make a map|Go on)").click()
    shown.get_by_text(re.compile(r"^[1-9]\d* of \d+ landing cells")).wait_for(timeout=MAP_MS)  # it sharpens
    guest.button("Cancel map").click()
    shown.get_by_text(re.compile("^Ended after [1-9]")).wait_for(timeout=MAP_MS)
    shown.get_by_label("Colour").select_option("reason")
    expect(shown.get_by_role("list").or_(shown.get_by_text("No landing cell is refused"))).to_be_visible()
    x, y = guest.on_the_map()
    guest.page.mouse.click(x, y)
    expect(guest.field("x [m]")).not_to_have_value("1.2")
    answer = guest.armed().or_(guest.button("Take nearest"))
    answer.or_(guest.page.get_by_role("alert")).first.wait_for(timeout=PLAN_MS)
    guest.button("Hide map").click()
    expect(shown.get_by_label("Colour")).to_have_count(0)


def test_a_map_of_another_extent_goes_on(guest: Visit, stack: PageStack) -> None:
    """As `fling map` begins it, and its user ends it."""
    wanted = {"extent_m": [0.2, 2.2, -1.1, 0.9], "plane_z_m": 0.1, "resolution_m": 0.5, "robust": True}
    begun = stack.http.post("/cells/ur5e-sim/map", json=wanted).raise_for_status().json()
    try:
        stack.http.post(f"/cells/ur5e-sim/map/cancel?id={begun['id']}").raise_for_status()
        guest.button("Show map").click()
        guest.button("Go on").wait_for(timeout=MAP_MS)  # its runner has ended
        with guest.page.expect_response(lambda answer: answer.request.method == "POST") as answer:
            guest.button("Go on").click()
        assert answer.value.json()["id"] == begun["id"]
    finally:
        stack.http.post(f"/cells/ur5e-sim/map/cancel?id={begun['id']}")


def test_a_real_arm_is_not_offered_where_it_would_be_refused(stack: PageStack, browser: Browser) -> None:
    with visit(browser, stack.url) as guest:
        guest.page.get_by_label("Cell", exact=True).select_option("example-real")
        expect(guest.page.get_by_role("banner").get_by_text("Real arm", exact=True)).to_be_visible()
        guest.button("Plan").click()
        guest.page.locator(".summary.valid").wait_for(timeout=PLAN_MS)
        expect(guest.button("Throw on example-real")).to_be_disabled()
        expect(guest.page.locator(".why")).to_contain_text("executes on simulated cells only")
        runs = stack.http.get("/executions").json()["executions"]
        assert [run for run in runs if run["cell"] == "example-real"] == []

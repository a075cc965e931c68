"""The page as a person throws with it: Chromium on a running `fling up`. What moves no arm is tested in `tests/web`."""

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
from tests.system.browser import CHROMIUM, MISSING, PLAN_MS, THROW_MS, PageStack, Visit, launch, visit

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

LISTENS_S = 90.0  # [s] on a busy machine
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


@pytest.mark.slow
def test_three_js_is_asked_for_after_the_form_is_painted(guest: Visit) -> None:
    painted_ms, asked_ms = guest.page.wait_for_function(PAINTED_AND_ASKED).json_value()
    assert painted_ms < asked_ms


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_throw_of_the_command_line_is_seen_and_stopped_by_key(guest: Visit, stack: PageStack) -> None:
    stack.execute(stack.plan_far_away())
    guest.outcome("Moved as planned")
    command = [sys.executable, "-c", "from api.cli import main; main()", "throw", "1.2", "0.3", "0", "--url", stack.url]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as thrower:
        guest.outcome("To the start")
        guest.page.keyboard.press("Escape")
        guest.outcome("Stopped on request")
        assert thrower.wait(THROW_MS / 1000) == 4


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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

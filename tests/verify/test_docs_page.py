"""Every example of the OpenAPI page runs, as a reader presses its button, beside a running `fling up`."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator

import pytest
from playwright.sync_api import Locator, sync_playwright

from tests.system.browser import CHROMIUM, MISSING, Visit, launch, visit

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

ANSWER_MS = 180_000  # [ms] a plan on a busy machine
BUSY_S = 180.0  # [s] until what an example before began has ended: a throw keeps its robot busy
AGAIN_MS = 500
EXAMPLES_MIN = 45  # of 40 calls; fewer: the page has lost some


@pytest.fixture
def reader(environment: dict[str, str]) -> Iterator[Visit]:
    """Somebody who reads the page."""
    with sync_playwright() as playwright:
        browser = launch(playwright)
        with visit(browser, f"{environment['FLING_URL']}/docs") as opened:
            opened.page.set_default_timeout(ANSWER_MS)
            yield opened
        browser.close()


def test_every_example_runs(reader: Visit):
    calls = reader.page.locator("details.call")
    calls.first.wait_for()
    answers = [answer for call in sorted(calls.all(), key=when) for answer in answered(call)]
    assert [answer for answer in answers if not is_success(answer)] == []
    assert len(answers) >= EXAMPLES_MIN


def when(call: Locator) -> int:
    """Returns when a call has its turn: what others name, what makes something, what joins, reads, ends, forgets it.

    An execution that is ended before it began has no recording: what ends one comes after what reads.
    """
    summary = call.locator("summary").first.inner_text()
    if "/targets" in summary and summary.startswith("POST"):
        return -1
    if joins(summary):
        return 1
    if "/abort" in summary or "/cancel" in summary:
        return 3
    return {"GET": 2, "DELETE": 4}.get(summary.split()[0], 0)


def answered(call: Locator) -> list[str]:
    """Returns the answers to all examples of a call, each after what it is called."""
    name = call.locator("summary").first.inner_text()
    call.locator("summary").first.click()
    call.get_by_role("button", name="Run").wait_for()
    choice = call.get_by_role("combobox", name="Example")
    count = max(1, choice.locator("option").count())
    found = []
    for number in range(count):
        if count > 1:
            choice.select_option(index=number)
        found.append(f"{name} {number}: {answer_of(call, 0.0 if joins(name) else BUSY_S)}")
    call.locator("summary").first.click()
    return found


def answer_of(call: Locator, busy_s: float) -> str:
    """Returns the answer to an example; while it is refused because of one before, it is tried again so long."""
    deadline = time.monotonic() + busy_s
    while True:
        call.get_by_role("button", name="Run").click()
        shown = call.get_by_label("Answer", exact=True).filter(has_text=re.compile(r"^\d{3} "))
        shown.wait_for()
        answer = shown.inner_text()
        if not answer.startswith(("404", "409")) or time.monotonic() > deadline:
            return answer
        call.page.wait_for_timeout(AGAIN_MS)


def joins(name: str) -> bool:
    """Returns whether a call asks to join a running motion: none runs here, and the newest plan begins at rest."""
    return "/replace" in name or "/retarget" in name


def is_success(answer: str) -> bool:
    return re.search(r"\d: 2\d\d ", answer) is not None or (joins(answer) and ": 409 " in answer)

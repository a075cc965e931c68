"""A plan of passages on the page: its flags on the time line, and what an execution says of its outputs."""

from __future__ import annotations

from typing import Any

import pytest
from playwright.sync_api import expect

from tests.system.browser import CHROMIUM, MISSING, Visit
from tests.web.conftest import METRICS, Desk, posted

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

SOON_MS = 15_000


def over(number: int) -> dict[str, Any]:
    """Returns a passage over a part, with a flash."""
    flash = {"output": "standard_digital", "index": number}
    pose = {"position": [0.5, 0.12 * number - 0.12, 0.35], "rotation_vector": [3.14159, 0.0, 0.0]}
    state = {"kind": "pose", "pose": pose, "twist": {"linear": [0.0, 0.8, 0.0], "angular": [0.0, 0.0, 0.0]}}
    outputs = [{**flash, "level": True}, {**flash, "level": False, "offset_s": 0.02}]
    return {"name": f"part {number}", "state": state, "outputs": outputs}


@pytest.fixture(scope="module")
def row_id(served: Desk) -> str:
    """Id of a plan over two parts."""
    return posted(served, {"passages": [over(0), over(1)]})


def test_the_time_line_shows_what_happens_in_passing(guest: Visit, desk: Desk, row_id: str) -> None:
    guest.page.goto(f"{desk.url}/#/plan/{row_id}")
    flags = guest.region("Timeline").get_by_role("list", name="Passages and outputs").get_by_role("button")
    expect(flags).to_have_count(6, timeout=SOON_MS)
    expect(flags.nth(0)).to_contain_text("part 0")
    expect(flags.nth(1)).to_contain_text("standard digital 0 on")
    expect(flags.nth(3)).to_contain_text("part 1")
    at_s = flags.nth(3).locator(".value").inner_text().removesuffix(" s")
    flags.nth(3).click()
    expect(guest.region("Timeline").get_by_role("slider")).to_have_attribute("aria-valuetext", f"{at_s} s")
    expect(guest.page.locator("body")).to_contain_text("Passes part 0 after")
    expect(guest.button("Throw on ur5e-sim: a motion through part 0, part 1")).to_be_enabled()
    guest.field("Tool at the release x [m]").fill("0.52")
    expect(guest.button("Throw on")).to_be_disabled()  # the form asks for something else now
    assert guest.complaints == []


def test_an_execution_says_when_its_outputs_changed(guest: Visit, desk: Desk, row_id: str) -> None:
    edge = {"passage": "part 0", "output": "standard_digital", "index": 0, "level": True}
    seen = [
        {**edge, "command_time_s": 0.98, "edge_time_s": 1.0004, "edge_late_s": 0.0004},
        {**edge, "level": False, "command_time_s": 1.0, "edge_time_s": None, "edge_late_s": None},
    ]
    id = desk.execution(row_id, metrics={**METRICS, "released": False, "outputs": seen})
    guest.page.goto(f"{desk.url}/#/execution/{id}")
    guest.page.reload()
    execution = guest.region("Execution")
    expect(execution).to_contain_text("part 0: standard digital 0 on", timeout=SOON_MS)
    expect(execution).to_contain_text("after 1.000 s, 0.4 ms late")
    expect(execution).to_contain_text("not seen")
    assert guest.complaints == []

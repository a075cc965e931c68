"""The page until something is thrown: planning, refusals, maps, reports, screens, and people with disabilities."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest
from click.testing import CliRunner
from playwright.sync_api import Browser, expect

from api.cli import main
from tests.system.browser import CHROMIUM, MISSING, PLAN_MS, SMALL, Visit, visit
from tests.web.conftest import CELL, Desk

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

PHONE = {"width": 390, "height": 844}
MAP_MS = 90_000  # [ms] until the first landing cells are known, on a busy machine
ASKED_MS = 30_000  # [ms] until the scene has been asked for again, on a busy machine
PNG = b"\x89PNG\r\n"


@pytest.fixture
def http(desk: Desk) -> Iterator[httpx2.Client]:
    """What another client of the service says."""
    with httpx2.Client(base_url=desk.url, trust_env=False, timeout=PLAN_MS / 1000) as client:
        yield client


@pytest.mark.slow
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


def test_text_that_is_no_number_is_named(guest: Visit) -> None:
    guest.field("z [m]").fill("ground")
    guest.button("Plan").click()
    expect(guest.page.get_by_role("alert")).to_contain_text('target 3: "ground" is not a number')


def test_what_is_infeasible_is_said_and_the_nearest_taken(guest: Visit) -> None:
    guest.field("x [m]").fill("4.2")
    guest.button("Plan").click()
    problem = guest.page.get_by_role("alert")
    expect(problem).to_contain_text("Tool speed", timeout=PLAN_MS)
    expect(problem).to_contain_text("against a limit of 4 m/s")
    guest.button("Take one that works").click()
    expect(guest.button("Throw on")).to_be_enabled(timeout=PLAN_MS)
    assert 1.5 < float(guest.field("x [m]").input_value()) < 4.2


@pytest.mark.slow
def test_the_target_is_dragged(viewer: Visit) -> None:
    x, y = viewer.grasp()
    mouse = viewer.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + 20, y + 10, steps=4)
    with viewer.page.expect_response(re.compile(r"/plan\?store=false")) as preview:
        mouse.move(x + 40, y + 20, steps=4)
    assert preview.value.status == 200
    expect(viewer.page.get_by_text("Preview while dragging")).to_be_visible()
    expect(viewer.button("Throw")).to_be_disabled()
    mouse.up()
    expect(viewer.button("Throw on")).to_be_enabled(timeout=PLAN_MS)
    expect(viewer.page.get_by_text("Preview while dragging")).to_be_hidden()
    assert viewer.field("x [m]").input_value() != "1.2"


@pytest.mark.slow
def test_a_lost_connection_is_said_and_mended(guest: Visit) -> None:
    guest.context.set_offline(True)
    alert = guest.page.get_by_role("alert")
    expect(alert).to_contain_text("Connection to the service lost", timeout=10_000)
    guest.button("Stop").click()
    expect(alert.filter(has_text="Stop did not get through")).to_contain_text("Use the emergency stop")
    guest.context.set_offline(False)
    expect(alert.filter(has_text="Connection to the service lost")).to_have_count(0, timeout=10_000)


@pytest.mark.slow
def test_a_scene_that_does_not_arrive_is_asked_for_again(desk: Desk, browser: Browser) -> None:
    with visit(browser, "about:blank") as guest:
        guest.url = desk.url
        guest.page.route(re.compile(r"/scene-[^/]*\.js$"), lambda route: route.abort(), times=1)
        guest.page.goto(desk.url)
        scene = guest.region("Scene")
        scene.get_by_text("The scene did not load").wait_for(timeout=ASKED_MS)
        scene.get_by_text("This browser draws no moving scene").wait_for(timeout=ASKED_MS)  # it is without WebGL
        expect(scene.get_by_text("The scene did not load")).to_have_count(0)


def test_nothing_keeps_people_out(desk: Desk, drawing_browser: Browser) -> None:
    with visit(drawing_browser, desk.url) as guest:
        guest.region("Robots").get_by_text("Ready").wait_for()
        assert guest.barriers() == []
        guest.page.get_by_text("Options", exact=True).click()
        guest.planned()
        assert guest.barriers() == []
        guest.field("x [m]").fill("4.2")
        guest.button("Plan").click()
        guest.button("Take one that works").wait_for(timeout=PLAN_MS)
        assert guest.barriers() == []
        guest.page.get_by_label("Cell", exact=True).select_option("real")
        assert guest.barriers() == []
        guest.page.set_viewport_size(PHONE)
        assert guest.barriers() == []
        for path in ("/docs", "/problems", "/problems/infeasible"):
            guest.page.goto(desk.url + path)
            assert guest.barriers() == []


@pytest.mark.parametrize("viewport", [SMALL, PHONE, {"width": 420, "height": 800}])
def test_plan_and_what_came_of_it_are_seen_without_scrolling(
    desk: Desk, drawing_browser: Browser, viewport: dict[str, int]
) -> None:
    with visit(drawing_browser, desk.url, viewport=viewport) as guest:
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


def test_a_report_keeps_nobody_out(desk: Desk, drawing_browser: Browser, plan_id: str, tmp_path: Path) -> None:
    file = tmp_path / "report.html"
    made = CliRunner().invoke(main, ["report", "--plan", plan_id, "--url", desk.url, "-o", str(file)])
    assert made.exit_code == 0, made.output
    with visit(drawing_browser, file.as_uri()) as guest:
        guest.page.wait_for_function("() => report.scene.statistics.draw_calls > 0")
        assert guest.barriers() == []
        with guest.page.expect_download() as saved:
            guest.button("Save Velocity as PNG").click()
        assert saved.value.path().read_bytes().startswith(PNG)
        with guest.page.expect_download() as saved:
            guest.button("SVG").first.click()
        assert "<title>Planned throw" in saved.value.path().read_text()


@pytest.mark.slow
def test_an_example_of_the_openapi_page_runs(desk: Desk, browser: Browser) -> None:
    with visit(browser, f"{desk.url}/docs") as guest:
        guest.page.get_by_text("List cells").click()
        guest.button("Run").click()
        expect(guest.page.get_by_label("Answer", exact=True)).to_contain_text("200 application/json")
        expect(guest.page.get_by_label("Answer", exact=True)).to_contain_text('"ur5e-sim"')


def test_a_map_lies_over_the_floor_and_a_click_plans_there(viewer: Visit) -> None:
    viewer.button("Show map").click()
    shown = viewer.region("Throwability map")
    shown.get_by_label("Landing cells").select_option("0.5")
    viewer.button("(Make a map|Go on)").click()
    shown.get_by_text(re.compile(r"^[1-9]\d* of \d+ landing cells")).wait_for(timeout=MAP_MS)  # it sharpens
    viewer.button("Cancel map").click()
    shown.get_by_text(re.compile("^Ended after [1-9]")).wait_for(timeout=MAP_MS)
    shown.get_by_label("Colour").select_option("reason")
    expect(shown.get_by_role("list").or_(shown.get_by_text("No landing cell is refused"))).to_be_visible()
    x, y = viewer.on_the_map()
    viewer.page.mouse.click(x, y)
    expect(viewer.field("x [m]")).not_to_have_value("1.2")
    answer = viewer.armed().or_(viewer.button("Take one that works"))
    answer.or_(viewer.page.get_by_role("alert")).first.wait_for(timeout=PLAN_MS)
    viewer.button("Hide map").click()
    expect(shown.get_by_label("Colour")).to_have_count(0)


@pytest.mark.slow
def test_a_map_of_another_extent_goes_on(guest: Visit, http: httpx2.Client) -> None:
    """As `fling map` begins it, and its user ends it."""
    wanted = {"extent_m": [0.2, 2.2, -1.1, 0.9], "plane_z_m": 0.1, "resolution_m": 0.5, "robust": True}
    begun = http.post(f"/cells/{CELL}/map", json=wanted).raise_for_status().json()
    try:
        http.post(f"/cells/{CELL}/map/cancel?id={begun['id']}").raise_for_status()
        guest.button("Show map").click()
        guest.button("Go on").wait_for(timeout=MAP_MS)  # its runner has ended
        with guest.page.expect_response(lambda answer: answer.request.method == "POST") as answer:
            guest.button("Go on").click()
        assert answer.value.json()["id"] == begun["id"]
    finally:
        http.post(f"/cells/{CELL}/map/cancel?id={begun['id']}")

"""What the page draws and how it is filled in: time, curves, numbers, fields, banners, small screens, no WebGL."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from playwright.sync_api import Browser, expect

from api.cli import main
from tests.system.browser import CHROMIUM, MISSING, PLAN_MS, Visit, visit
from tests.web.conftest import HOME, Desk, planned

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason=MISSING)

PHONE = {"width": 390, "height": 844}
SOON_MS = 15_000
SAME_PX = 2.0  # [px] rounding of the layout


RED = """() => {
  const probe = document.createElement("i");
  probe.style.color = "var(--bad)";
  document.body.append(probe);
  const colour = getComputedStyle(probe).color;
  probe.remove();
  return colour;
}"""
PLACES = """(svg, texts) => texts.map((text) => {
  const box = [...svg.querySelectorAll("text")].find((label) => label.textContent === text).getBoundingClientRect();
  return [box.x, box.y];
})"""
PLACE_IN_FORM = """(field) => {
  const form = field.form;
  return field.getBoundingClientRect().top - form.getBoundingClientRect().top + form.scrollTop;
}"""


@pytest.mark.slow
def test_time_line_and_curves_share_their_axis(guest: Visit) -> None:
    planned(guest)
    timeline = guest.region("Timeline")
    slider = timeline.get_by_role("slider")
    plot = timeline.locator(".u-over")
    expect(plot).to_be_visible(timeout=SOON_MS)
    end = float(slider.get_attribute("max") or 0.0)
    for share in (0.0, 0.5, 1.0):
        slider.fill(f"{share * end:.3f}")
        area = plot.bounding_box()
        track = slider.bounding_box()
        cursor = timeline.locator(".chart-cursor").bounding_box()
        assert area is not None
        assert track is not None
        assert cursor is not None
        thumb = track["x"] + 8.0 + share * (track["width"] - 16.0)
        assert abs(cursor["x"] + cursor["width"] / 2 - thumb) < SAME_PX + area["width"] * 0.001 / end
    assert abs(area["x"] + area["width"] - (track["x"] + track["width"] - 8.0)) < SAME_PX


@pytest.mark.slow
def test_time_is_zoomed_about_the_cursor(guest: Visit) -> None:
    planned(guest)
    timeline = guest.region("Timeline")
    slider = timeline.get_by_role("slider")
    end = float(slider.get_attribute("max") or 0.0)
    slider.fill(f"{end / 2:.3f}")
    guest.button("Show less of the time").click()
    first, last = (float(slider.get_attribute(name) or 0.0) for name in ("min", "max"))
    assert last - first == pytest.approx(end / 2, abs=0.01)
    assert first < end / 2 < last
    guest.button("Show more of the time").click()
    expect(slider).to_have_attribute("min", "0")
    expect(guest.button("Show more of the time")).to_be_disabled()


@pytest.mark.slow
def test_a_chart_tells_its_values_under_the_pointer(guest: Visit) -> None:
    planned(guest)
    timeline = guest.region("Timeline")
    timeline.get_by_role("button", name="Tool speed").click(timeout=SOON_MS)
    readout = timeline.locator(".chart-readout")
    expect(readout).to_be_hidden()
    plot = timeline.locator(".u-over").bounding_box()
    end = float(timeline.get_by_role("slider").get_attribute("max") or 0.0)
    assert plot is not None
    guest.page.mouse.move(plot["x"] + plot["width"] * 0.1 / end, plot["y"] + 50)  # 0.1 s
    expect(readout).to_be_visible()
    told = re.fullmatch(r"0\.(\d{3}) s, m/s\s*tool centre point (\S+)\s*flange \S+", readout.inner_text())
    assert told is not None
    assert abs(int(told[1]) - 100) <= 2
    timeline.get_by_role("slider").fill(f"0.{told[1]}")
    shown = timeline.locator(".legend .value").first.inner_text()
    assert float(shown) == pytest.approx(float(told[2]), rel=6e-3)  # three digits there, four here
    guest.page.mouse.move(plot["x"] + plot["width"] - 5, plot["y"] + 50)  # the arm has come to rest: nothing there
    expect(readout).to_be_hidden()


@pytest.mark.slow
def test_the_keyboard_plays_and_steps_by_ticks(guest: Visit) -> None:
    planned(guest)
    page = guest.page
    slider = guest.region("Timeline").get_by_role("slider")
    slider.fill("0.1")
    page.locator("body").click(position={"x": 640, "y": 30})  # no control has the keys
    page.keyboard.press("ArrowRight")
    expect(slider).to_have_value("0.102")
    page.keyboard.press("Shift+ArrowLeft")
    expect(slider).to_have_value("0.082")
    page.keyboard.press("Space")
    expect(guest.button("Play").or_(guest.button("Pause"))).to_be_visible()
    expect(slider).not_to_have_value("0.082")
    guest.field("x [m]").press("End")
    before = slider.input_value()
    guest.field("x [m]").press("ArrowLeft")  # a field's own
    guest.field("x [m]").press("Space")
    assert guest.field("x [m]").input_value() == "1. 2"
    assert slider.input_value() >= before  # it may play still; nothing steps it back


@pytest.mark.slow
def test_the_clock_does_not_run_beyond_what_is_shown(guest: Visit, desk: Desk, thrown_id: str) -> None:
    id = desk.begun(thrown_id, "streaming")
    guest.outcome("Throwing")
    clock = guest.region("Timeline").locator(".clock")
    expect(clock).to_have_text(re.compile("^0.00 / "), timeout=SOON_MS)  # its plan is there
    still = {"positions": HOME, "velocities": [0.0] * 6, "planned_positions": HOME, "tcp_speed_m_s": 0.0}
    desk.store.add_event(id, "telemetry", {"clock_s": 9.0, **still})
    expect(clock).not_to_have_text(re.compile("^0.00"), timeout=SOON_MS)
    shown, end = clock.inner_text().removesuffix(" s").split(" / ")
    assert shown == end


@pytest.mark.slow
def test_curves_are_saved_as_numbers(guest: Visit) -> None:
    planned(guest)
    timeline = guest.region("Timeline")
    timeline.get_by_role("button", name="Velocity").click(timeout=SOON_MS)
    with guest.page.expect_download() as saved:
        guest.button("Save these curves as CSV").click()
    head, first, *rest = Path(saved.value.path()).read_text().splitlines()
    assert saved.value.suggested_filename == "fling-joint_velocity.csv"
    assert head.startswith("time [s],Base [rad/s],Shoulder [rad/s],")
    assert [float(value) for value in first.split(",")] == pytest.approx([0.0] * 7, abs=1e-9)
    assert float(rest[0].split(",")[0]) == pytest.approx(0.002)


@pytest.mark.slow
def test_a_limit_that_holds_does_not_read_as_exceeded(guest: Visit) -> None:
    planned(guest)
    certificate = guest.region("Certificate")
    expect(certificate.get_by_role("button", name="Joint jerk")).to_contain_text(re.compile("[0-9.]+ ≤ 500"))
    near = certificate.get_by_role("button", name=re.compile("singularity|floor|links", re.IGNORECASE)).first
    expect(near).to_contain_text(re.compile("[0-9.]+ ≥ [0-9.]+"))
    fills = certificate.locator(".bar-row .meter .left").evaluate_all(
        "(bars) => bars.map((bar) => getComputedStyle(bar).fill)"
    )
    bad = guest.page.evaluate(RED)
    assert fills
    assert bad not in fills


def test_odds_without_knowledge_are_no_percentage(guest: Visit) -> None:
    planned(guest)
    summary = guest.page.locator(".summary")
    expect(summary).to_contain_text("How likely it hits is not known")
    expect(summary).not_to_contain_text("probability")


def test_words_have_no_underscores(guest: Visit, desk: Desk, thrown_id: str) -> None:
    planned(guest)
    desk.execution(thrown_id)
    guest.past("Thrown as planned").get_by_role("button").first.click(timeout=SOON_MS)
    execution = guest.region("Execution")
    execution.get_by_text("Everything that was measured").click()
    expect(execution).to_contain_text("Joint off the plan")
    for name in ("Execution", "Certificate", "Timeline", "Scene"):
        shown = guest.region(name).inner_text()
        assert not re.search(r"\b[a-z]+_[a-z]+", shown), shown


def test_a_wrong_number_marks_its_field(guest: Visit) -> None:
    guest.field("z [m]").fill("ground")
    guest.button("Plan").click()
    expect(guest.field("z [m]")).to_have_attribute("aria-invalid", "true")
    expect(guest.field("z [m]")).to_be_focused()
    expect(guest.field("x [m]")).to_have_attribute("aria-invalid", "false")
    guest.field("z [m]").fill("0")
    expect(guest.field("z [m]")).to_have_attribute("aria-invalid", "false")


def test_a_field_that_the_service_refuses_is_marked(guest: Visit) -> None:
    guest.page.locator("form details.options").first.evaluate("(element) => (element.open = true)")
    guest.field("Time limit [s]").fill("-3")
    guest.page.locator("form details.options").first.evaluate("(element) => (element.open = false)")
    guest.button("Plan").click()
    expect(guest.field("Time limit [s]")).to_have_attribute("aria-invalid", "true", timeout=SOON_MS)
    expect(guest.field("Time limit [s]")).to_be_visible()  # its options were opened


ABANDONED = """async () => /plans_total.*"abandoned".* 1/.test(await (await fetch("/metrics")).text())"""


def test_a_search_is_told_while_it_goes_on_and_can_be_cancelled(guest: Visit) -> None:
    guest.field("x [m]").fill("2.3")
    guest.field("z [m]").fill("0")
    guest.button("Plan").click()
    expect(guest.page.locator(".search")).to_contain_text(re.compile(r"candidates? tried"), timeout=PLAN_MS)
    guest.button("Cancel").click()
    expect(guest.page.get_by_text(re.compile(r"^Cancelled after [\d.]+ s"))).to_be_visible()
    expect(guest.page.locator(".search")).to_have_count(0)
    assert guest.page.locator(".problem").count() == 0
    expect(guest.button("Plan")).to_have_attribute("aria-disabled", "false")
    guest.page.wait_for_function(ABANDONED)


@pytest.mark.slow
def test_nothing_jumps_when_something_is_said(guest: Visit, desk: Desk) -> None:
    before = guest.field("x [m]").evaluate(PLACE_IN_FORM)
    planned(guest)
    assert guest.field("x [m]").evaluate(PLACE_IN_FORM) == pytest.approx(before)
    desk.executor.fault = {"outcome": "late", "reason": "five ticks were lost", "at": 1.0}
    expect(guest.page.get_by_role("alert").filter(has_text="five ticks")).to_be_visible(timeout=SOON_MS)
    scene = "(scene) => scene.getBoundingClientRect().top + scrollY"
    assert guest.page.locator(".scene").evaluate(scene) == pytest.approx(56.0, abs=1.0)  # below the header, as before


@pytest.mark.slow
def test_without_webgl_two_views_are_drawn_from_the_start(guest: Visit) -> None:
    views = guest.region("Scene").locator(".drawn-views svg")
    expect(views).to_have_count(2, timeout=SOON_MS)
    expect(views.first).to_contain_text("Arm of ur5e")
    planned(guest)
    expect(views.first).to_contain_text("landing after", timeout=SOON_MS)
    before = views.first.inner_html()
    guest.region("Timeline").get_by_role("slider").fill("0.1")
    expect(views.first).not_to_have_text(before)
    expect(guest.region("Scene")).to_contain_text("two views instead")


@pytest.mark.slow
def test_axes_are_drawn_and_named(guest: Visit) -> None:
    views = guest.region("Scene").locator(".drawn-views svg")
    for text in ("x", "y", "1 m", "−1 m"):
        expect(views.nth(1).get_by_text(text, exact=True).first).to_be_visible(timeout=SOON_MS)
    for _ in range(30):
        guest.page.wait_for_timeout(500)  # the views are laid out anew once the arm is known
        (right, _), (_, up), origin = views.nth(1).evaluate(PLACES, ["x", "y", "z"])
        if right > origin[0]:
            break
    assert right > origin[0]  # seen from above, x points to the right
    assert up < origin[1]  # and y upwards


@pytest.mark.slow
def test_the_scene_is_zoomed_and_keeps_the_view_of_a_person(viewer: Visit) -> None:
    viewer.page.wait_for_timeout(1000)
    scene = viewer.region("Scene")
    before = scene.locator("canvas").screenshot()
    viewer.button("Zoom in").click()
    viewer.page.wait_for_timeout(1500)
    assert scene.locator("canvas").screenshot() != before


@pytest.mark.slow
def test_on_a_phone_the_throw_is_above_the_sheet(desk: Desk, drawing_browser: Browser) -> None:
    with visit(drawing_browser, desk.url, viewport=PHONE) as guest:
        guest.region("Robots").get_by_text("Ready").wait_for()
        guest.page.wait_for_timeout(1500)
        _, y = guest.middle_of("grab")
        sheet = guest.page.locator(".panel.request").bounding_box()
        cameras = guest.page.locator(".cameras").bounding_box()
        assert sheet is not None
        assert cameras is not None
        assert y < min(sheet["y"], cameras["y"])


@pytest.mark.slow
def test_on_a_phone_the_sheet_drops_once_something_is_thrown(desk: Desk, browser: Browser) -> None:
    with visit(browser, desk.url, viewport=PHONE) as guest:
        guest.region("Robots").get_by_text("Ready").wait_for()
        planned(guest)
        guest.page.evaluate("scrollTo(0, 300)")
        guest.button("Throw on").click()
        guest.page.wait_for_function("() => scrollY === 0")


@pytest.mark.slow
def test_a_report_without_webgl_has_two_drawn_views(
    desk: Desk, browser: Browser, thrown_id: str, tmp_path: Path
) -> None:
    file = tmp_path / "report.html"
    made = CliRunner().invoke(main, ["report", "--plan", thrown_id, "--url", desk.url, "-o", str(file)])
    assert made.exit_code == 0, made.output
    with visit(browser, file.as_uri()) as guest:
        views = guest.page.locator(".drawn-views svg")
        expect(views).to_have_count(2, timeout=SOON_MS)
        expect(views.first).to_contain_text("landing after")
        assert guest.barriers() == []


@pytest.mark.slow
def test_on_a_phone_a_plan_is_one_line_until_more_is_asked(desk: Desk, browser: Browser) -> None:
    with visit(browser, desk.url, viewport=PHONE) as guest:
        guest.region("Robots").get_by_text("Ready").wait_for()
        planned(guest)
        guest.page.locator("form details.options").first.evaluate("(element) => (element.open = false)")
        summary = guest.page.locator(".summary")
        expect(summary.get_by_text("How likely it hits")).to_be_hidden()
        summary.get_by_text("Timing and odds").click()
        expect(summary.get_by_text("How likely it hits")).to_be_visible()

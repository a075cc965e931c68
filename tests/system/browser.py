"""A browser on a running service: Debian's Chromium, watched for errors and for requests to other hosts."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Locator, Page, Playwright, Request

from executor.robot import simulator_client
from tests.system.test_over_http import ROOT, Up

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
MISSING = "CHROMIUM IS MISSING: the page is not tested; apt-get install chromium"
# No traffic of the browser's own.
QUIET_FLAGS = [
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
FLAGS = [  # software rendering
    *QUIET_FLAGS,
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
]
PLAN_MS = 30_000  # [ms] a busy machine plans slowly
THROW_MS = 60_000
SMALL = {"width": 1024, "height": 700}  # [px] drawn without a graphics processor
TABS_MAX = 80  # controls on the page, and more
STEP_PX = 12  # [px] a handle is taken within 14
DRAWN_S = 30.0  # [s] until the scene is drawn, on a busy machine
LOOK_MS = 200  # [ms] between two looks for something in it
# Feels for it inside the page: a round trip for each of a thousand places takes minutes.
FIND_POINTER = """(canvas, [step, pointer]) => {
  const { left, top, right, bottom } = canvas.getBoundingClientRect();
  for (let y = bottom - step; y > top; y -= step) // the floor before what stands on it
    for (let x = left + step; x < right; x += step) {
      if (document.elementFromPoint(x, y) !== canvas) continue;
      canvas.dispatchEvent(new PointerEvent("pointermove", { clientX: x, clientY: y }));
      if (canvas.style.cursor === pointer) return [x, y];
    }
  return null;
}"""
FIND_MIDDLE = """(canvas, [step, pointer]) => {
  const { left, top, right, bottom } = canvas.getBoundingClientRect();
  const found = [];
  for (let y = top + step; y < bottom; y += step)
    for (let x = left + step; x < right; x += step) {
      if (document.elementFromPoint(x, y) !== canvas) continue;
      canvas.dispatchEvent(new PointerEvent("pointermove", { clientX: x, clientY: y }));
      if (canvas.style.cursor === pointer) found.push([x, y]);
    }
  const sum = found.reduce(([a, b], [x, y]) => [a + x, b + y], [0, 0]);
  return found.length ? sum.map((value) => value / found.length) : null;
}"""
REFUSED = "Failed to load resource"  # Chromium's own word for a status of 400 and up, or for no answer
HARMLESS_IMPACTS = (None, "minor", "moderate")
AXE = Axe()
LIGHT = {"resultTypes": ["violations"]}
DARK = {**LIGHT, "runOnly": ["color-contrast"]}  # the rest does not depend on colours


class PageStack(Up):
    """A running `fling up` whose arm approaches slowly, and the faults of its simulated controller."""

    def __init__(self, folder: Path) -> None:
        shutil.copy(ROOT / "cells" / "example-real.toml", folder)
        os.environ["FLING_APPROACH_PACE"] = "0.25"  # so that a busy browser sees it, too
        try:
            super().__init__(folder)
        finally:
            del os.environ["FLING_APPROACH_PACE"]
        self.folder = folder
        self.url = f"http://127.0.0.1:{self.port}"
        match = re.search(r'host = "(127[^"]*)"', (folder / "ur5e-sim.toml").read_text())
        assert match is not None
        self.host = match[1]

    def fault(self, name: str, **parameters: Any) -> None:
        """Injects a fault into the simulated controller."""
        simulator_client.request(self.host, "fault", name=name, **parameters)

    def plan_far_away(self) -> str:
        """Plans a move that starts and ends seconds away from where the arm is now. Returns its id."""
        turn = -1.2 if self.robot()["positions"][0] > 0.0 else 1.2
        far = [turn, -1.57, 1.57, -1.57, -1.57, 0.0]
        release = {"kind": "joint", "positions": [turn + 0.03, *far[1:]], "velocities": [0.0] * 6}
        request = {"start": {"positions": far}, "release": release, "backend": "ruckig"}
        return self.http.post("/plan", json=request).raise_for_status().json()["id"]

    def robot(self) -> dict[str, Any]:
        """Returns the live state of the robot."""
        return self.http.get("/cells/ur5e-sim/state").raise_for_status().json()["robot"]

    def execute(self, plan_id: str) -> str:
        """Queues an execution, as another client does; returns its id."""
        return self.http.post("/execute", json={"plan_id": plan_id}).raise_for_status().json()["id"]


class Visit:
    """One person's tab, and what the browser complained about.

    Attributes:
        page: The tab.
        complaints: Errors on the console and uncaught exceptions.
        foreign: Addresses of other hosts that were asked.
    """

    def __init__(self, context: BrowserContext, url: str) -> None:
        self.context = context
        self.url = url
        self.page: Page = context.new_page()
        self.complaints: list[str] = []
        self.foreign: list[str] = []
        self.page.on("console", self._console)
        self.page.on("pageerror", lambda error: self.complaints.append(f"{error}: {error.stack}"))
        context.on("request", self._request)
        self.page.goto(url)

    def button(self, name: str) -> Locator:
        """Returns the one button whose accessible name begins so."""
        return self.page.get_by_role("button", name=re.compile(f"^{name}"))

    def region(self, name: str) -> Locator:
        """Returns a region by its label."""
        return self.page.get_by_role("region", name=name, exact=True)

    def field(self, name: str) -> Locator:
        """Returns a field of the request by its accessible name."""
        return self.page.get_by_label(name, exact=True)

    def planned(self) -> None:
        """Presses Plan and waits until the answer can be thrown."""
        self.button("Plan").click()
        self.armed().wait_for(timeout=PLAN_MS)

    def armed(self) -> Locator:
        """Returns the button that throws, where it can be pressed."""
        return self.button("Throw on").and_(self.page.locator(":enabled:not([aria-disabled=true])"))

    def tab_to(self, name: str) -> None:
        """Presses Tab until a control has the focus whose accessible name begins so, as a person does."""
        wanted = self.page.get_by_label(re.compile(f"^{re.escape(name)}")).or_(self.button(re.escape(name)))
        summary = self.page.locator("summary", has_text=re.compile(f"^{re.escape(name)}"))
        focused = wanted.or_(summary).and_(self.page.locator(":focus-visible"))
        for _ in range(TABS_MAX):
            self.page.keyboard.press("Tab")
            if focused.count():
                return
        raise AssertionError(f"Tab does not come to {name}")

    def outcome(self, text: str, timeout: float = THROW_MS) -> None:
        """Waits until the execution's outcome is shown in these words."""
        shown = self.region("Execution").get_by_role("status").filter(has_text=text)
        shown.wait_for(timeout=timeout)

    def past(self, outcome: str) -> Locator:
        """Returns the newest row of the history that ended so."""
        return self.region("History").get_by_role("row").filter(has_text=outcome).first

    def grasp(self) -> tuple[float, float]:
        """Returns where the target's handle is [px]: where the pointer becomes a hand."""
        return self._where("grab")

    def on_the_map(self) -> tuple[float, float]:
        """Returns a point of the map [px]: where the pointer becomes a crosshair."""
        return self._where("crosshair")

    def middle_of(self, pointer: str) -> tuple[float, float]:
        """Returns the middle of the places where the pointer is one of these [px]."""
        canvas = self.region("Scene").locator("canvas")
        found = canvas.evaluate(FIND_MIDDLE, [STEP_PX / 2, pointer])
        assert found is not None, f"the pointer becomes a {pointer} nowhere"
        return found[0], found[1]

    def _where(self, pointer: str) -> tuple[float, float]:
        canvas = self.region("Scene").locator("canvas")
        canvas.scroll_into_view_if_needed()
        deadline = time.monotonic() + DRAWN_S
        while (found := canvas.evaluate(FIND_POINTER, [STEP_PX, pointer])) is None:
            assert time.monotonic() < deadline, f"the pointer becomes a {pointer} nowhere"
            self.page.wait_for_timeout(LOOK_MS)
        return found[0], found[1]

    def barriers(self) -> list[str]:
        """Returns what axe-core finds serious or worse for people with disabilities, light and dark."""
        self._choose("light")
        found = self._violations(LIGHT)
        self._choose("dark")
        return [*found, *self._violations(DARK)]

    def _choose(self, scheme: Literal["light", "dark"]) -> None:
        """Chooses light or dark; pages hear of it with the next frame, and draw with the one after."""
        self.page.emulate_media(color_scheme=scheme)
        self.page.evaluate("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")

    def _violations(self, options: Mapping[str, Any]) -> list[str]:
        found = AXE.run(self.page, options=dict(options)).response["violations"]
        return [
            f"{rule['id']}: {node['target']} {node['failureSummary']}"
            for rule in found
            if rule["impact"] not in HARMLESS_IMPACTS
            for node in rule["nodes"]
        ]

    def _console(self, message: ConsoleMessage) -> None:
        if message.type == "error" and REFUSED not in message.text:
            self.complaints.append(message.text)

    def _request(self, request: Request) -> None:
        own = "/".join(self.url.split("/")[:3])  # scheme, host and port
        if not request.url.startswith((own, "blob:", "data:")):
            self.foreign.append(request.url)


def launch(playwright: Playwright, draws: bool = True) -> Browser:
    """Starts the browser; `draws` is whether it has WebGL, which costs a machine without a graphics processor time."""
    flags = FLAGS if draws else [*QUIET_FLAGS, "--disable-3d-apis"]
    if os.geteuid() == 0:
        flags = [*flags, "--no-sandbox"]
    return playwright.chromium.launch(executable_path=CHROMIUM, args=flags)


@contextmanager
def visit(browser: Browser, url: str, **options: Any) -> Iterator[Visit]:
    """Opens a tab; at its end nothing was complained about, and no other host was asked."""
    settings: Mapping[str, Any] = {"viewport": SMALL, "reduced_motion": "reduce", **options}
    context = browser.new_context(**settings)
    try:
        guest = Visit(context, url)
        yield guest
        assert guest.complaints == [], guest.complaints
        assert guest.foreign == [], guest.foreign
    finally:
        context.close()

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner

from api.cli import main
from api.report import plan_svg, report_html
from planner.cell import load_cell
from planner.plan_document import plan_document
from planner.planning import plan as plan_request
from planner.request import problem_from_request
from tests.api.conftest import RunningService
from tests.api.test_bad_input import problem_of

SVG = "{http://www.w3.org/2000/svg}"
TARGET = {"release": {"kind": "target", "position": [1.2, 0.3, 0.0]}, "backend": "ruckig"}


@pytest.fixture(scope="module")
def throw(shared: RunningService):
    return shared.client.post("/plan", json=TARGET).json()


def points(line: ElementTree.Element) -> np.ndarray:
    return np.array([pair.split(",") for pair in line.attrib["points"].split()], float)


def test_the_top_view_is_the_plan_to_scale(throw, root: Path):
    drawing = ElementTree.fromstring(plan_svg(throw, load_cell(root / "cells" / "ur5e-sim.toml")))
    top = drawing.findall(f"{SVG}g")[1]
    lines = {line.attrib["class"]: points(line) for line in top.findall(f"{SVG}polyline")}
    dots = {dot.attrib["class"]: dot for dot in top.findall(f"{SVG}circle")}
    release, landing = throw["release"]["pose"]["position"], throw["flight"]["landing_point"]
    flown = lines["flight"][-1] - lines["flight"][0]
    meant = np.array([landing[0] - release[0], release[1] - landing[1]])  # the page's y points down
    assert np.allclose(flown / np.linalg.norm(flown), meant / np.linalg.norm(meant), atol=2e-3)
    scale = np.linalg.norm(flown) / np.linalg.norm(meant)
    base, tool = lines["arm release"][0], lines["arm release"][-1]
    assert np.allclose((tool - base) / scale, [release[0], -release[1]], atol=2e-3)  # the base is the world's origin
    assert np.allclose(lines["launch"][-1], lines["brake"][0], atol=0.11)
    assert {"landing", "let-go", "target"} == set(dots)
    assert abs(float(dots["target"].attrib["cx"]) - float(dots["landing"].attrib["cx"])) < 0.5


def test_a_bin_is_drawn_to_scale_from_the_side_and_from_above(root: Path):
    opening = {"radius_m": 0.12, "rim_height_m": 0.2}
    here = load_cell(root / "cells" / "ur5e-sim.toml")
    request = {"release": {**TARGET["release"], "opening": opening}, "backend": "ruckig"}
    plan = plan_document(plan_request(problem_from_request(request, here)), request, "id", "2026-01-01T00:00:00Z")
    side, top = ElementTree.fromstring(plan_svg(plan, here)).findall(f"{SVG}g")
    ruler = next(line for line in side.findall(f"{SVG}line") if line.attrib["class"] == "ruler")
    scale = (float(ruler.attrib["x2"]) - float(ruler.attrib["x1"])) / 0.5
    bottom, wall, _ = (points(line) for line in side.findall(f"{SVG}polyline[@class='bin']"))
    assert np.allclose(np.ptp(bottom, axis=0) / scale, [0.24, 0.0], atol=3e-3)
    assert np.allclose(np.ptp(wall, axis=0) / scale, [0.0, 0.2], atol=3e-3)
    target = next(dot for dot in top.findall(f"{SVG}circle") if dot.attrib["class"] == "target")
    around = points(top.find(f"{SVG}polyline[@class='bin']"))[:-1]
    assert np.allclose(around.mean(0), [float(target.attrib["cx"]), float(target.attrib["cy"])], atol=0.1)


def test_the_report_says_what_a_release_10_ms_off_does(throw, root: Path):
    text, shift = report_html(throw, None), throw["flight"]["landing_shift_10ms_m"]
    for when in ("early", "late"):
        assert f"<td>release 10 ms {when}</td><td>the landing moves by {1000 * shift[when]:.0f} mm</td>" in text
    assert "lands within 20 mm" in text
    old = {**throw, "flight": {k: v for k, v in throw["flight"].items() if not k.startswith(("release", "landing_s"))}}
    assert "release 10 ms" not in report_html(old, None)


def test_the_picture_is_served_while_the_cell_is_the_same(service: RunningService, throw, cells: Path):
    response = service.client.get(f"/plans/{throw['id']}/picture.svg")
    assert response.headers["content-type"].startswith("image/svg+xml")
    ElementTree.fromstring(response.text)
    other = service.client.post("/plan", json={**TARGET, "cell": "changing"}).json()
    file = cells / "changing.toml"
    before = file.read_text()
    file.write_text(before + "# changed\n")
    problem_of(service.client.get(f"/plans/{other['id']}/picture.svg"), 409, "cell-changed")
    file.write_text(before)


def test_the_report_is_one_file(throw, root: Path):
    text = report_html(throw, load_cell(root / "cells" / "ur5e-sim.toml"))
    assert not re.search(r"(src|href)=", text)
    assert "<script" not in text
    assert set(re.findall(r"https?://[^\"' <]+", text)) == {"http://www.w3.org/2000/svg"}
    for check in throw["certificate"]["checks"]:
        assert f"<td>{check['name']}</td>" in text
    assert "no picture" in report_html({**throw, "cell_sha256": "other"}, load_cell(root / "cells" / "ur5e-sim.toml"))


def test_a_move_that_ends_at_rest_has_no_flight(shared: RunningService, root: Path):
    release = {"kind": "joint", "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0], "velocities": [0.0] * 6}
    plan = shared.client.post("/plan", json={"release": release, "backend": "ruckig"}).json()
    assert plan["flight"] is None
    drawing = plan_svg(plan, load_cell(root / "cells" / "ur5e-sim.toml"))
    assert 'class="flight"' not in drawing


def test_fling_report(throw, root: Path, tmp_path: Path):
    import json

    file = tmp_path / "plan.json"
    file.write_text(json.dumps(throw))
    result = CliRunner().invoke(main, ["report", str(file), "--cells", str(root / "cells")])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "plan.html").read_text().startswith("<!doctype html>")
    file.write_text("{}")
    assert CliRunner().invoke(main, ["report", str(file)]).exit_code == 1

from __future__ import annotations

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner

import api.report.page
from api.cli import main
from api.experiment_statistics import statistics_of
from api.report import ReportContent, report_html
from api.scene import cell_model, plan_curves
from fling import plan_svg
from planner.answer import plan_document
from planner.cell import load_cell
from planner.planning import plan as plan_request
from planner.request import problem_from_request
from tests.api.conftest import RunningService
from tests.api.test_bad_input import problem_of

PROGRAM = Path(api.report.page.__file__).parents[1] / "web" / "report"
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
    release = throw["release"]["pose"]["position"]
    landing = throw["flight"]["landing_point"]
    flown = lines["flight"][-1] - lines["flight"][0]
    meant = np.array([landing[0] - release[0], release[1] - landing[1]])  # the page's y points down
    assert np.allclose(flown / np.linalg.norm(flown), meant / np.linalg.norm(meant), atol=2e-3)
    scale = np.linalg.norm(flown) / np.linalg.norm(meant)
    base = lines["arm release"][0]
    tool = lines["arm release"][-1]
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
    text = report_html(ReportContent(throw))
    shift = throw["flight"]["landing_shift_10ms_m"]
    for when in ("early", "late"):
        assert f"<td>release 10 ms {when}</td><td>the landing moves by {1000 * shift[when]:.0f} mm</td>" in text
    assert "lands within 20 mm" in text
    old = {**throw, "flight": {k: v for k, v in throw["flight"].items() if not k.startswith(("release", "landing_s"))}}
    assert "release 10 ms" not in report_html(ReportContent(old))


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


@pytest.fixture
def content(throw, root: Path) -> ReportContent:
    cell = load_cell(root / "cells" / "ur5e-sim.toml")
    return ReportContent(throw, plan_svg(throw, cell), cell_model(cell), plan_curves(throw, cell))


class Outline(HTMLParser):
    """Elements of a page, and what its scripts hold."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data):
        if self.cdata_elem == "script":
            self.scripts[-1] += data


def test_the_report_is_one_file(content: ReportContent, throw):
    text = report_html(content)
    outline = Outline(text)
    assert not [(tag, at) for tag, at in outline.tags if {"src", "href", "srcset", "action"} & at.keys()]
    assert "default-src 'none'" in text
    assert not re.search(r"@import|url\((?!#)", (PROGRAM / "report.css").read_text())
    for check in throw["certificate"]["checks"]:
        assert f"<td>{check['name'].replace('_', ' ')}</td>" in text
    assert re.search(r"<td>singularity distance</td><td>[\d.]+</td><td>≥</td><td>0.05</td>", text)  # not exceeded
    assert re.search(r"<td>joint jerk</td><td>[\d.]+</td><td>≤</td><td>500</td>", text)
    assert "no picture" not in text
    assert "no picture" in report_html(ReportContent(throw))


def test_the_report_carries_what_its_program_draws(content: ReportContent, throw):
    data, program = Outline(report_html(content)).scripts
    carried = json.loads(data)
    assert carried["plan"] == throw
    assert carried["model"] == content.model
    assert carried["curves"] == content.curves
    assert len(program) > 100_000  # three.js and all


@pytest.mark.parametrize("id", ["</script><script>alert(1)</script>", "<!--<script>", "<!-- <script", "<![CDATA["])
def test_nothing_in_a_plan_ends_the_script(content: ReportContent, id: str):
    """HTML's "script data double escaped state" begins with `<!--<script` and swallows the end of the script."""
    nasty = replace(content, plan={**content.plan, "id": id})
    outline = Outline(report_html(nasty))
    assert [tag for tag, _ in outline.tags].count("script") == 2
    assert "<" not in outline.scripts[0]
    assert json.loads(outline.scripts[0])["plan"]["id"] == nasty.plan["id"]


def test_the_report_of_an_execution_has_its_outcome_and_its_recording(content: ReportContent):
    landing = {"source": "sim-camera", "position": [1.21, 0.3, 0.0], "std_m": 0.0, "result": None, "radius_m": None}
    metrics = {"landing_error_m": 0.0123, "missed_ticks": 0, "ticks": 279, "released": True}
    execution = {"id": "e", "outcome": "completed", "state": "finished", "reason": None, "metrics": metrics}
    names = [f"{kind}_{joint}_rad" for kind in ("q", "planned_q") for joint in range(6)]
    rows = [
        [0.002 * i, *(0.1 * joint + 0.01 for joint in range(6)), *(0.1 * joint for joint in range(6))] for i in (0, 1)
    ]
    recording = "\n".join([",".join(["clock_s", *names]), *(",".join(map(repr, row)) for row in rows)])
    text = report_html(replace(content, execution=execution, landings=[landing], recording=recording))
    assert "<td>completed</td>" in text
    assert "<td>12.3 mm</td>" in text
    assert "dry run: nothing moved" in report_html(replace(content, execution={**execution, "dry_run": True}))
    carried = json.loads(Outline(text).scripts[0])
    assert carried["landings"] == [{"id": "0", "position": [1.21, 0.3, 0.0], "newest": True}]
    assert carried["tracking"]["unit"] == "mrad"
    assert carried["tracking"]["times"] == [0.0, 0.002]
    assert np.allclose([line["values"] for line in carried["tracking"]["lines"]], 10.0)


def test_the_report_of_an_experiment_has_its_throws_and_their_ellipse(content: ReportContent, throw):
    target = throw["request"]["release"]["position"]
    landings = [[1.21, 0.3, 0.0], [1.19, 0.31, 0.0], None]
    throws = [
        {
            **{"execution_id": str(i), "plan_id": throw["id"], "state": "finished", "outcome": "completed"},
            **{"target": target, "landing": landing, "error_m": landing and 0.01, "results": [], "reason": None},
        }
        for i, landing in enumerate(landings)
    ]
    statistics = statistics_of(throws)
    experiment = {
        **{"id": "x", "name": "new fingers", "throws": throws, "statistics": statistics},
        "targets": [{"target": target, **statistics}],
    }
    text = report_html(replace(content, experiment=experiment))
    assert "<h1>Experiment new fingers</h1>" in text
    assert text.count("10.0 mm") >= 2
    carried = json.loads(Outline(text).scripts[0])
    assert [mark["position"] for mark in carried["landings"]] == landings[:2]
    assert np.allclose(carried["ellipse"]["center"], np.mean(landings[:2], axis=0)[:2])


def test_a_move_that_ends_at_rest_has_no_flight(shared: RunningService, root: Path):
    release = {"kind": "joint", "positions": [0.4, -1.4, 1.2, -1.2, -1.57, 0.0], "velocities": [0.0] * 6}
    plan = shared.client.post("/plan", json={"release": release, "backend": "ruckig"}).json()
    assert plan["flight"] is None
    drawing = plan_svg(plan, load_cell(root / "cells" / "ur5e-sim.toml"))
    assert 'class="flight"' not in drawing


def test_fling_report(throw, root: Path, tmp_path: Path):
    file = tmp_path / "plan.json"
    file.write_text(json.dumps(throw))
    result = CliRunner().invoke(main, ["report", str(file), "--cells", str(root / "cells")])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "plan.html").read_text().startswith("<!doctype html>")
    assert CliRunner().invoke(main, ["report", str(file), "--plan", "latest"]).exit_code != 0
    file.write_text("{}")
    assert CliRunner().invoke(main, ["report", str(file)]).exit_code == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"type": "/problems/infeasible", "title": "The arm cannot do this"}', "refused: The arm cannot do this"),
        ('{"a": 1}', "it lacks 'trajectory'"),
        ('{"trajectory": {}, "flight": null}', "it lacks 'certificate'"),
        ("[1]", "it has another form"),
        ("robot = 1", "it is not JSON"),
        ("", "it is empty"),
    ],
)
def test_a_file_without_a_plan_is_refused_in_words(tmp_path: Path, text: str, said: str):
    file = tmp_path / "some.json"
    file.write_text(text)
    result = CliRunner().invoke(main, ["report", str(file)])
    assert result.exit_code == 1
    assert said in result.stderr

"""Pictures of landings: dots where they belong, read back from the SVG."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import pytest

from api.report import explained_svg, lags_svg
from api.report.landings import EDGE, SIZE

SVG = "{http://www.w3.org/2000/svg}"
SCALE = (SIZE / 2.0 - EDGE) / 0.2  # [px/m] the farthest landing, 20 cm off, is at the margin


def dots(svg: str, kind: str) -> list[tuple[float, float]]:
    """Returns the places of the dots of a kind, from the centre of the picture [m]."""
    found = [c for c in ElementTree.fromstring(svg).iter() if c.tag.endswith("circle") and c.get("class") == kind]
    return [((float(c.get("cx")) - SIZE / 2) / SCALE, (SIZE / 2 - float(c.get("cy"))) / SCALE) for c in found]


def test_landings_before_and_after_are_where_they_belong():
    rows = [
        {"planned": [1.0, 0.0], "observed": [1.2, 0.1], "expected": [1.18, 0.11]},
        {"planned": [0.0, 1.0], "observed": [-0.05, 0.9], "expected": [-0.05, 0.92]},
    ]
    svg = explained_svg(rows)
    off = [*dots(svg, "landing"), *dots(svg, "explained")]
    for found, expected in zip(off, [(0.2, 0.1), (-0.05, -0.1), (0.02, -0.01), (0.0, -0.02)], strict=True):
        assert found == pytest.approx(expected, abs=0.1 / SCALE)
    assert re.search("2 throws", svg)


def test_lags_are_drawn_beside_the_one_that_plans_assume():
    runs = [{"lag_s": 0.0262, "lag_std_s": 0.0002}, {"lag_s": 0.0258, "lag_std_s": 0.0004}]
    drawn = ElementTree.fromstring(lags_svg(runs, 0.0260, 0.020))
    dots = [each for each in drawn.iter(f"{SVG}circle") if each.get("class") == "run"]
    assert len(dots) == 2
    higher, lower = (float(each.attrib["cy"]) for each in dots)
    (assumed,) = (each for each in drawn.iter(f"{SVG}path") if each.get("class") == "assumed")
    at = float(assumed.attrib["d"].removeprefix("M48 ").partition("H")[0])
    assert higher < lower < at  # a longer lag stands higher; the assumed one is 6 ms below
    scale = (at - higher) / (0.0262 - 0.020)
    assert (at - lower) == pytest.approx(scale * (0.0258 - 0.020), abs=0.2)
    texts = " ".join(each.text or "" for each in drawn.iter(f"{SVG}text"))
    assert "assumed 20.0 ms" in texts and "measured 26.0 ms" in texts

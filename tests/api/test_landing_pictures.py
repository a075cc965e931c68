"""Pictures of landings: dots where they belong, read back from the SVG."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import pytest

from api.report import explained_svg
from api.report.landings import EDGE, SIZE

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

"""Tables of the pages, and how numbers are written in them."""

from __future__ import annotations

import math
from collections.abc import Sequence


def markdown_table(head: Sequence[str], body: Sequence[Sequence[str]]) -> list[str]:
    """Returns a Markdown table."""
    rule = ["---"] * len(head)
    return ["| " + " | ".join(row) + " |" for row in (head, rule, *body)]


def decimals(values: Sequence[float], digits: int = 3) -> str:
    """Returns numbers for a table; a dash for NaN."""
    return " / ".join("–" if math.isnan(v) else f"{v:.{digits}f}" for v in values)


def thousandths(values: Sequence[float], digits: int = 0) -> str:
    """Returns numbers in thousandths, such as seconds in milliseconds."""
    return decimals([1000.0 * v for v in values], digits)


def percent(share: float) -> str:
    """Returns a share as a percentage."""
    return "–" if math.isnan(share) else f"{100.0 * share:.1f} %"

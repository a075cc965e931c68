"""A picture that needs no style sheet, as one SVG with a line of words below it.

Its styles are attributes: the service's content security policy forbids style sheets within a picture.
"""

from __future__ import annotations

from collections.abc import Iterable

TEXT = 'font-family="sans-serif" font-size="12" fill="#333"'


def standalone_svg(width: int, height: int, name: str, parts: Iterable[str], words: str) -> str:
    """Returns the parts of a picture [px] under its accessible name, with words along the lower edge."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" aria-label="{name}">'
    return f'{head}{"".join(parts)}<text {TEXT} x="8" y="{height - 8}">{words}</text></svg>'

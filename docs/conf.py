"""Settings of the documentation's generator, Sphinx. `make docs` writes build/docs; nothing is fetched."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

project = "Fling"
copyright = "the authors of Fling; BSD-3-Clause"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "docs.reference.generated",
    "docs.reference.mathml",
]
html_theme = "furo"
html_title = "Fling"
html_show_sphinx = False
html_math_renderer = "mathml"
html_theme_options = {"light_css_variables": {"font-stack": "system-ui, sans-serif"}}

# The pages are plain Markdown, which also reads well where the repository is shown.
myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 4
suppress_warnings = [
    "myst.xref_missing",  # links to files outside of docs/: tests/test_docs.py follows them
    "misc.highlighting_failure",
    "toc.not_included",  # a page that is only linked to
]

# Notebooks of course and gallery run when the pages are built, unless they ran before, and any error ends the build.
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "build" / "notebooks")
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_typehints = "description"
autodoc_member_order = "bysource"


def escape_bars(_app: object, _what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Keeps |v| of a docstring as it is written: to docutils it would be a substitution."""
    lines[:] = [line.replace("|", "\\|") for line in lines]


def setup(app: object) -> None:
    """Connects what is done to docstrings."""
    app.connect("autodoc-process-docstring", escape_bars)  # type: ignore[attr-defined]

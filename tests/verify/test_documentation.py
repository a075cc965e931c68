"""The documentation builds, its notebooks run, and it needs no network."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGES = ("index", "tutorial/first-throw", "tutorial/real-arm", "course/08-online", "reference/cli", "reference/http")
pytestmark = pytest.mark.slow
FETCHED = re.compile(r"""(?:src=|<link[^>]*href=|@import\s+|url\()["']?(?:https?:)?//""")


@pytest.fixture(scope="module")
def built(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages, with every notebook of the course executed anew."""
    folder = tmp_path_factory.mktemp("docs")
    command = [
        sys.executable,
        "-P",
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-D",
        f"nb_execution_cache_path={folder}/cache",
    ]
    done = subprocess.run(
        [*command, "docs", str(folder / "html")], cwd=root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-5000:]
    return folder / "html"


def test_every_page_is_there_and_fetches_nothing(built: Path):
    assert [page for page in PAGES if not (built / f"{page}.html").is_file()] == []
    for file in [*built.rglob("*.html"), *built.rglob("*.css")]:
        assert FETCHED.search(file.read_text()) is None, file


def test_the_notebooks_show_figures_from_the_library(built: Path, root: Path):
    for notebook in [*(root / "docs" / "course").glob("0*.md"), *(root / "docs" / "gallery").glob("[!i]*.md")]:
        page = (built / notebook.parent.name / f"{notebook.stem}.html").read_text()
        if "plt." in notebook.read_text():
            assert "<img" in page, notebook
        assert "Traceback" not in page, notebook


def test_the_reference_names_every_command_route_and_public_name(built: Path):
    import fling
    from api.cli import COMMANDS
    from docs.reference.generated import openapi_document

    pages = {name: (built / "reference" / f"{name}.html").read_text() for name in ("cli", "http", "library")}
    assert [name for name in COMMANDS if f"fling-{name}" not in pages["cli"]] == []
    assert [path for path in openapi_document()["paths"] if path not in pages["http"]] == []
    modules = (
        "flight",
        "integrate",
        "kinematics",
        "robot",
        "rotations",
        "timing",
        "Robot",
        "ThrowProblem",
        "__version__",
    )
    assert [name for name in fling.__all__ if name not in (*modules,) and f".{name}" not in pages["library"]] == []

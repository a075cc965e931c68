"""HTML pages: the web page, the OpenAPI page, one page per problem type. They load nothing from other hosts."""

from __future__ import annotations

import html
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import FileResponse, HTMLResponse

from api.http import PROBLEM_TYPES, ProblemDetails

router = APIRouter(include_in_schema=False)

WEB = Path(__file__).parents[1] / "web"  # the bundle that `make web` builds from web/
MEDIA_TYPES = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml", ".txt": "text/plain"}
ASSETS = "assets/"  # files whose names change with their content
FOR_EVER = {"Cache-Control": "public, max-age=31536000, immutable"}
REVALIDATED = {"Cache-Control": "no-cache"}


@router.get("/")
def page() -> FileResponse:
    """Serves the web page."""
    return FileResponse(WEB / "index.html", headers=REVALIDATED, media_type="text/html")


@router.get("/docs")
def docs() -> FileResponse:
    """Serves the OpenAPI page, which the browser renders from /openapi.json."""
    return FileResponse(WEB / "docs.html", headers=REVALIDATED, media_type="text/html")


@router.get("/web/{name:path}")
def asset(name: str) -> FileResponse:
    """Serves a script, style sheet or image of the pages."""
    known = {path.relative_to(WEB).as_posix(): path for path in WEB.rglob("*") if path.suffix in MEDIA_TYPES}
    if name not in known:
        raise ProblemDetails("not-found", "no such file")
    caching = FOR_EVER if name.startswith(ASSETS) else REVALIDATED
    return FileResponse(known[name], headers=caching, media_type=MEDIA_TYPES[known[name].suffix])


@router.get("/problems")
def problems() -> HTMLResponse:
    """Lists the problem types."""
    items = "".join(
        f'<li><a href="/problems/{name}">{name}</a> ({kind.status}): {html.escape(kind.title)}</li>'
        for name, kind in PROBLEM_TYPES.items()
    )
    return _page("Errors of Fling", f"<ul>{items}</ul>")


@router.get("/problems/{name}")
def problem(name: str) -> HTMLResponse:
    """Explains one problem type."""
    kind = PROBLEM_TYPES.get(name)
    if kind is None:
        raise ProblemDetails("not-found", "no such problem type")
    text = f"<p><code>{name}</code>, status {kind.status}</p><p>{html.escape(kind.explanation)}</p>"
    return _page(kind.title, text + '<p><a href="/problems">all problem types</a></p>')


def _page(title: str, body: str) -> HTMLResponse:
    title = html.escape(title)
    return HTMLResponse(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<link rel="icon" href="/web/icon.svg"><link rel="stylesheet" href="/web/base.css">'
        f'<main class="prose"><p><a href="/">Fling</a></p><h1>{title}</h1>{body}</main></html>'
    )

"""Pages for people: the web page, the OpenAPI page, what each error means. Nothing is loaded from elsewhere."""

from __future__ import annotations

import html
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import FileResponse, HTMLResponse

from api.errors import PROBLEMS, Problem

router = APIRouter(include_in_schema=False)

WEB = Path(__file__).parent / "web"
MEDIA_TYPES = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


@router.get("/")
def page() -> FileResponse:
    """The web page."""
    return FileResponse(WEB / "index.html", media_type="text/html")


@router.get("/docs")
def docs() -> FileResponse:
    """The OpenAPI page, made from /openapi.json in the browser."""
    return FileResponse(WEB / "docs.html", media_type="text/html")


@router.get("/web/{name}")
def asset(name: str) -> FileResponse:
    """A script, a style sheet or a picture of the pages."""
    known = {path.name: path for path in WEB.iterdir() if path.suffix in MEDIA_TYPES}
    if name not in known:
        raise Problem("not-found", "no such file")
    return FileResponse(known[name], media_type=MEDIA_TYPES[known[name].suffix])


@router.get("/problems")
def problems() -> HTMLResponse:
    """Every kind of error."""
    items = "".join(
        f'<li><a href="/problems/{name}">{name}</a> ({kind.status}): {html.escape(kind.title)}</li>'
        for name, kind in PROBLEMS.items()
    )
    return _page("Errors of Fling", f"<ul>{items}</ul>")


@router.get("/problems/{name}")
def problem(name: str) -> HTMLResponse:
    """What one kind of error means, and what to do about it."""
    kind = PROBLEMS.get(name)
    if kind is None:
        raise Problem("not-found", "no such kind of error")
    text = f"<p><code>{name}</code>, status {kind.status}</p><p>{html.escape(kind.explanation)}</p>"
    return _page(kind.title, text + '<p><a href="/problems">all kinds of errors</a></p>')


def _page(title: str, body: str) -> HTMLResponse:
    title = html.escape(title)
    return HTMLResponse(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>'
        f'<link rel="stylesheet" href="/web/style.css"><main><h1>{title}</h1>{body}</main></html>'
    )

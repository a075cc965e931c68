"""Reference pages that are written from code when the documentation is built: HTTP from the OpenAPI document."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

METHODS = ("get", "post", "put", "delete", "patch")
PAGE = "reference/http.md"  # not under version control


def setup(app: Any) -> dict[str, bool]:
    """Writes the pages when a build begins."""
    app.connect("builder-inited", lambda built: write_http_page(Path(built.srcdir) / PAGE))
    return {"parallel_read_safe": True}


def write_http_page(page: Path) -> None:
    """Writes the page unless it is there already as it should be: an unchanged page is not built anew."""
    text = "\n".join(http_lines(openapi_document())) + "\n"
    if not page.exists() or page.read_text() != text:
        page.write_text(text)


def openapi_document() -> dict[str, Any]:
    """Returns the OpenAPI document of a service with an empty store."""
    from api.app import create_app
    from api.settings import ServiceSettings
    from planner.cell_folder import default_cells_folder

    with tempfile.TemporaryDirectory() as folder:
        url = f"sqlite:///{folder}/fling.db"
        app = create_app(ServiceSettings(database_url=url, cells=default_cells_folder(), tokens_file=None))
        return app.openapi()


def http_lines(document: dict[str, Any]) -> Iterator[str]:
    """Yields the page's lines: every operation with its parameters and answers, then every schema."""
    yield "# HTTP\n"
    yield "Written from the service's own OpenAPI document, which a running service answers at `/openapi.json`, and"
    yield "shows with runnable examples at `/docs`. [The service in examples](../api.md) is the tour.\n"
    for path, item in document["paths"].items():
        for method in filter(item.__contains__, METHODS):
            yield from _operation(method.upper(), path, item[method])
    yield "## Schemas\n"
    for name, schema in sorted(document["components"]["schemas"].items()):
        yield from _schema(name, schema)


def _operation(method: str, path: str, operation: dict[str, Any]) -> Iterator[str]:
    yield f"## {method} `{path}`\n"
    yield f"{operation.get('summary', '')}. {operation.get('description', '')}".strip(" .") + ".\n"
    parameters = operation.get("parameters", [])
    if parameters:
        yield "| parameter | in | meaning |\n|---|---|---|"
        yield from (f"| `{p['name']}` | {p['in']} | {_cell(p.get('description', ''))} |" for p in parameters)
        yield ""
    if "requestBody" in operation:
        yield f"Body: {_content(operation['requestBody'])}.\n"
    yield "| status | answer | media types |\n|---|---|---|"
    for status, answer in operation["responses"].items():
        yield f"| {status} | {_cell(answer.get('description', ''))} | {_content(answer)} |"
    yield ""


def _schema(name: str, schema: dict[str, Any]) -> Iterator[str]:
    yield f"### `{name}`\n"
    if schema.get("description"):
        yield f"{_cell(schema['description'])}\n"
    if schema.get("properties"):
        required = schema.get("required", [])
        yield "| field | type | meaning |\n|---|---|---|"
        for field, part in schema["properties"].items():
            mark = "" if field in required else " (optional)"
            yield f"| `{field}`{mark} | {_type(part)} | {_cell(part.get('description', ''))} |"
        yield ""


def _content(part: dict[str, Any]) -> str:
    kinds = part.get("content", {})
    return ", ".join(f"`{kind}` {_type(body.get('schema', {}))}".strip() for kind, body in kinds.items())


def _type(schema: dict[str, Any]) -> str:
    """Returns a schema's type in a few words."""
    if "$ref" in schema:
        return f"`{schema['$ref'].rpartition('/')[2]}`"
    for word in ("anyOf", "oneOf", "allOf"):
        if word in schema:
            return " or ".join(dict.fromkeys(_type(part) for part in schema[word]))
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {}))}"
    if "enum" in schema or "const" in schema:
        return ", ".join(f"`{value}`" for value in schema.get("enum", [schema.get("const")]))
    return str(schema.get("type", ""))


def _cell(text: str) -> str:
    """Returns text that fits into a cell of a table."""
    return " ".join(text.replace("|", "\\|").split())

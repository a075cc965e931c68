"""Planning and executing through a running service, with progress on the terminal."""

from __future__ import annotations

from typing import Any

import click

from api.cli.support.search_line import SearchLine
from api.cli.support.summary import plan_text
from api.cli.support.terminal import say_step


def make_plan(client: Any, request: dict[str, Any], progress: bool = True) -> dict[str, Any]:
    """Plans and prints what was planned. Returns the plan, without its trajectory."""
    if not progress:
        return search_plan(client, request, is_quiet=True)
    say_step("planning …")
    plan = search_plan(client, request)
    say_step(plan_text(plan))
    return plan


def search_plan(client: Any, request: dict[str, Any], is_quiet: bool = False) -> dict[str, Any]:
    """Plans with a line about the search, which Ctrl-C ends. Returns the plan, without its trajectory."""
    with SearchLine(is_quiet) as line:
        return client.planned(request, trajectory=False, progress=line)


def execute_plan(
    client: Any,
    plan: dict[str, Any],
    mode: str = "speedj",
    dry_run: bool = False,
    progress: bool = True,
    experiment_id: str | None = None,
) -> dict[str, Any]:
    """Executes a plan and prints the progress. Returns the finished execution; Ctrl-C asks for the brake first."""
    request = {"plan_id": plan["id"], "mode": mode, "dry_run": dry_run}
    request |= {"experiment_id": experiment_id} if experiment_id else {}
    execution = client.post("/execute", request)

    said: set[str] = set()  # the stream of states begins anew after an interruption

    def follow(kind: str, data: dict[str, Any]) -> None:
        if kind == "state" and progress and data["state"] not in said:
            said.add(data["state"])
            say_step(f"  {data['state']}")

    try:
        return client.finished(execution["id"], follow)
    except KeyboardInterrupt:
        client.abort(execution["id"])
        click.echo("interrupted: the executor was asked to brake. This is not a safety function.", err=True)
        return client.finished(execution["id"], follow)

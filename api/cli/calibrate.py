"""What a cell's own runs teach: fling calibrate lag, gripper, outputs, landings; fling profile."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from api.cli.support.client import ServiceClient, ServiceError
from api.cli.support.errors import FlingGroup
from api.cli.support.exit_status import NotCompleted
from api.cli.support.options import calls_service, cell_of_service, cell_option, json_option
from api.cli.support.progress import execute_plan, search_plan
from api.cli.support.summary import ending_text, numbers_text, outputs_text, profile_text

MOTIONS = 4  # as many as the service offers: more are the same again
NO_TIMING = "shows no timing: its recording has gaps, or nothing moved in it; fling doctor judges this machine"
THROWS = 8  # after which the delay is within its own scatter: docs/learning.md
UNSEEN = (
    "no landing was reported, and the gripper does not tell when its fingers open: nothing shows when it lets go. "
    "Report where a throw landed with 'fling landing', then: fling calibrate landings"
)
EDGES = 128  # of each output: the mean of one that scatters by 2 ms is then known within 0.2 ms
UNWIRED = "no output of [outputs] has a sense_input: wire one to an input, and name that in the cell file"
UNSENSED = "no edge was seen at an input: is each output wired to its sense_input, and does it switch within 0.2 s?"
EYE_STD_M = 0.01  # [m] of a position that a person reports
PROPOSED = ("lag_s", "lag_std_s", "gain", "delay_s", "delay_std_s", "jitter_s", "jitter_std_s", "speed_factor",
            "speed_factor_std", "landing_offset_m", "landing_offset_std_m", "drag_coefficient", "base_turn_rad",
            "landing_error_before_m", "landing_error_after_m", "cell_file", "evidence", "adopted")  # fmt: skip


def picture_option(shown: str) -> Any:
    """Returns what adds the option --picture to a command: a file for a picture of what is shown."""
    kind = click.Path(dir_okay=False, writable=True, path_type=Path)
    return click.option("--picture", type=kind, help=f"SVG of {shown}, before and after.")


@click.group(cls=FlingGroup)
def calibrate() -> None:
    """Measure what a cell's own motions and throws teach."""


@calibrate.command()
@click.option("--cell", help="Cell; not needed with --from-csv.")
@click.option("--from-csv", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FILE",
              help="Recorded run: time_s, command_0 … command_5, measured_0 … measured_5 [rad/s].")  # fmt: skip
@click.option("--throws", type=click.IntRange(1, 100), default=MOTIONS, show_default=True, help="Number of motions.")
@click.option("--adopt", is_flag=True, help="Use a profile with the measured lag from now on.")
@picture_option("the lags")
@json_option
@calls_service
def lag(
    cell: str | None,
    from_csv: Path | None,
    throws: int,
    adopt: bool,
    picture: Path | None,
    as_json: bool,
    client: ServiceClient,
) -> None:
    """Measure the arm's lag and gains: from a recorded run, or with small certified motions without an object.

    **The motions move the arm**, about its home; the gripper stays as it is.
    """
    if from_csv is not None and (adopt or picture is not None):
        raise click.UsageError("--adopt and --picture rest on runs of the cell, not on --from-csv")
    if from_csv is not None:
        found = _from_csv(from_csv)
    elif cell is None:
        raise click.UsageError("Missing option '--cell': the arm moves")
    else:
        found = _by_motions(cell, throws, as_json, picture, client)
    if adopt and cell is not None:
        found |= {"profile": _estimate(client, cell, adopt)["id"], "adopted": True}
    click.echo(json.dumps({"cell": cell, **found}) if as_json else _lag_text(found))


@calibrate.command()
@click.option("--cell", required=True, help="Cell.")
@click.option("--throws", type=click.IntRange(2, 100), default=THROWS, show_default=True, help="Number of throws.")
@click.option("--adopt", is_flag=True, help="Use the profile from now on.")
@picture_option("the landings")
@json_option
@calls_service
def gripper(cell: str, throws: int, adopt: bool, picture: Path | None, as_json: bool, client: ServiceClient) -> None:
    """Measure the gripper's delay and jitter by soonest throws to targets all around, no two alike.

    **It throws.** A robust throw is blind to the delay that it protects against. On a real arm you are asked to put an
    object in before each throw, and where it landed afterwards.
    """
    is_simulated = client.get(f"/cells/{cell}")["link"]["kind"] == "sim"
    candidates = client.get(f"/cells/{cell}/calibration?throws={throws}")["throws"]
    if not as_json:
        click.echo(f"planning {throws} throws, each when the one before has landed …")
    done: list[str] = []
    for i, plan in enumerate(_soonest_plans(client, candidates, throws, as_json), start=1):
        try:
            text = _throw_and_observe(client, plan, is_simulated)
        except NotCompleted as error:
            raise NotCompleted(f"throw {i} of {throws}: {error.message}{_kept_text(cell, done)}") from error
        done.append(text)
        if not as_json:
            click.echo(f"throw {i} of {throws}: {text}")
    _propose(client, cell, adopt, as_json, picture, of="gripper")


@calibrate.command()
@click.option("--cell", required=True, help="Cell.")
@click.option("--count", type=click.IntRange(8, 400), default=EDGES, show_default=True, help="Edges of each output.")
@click.option("--adopt", is_flag=True, help="Use the profile from now on.")
@json_option
@calls_service
def outputs(cell: str, count: int, adopt: bool, as_json: bool, client: ServiceClient) -> None:
    """Measure delay and jitter of every output with a sense_input, in small certified motions without an object.

    **It switches these outputs**, and leaves them off; the arm moves about its home, and the gripper stays as it is.
    """
    motions = client.get(f"/cells/{cell}/calibration")["outputs"]
    if not motions:
        raise click.ClickException(UNWIRED)
    plan = _plan_motion(client, motions, as_json)
    runs = math.ceil(count / len(plan["passages"][0]["outputs"]))
    for i in range(runs):
        try:
            edges = _executed(client, plan)["metrics"]["outputs"]
        except NotCompleted as error:
            raise NotCompleted(f"motion {i + 1} of {runs}: {error.message}{_kept_text(cell, range(i))}") from error
        if not as_json:
            seen = sum(each["edge_time_s"] is not None for each in edges)
            click.echo(f"motion {i + 1} of {runs}: {seen} of {len(edges)} edges seen")
    profile = _estimate(client, cell, adopt, of="outputs")
    unseen = [passed["name"] for passed in plan["passages"] if passed["name"] not in profile["outputs"]]
    if as_json:
        found = {name: profile[name] for name in ("outputs", "adopted")}
        click.echo(json.dumps({"cell": cell, "profile": profile["id"], **found, "unseen": unseen}))
        return
    use = f"profile {profile['id']} is in use" if adopt else f"to use it: fling profile adopt {profile['id']}"
    click.echo("\n".join([*outputs_text(profile), *(f"{name}: not seen at its input" for name in unseen), use]))


@calibrate.command()
@click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--cell", help="The touched points are in this cell's base frame, as its pendant shows them.")
@click.option("--out", type=click.Path(dir_okay=False, writable=True, path_type=Path), metavar="FILE",
              help="Write the camera there, for fling.Camera.load.")  # fmt: skip
@json_option
@calls_service
def camera(file: Path, cell: str | None, out: Path | None, as_json: bool, client: ServiceClient) -> None:
    """Find where a camera stands, from points that it has seen and that the tool's tip has touched.

    FILE is a CSV with a line a point: seen_x_m, seen_y_m, seen_z_m in the camera's frame, touched_x_m, touched_y_m,
    touched_z_m in the world. Four points or more, not on a line; ten, spread over what the camera sees, show its error.
    """
    from api.cli.support.touched_points import TouchedPoints

    base = None if cell is None else client.get(f"/cells/{cell}")["base_in_world"]
    fitted = TouchedPoints.read(file, base)
    if out is not None:
        fitted.camera.save(out)
    click.echo(json.dumps(fitted.document()) if as_json else fitted.text())


@calibrate.command()
@click.option("--cell", required=True, help="Cell.")
@click.option("--adopt", is_flag=True, help="Use the profile from now on.")
@picture_option("the landings")
@json_option
@calls_service
def landings(cell: str, adopt: bool, picture: Path | None, as_json: bool, client: ServiceClient) -> None:
    """Learn from every execution and landing that is known already; nothing moves."""
    _propose(client, cell, adopt, as_json, picture)


def _soonest_plans(
    client: ServiceClient, candidates: Sequence[dict[str, Any]], count: int, is_quiet: bool
) -> Iterator[dict[str, Any]]:
    """Yields `count` plans of calibration throws; refused candidates are left out."""
    found = 0
    for request in candidates:
        if found == count:
            return
        plan = _searched(client, request, is_quiet, ("/problems/infeasible",))
        if plan is not None:
            found += 1
            yield plan
    if found < count:
        raise click.ClickException(f"only {found} of {count} targets around the base can be thrown at")


def _throw_and_observe(client: ServiceClient, plan: dict[str, Any], is_simulated: bool) -> str:
    """Executes a plan and sees to it that its landing is reported; returns what is known of it in words."""
    if not is_simulated:
        click.prompt("put an object into the gripper, then press Enter", default="", show_default=False, err=True)
    done = _executed(client, plan)
    path = f"/executions/{done['id']}/landing"
    if not is_simulated:
        place = _asked_place()
        if place:
            z = plan["request"]["release"]["position"][2]
            client.post(path, {"position": [*place[:2], z], "std_m": EYE_STD_M})
    seen = [x["position"] for x in client.get(path)["landings"] if x["position"] is not None]
    if not seen:
        return "the landing was not seen"
    miss = math.dist(seen[-1][:2], plan["request"]["release"]["position"][:2])
    return f"landed at {seen[-1][0]:.3f} {seen[-1][1]:.3f}, {1e3 * miss:.0f} mm from the target"


def _asked_place() -> list[float]:
    """Returns the landing that a person reports, two or three coordinates [m]; asks again for anything else.

    Nothing where it was not seen.
    """
    question = "landing x y [m], nothing if it was not seen"
    while True:
        answer = click.prompt(question, default="", show_default=False, err=True).replace(",", " ").split()
        try:
            place = [float(word) for word in answer]
        except ValueError:
            place = [math.nan]
        if len(place) in (0, 2, 3) and all(map(math.isfinite, place)):
            return place
        question = f"{' '.join(answer)!r} is not two numbers [m], such as 1.21 0.29; nothing if it was not seen"


def _estimate(client: ServiceClient, cell: str, adopt: bool, of: str = "") -> dict[str, Any]:
    """Estimates a profile; refuses one `of` the gripper, or of outputs, that rests on nothing that shows them."""
    profile = client.post(f"/cells/{cell}/profiles")
    if of == "gripper" and not (profile["evidence"]["throws"] or profile["evidence"]["reported"]):
        raise click.ClickException(UNSEEN)
    if of == "outputs" and not profile["outputs"]:
        raise click.ClickException(UNSENSED)
    if adopt:
        client.post(f"/profiles/{profile['id']}/adopt")
    return {**profile, "adopted": adopt}


def _propose(client: ServiceClient, cell: str, adopt: bool, as_json: bool, picture: Path | None, of: str = "") -> None:
    """Estimates a profile, prints it, draws its landings, and says how to adopt it."""
    from api.report import explained_svg

    profile = _estimate(client, cell, adopt, of)
    if picture is not None:
        picture.write_text(explained_svg(profile["landings"]))
    if as_json:
        click.echo(json.dumps({"cell": cell, "profile": profile["id"], **{k: profile[k] for k in PROPOSED}}))
        return
    click.echo(profile_text(profile))
    if picture is not None:
        click.echo(f"landings before and after: {picture}")
    if not adopt:
        click.echo(f"to use it: fling profile adopt {profile['id']}")


def _executed(client: ServiceClient, plan: dict[str, Any]) -> dict[str, Any]:
    """Executes a plan; returns the finished execution."""
    done = execute_plan(client, plan, progress=False)
    if done["outcome"] != "completed":
        raise NotCompleted(ending_text(done))
    return done


def _from_csv(file: Path) -> dict[str, Any]:
    from learning import RECORDING_BYTES, RecordingError, estimate_timing, recording_from_csv
    from planner.documents import read_text

    try:
        return estimate_timing(recording_from_csv(read_text(file, RECORDING_BYTES))).as_document()
    except RecordingError as error:
        raise click.ClickException(f"{file}: {error}") from error


def _by_motions(cell: str, count: int, quiet: bool, picture: Path | None, client: ServiceClient) -> dict[str, Any]:
    """Returns the timing pooled over `count` motions about home, executed by the running service; draws it."""
    from api.report import lags_svg
    from learning import pooled_document

    runs = []
    motions = client.get(f"/cells/{cell}/calibration")["motions"]
    assumed_s = client.get(f"/cells/{cell}/timing")["assumed_lag_s"]
    for i in range(count):
        try:
            timing = _move(client, motions[i % len(motions)], quiet)
        except NotCompleted as error:
            raise NotCompleted(f"motion {i + 1} of {count}: {error.message}{_kept_text(cell, runs)}") from error
        if timing is not None:
            runs.insert(0, timing)
        if not quiet:
            click.echo(f"motion {i + 1} of {count}: {_milliseconds(timing) if timing else NO_TIMING}")
    pooled = pooled_document(runs, assumed_s)
    if pooled is None:
        raise click.ClickException(f"each motion {NO_TIMING}")
    if picture is not None:
        picture.write_text(lags_svg(runs[::-1], pooled["lag_s"], assumed_s))
    return {**pooled, "assumed_lag_s": assumed_s}


def _kept_text(cell: str, runs: Sequence[Any]) -> str:
    """Returns how to go on after a run that was not completed, and what those before it are good for."""
    kept = f"; what the {len(runs)} before showed is kept: fling calibrate landings --cell {cell}" if runs else ""
    return f". Once the arm is checked: fling acknowledge --cell {cell}{kept}"


def _move(client: ServiceClient, motions: Sequence[dict[str, Any]], quiet: bool) -> Any:
    """Plans the longest motion of these that is certified, and executes it.

    Returns its timing, None where its recording shows none.
    """
    return _executed(client, _plan_motion(client, motions, quiet))["metrics"]["timing"]


def _plan_motion(client: ServiceClient, motions: Sequence[dict[str, Any]], quiet: bool) -> dict[str, Any]:
    """Returns the plan of the first of these requests that is not refused; raises the refusal of the last."""
    for request in motions[:-1]:
        plan = _searched(client, request, quiet, ("/problems/infeasible", "/problems/invalid-request"))
        if plan is not None:
            return plan
    return search_plan(client, motions[-1], quiet)


def _searched(
    client: ServiceClient, request: dict[str, Any], quiet: bool, refusals: Sequence[str]
) -> dict[str, Any] | None:
    """Returns the plan of a request; None where it is refused with one of these types of problem."""
    try:
        return search_plan(client, request, quiet)
    except ServiceError as error:
        if error.problem.get("type") not in refusals:
            raise
        return None


def _lag_text(found: dict[str, Any]) -> str:
    gains = ", ".join("–" if gain is None else f"{gain:.3f}" for gain in found["gain"])
    lines = [f"lag {_milliseconds(found)}; gain of each joint {gains}"]
    if found.get("ramp_rad_s2"):
        lines.append(f"speedj's acceleration of {found['ramp_rad_s2']:.1f} rad/s² held the arm back")
    if found.get("adopted"):
        lines.append(f"profile {found['profile']} is in use: plans assume this lag")
    elif "assumed_lag_s" in found:
        lines.append(found["advice"] or f"as plans assume it: {1e3 * found['assumed_lag_s']:.1f} ms")
    else:
        lines.append(f"for the cell file: timing.lag_s = {found['lag_s']:.4f}")
    return "\n".join([*lines, *_lag_change_text(found)])


def _lag_change_text(found: dict[str, Any]) -> list[str]:
    """Returns what the measured lag changes: by how much a joint was behind its plan, and is then."""
    if "assumed_lag_s" not in found:
        return []
    before = abs(found["lag_s"] - found["assumed_lag_s"])
    after = found["lag_std_s"]
    return [
        f"a joint at 1 rad/s was {1e3 * before:.2f} mrad off its plan, and is within {1e3 * after:.2f} with this lag"
    ]


def _milliseconds(timing: dict[str, Any]) -> str:
    return f"{1e3 * timing['lag_s']:.2f} ± {1e3 * timing['lag_std_s']:.2f} ms"


@click.group(cls=FlingGroup)
def profile() -> None:
    """List, show, adopt or revert what was learnt of a cell."""


@profile.command(name="list")
@cell_option(service=True)
@json_option
@calls_service
def list_profiles(cell: str | None, as_json: bool, client: ServiceClient) -> None:
    """List the profiles of a cell, newest first; * marks the one that it uses."""
    answer = client.get(f"/cells/{cell_of_service(client, cell)}/profiles")
    if as_json:
        click.echo(json.dumps(answer))
        return
    for row in answer["profiles"]:
        mark = "*" if row["adopted"] else " "
        throws = len(row["evidence"]["throws"])
        click.echo(f"{mark} {row['id']}  {row['created_at']}  {throws} throws; {numbers_text(row)}")
    if answer["adopted"] is None:
        click.echo("in use: the cell file's numbers")
    if answer["warning"]:
        click.echo(f"warning: {answer['warning']}", err=True)


@profile.command()
@click.argument("id")
@json_option
@calls_service
def show(id: str, as_json: bool, client: ServiceClient) -> None:
    """Show one profile with its evidence."""
    answer = client.get(f"/profiles/{id}")
    click.echo(json.dumps(answer) if as_json else profile_text(answer))


@profile.command()
@click.argument("id")
@json_option
@calls_service
def adopt(id: str, as_json: bool, client: ServiceClient) -> None:
    """Use a profile from now on; plans made before it must be made again."""
    answer = client.post(f"/profiles/{id}/adopt")
    said = f"{answer['cell']} uses profile {answer['profile']}, adopted by {answer['adopted_by']}"
    click.echo(json.dumps(answer) if as_json else said)


@profile.command()
@cell_option(service=True)
@json_option
@calls_service
def revert(cell: str | None, as_json: bool, client: ServiceClient) -> None:
    """Use the cell file's own numbers again."""
    name = cell_of_service(client, cell)
    answer = client.post(f"/cells/{name}/profiles/revert")
    click.echo(json.dumps(answer) if as_json else f"{name} uses the cell file's numbers")

"""The command export: a plan for a controller that Fling is not connected to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from api.cli.support.options import json_option
from api.cli.support.plan_file import cell_of_plan, plan_in

if TYPE_CHECKING:
    from planner.cell import Cell
    from planner.controller_program import ControllerProgram
    from planner.trajectory import Trajectory


@click.command()
@click.option(
    "--urscript",
    "file",
    required=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="PLAN",
    help="File with a plan (JSON as from `fling plan` or GET /plans/{id}).",
)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Script file; default: PLAN with .script.")
@click.option("--cells", type=click.Path(exists=True, file_okay=False, path_type=Path), help="FLING_CELLS.")
@json_option
def export(file: Path, output: Path | None, cells: Path | None, as_json: bool) -> None:
    """Write a plan as one URScript program for the pendant, once it is certified again with the cell file.

    Its head says what it does. Nobody watches it: it has no dead-man, only the pendant's stop and the arm's own limits.
    """
    from planner.errors import PlannerError

    plan = plan_in(file)
    try:
        text = _program_text(plan, cells)
    except (KeyError, TypeError, ValueError, PlannerError) as error:
        raise click.ClickException(f"{file}: {error}") from error
    target = output or file.with_suffix(".script")
    target.write_text(text, encoding="utf-8")
    click.echo(json.dumps({"plan_id": plan["id"], "file": str(target)}) if as_json else target)


def _program_text(plan: dict[str, Any], cells: Path | None) -> str:
    """Returns the program of a plan.

    Raises:
        click.ClickException: the plan does not belong to the cell file, or fails its certificate.
        NoProgram: a program cannot make it.
        PlannerError: the plan does not fit the cell, or the cell file is refused.
    """
    from planner.answer import plan_from_document
    from planner.approach import find_brakes
    from planner.certificate import certify
    from planner.passages import output_edges
    from planner.stream_rows import controller_program, sample_rows

    cell = cell_of_plan(plan, cells)
    problem, trajectory = plan_from_document(plan, cell)
    if problem.starts_at_s is not None:
        what = f"the plan starts at {problem.starts_at_s:.3f} s of the controller's clock, for a target that moves"
        raise click.ClickException(f"{what}: the pendant would start it at any time")
    failures = [check.name for check in certify(problem, trajectory).checks if not check.ok]
    if failures:
        raise click.ClickException(f"the plan fails its certificate: {', '.join(failures)}")
    edges = output_edges(problem.cell, problem.passages, trajectory)
    rows = sample_rows(problem.cell, trajectory, problem.throws, edges)
    brakes = find_brakes(problem.cell, rows.q, rows.qd, rows.qdd, trajectory.dt, problem.holds_object)
    program = controller_program(problem.cell, rows, brakes)
    return program.text(None, _head(plan, cell, trajectory, program))


def _head(plan: dict[str, Any], cell: Cell, trajectory: Trajectory, program: ControllerProgram) -> list[str]:
    """Returns what the program says of itself."""
    import orjson

    from planner.controller_program import AT_START_RAD, OFF_COURSE_RAD, ROWS_MAX
    from store import plan_sha256, split_plan

    sha256 = plan_sha256(plan["id"], *split_plan(orjson.dumps(plan)))
    fastest = max(max(map(abs, qd)) for qd in program.qd)
    tcp = cell.tool.X_FT[:3, 3].tolist()
    return [
        "Fling: one certified motion as a URScript program, for the pendant.",
        f"plan {plan['id']}, sha256 {sha256}",
        f"cell {cell.name} ({cell.robot.name}), sha256 {cell.sha256}",
        "",
        f"It moves all joints for {trajectory.duration_s:.3f} s, at up to {fastest:.2f} rad/s,",
        f"from {_rounded(trajectory.q[0])} rad",
        f"to   {_rounded(trajectory.q[-1])} rad, at rest.",
        *_throw_words(plan, cell, program),
        "",
        f"Before it runs, the arm stands at the start, within {AT_START_RAD:g} rad: it moves from nowhere else.",
        f"The speed slider is at 100 %, the tool centre point at {_rounded(tcp)} m;",
        f"payload {cell.tool.mass_kg:g} kg, and {cell.object.mass_kg:g} kg of the object.",
        "Nobody watches it: there is no dead-man. The pendant's stop and emergency stop end it, and the arm's own",
        f"safety limits. It stops by itself where the controller's target is {OFF_COURSE_RAD:g} rad or "
        f"{program.off_speed:.2f} rad/s off the motion:",
        "under a speed slider, or resumed after a pause.",
        f"{len(program.qd)} rows of at most {ROWS_MAX}.",
    ]


def _throw_words(plan: dict[str, Any], cell: Cell, program: ControllerProgram) -> list[str]:
    gripper = program.gripper
    flight = plan["flight"]
    switched = [
        f"{switch.row * program.dt:.3f} s after its first row it sets {switch.output} {switch.index} to {switch.level}."
        for switch in program.switches
    ]
    if gripper.row < 0:
        return ["It throws nothing.", *switched]
    speed = "" if flight is None else f" at {flight['speed_m_s']:.2f} m/s"
    lands = "" if flight is None else f" and lands at {_rounded(flight['landing_point'])} m in the cell's world"
    return [
        *switched,
        f"{gripper.row * program.dt:.3f} s after its first row it sets {gripper.output} {gripper.index} to "
        f"{gripper.open_level}: the gripper opens;",
        f"{cell.gripper.delay_s + cell.timing.lag_s:.3f} s later the object leaves it{speed}{lands}.",
    ]


def _rounded(values: Any) -> str:
    return f"[{', '.join(f'{float(x):.4f}' for x in values)}]"

"""Pairs that may touch: read by name, checked nowhere, told in the certificate; everything else is checked as ever."""

from dataclasses import replace

import numpy as np
import pytest

from audit.judge import find_faults
from planner.approach import find_approach
from planner.approach.rrt_connect import Obstacles
from planner.approach.swept_clearance import SweptPaths, keep_clear
from planner.backends.casadi_nlp import layout
from planner.backends.casadi_nlp.parameters import pair_parameters, touching_slots
from planner.cell import AllowedContact, CellSource, load_cell, mended_cell, parse_cell, shape_of
from planner.cell_folder import home_faults
from planner.certificate import certify
from planner.errors import CellError, Infeasible
from planner.geometry import SELF_CLEARANCE_M, body_model, passable, tool_pose
from planner.planning import plan
from planner.problem import TargetRelease, ThrowProblem
from planner.rotations import pose
from tests.planner.problems import cell, steady_cell, with_shapes

LEAST = 'robot = "ur5e"\n[link]\nkind = "sim"\n'
CAPSULE = "{ from_m = [0, 0, 0], to_m = [0, 0, 0.1], radius_m = 0.04 }"
NEST = 'name = "nest", shape = "sphere", pose = { position_m = [1.5, 0, 0.3] }, radius_m = 0.1'


def touching(here, *pairs):
    """The cell in which pairs may touch, each of a part and what is kept out or another part."""
    names = here.surroundings.keep_out_names
    contacts = tuple(AllowedContact(a, b, (b,) if b in names else ()) for a, b in pairs)
    return replace(here, surroundings=replace(here.surroundings, may_touch=contacts))


def read(*pairs, shapes=NEST):
    entries = ", ".join(f'{{ a = "{a}", b = "{b}" }}' for a, b in pairs)
    text = f"{LEAST}[tool]\ncapsules = [{CAPSULE}, {CAPSULE}]\n[surroundings]\nkeep_out = [{{ {shapes} }}]\n"
    return parse_cell(f"{text}may_touch = [{entries}]\n", "c")


def test_pairs_are_read_in_either_order():
    here = read(("nest", "tool"), ("wrist_3", "nest"), ("tool_1", "forearm"), ("object", "nest"))
    around = here.surroundings
    for free in (("tool_0", "nest"), ("tool_1", "nest"), ("wrist_3", "nest"), ("object", "nest")):
        assert around.is_free_to_touch(*free)
    assert around.is_free_to_touch("tool_1", "forearm")
    assert around.is_free_to_touch("forearm", "tool_1")
    for kept in (("wrist_2", "nest"), ("tool_0", "forearm"), ("object", "forearm"), ("tool_0", "wrist_1")):
        assert not around.is_free_to_touch(*kept)
    moved = here.with_obstacles({"shape": "sphere", "pose": {"position_m": [2, 2, 2]}, "radius_m": 0.1})
    assert moved.surroundings.may_touch == around.may_touch


def test_of_a_mesh_all_boxes_are_meant_and_no_others(tmp_path):
    corners = [(x, y, z) for x in (0.0, 0.1) for y in (0.0, 0.1) for z in (0.0, 0.4)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"v {x + 0.1} {y} {0.25 * z}" for x, y, z in corners]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines += [f"f {' '.join(str(i + k) for i in quad)}" for k in (0, 8) for quad in quads]
    (tmp_path / "step.obj").write_text("\n".join([*lines, ""]))
    placed = "pose = { position_m = [1.2, 0, 0] }"
    other = 'name = "rack 7", shape = "sphere", pose = { position_m = [1.5, 1, 0.3] }, radius_m = 0.1'
    entries = f'{{ name = "rack", shape = "mesh", file = "step.obj", {placed} }}, {{ {other} }}'
    text = f'{LEAST}[surroundings]\nkeep_out = [{entries}]\nmay_touch = [{{ a = "tool", b = "rack" }}]\n'
    (tmp_path / "c.toml").write_text(text)
    around = load_cell(tmp_path / "c.toml").surroundings
    free = [name for name in around.keep_out_names if around.is_free_to_touch("tool_0", name)]
    assert len(free) > 1
    assert free == [name for name in around.keep_out_names if name != "rack 7"]


@pytest.mark.parametrize(
    ("pair", "field", "words"),
    [
        (("tool", "nests"), "b", "did you mean 'nest'"),
        (("gripper", "nest"), "a", "upper_arm"),
        (("tool_2", "nest"), "a", "tool_1, object, nest"),
        (("nest", "nest"), "b", "does not move against"),
        (("base", "nest"), "b", "does not move against"),
        (("foot", "base"), "b", "does not move against"),
        (("tool", "floor"), "b", "must be one of"),
    ],
)
def test_what_is_no_pair_is_refused_with_the_names_that_are_known(pair, field, words):
    with pytest.raises(CellError, match=words) as refusal:
        read(pair)
    assert refusal.value.field == f"surroundings.may_touch[0].{field}"


def test_other_faults_are_told_beside_that_of_a_pair():
    text = f'{LEAST}[surroundings]\nmay_touch = [{{ a = "tool", b = "nest" }}]\n[timing]\nlag_s = 9\n'
    faults, here = mended_cell(CellSource("c", text.encode()))
    assert [fault.field for fault in faults] == ["timing.lag_s", "surroundings.may_touch[0].b"]
    assert here is not None


def nested():
    """A cell whose tool stands in a nest at home, and the throw out of it."""
    here = steady_cell()
    p = tool_pose(here, here.home[None])[0, :3, 3]
    nest = shape_of("box", pose(p - [0.0, 0.0, 0.03], np.eye(3)), np.array([0.12, 0.12, 0.06]), "nest")
    return with_shapes(here, nest)


def thrown(here):
    return ThrowProblem(here, here.home, TargetRelease(np.array([1.0, 0.5, 0.0])), here.limits)


FREE = (("tool", "nest"), ("object", "nest"), ("wrist_3", "nest"))


def test_a_throw_out_of_a_nest_is_planned_where_the_tool_may_touch_it():
    kept = nested()
    with pytest.raises(Infeasible) as refusal:
        plan(thrown(kept))
    assert {violation.constraint for violation in refusal.value.violations} == {"keep_out"}
    assert [fault.field for fault in home_faults(kept)] == ["home_rad"]
    free = touching(kept, *FREE)
    assert home_faults(free) == []
    problem = thrown(free)
    found = plan(problem)
    assert found.certificate.valid
    assert "may_touch (tool and nest, object and nest, wrist_3 and nest)" in found.certificate.not_checked
    assert not any("may_touch" in each for each in certify(thrown(kept), found.trajectory).not_checked)
    assert not certify(thrown(kept), found.trajectory).check("keep_out").ok
    assert find_faults(problem, found.trajectory) == []
    assert any(fault.rule == "keep_out" for fault in find_faults(thrown(kept), found.trajectory))


def test_a_part_that_may_not_touch_is_checked_as_ever():
    kept = nested()
    motion = plan(thrown(touching(kept, *FREE))).trajectory
    partly = certify(thrown(touching(kept, *FREE[1:])), motion).check("keep_out")
    assert not partly.ok
    assert partly.detail == "tool_0, nest"
    body = body_model(touching(kept, *FREE))
    ends = body.end_points(body.link_poses(kept.home[None]))
    apart = body.shape_distances(ends)[0, :, 0]
    as_ever = body_model(kept).shape_distances(ends)[0, :, 0]
    free = [body.names[i] in ("tool_0", "object", "wrist_3") for i in body.moving]
    assert (apart[free] > 100.0).all()
    assert (apart == as_ever)[~np.array(free)].all()


def test_approaches_and_brakes_do_not_see_what_may_touch():
    kept = nested()
    free = touching(kept, *FREE)
    goal = kept.home + np.array([0.0, -0.4, 0.1, 0.0, 0.0, 0.0])
    assert find_approach(kept, kept.home, goal)[0] is None
    approach, _ = find_approach(free, kept.home, goal)
    assert approach is not None
    paths = SweptPaths.straight(np.linspace(kept.home, goal, 60)[None])
    assert keep_clear(free, paths)[0].all()
    assert keep_clear(kept, paths)[1].all()
    ends = np.array([kept.home, goal])
    for here, is_clear in ((kept, False), (free, True)):
        assert Obstacles.of(here, 0.0, ends).clear(ends[:1], ends[1:])[0] == is_clear


def test_parts_of_arm_and_tool_that_may_touch_are_no_pair_and_no_barrier():
    here = cell()
    thick = replace(here.tool, capsules=(replace(here.tool.capsules[0], radius_m=0.06),))
    kept = replace(here, tool=thick)
    free = touching(kept, ("tool", "wrist_1"), ("tool", "forearm"), ("tool", "forearm_start"))
    names = {(body_model(kept).names[i], body_model(kept).names[j]) for i, j in body_model(kept).pairs}
    left = {(body_model(free).names[i], body_model(free).names[j]) for i, j in body_model(free).pairs}
    assert left < names
    assert names - left <= {(part, "tool_0") for part in ("wrist_1", "forearm", "forearm_start")}
    assert np.isfinite(passable(kept.robot, thick.capsules, kept.home, kept.surroundings)[0][4])
    assert np.isinf(passable(free.robot, thick.capsules, kept.home, free.surroundings)[0][4])
    q = kept.home.copy()
    q[4] = -np.pi
    assert body_model(kept).clearances(q[None]).self_collision[0] < -SELF_CLEARANCE_M
    assert body_model(free).clearances(q[None], with_object=False).self_collision[0] > 0.0
    slots = [*layout.ARM_CAPSULES, "tool_0", "tool_1", "object"]
    lost = np.flatnonzero((pair_parameters(free) > 0.0) & (pair_parameters(kept) == 0.0))
    assert {(slots[i], slots[j]) for i, j in (layout.PAIRS[k] for k in lost)} == names - left


def test_slots_of_the_optimiser_are_free_where_all_of_their_capsules_are():
    here = nested()
    short = here.tool.capsules[0]
    three = replace(here, tool=replace(here.tool, capsules=(short, short, short)))
    for pairs, free in (
        ((("tool", "nest"),), (True, True)),
        ((("tool_0", "nest"), ("tool_1", "nest")), (True, False)),  # the second one has tool_2 in it, too
        ((("tool_1", "nest"), ("tool_2", "nest")), (False, True)),
    ):
        (slots,) = touching_slots(touching(three, *pairs))
        assert tuple(slots[layout.FIRST_TOOL : layout.OBJECT].tolist()) == free
        assert not slots[: layout.FIRST_TOOL].any()
    (slots,) = touching_slots(touching(here, ("wrist_3", "nest"), ("object", "nest")))
    assert np.flatnonzero(slots).tolist() == [list(layout.ARM_CAPSULES).index("wrist_3"), layout.OBJECT]


def test_no_shape_is_called_as_the_tool_or_as_a_body_of_several():
    """A pair with `tool` would mean the shape, and one with a name that two have either of them."""
    with pytest.raises(CellError, match="tool"):
        read(("forearm", "tool"), shapes=NEST.replace("nest", "tool"))
    with pytest.raises(CellError, match="what another one is called"):
        read(("tool", "nest"), shapes=f"{NEST} }}, {{ {NEST}")

"""Draws docs/img/collision-geometry.svg: `python docs/img/collision_geometry.py` (needs matplotlib)."""

from itertools import combinations
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib import pyplot as plt
from matplotlib.patches import Polygon

from planner.cell import ToolCapsule
from planner.geometry import (
    SELF_CLEARANCE_M,
    body_capsules,
    capsule_endpoints,
    segment_segment_distance,
    self_collision_pairs,
)
from planner.robots import robot

ARM = robot("ur5e")
TOOL = (ToolCapsule(np.zeros(3), np.array([0.0, 0.0, 0.15]), 0.05),)
POSTURE = np.array([0.0, -1.9, 1.4, -1.0, -1.57, 0.0])
VIEWS = {"from the side": (0, 2), "from the front": (1, 2), "from above": (0, 1)}
KEPT = 3
NEVER = 2
ALWAYS = 1
SAME = 0
PALETTE = ["#ffffff", "#d9d9d9", "#b7d7b0", "#d95f5f"]
LEGEND = {"can collide: checked": KEPT, "never collide": NEVER, "joined: always overlap": ALWAYS}


def outline(end, other, radius):
    """Returns the outline of a capsule in an orthographic view (n, 2): a rectangle with round ends."""
    along = other - end
    heading = np.arctan2(along[1], along[0])
    turn = np.linspace(np.pi / 2, 3 * np.pi / 2, 40) + heading
    cap = radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    return np.concatenate([end + cap, other - cap])


def draw_view(axis, title, plane, capsules, ends):
    """Draws one orthographic view of all capsules."""
    colours = plt.get_cmap("tab20").colors
    for i, (capsule, (p0, p1)) in enumerate(zip(capsules, ends, strict=True)):
        shape = outline(p0[list(plane)], p1[list(plane)], capsule.radius_m)
        axis.add_patch(Polygon(shape, facecolor=(*colours[i], 0.45), edgecolor=colours[i], label=capsule.name))
        axis.plot(*np.array([p0, p1]).T[list(plane)], color=colours[i], linewidth=1.0)
    axis.set_aspect("equal")
    axis.autoscale_view()
    axis.set_title(title)
    axis.set_xlabel("xyz"[plane[0]] + " [m]")
    axis.set_ylabel("xyz"[plane[1]] + " [m]")


def pair_kinds(capsules):
    """Returns the kind of every pair, as a square matrix of the kinds above."""
    kept = set(self_collision_pairs(ARM, TOOL))
    q = np.random.default_rng(0).uniform(ARM.q_lower, ARM.q_upper, (500, 6))
    ends = capsule_endpoints(ARM, capsules, q)
    kinds = np.full((len(capsules), len(capsules)), SAME)
    for i, j in combinations(range(len(capsules)), 2):
        gap = segment_segment_distance(ends[:, i, 0], ends[:, i, 1], ends[:, j, 0], ends[:, j, 1])
        touching = gap.max() - capsules[i].radius_m - capsules[j].radius_m < SELF_CLEARANCE_M
        kinds[i, j] = kinds[j, i] = KEPT if (i, j) in kept else ALWAYS if touching else NEVER
    return kinds


def draw_pairs(axis, capsules):
    """Draws which pairs can collide."""
    names = [capsule.name for capsule in capsules]
    axis.imshow(pair_kinds(capsules), cmap=matplotlib.colors.ListedColormap(PALETTE), vmin=0, vmax=3)
    axis.set_xticks(range(len(names)), names, rotation=60, ha="right")
    axis.set_yticks(range(len(names)), names)
    axis.set_title("pairs")
    patches = [Polygon([(0, 0)] * 3, facecolor=PALETTE[kind], edgecolor="grey", label=k) for k, kind in LEGEND.items()]
    axis.legend(handles=patches, loc="upper center", bbox_to_anchor=(0.5, -0.28), frameon=False)


def main():
    """Writes the picture beside this file."""
    matplotlib.rcParams |= {"svg.hashsalt": "fling", "svg.fonttype": "none"}
    capsules = body_capsules(ARM, TOOL)
    ends = capsule_endpoints(ARM, capsules, POSTURE)
    figure, axes = plt.subplots(2, 2, figsize=(11, 10))
    for axis, (title, plane) in zip(axes.flat, VIEWS.items(), strict=False):
        draw_view(axis, title, plane, capsules, ends)
    draw_pairs(axes[1, 1], capsules)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="upper center", ncols=5, frameon=False)
    figure.tight_layout(rect=(0, 0, 1, 0.94))
    figure.savefig(Path(__file__).with_name("collision-geometry.svg"), metadata={"Date": None})


if __name__ == "__main__":
    main()

import { describe, expect, it } from "vitest";
import { armParts } from "../src/scene/arm/shape";
import { fingersOf, toolParts } from "../src/scene/arm/tool";
import { isInside, ringPoints, type Turned, visibleStrips } from "../src/scene/arm/turned";
import { type Capsule, geometryOf } from "../src/model/cell";
import { linkPoses } from "../src/model/chain";
import { distance, plus, type Pose, positionOf, transformed, type Vector } from "../src/model/poses";
import MODELS from "./cell-models.json";

const OUTSIDE_M = 0.012; // [m] the rims of lids, which a capsule rounds off

function depthIn(capsule: Capsule, poses: readonly Pose[], point: Vector): number {
  const [a, b] = [transformed(poses[capsule.frame]!, capsule.from), transformed(poses[capsule.frame]!, capsule.to)];
  const along = plus(b, a, -1);
  const square = along[0] ** 2 + along[1] ** 2 + along[2] ** 2;
  const from = plus(point, a, -1);
  const share = square ? Math.min(1, Math.max(0, (from[0] * along[0] + from[1] * along[1] + from[2] * along[2]) / square)) : 0;
  return capsule.radius - distance(point, plus(a, along, share));
}

const surface = (part: Turned): Vector[] => part.profile.flatMap((at) => ringPoints(part, at, 16));

describe.each(MODELS)("$robot", (document) => {
  const cell = geometryOf(document);
  const poses = linkPoses(cell.chain, cell.home);
  const parts = armParts(cell);

  it("is drawn within the capsules that the planner certifies", () => {
    const outside = parts.flatMap((part) =>
      surface(part).map((point) => {
        const at = transformed(poses[part.link]!, point);
        return { name: part.name, by: -Math.max(...cell.capsules.map((capsule) => depthIn(capsule, poses, at))) };
      }),
    );
    const worst = outside.reduce((a, b) => (a.by > b.by ? a : b));
    expect(worst.by, worst.name).toBeLessThan(OUTSIDE_M);
  });

  it("fills its capsules: the arm is not drawn slimmer than it is", () => {
    const tubes = { upper_arm: 0.9, forearm: 0.9 };
    for (const [name, share] of Object.entries(tubes)) {
      const capsule = cell.capsules.find((item) => item.name === name)!;
      const part = parts.find((item) => item.name === name)!;
      expect(Math.max(...part.profile.map(([radius]) => radius)) / capsule.radius).toBeGreaterThan(share);
    }
  });

  it("has no gap between its links", () => {
    poses.slice(1, 6).forEach((pose, i) => {
      const near = parts.flatMap((part) => surface(part).map((point) => ({ link: part.link, at: transformed(poses[part.link]!, point) })));
      const own = near.filter(({ link }) => link === i + 1).map(({ at }) => at);
      const before = near.filter(({ link }) => link === i).map(({ at }) => at);
      const gap = Math.min(...own.map((at) => Math.min(...before.map((other) => distance(at, other)))));
      expect(gap, `before link ${i + 1} at ${positionOf(pose)}`).toBeLessThan(0.03);
    });
  });

  it("leaves out of the meshes what other parts of the link hide, and nothing else", () => {
    for (const part of parts) {
      const strips = visibleStrips(part, parts);
      part.profile.slice(1).forEach((_, i) => {
        if (strips.includes(i)) return;
        const others = parts.filter((other) => other !== part && other.link === part.link);
        const ends = [part.profile[i]!, part.profile[i + 1]!].flatMap((at) => ringPoints(part, at, 60));
        expect(ends.every((point) => others.some((other) => isInside(other, point)))).toBe(true);
      });
    }
    expect(parts.reduce((sum, part) => sum + part.profile.length - 1 - visibleStrips(part, parts).length, 0)).toBeGreaterThan(8);
  });

  it("holds the object between fingers within the tool's capsules", () => {
    const tool = cell.capsules.filter((capsule) => capsule.name.startsWith("tool_"));
    const tcp = positionOf(cell.chain.tool);
    const fingers = fingersOf(tool, tcp, cell.objectRadius)!;
    expect(distance(plus(fingers.root, fingers.axis, fingers.length), tcp)).toBeLessThan(cell.objectRadius);
    expect(fingers.aside).toBeGreaterThan(cell.objectRadius);
    const radius = Math.max(...toolParts(tool, fingers).flatMap((part) => part.profile.map(([r]) => r)));
    expect(radius).toBeLessThan(tool[0]!.radius);
  });
});

it("has no fingers where the tool does not point at the object", () => {
  const capsule: Capsule = { name: "tool_0", frame: 6, from: [0, 0, 0], to: [0, 0, 0.1], radius: 0.04 };
  expect(fingersOf([capsule], [0.2, 0, 0.05], 0.02)).toBeNull();
  expect(fingersOf([], [0, 0, 0.2], 0.02)).toBeNull();
});

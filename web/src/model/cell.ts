/** Geometry of a cell: chain, capsules, surroundings and object. */

import type { Air } from "./flight";
import type { Chain } from "./chain";
import { poseOfRows, type Vector } from "./poses";
import type { Body } from "./bodies";

/** All points within a radius of a segment that is fixed in a link's frame; 0 is the base, 6 the flange. */
export interface Capsule {
  readonly name: string;
  readonly frame: number;
  readonly from: Vector;
  readonly to: Vector;
  readonly radius: number;
}

export interface CellGeometry {
  readonly name: string;
  readonly robot: string;
  readonly sampleRateHz: number;
  readonly chain: Chain;
  readonly capsules: readonly Capsule[]; // of arm and tool; the tool's are named tool_0, tool_1, …
  readonly home: readonly number[]; // [rad]
  readonly floorZ: number;
  readonly keepIn: readonly Body[];
  readonly keepOut: readonly Body[];
  readonly objectRadius: number;
  readonly air: Air;
}

/** What of the answer of `GET /cells/{name}/model` the geometry is made from. */
export interface CellDocument {
  readonly cell: string;
  readonly robot: string;
  readonly sample_rate_hz: number;
  readonly base_in_world: readonly (readonly number[])[];
  readonly chain: readonly (readonly (readonly number[])[])[];
  readonly tool_in_flange: readonly (readonly number[])[];
  readonly home: readonly number[];
  readonly capsules: readonly {
    readonly name: string;
    readonly part: string;
    readonly frame: number;
    readonly from_m: readonly number[];
    readonly to_m: readonly number[];
    readonly radius_m: number;
  }[];
  readonly surroundings: {
    readonly floor_z_m: number;
    readonly gravity_m_s2: number;
    readonly keep_in: readonly BodyDocument[];
    readonly keep_out: readonly BodyDocument[];
  };
  readonly object: { readonly radius_m: number; readonly drag_per_m: number };
}

interface BodyDocument {
  readonly name: string;
  readonly shape: Body["shape"];
  readonly pose: readonly (readonly number[])[];
  readonly extent_m: readonly number[];
}

/** Returns the geometry of a cell from the service's document. */
export function geometryOf(document: CellDocument): CellGeometry {
  const { surroundings, object } = document;
  return {
    name: document.cell,
    robot: document.robot,
    sampleRateHz: document.sample_rate_hz,
    chain: {
      base: poseOfRows(document.base_in_world),
      transforms: document.chain.map(poseOfRows),
      tool: poseOfRows(document.tool_in_flange),
    },
    capsules: document.capsules.filter(({ part }) => part !== "object").map(capsuleOf),
    home: document.home,
    floorZ: surroundings.floor_z_m,
    keepIn: surroundings.keep_in.map(bodyOf),
    keepOut: surroundings.keep_out.map(bodyOf),
    objectRadius: object.radius_m,
    air: { gravity: surroundings.gravity_m_s2, drag: object.drag_per_m },
  };
}

function capsuleOf({ name, frame, from_m, to_m, radius_m }: CellDocument["capsules"][number]): Capsule {
  return { name, frame, from: vectorOf(from_m), to: vectorOf(to_m), radius: radius_m };
}

function bodyOf({ name, shape, pose, extent_m }: BodyDocument): Body {
  return { name, shape, pose: poseOfRows(pose), extent: vectorOf(extent_m) };
}

function vectorOf([x = 0, y = 0, z = 0]: readonly number[]): Vector {
  return [x, y, z];
}

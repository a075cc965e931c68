/**
 * Turned parts: profiles that are rotated about an axis, the stuff that arms, lids and tools are drawn of.
 *
 * All parts of a link end in one geometry with colours at its vertices, so that a link is one draw call.
 */

import { BufferAttribute, BufferGeometry, Color } from "three";
import { cross, norm, plus, type Vector } from "../../model/poses";

export const SEGMENTS = 40; // around the axis: edges of 9°, which shading hides
const SMOOTH_RAD = 0.7; // [rad] profile corners below it are shaded round

/** A point of a profile: distance from the axis and place along it [m]. */
export type ProfilePoint = readonly [radius: number, along: number];

/** A part of one colour: its profile turned about the axis from `origin` along the unit vector `axis`. */
export interface Turned {
  readonly link: number; // DH frame it is fixed in; 0 is the base, 6 the flange
  readonly name: string;
  readonly origin: Vector;
  readonly axis: Vector;
  readonly profile: readonly ProfilePoint[];
  readonly colour: string; // name in the palette
}

/** Returns two unit vectors that are perpendicular to a unit vector and to each other. */
export function across(axis: Vector): [Vector, Vector] {
  const aside: Vector = Math.abs(axis[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const u = cross(axis, aside);
  const first: Vector = [u[0] / norm(u), u[1] / norm(u), u[2] / norm(u)];
  return [first, cross(axis, first)];
}

/** Grows one indexed triangle mesh with colours. */
export class MeshBuilder {
  private readonly positions: number[] = [];
  private readonly normals: number[] = [];
  private readonly colours: number[] = [];
  private readonly indices: number[] = [];

  constructor(private readonly palette: Readonly<Record<string, Color>>) {}

  /** Adds a turned part. */
  add(part: Turned): void {
    const [u, v] = across(part.axis);
    const normals = profileNormals(part.profile);
    const colour = this.palette[part.colour] ?? new Color("magenta");
    for (let i = 0; i + 1 < part.profile.length; i++) {
      const first = this.positions.length / 3;
      this.ring(part, u, v, part.profile[i]!, normals[i]![0], colour);
      this.ring(part, u, v, part.profile[i + 1]!, normals[i]![1], colour);
      this.strip(first);
    }
  }

  /** Adds triangles of flat faces: each face a convex polygon of points, counter-clockwise from outside. */
  addFaces(faces: readonly (readonly Vector[])[], colour: string): void {
    const { r, g, b } = this.palette[colour] ?? new Color("magenta");
    for (const face of faces) {
      const first = this.positions.length / 3;
      const n = cross(plus(face[1]!, face[0]!, -1), plus(face[2]!, face[0]!, -1));
      for (const point of face) {
        this.positions.push(...point);
        this.normals.push(n[0] / norm(n), n[1] / norm(n), n[2] / norm(n));
        this.colours.push(r, g, b);
      }
      for (let i = 1; i + 1 < face.length; i++) this.indices.push(first, first + i, first + i + 1);
    }
  }

  /** Returns the mesh. */
  geometry(): BufferGeometry {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(this.positions), 3));
    geometry.setAttribute("normal", new BufferAttribute(new Float32Array(this.normals), 3));
    geometry.setAttribute("color", new BufferAttribute(new Float32Array(this.colours), 3));
    geometry.setIndex(this.indices);
    geometry.computeBoundingSphere();
    return geometry;
  }

  private ring(
    part: Turned,
    u: Vector,
    v: Vector,
    [radius, along]: ProfilePoint,
    [outwards, forwards]: readonly [number, number],
    colour: Color,
  ): void {
    for (let k = 0; k <= SEGMENTS; k++) {
      const angle = (2 * Math.PI * k) / SEGMENTS;
      const aside = plus([Math.cos(angle) * u[0], Math.cos(angle) * u[1], Math.cos(angle) * u[2]], v, Math.sin(angle));
      this.positions.push(...plus(plus(part.origin, part.axis, along), aside, radius));
      this.normals.push(...plus([aside[0] * outwards, aside[1] * outwards, aside[2] * outwards], part.axis, forwards));
      this.colours.push(colour.r, colour.g, colour.b);
    }
  }

  private strip(first: number): void {
    const second = first + SEGMENTS + 1;
    for (let k = 0; k < SEGMENTS; k++) {
      this.indices.push(first + k, first + k + 1, second + k, second + k, first + k + 1, second + k + 1);
    }
  }
}

type Normal = readonly [outwards: number, forwards: number];

/** Returns the normals at both ends of each piece of a profile, the same for both pieces at a round corner. */
function profileNormals(profile: readonly ProfilePoint[]): [Normal, Normal][] {
  const pieces = profile.slice(1).map(([radius, along], i) => {
    const [dr, dz] = [radius - profile[i]![0], along - profile[i]![1]];
    const length = Math.hypot(dr, dz) || 1;
    return [dz / length, -dr / length] as Normal;
  });
  const meet = (a: Normal, b: Normal | undefined): Normal => {
    if (!b || a[0] * b[0] + a[1] * b[1] < Math.cos(SMOOTH_RAD)) return a;
    const length = Math.hypot(a[0] + b[0], a[1] + b[1]);
    return [(a[0] + b[0]) / length, (a[1] + b[1]) / length];
  };
  return pieces.map((own, i) => [meet(own, pieces[i - 1]), meet(own, pieces[i + 1])]);
}

/**
 * Turned parts: profiles that are rotated about an axis, the stuff that arms, lids and tools are drawn of.
 *
 * All parts of a link end in one geometry with colours at its vertices, so that a link is one draw call.
 */

import { BufferAttribute, BufferGeometry, Color } from "three";
import { cross, norm, plus, type Vector } from "../../model/poses";

const SEGMENTS = 36; // around the axis: edges of 10°, which shading hides
const COARSE = 3; // a coarse mesh takes each third of them: 12 around the axis
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

const HIDDEN_M = 0.0004; // [m] below another part's surface
const HIDDEN_POINTS = 12; // around a ring, that are looked at

/** Returns the strips of a part, pairs of neighbouring profile points, that are not inside other parts of its link. */
export function visibleStrips(part: Turned, parts: readonly Turned[]): number[] {
  const others = parts.filter((other) => other !== part && other.link === part.link);
  const hidden = part.profile.map((point) => others.find((other) => ringPoints(part, point, HIDDEN_POINTS).every((at) => isInside(other, at))));
  return part.profile.slice(1).flatMap((_, i) => (hidden[i] && hidden[i] === hidden[i + 1] ? [] : [i]));
}

/** Returns points around the axis of a part, at a point of its profile. */
export function ringPoints(part: Turned, [radius, along]: ProfilePoint, count: number): Vector[] {
  const [u, v] = across(part.axis);
  const middle = plus(part.origin, part.axis, along);
  return Array.from({ length: count }, (_, k) => {
    const angle = (2 * Math.PI * k) / count;
    return plus(plus(middle, u, radius * Math.cos(angle)), v, radius * Math.sin(angle));
  });
}

/** Returns whether a point of the link's frame is inside a part. */
export function isInside(part: Turned, point: Vector): boolean {
  const from = plus(point, part.origin, -1);
  const along = from[0] * part.axis[0] + from[1] * part.axis[1] + from[2] * part.axis[2];
  const radius = norm(plus(from, part.axis, -along));
  return part.profile.slice(1).some(([r1, z1], i) => {
    const [r0, z0] = part.profile[i]!;
    if (along < Math.min(z0, z1) || along > Math.max(z0, z1) || z0 === z1) return false;
    return radius < r0 + ((r1 - r0) * (along - z0)) / (z1 - z0) - HIDDEN_M;
  });
}

/** A mesh for close looks, and one for shadows and slow machines. */
export interface Mesh {
  readonly fine: BufferGeometry;
  readonly coarse: BufferGeometry;
}

/** Grows one indexed triangle mesh with colours. */
export class MeshBuilder {
  private readonly positions: number[] = [];
  private readonly normals: number[] = [];
  private readonly colours: number[] = [];
  private readonly indices: number[] = [];
  private readonly coarse: number[] = [];

  constructor(private readonly palette: Readonly<Record<string, Color>>) {}

  /** Adds a turned part, or some strips of it. */
  add(part: Turned, strips: readonly number[] = part.profile.slice(1).map((_, i) => i)): void {
    const [u, v] = across(part.axis);
    const normals = profileNormals(part.profile);
    const colour = this.palette[part.colour] ?? new Color("magenta");
    for (const i of strips) {
      const first = this.positions.length / 3;
      this.ring(part, u, v, part.profile[i]!, normals[i]![0], colour);
      this.ring(part, u, v, part.profile[i + 1]!, normals[i]![1], colour);
      this.strip(first, 1, this.indices);
      this.strip(first, COARSE, this.coarse);
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
      for (let i = 1; i + 1 < face.length; i++) {
        this.indices.push(first, first + i, first + i + 1);
        this.coarse.push(first, first + i, first + i + 1);
      }
    }
  }

  /** Returns the mesh, and one of a third of its triangles on the same vertices. */
  geometry(): Mesh {
    const fine = new BufferGeometry();
    fine.setAttribute("position", new BufferAttribute(new Float32Array(this.positions), 3));
    fine.setAttribute("normal", new BufferAttribute(new Float32Array(this.normals), 3));
    fine.setAttribute("color", new BufferAttribute(new Float32Array(this.colours), 3));
    const coarse = new BufferGeometry();
    for (const [name, attribute] of Object.entries(fine.attributes)) coarse.setAttribute(name, attribute);
    fine.setIndex(this.indices);
    coarse.setIndex(this.coarse);
    return { fine, coarse };
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

  private strip(first: number, step: number, indices: number[]): void {
    const second = first + SEGMENTS + 1;
    for (let k = 0; k < SEGMENTS; k += step) {
      const next = k + step;
      indices.push(first + k, first + next, second + k, second + k, first + next, second + next);
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

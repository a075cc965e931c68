/** The arm with its tool: one mesh a link, moved by the links' poses; and the same arm frozen in one posture. */

import { BufferAttribute, BufferGeometry, Group, type Material, Matrix4, Mesh } from "three";
import type { CellGeometry } from "../../model/cell";
import { JOINTS, linkPoses } from "../../model/chain";
import { axisOf, type Pose, plus, positionOf, type Vector } from "../../model/poses";
import { CASTERS, COARSE, FINE } from "../layers";
import type { Palette } from "../palette";
import { armParts } from "./shape";
import { type Fingers, fingerFaces, fingersOf, OPEN_M, toolParts } from "./tool";
import { type Mesh as Meshes, MeshBuilder, type Turned, visibleStrips } from "./turned";

/** Geometry of an arm and its tool: a mesh for each link, and one for each finger in the frame of the flange. */
export interface ArmGeometry {
  readonly parts: readonly Turned[]; // what the links are made of, for drawings
  readonly links: readonly Meshes[];
  readonly fingers: readonly { readonly geometry: Meshes; readonly side: Vector }[];
}

/** Returns the geometry of a cell's arm and tool. */
export function armGeometry(cell: CellGeometry, palette: Palette): ArmGeometry {
  const tool = cell.capsules.filter((capsule) => capsule.name.startsWith("tool_"));
  const fingers = fingersOf(tool, positionOf(cell.chain.tool), cell.objectRadius);
  const parts = [...armParts(cell), ...toolParts(tool, fingers)];
  const links = Array.from({ length: JOINTS + 1 }, (_, link) => {
    const builder = new MeshBuilder(palette.arm);
    parts.filter((part) => part.link === link).forEach((part) => builder.add(part, visibleStrips(part, parts)));
    return builder.geometry();
  });
  return { parts, links, fingers: fingers ? fingerGeometries(fingers, cell, palette) : [] };
}

function fingerGeometries(fingers: Fingers, cell: CellGeometry, palette: Palette): ArmGeometry["fingers"] {
  const [side, wide] = [axisOf(cell.chain.tool, 0), axisOf(cell.chain.tool, 1)];
  return [side, [-side[0], -side[1], -side[2]] as Vector].map((direction) => {
    const builder = new MeshBuilder(palette.arm);
    builder.addFaces(fingerFaces(fingers, direction, direction === side ? wide : [-wide[0], -wide[1], -wide[2]]), "finger");
    return { geometry: builder.geometry(), side: direction };
  });
}

/** Writes a pose into a matrix of three.js. */
function setMatrix(matrix: Matrix4, X: Pose): void {
  matrix.set(...(X as unknown as Parameters<Matrix4["set"]>));
}

/** The arm that moves. */
export class SolidArm {
  readonly root = new Group();
  private readonly links: readonly Group[];
  private readonly fingers: readonly { readonly group: Group; readonly side: Vector }[];

  constructor(
    private readonly cell: CellGeometry,
    geometry: ArmGeometry,
    material: Material,
  ) {
    this.links = geometry.links.map((link) => bodyOf(link, material));
    this.fingers = geometry.fingers.map(({ geometry: finger, side }) => ({ group: bodyOf(finger, material), side }));
    this.root.add(...this.links, ...this.fingers.map((finger) => finger.group));
  }

  /** Moves the arm to joint positions [rad]; `open` is how far the fingers are, 0 to 1. */
  move(q: ArrayLike<number>, open: number): void {
    const poses = linkPoses(this.cell.chain, q);
    this.links.forEach((group, i) => setMatrix(group.matrix, poses[i]!));
    for (const { group, side } of this.fingers) {
      setMatrix(group.matrix, poses[JOINTS]!);
      group.matrix.multiply(new Matrix4().makeTranslation(...plus([0, 0, 0], side, open * OPEN_M)));
    }
  }
}

/** Returns a rigid body: its fine mesh, and the coarse one that casts its shadow. */
function bodyOf({ fine, coarse }: Meshes, material: Material): Group {
  const [close, far] = [new Mesh(fine, material), new Mesh(coarse, material)];
  close.layers.set(FINE);
  far.layers.set(COARSE);
  far.layers.enable(CASTERS);
  const group = new Group();
  group.matrixAutoUpdate = false;
  return group.add(close, far);
}

/** Writes what moves of the arm at one posture into `into`, or into a new geometry: positions in the world, and normals. */
export function frozen(cell: CellGeometry, arm: ArmGeometry, q: ArrayLike<number>, into?: BufferGeometry): BufferGeometry {
  const poses = linkPoses(cell.chain, q);
  const pieces = [
    ...arm.links.slice(1).map(({ fine: geometry }, i) => ({ geometry, pose: poses[i + 1]! })),
    ...arm.fingers.map(({ geometry: { fine: geometry } }) => ({ geometry, pose: poses[JOINTS]! })),
  ];
  const geometry = into ?? emptyOf(pieces.map((piece) => piece.geometry));
  const [positions, normals] = [geometry.getAttribute("position"), geometry.getAttribute("normal")];
  let first = 0;
  for (const { geometry: piece, pose } of pieces) {
    turn(piece.getAttribute("position").array, pose, 1, positions.array as Float32Array, first);
    turn(piece.getAttribute("normal").array, pose, 0, normals.array as Float32Array, first);
    first += piece.getAttribute("position").count;
  }
  positions.needsUpdate = normals.needsUpdate = true;
  geometry.computeBoundingSphere();
  return geometry;
}

function emptyOf(pieces: readonly BufferGeometry[]): BufferGeometry {
  const count = pieces.reduce((sum, piece) => sum + piece.getAttribute("position").count, 0);
  const indices: number[] = [];
  let first = 0;
  for (const piece of pieces) {
    for (const index of piece.getIndex()!.array) indices.push(first + index);
    first += piece.getAttribute("position").count;
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * count), 3));
  geometry.setAttribute("normal", new BufferAttribute(new Float32Array(3 * count), 3));
  geometry.setIndex(indices);
  return geometry;
}

/** Writes R v + w p for each vector of `from` into `to`, from vertex `first` on. */
function turn(from: ArrayLike<number>, X: Pose, w: number, to: Float32Array, first: number): void {
  for (let i = 0, k = 3 * first; i < from.length; i += 3, k += 3) {
    const [x, y, z] = [from[i]!, from[i + 1]!, from[i + 2]!];
    to[k] = X[0]! * x + X[1]! * y + X[2]! * z + w * X[3]!;
    to[k + 1] = X[4]! * x + X[5]! * y + X[6]! * z + w * X[7]!;
    to[k + 2] = X[8]! * x + X[9]! * y + X[10]! * z + w * X[11]!;
  }
}

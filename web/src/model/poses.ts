/** Vectors and poses in double precision. A pose is a 4 × 4 matrix, row by row, as the service writes it. */

export type Vector = readonly [number, number, number];
export type Pose = Float64Array; // 16 numbers, row-major: three.js keeps its matrices in single precision, by columns

/** Returns a pose from its four rows. */
export function poseOfRows(rows: readonly (readonly number[])[]): Pose {
  return Float64Array.from(rows.flat());
}

/** Returns the product A B of two poses. */
export function times(a: Pose, b: Pose): Pose {
  const product = new Float64Array(16);
  for (let row = 0; row < 16; row += 4) {
    for (let column = 0; column < 4; column++) {
      let sum = 0;
      for (let k = 0; k < 4; k++) sum += a[row + k]! * b[4 * k + column]!;
      product[row + column] = sum;
    }
  }
  return product;
}

/** Returns X Rz(angle): the pose turned about its own z axis [rad]. */
export function turnedAboutZ(pose: Pose, angle: number): Pose {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const turned = pose.slice();
  for (let row = 0; row < 12; row += 4) {
    const [x, y] = [pose[row]!, pose[row + 1]!];
    turned[row] = c * x + s * y;
    turned[row + 1] = c * y - s * x;
  }
  return turned;
}

/** Returns the position of a pose [m]. */
export function positionOf(pose: Pose): Vector {
  return [pose[3]!, pose[7]!, pose[11]!];
}

/** Returns one axis of a pose as a direction: 0 is x, 1 is y, 2 is z. */
export function axisOf(pose: Pose, axis: 0 | 1 | 2): Vector {
  return [pose[axis]!, pose[4 + axis]!, pose[8 + axis]!];
}

/** Returns a point of the pose's frame in the frame of the pose. */
export function transformed(pose: Pose, [x, y, z]: Vector): Vector {
  const row = (i: number): number => pose[i]! * x + pose[i + 1]! * y + pose[i + 2]! * z + pose[i + 3]!;
  return [row(0), row(4), row(8)];
}

/** Returns a + s b. */
export function plus(a: Vector, b: Vector, s = 1): Vector {
  return [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
}

/** Returns s v. */
export function scaled(v: Vector, s: number): Vector {
  return [s * v[0], s * v[1], s * v[2]];
}

export type Quaternion = readonly [number, number, number, number]; // x, y, z, w

/** Returns the unit quaternion of a rotation vector [rad]. */
export function quaternionOf(rotation: Vector): Quaternion {
  const angle = norm(rotation);
  const s = angle < 1e-9 ? 0.5 : Math.sin(angle / 2) / angle;
  return [s * rotation[0], s * rotation[1], s * rotation[2], Math.cos(angle / 2)];
}

/** Returns the rotation vector [rad] of a unit quaternion, at most half a turn. */
export function rotationVectorOf([x, y, z, w]: Quaternion): Vector {
  const sine = Math.hypot(x, y, z);
  const s = sine < 1e-9 ? 2 : (2 * Math.atan2(sine, Math.abs(w))) / sine;
  const sign = w < 0 ? -s : s;
  return [sign * x, sign * y, sign * z];
}

/** Returns the unit quaternion of a pose's rotation: of its four numbers the largest is not negative. Source: Shepperd (1978). */
export function quaternionOfPose(pose: Pose): Quaternion {
  const r = (row: number, column: number): number => pose[4 * row + column]!;
  const trace = r(0, 0) + r(1, 1) + r(2, 2);
  const squares = [r(0, 0), r(1, 1), r(2, 2), trace].map((value, i) => (i < 3 ? 1 + 2 * value - trace : 1 + value)); // 4 x², … 4 w²
  const largest = squares.indexOf(Math.max(...squares));
  const [xy, xz, yz] = [r(1, 0) + r(0, 1), r(2, 0) + r(0, 2), r(2, 1) + r(1, 2)]; // 4 x y, …
  const [xw, yw, zw] = [r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)];
  const products = [[squares[0]!, xy, xz, xw], [xy, squares[1]!, yz, yw], [xz, yz, squares[2]!, zw], [xw, yw, zw, squares[3]!]][largest]!;
  const scale = 2 * Math.sqrt(squares[largest]!);
  return products.map((product) => product / scale) as unknown as Quaternion;
}

/** Returns the distance of two points [m]. */
export function distance(a: Vector, b: Vector): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/** Returns the length of a vector. */
export function norm(v: Vector): number {
  return Math.hypot(v[0], v[1], v[2]);
}

/** Returns the cross product of two vectors. */
export function cross(a: Vector, b: Vector): Vector {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

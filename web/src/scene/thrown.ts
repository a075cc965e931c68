/** The object: held, in flight, or where it landed; and the dark spot below it that tells its height. */

import { CircleGeometry, type Color, Group, Mesh, MeshMatcapMaterial, ShaderMaterial, SphereGeometry } from "three";
import type { Vector } from "../model/poses";
import { sphere } from "./studio";

const SMALLEST_M = 0.018; // [m] radius that is still seen from across the room
const SPOT_REACH_M = 1.6; // [m] height from which the spot is gone

const SPOT_VERTEX = /* glsl */ `varying vec2 at; void main() { at = uv * 2.0 - 1.0; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`;
const SPOT_FRAGMENT = /* glsl */ `
uniform float strength;
varying vec2 at;
void main() { float r = dot(at, at); gl_FragColor = vec4(0.0, 0.0, 0.0, strength * (1.0 - r) * (1.0 - r)); }`;

export class ThrownObject {
  readonly root = new Group();
  private readonly ball: Mesh<SphereGeometry, MeshMatcapMaterial>;
  private readonly spot: Mesh<CircleGeometry, ShaderMaterial>;
  private radius = SMALLEST_M;

  constructor() {
    this.ball = new Mesh(new SphereGeometry(1, 28, 18), new MeshMatcapMaterial({ matcap: sphere() }));
    const material = new ShaderMaterial({
      vertexShader: SPOT_VERTEX,
      fragmentShader: SPOT_FRAGMENT,
      uniforms: { strength: { value: 0.4 } },
      transparent: true,
      depthWrite: false,
    });
    this.spot = new Mesh(new CircleGeometry(1, 24), material);
    this.root.add(this.ball, this.spot);
    this.root.visible = false; // until there is a cell, and a hand to hold it
  }

  set colour(colour: Color) {
    this.ball.material.color.copy(colour);
  }

  setRadius(radius: number): void {
    this.radius = Math.max(radius, SMALLEST_M);
    this.ball.scale.setScalar(this.radius);
  }

  place(at: Vector, floorZ: number): void {
    this.ball.position.set(...at);
    const height = Math.max(0, at[2] - floorZ);
    this.spot.position.set(at[0], at[1], floorZ + 0.0012);
    this.spot.scale.setScalar(this.radius * (1.5 + 1.6 * height));
    this.spot.material.uniforms.strength!.value = 0.45 * Math.max(0, 1 - height / SPOT_REACH_M);
  }

  dispose(): void {
    for (const mesh of [this.ball, this.spot]) {
      mesh.geometry.dispose();
      mesh.material.dispose();
    }
  }
}

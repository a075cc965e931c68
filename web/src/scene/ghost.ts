/** Ghosts: an arm in one posture as a pane of coloured glass, bright at its outline. */

import { type BufferGeometry, Color, Group, Mesh, MeshBasicMaterial, ShaderMaterial } from "three";

const VERTEX = /* glsl */ `
varying float facing;
void main() {
  vec4 place = modelViewMatrix * vec4(position, 1.0);
  facing = abs(dot(normalize(normalMatrix * normal), normalize(-place.xyz)));
  gl_Position = projectionMatrix * place;
}`;

const FRAGMENT = /* glsl */ `
uniform vec3 colour;
uniform float fill;
uniform float outline;
varying float facing;
void main() {
  float edge = 1.0 - facing;
  gl_FragColor = vec4(colour, fill + (outline - fill) * edge * edge * edge);
  #include <colorspace_fragment>
}`;

const BEHIND = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 8 }; // the solid arm wins where both are

/** A see-through arm; its surface hides its own back, so that nothing of its inside shows. */
export class Ghost {
  readonly root = new Group();
  private readonly material: ShaderMaterial;
  private readonly meshes: Mesh[];

  constructor(geometry: BufferGeometry, colour: Color, strength: number, order: number) {
    this.material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: {
        colour: { value: colour.clone() },
        fill: { value: 0.16 * strength },
        outline: { value: 0.95 * strength },
      },
      transparent: true,
      depthWrite: false,
      ...BEHIND,
    });
    const depthOnly = new Mesh(geometry, new MeshBasicMaterial({ colorWrite: false, transparent: true, ...BEHIND }));
    const glass = new Mesh(geometry, this.material);
    depthOnly.renderOrder = order;
    glass.renderOrder = order + 0.5;
    this.meshes = [depthOnly, glass];
    this.root.add(...this.meshes);
  }

  set colour(colour: Color) {
    (this.material.uniforms.colour!.value as Color).copy(colour);
  }

  get geometry(): BufferGeometry {
    return this.meshes[0]!.geometry;
  }

  dispose(): void {
    this.geometry.dispose();
    for (const mesh of this.meshes) (mesh.material as ShaderMaterial).dispose();
  }
}

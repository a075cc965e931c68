/** The floor: a fine grid that ends in the background, and the soft shadow of what stands above it. */

import {
  CircleGeometry,
  Color,
  Mesh,
  NoBlending,
  OrthographicCamera,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
  type Texture,
  UnsignedByteType,
  Vector2,
  WebGLRenderTarget,
  type WebGLRenderer,
} from "three";
import { CASTERS } from "./layers";
import type { Palette } from "./palette";

const RADIUS_M = 14; // [m] of the disc that is drawn
const SHADOW_PX = 192; // side of the shadow's picture: soft anyway
const SHADOW_REACH_M = 0.9; // [m] height at which a thing no longer darkens the floor

const FLOOR_VERTEX = /* glsl */ `
varying vec2 place;
void main() {
  place = (modelMatrix * vec4(position, 1.0)).xy;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const FLOOR_FRAGMENT = /* glsl */ `
uniform vec3 background, ground, fineLine, boldLine;
uniform vec2 centre;
uniform float fadeFrom, fadeTo;
varying vec2 place;
float lines(float cell, float width) {
  vec2 p = place / cell;
  vec2 w = fwidth(p);
  vec2 d = abs(fract(p - 0.5) - 0.5) / max(w, vec2(1e-6));
  float line = 1.0 - min(min(d.x, d.y) / width, 1.0);
  return line * clamp(0.45 / max(w.x, w.y), 0.0, 1.0) * clamp(1.4 - 2.0 * max(w.x, w.y), 0.0, 1.0);
}
void main() {
  float away = length(place - centre);
  float seen = 1.0 - smoothstep(fadeFrom, fadeTo, away);
  vec3 colour = mix(ground, fineLine, lines(0.1, 1.0));
  colour = mix(colour, boldLine, lines(1.0, 1.3));
  gl_FragColor = vec4(mix(background, colour, seen), 1.0);
  #include <colorspace_fragment>
}`;

const SHADE_VERTEX = /* glsl */ `
varying vec2 at;
void main() { at = vec2(1.0 - uv.x, uv.y); gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`; // seen from below
const SHADE_FRAGMENT = /* glsl */ `
uniform float strength;
uniform sampler2D shadow;
varying vec2 at;
void main() { gl_FragColor = vec4(0.0, 0.0, 0.0, strength * texture2D(shadow, at).r); }`;

const CAST_VERTEX = /* glsl */ `
varying float height;
uniform float floorZ;
void main() {
  vec4 place = modelMatrix * vec4(position, 1.0);
  height = place.z - floorZ;
  gl_Position = projectionMatrix * viewMatrix * place;
}`;
const CAST_FRAGMENT = /* glsl */ `
varying float height;
uniform float reach;
void main() { float s = clamp(1.0 - height / reach, 0.0, 1.0); gl_FragColor = vec4(0.25 + 0.75 * s * s, 0.0, 0.0, 1.0); }`;

const BLUR_VERTEX = /* glsl */ `varying vec2 uv2; void main() { uv2 = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }`;
const BLUR_FRAGMENT = /* glsl */ `
uniform sampler2D from;
uniform vec2 along;
varying vec2 uv2;
void main() {
  float sum = 0.1964 * texture2D(from, uv2).r;
  sum += 0.2969 * (texture2D(from, uv2 + 1.411 * along).r + texture2D(from, uv2 - 1.411 * along).r);
  sum += 0.0945 * (texture2D(from, uv2 + 3.297 * along).r + texture2D(from, uv2 - 3.297 * along).r);
  sum += 0.0104 * (texture2D(from, uv2 + 5.176 * along).r + texture2D(from, uv2 - 5.176 * along).r);
  gl_FragColor = vec4(sum, 0.0, 0.0, 1.0);
}`;

/** The floor with its shadow. */
export class Floor {
  readonly mesh: Mesh;
  readonly shadow: Mesh; // lies on the floor
  private readonly material: ShaderMaterial;
  private readonly shade: ShaderMaterial;
  private readonly targets = [0, 1].map(() => new WebGLRenderTarget(SHADOW_PX, SHADOW_PX, { type: UnsignedByteType }));
  private readonly camera = new OrthographicCamera();
  private readonly cast: ShaderMaterial;
  private readonly blur: ShaderMaterial;
  private readonly blurScene = new Scene();
  private readonly blurCamera = new OrthographicCamera(-1, 1, 1, -1, 0, 1);

  constructor() {
    this.material = new ShaderMaterial({
      vertexShader: FLOOR_VERTEX,
      fragmentShader: FLOOR_FRAGMENT,
      uniforms: {
        ...{ background: { value: new Color() }, ground: { value: new Color() } },
        ...{ fineLine: { value: new Color() }, boldLine: { value: new Color() } },
        ...{ centre: { value: new Vector2() }, fadeFrom: { value: 2 }, fadeTo: { value: 6 } },
      },
    });
    this.shade = new ShaderMaterial({
      vertexShader: SHADE_VERTEX,
      fragmentShader: SHADE_FRAGMENT,
      uniforms: { strength: { value: 0 }, shadow: { value: this.targets[0]!.texture as Texture } },
      transparent: true,
      depthWrite: false,
    });
    this.shadow = new Mesh(new PlaneGeometry(1, 1), this.shade);
    this.shadow.renderOrder = -1;
    this.mesh = new Mesh(new CircleGeometry(RADIUS_M, 64), this.material);
    this.cast = new ShaderMaterial({
      vertexShader: CAST_VERTEX,
      fragmentShader: CAST_FRAGMENT,
      blending: NoBlending,
      uniforms: { floorZ: { value: 0 }, reach: { value: SHADOW_REACH_M } },
    });
    this.blur = new ShaderMaterial({
      vertexShader: BLUR_VERTEX,
      fragmentShader: BLUR_FRAGMENT,
      uniforms: { from: { value: null }, along: { value: new Vector2() } },
      depthTest: false,
      depthWrite: false,
    });
    const screen = new Mesh(new PlaneGeometry(2, 2), this.blur);
    screen.frustumCulled = false;
    this.blurScene.add(screen);
    this.camera.layers.set(CASTERS);
  }

  setPalette(palette: Palette): void {
    const uniforms = this.material.uniforms;
    (uniforms.background!.value as Color).copy(palette.background);
    (uniforms.ground!.value as Color).copy(palette.floor);
    (uniforms.fineLine!.value as Color).copy(palette.gridFine);
    (uniforms.boldLine!.value as Color).copy(palette.gridBold);
    this.shade.uniforms.strength!.value = palette.shadow;
  }

  /** Places the floor: its height, the middle of what stands on it, how far that reaches [m]. */
  place(z: number, centre: readonly [number, number], extent: number, arm: readonly [number, number], reach: number): void {
    this.mesh.position.z = z - 0.0005;
    this.mesh.position.x = centre[0];
    this.mesh.position.y = centre[1];
    const uniforms = this.material.uniforms;
    (uniforms.centre!.value as Vector2).set(...centre);
    uniforms.fadeFrom!.value = 0.7 * extent;
    uniforms.fadeTo!.value = 2.6 * extent;
    this.shadow.position.set(arm[0], arm[1], z + 0.0004);
    this.shadow.scale.set(2 * reach, 2 * reach, 1);
    this.cast.uniforms.floorZ!.value = z;
    Object.assign(this.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0, far: 10 });
    this.camera.position.set(arm[0], arm[1], z - 0.01); // looks up from below, so that the lowest surface is seen
    this.camera.up.set(0, 1, 0);
    this.camera.lookAt(arm[0], arm[1], z + 1);
    this.camera.updateProjectionMatrix();
  }

  /** Draws the shadow of all casters. */
  drawShadow(renderer: WebGLRenderer, scene: Scene): void {
    const [background, override] = [scene.background, scene.overrideMaterial];
    const clear = renderer.getClearColor(new Color());
    scene.background = null;
    scene.overrideMaterial = this.cast;
    renderer.setClearColor(0x000000, 1);
    renderer.setRenderTarget(this.targets[0]!);
    renderer.clear();
    renderer.render(scene, this.camera);
    scene.overrideMaterial = override;
    scene.background = background;
    this.blurInto(renderer, 0, 1, 1 / SHADOW_PX, 0);
    this.blurInto(renderer, 1, 0, 0, 1 / SHADOW_PX);
    renderer.setRenderTarget(null);
    renderer.setClearColor(clear, 1);
  }

  private blurInto(renderer: WebGLRenderer, from: 0 | 1, to: 0 | 1, x: number, y: number): void {
    this.blur.uniforms.from!.value = this.targets[from]!.texture;
    (this.blur.uniforms.along!.value as Vector2).set(x, y);
    renderer.setRenderTarget(this.targets[to]!);
    renderer.render(this.blurScene, this.blurCamera);
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.shadow.geometry.dispose();
    for (const item of [this.material, this.shade, this.cast, this.blur, ...this.targets]) item.dispose();
  }
}

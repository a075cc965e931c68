/**
 * The picture of everything that stands still, kept while only the arm moves: without a graphics processor, drawing the
 * floor and the ghosts anew is most of a frame.
 *
 * Two pictures from the same camera: colours with the ghosts, depths without them, so that the arm is never hidden
 * behind glass. While it moves the ghosts are seen behind it; at rest everything is drawn in order.
 */

import {
  DepthTexture,
  GLSL3,
  Mesh,
  OrthographicCamera,
  PlaneGeometry,
  Scene,
  ShaderMaterial,
  SRGBColorSpace,
  Vector2,
  WebGLRenderTarget,
  type WebGLRenderer,
} from "three";

const VERTEX = /* glsl */ `void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }`;
const FRAGMENT = /* glsl */ `
out vec4 colour;
uniform sampler2D colours;
uniform sampler2D depths;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  colour = texelFetch(colours, at, 0);
  gl_FragDepth = texelFetch(depths, at, 0).r;
}`;

export class StillPicture {
  fresh = false;
  private readonly behind: WebGLRenderTarget; // depths, without the ghosts
  private readonly seen: WebGLRenderTarget; // colours
  private readonly material: ShaderMaterial;
  private readonly scene = new Scene();
  private readonly camera = new OrthographicCamera(-1, 1, 1, -1, 0, 1);

  constructor() {
    this.behind = new WebGLRenderTarget(1, 1, { depthTexture: new DepthTexture(1, 1) });
    this.seen = new WebGLRenderTarget(1, 1);
    // The picture is kept as it goes to the screen, encoded and blended there: three does that for targets of headsets.
    this.seen.texture.colorSpace = SRGBColorSpace;
    Object.assign(this.seen, { isXRRenderTarget: true });
    this.material = new ShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: { colours: { value: this.seen.texture }, depths: { value: this.behind.depthTexture } },
      depthFunc: 1, // AlwaysDepth
      toneMapped: false,
    });
    const screen = new Mesh(new PlaneGeometry(2, 2), this.material);
    screen.frustumCulled = false;
    this.scene.add(screen);
  }

  /** Takes both pictures; `draw` draws what stands still, with ghosts or without. */
  take(renderer: WebGLRenderer, draw: (ghosts: boolean) => void): void {
    const { x, y } = renderer.getDrawingBufferSize(new Vector2());
    for (const [target, ghosts] of [
      [this.behind, false],
      [this.seen, true],
    ] as const) {
      if (target.width !== x || target.height !== y) target.setSize(x, y);
      renderer.setRenderTarget(target);
      draw(ghosts);
    }
    renderer.setRenderTarget(null);
    this.fresh = true;
  }

  /** Shows the picture, with its depths. */
  show(renderer: WebGLRenderer): void {
    renderer.render(this.scene, this.camera);
  }

  dispose(): void {
    this.behind.dispose();
    this.seen.dispose();
    this.material.dispose();
  }
}

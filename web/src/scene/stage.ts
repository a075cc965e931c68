/** The stage: renderer, camera, floor; it draws on demand, less finely while things move on a slow machine. */

import { Color, PerspectiveCamera, Scene, Vector3 as ThreeVector, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { DetailControl, LEVELS } from "./detail";
import { Floor } from "./floor";

const FIELD_OF_VIEW_DEG = 34;
const PIXEL_RATIO_MAX = 2; // more is not seen
const REST_MS = 160; // [ms] without motion, after which the picture is drawn in full
const PLAIN_LEVEL = 3; // first level of detail where a person wants little

/** What the stage asks before each frame. */
export interface Actors {
  /** Moves what moves by itself; returns whether it goes on. */
  step(now: number): boolean;
}

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.03, 60);
  readonly floor = new Floor();
  readonly controls: OrbitControls;
  readonly renderer: WebGLRenderer;
  frameMs = 0;
  private readonly detail: DetailControl;
  private readonly background = new Color();
  private actors: Actors = { step: () => false };
  private requested = 0;
  private rest = 0;
  private shadowDue = true;
  private drawnLevel = -1;
  private disposed = false;

  constructor(
    readonly canvas: HTMLCanvasElement,
    plain: boolean,
  ) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "high-performance" });
    this.renderer.info.autoReset = false;
    this.detail = new DetailControl(plain ? PLAIN_LEVEL : 0);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(1.5, -3, 1.7);
    this.scene.add(this.floor.mesh);
    this.controls = new OrbitControls(this.camera, canvas);
    Object.assign(this.controls, { maxPolarAngle: 1.62, minDistance: 0.25, maxDistance: 14, zoomSpeed: 1.2 });
    this.controls.addEventListener("change", () => this.invalidate());
  }

  setActors(actors: Actors): void {
    this.actors = actors;
  }

  setBackground(colour: Color): void {
    this.background.copy(colour);
    this.renderer.setClearColor(this.background, 1);
    this.invalidate();
  }

  get lookedAt(): ThreeVector {
    return this.controls.target;
  }

  get level(): number {
    return this.detail.level;
  }

  /** Asks for a frame; `casters` says that something with a shadow has moved. */
  invalidate(casters = false): void {
    this.shadowDue ||= casters;
    if (this.disposed || this.requested) return;
    this.requested = requestAnimationFrame((now) => this.frame(now));
  }

  /** Takes the canvas' size in the layout. */
  resize(): void {
    this.drawnLevel = -1;
    this.invalidate();
  }

  /** Draws at once and in full. */
  drawNow(): void {
    this.draw(0);
  }

  private frame(now: number): void {
    this.requested = 0;
    if (this.disposed) return;
    const goesOn = this.actors.step(now);
    this.controls.update();
    this.detail.frame(now);
    this.draw(this.detail.level);
    if (goesOn) this.invalidate();
    window.clearTimeout(this.rest);
    this.rest = window.setTimeout(() => this.settle(), REST_MS);
  }

  /** Draws in full what no longer moves. */
  private settle(): void {
    if (this.disposed || this.requested) return;
    this.detail.pause();
    if (this.detail.level > 0) this.draw(0);
  }

  private draw(level: number): void {
    const began = performance.now();
    this.fit(level);
    const detail = LEVELS[level]!;
    this.renderer.info.reset();
    this.floor.setShadow(detail.shadow);
    if (detail.shadow && this.shadowDue) {
      this.floor.drawShadow(this.renderer, this.scene);
      this.shadowDue = false;
    }
    this.renderer.render(this.scene, this.camera);
    this.frameMs = performance.now() - began;
  }

  /** Gives the picture the resolution of a level. */
  private fit(level: number): void {
    if (level === this.drawnLevel) return;
    const [width, height] = [Math.max(1, this.canvas.clientWidth), Math.max(1, this.canvas.clientHeight)];
    const ratio = Math.min(window.devicePixelRatio || 1, PIXEL_RATIO_MAX) * LEVELS[level]!.resolution;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.drawnLevel = level;
  }

  dispose(): void {
    this.disposed = true;
    window.clearTimeout(this.rest);
    cancelAnimationFrame(this.requested);
    this.controls.dispose();
    this.floor.dispose();
    this.renderer.dispose();
  }
}

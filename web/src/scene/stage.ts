/** The stage: renderer, camera, floor; it draws on demand, less finely while things move on a slow machine. */

import { Color, Group, type Matrix4, PerspectiveCamera, Scene, Vector3 as ThreeVector, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { DetailControl, LEVELS, SOFTWARE_LEVEL } from "./detail";
import { type FreeArea, NO_INSETS, shiftLens } from "./camera";
import { Floor } from "./floor";
import type { Insets } from "./interface";
import { COARSE, FINE } from "./layers";
import { both, EVERYWHERE, type Region, regionOf } from "./region";
import { StillPicture } from "./still";

const FIELD_OF_VIEW_DEG = 34;
const PIXEL_RATIO_MAX = 2; // more is not seen
const REST_FINER = 2; // pixels drawn for each of the screen's, along both sides, of a picture at rest: smooth edges
const LEAST_FREE = 0.3; // of the canvas: what is shown is not drawn smaller than that
const EDGE_PX = 4; // [px] drawn round what moves: pixels of a low resolution are as large
const ROUNDING = 1e-9; // [-] and [m] of the camera's matrix: no pixel sees less
const REST_MS = 700; // [ms] without motion, after which the picture is drawn in full; a moving arm is reported more often

/** What the stage asks before each frame. */
interface Actors {
  /** Moves what moves by itself; returns whether it goes on. */
  step(now: number): boolean;
  /** What is to be done once a frame is drawn. */
  drawn(): void;
}

export class Stage {
  readonly scene = new Scene();
  readonly still = new Group(); // floor, plan, marks
  readonly ghosts = new Group(); // see-through, and still as well
  readonly moving = new Group(); // arm and object
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.03, 60);
  readonly floor = new Floor();
  readonly controls: OrbitControls;
  readonly renderer: WebGLRenderer;
  frameMs = 0;
  insets: Insets = NO_INSETS;
  private readonly detail: DetailControl;
  private readonly background = new Color();
  private actors: Actors = { step: () => false, drawn: () => undefined };
  private requested = 0;
  private rest = 0;
  private shadowDue = true;
  private drawnResolution = Number.NaN;
  private disposed = false;
  private pinned: number | null = null;
  private readonly picture = new StillPicture();
  private movedIn = EVERYWHERE; // where the canvas differs from the picture of what stands still
  private readonly software: boolean; // no graphics processor
  private readonly seenFrom: Matrix4;

  constructor(readonly canvas: HTMLCanvasElement) {
    const renderer = rendererName();
    if (renderer === null) throw new Error("it has no WebGL");
    this.software = /swiftshader|llvmpipe|softpipe|basic render/i.test(renderer);
    this.renderer = new WebGLRenderer({ canvas, antialias: !this.software, preserveDrawingBuffer: this.software, powerPreference: "high-performance" });
    this.renderer.info.autoReset = false;
    this.detail = new DetailControl(this.software ? SOFTWARE_LEVEL : 0);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(1.5, -3, 1.7);
    this.seenFrom = this.camera.matrixWorld.clone();
    this.still.add(this.floor.mesh);
    this.moving.add(this.floor.shadow);
    this.scene.add(this.still, this.ghosts, this.moving);
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

  /** What of the canvas no panel covers. */
  get freeArea(): FreeArea {
    const { left, right, top, bottom } = this.insets;
    const share = (covered: number, side: number): number => Math.max(LEAST_FREE, 1 - covered / Math.max(1, side));
    return { width: share(left + right, this.canvas.clientWidth), height: share(top + bottom, this.canvas.clientHeight) };
  }

  /** Moves the camera away from what it looks at by a factor, as far as the controls let a person. */
  zoom(factor: number): void {
    const away = this.camera.position.clone().sub(this.controls.target);
    const { minDistance, maxDistance } = this.controls;
    away.setLength(Math.min(maxDistance, Math.max(minDistance, factor * away.length())));
    this.camera.position.copy(this.controls.target).add(away);
    this.invalidate();
  }

  get lookedAt(): ThreeVector {
    return this.controls.target;
  }

  /** Without a graphics processor edges are not smoothed while things move. */
  private get restFiner(): number {
    return this.software ? REST_FINER : 1;
  }

  get level(): number {
    return this.pinned ?? this.detail.level;
  }

  /** Asks for a frame because of what stands still, or of the camera. */
  invalidate(): void {
    this.picture.fresh = false;
    this.request();
  }

  /** Asks for a frame because the arm or the object has moved. */
  moved(): void {
    this.shadowDue = true;
    this.request();
  }

  private request(): void {
    if (this.disposed || this.requested) return;
    this.requested = requestAnimationFrame((now) => this.frame(now));
  }

  /** Keeps to one level of detail, for measurements and pictures; null: as fast as the machine is. */
  pin(level: number | null): void {
    this.pinned = level;
  }

  /** Takes the canvas' size in the layout. */
  resize(): void {
    this.drawnResolution = Number.NaN;
    this.invalidate();
  }

  /** Draws at once and in full; `finest`: as it is drawn at rest. */
  drawNow(finest = false): void {
    this.shadowDue = true;
    this.controls.update();
    this.draw(0, true, finest ? this.restFiner : 1);
  }

  private frame(now: number): void {
    this.requested = 0;
    if (this.disposed) return;
    const goesOn = this.actors.step(now);
    this.controls.update();
    this.detail.frame(now);
    this.draw(this.pinned ?? this.detail.level);
    if (goesOn) this.request();
    window.clearTimeout(this.rest);
    this.rest = window.setTimeout(() => this.settle(), REST_MS);
  }

  /** Draws in full what no longer moves. */
  private settle(): void {
    if (this.disposed || this.requested) return;
    this.detail.pause();
    if (this.pinned !== null) return;
    if (this.detail.level > 0 || this.software) this.draw(0, true, this.restFiner);
  }

  /** Draws at a level of detail; `whole` draws what stands still anew and in order. */
  private draw(level: number, whole = false, finer = 1): void {
    const began = performance.now();
    const detail = LEVELS[level]!;
    this.fit(level, finer);
    this.camera.layers.set(0);
    this.camera.layers.enable(detail.fine ? FINE : COARSE);
    this.renderer.info.reset();
    this.floor.shadow.visible = detail.shadow;
    if (detail.shadow && this.shadowDue) {
      this.floor.drawShadow(this.renderer, this.scene);
      this.shadowDue = false;
    }
    this.camera.updateMatrixWorld();
    if (whole || !this.isSeenAsBefore() || !(this.software || level > 0)) this.drawWhole();
    else this.drawMoving();
    this.actors.drawn();
    this.frameMs = performance.now() - began;
  }

  /** Whether the camera stands where the last whole picture was seen from; the controls round anew at each update. */
  private isSeenAsBefore(): boolean {
    return this.camera.matrixWorld.elements.every((value, i) => Math.abs(value - this.seenFrom.elements[i]!) < ROUNDING);
  }

  private drawWhole(): void {
    this.renderer.render(this.scene, this.camera);
    this.seenFrom.copy(this.camera.matrixWorld);
    this.picture.fresh = false;
  }

  /** Draws what moves before the picture of what does not; in software only where either differs from the last frame. */
  private drawMoving(): void {
    if (!this.picture.fresh) this.takePicture();
    const now = this.software ? this.movingRegion() : EVERYWHERE;
    this.cut(both(now, this.movedIn));
    this.movedIn = now;
    this.renderer.autoClear = false;
    this.picture.show(this.renderer);
    this.only(this.moving);
    this.renderer.render(this.scene, this.camera);
    this.only(this.still, this.ghosts, this.moving);
    this.renderer.autoClear = true;
    this.renderer.setScissorTest(false);
  }

  private movingRegion(): Region {
    const { shadow } = this.floor;
    const things = this.moving.children.filter((thing) => thing !== shadow);
    return regionOf(things, this.camera, shadow.visible ? shadow.position.z : null);
  }

  /** Draws within a region alone. */
  private cut({ left, right, bottom, top }: Region): void {
    const [width, height] = [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2];
    const [x, y] = [(left + 1) * width - EDGE_PX, (bottom + 1) * height - EDGE_PX];
    this.renderer.setScissor(x, y, (right - left) * width + 2 * EDGE_PX, (top - bottom) * height + 2 * EDGE_PX);
    this.renderer.setScissorTest(true);
  }

  private takePicture(): void {
    this.movedIn = EVERYWHERE;
    this.picture.take(this.renderer, (ghosts) => {
      this.only(this.still, ...(ghosts ? [this.ghosts] : []));
      this.renderer.render(this.scene, this.camera);
    });
    this.only(this.still, this.ghosts, this.moving);
  }

  private only(...shown: readonly Group[]): void {
    for (const group of [this.still, this.ghosts, this.moving]) group.visible = shown.includes(group);
  }

  /** Gives the picture the resolution of a level; `finer` is more than the screen's. */
  private fit(level: number, finer: number): void {
    const resolution = finer * LEVELS[level]!.resolution;
    if (resolution === this.drawnResolution) return;
    const [width, height] = [Math.max(1, this.canvas.clientWidth), Math.max(1, this.canvas.clientHeight)];
    const ratio = Math.min(window.devicePixelRatio || 1, PIXEL_RATIO_MAX) * resolution;
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    shiftLens(this.camera, width, height, this.insets);
    this.camera.updateProjectionMatrix();
    this.drawnResolution = resolution;
    this.picture.fresh = false;
  }

  dispose(): void {
    this.disposed = true;
    window.clearTimeout(this.rest);
    cancelAnimationFrame(this.requested);
    this.controls.dispose();
    this.floor.dispose();
    this.picture.dispose();
    this.renderer.dispose();
  }
}

/** Returns the name of what draws on this machine, null without WebGL. */
function rendererName(): string | null {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (gl === null) return null;
  const info = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(info?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

/** The scene: the only module that the page loads of it, and the only one that knows all the others. */

import { type ArmGeometry, armGeometry, frozen, SolidArm } from "./arm/model";
import { type CellDocument, type CellGeometry, geometryOf } from "../model/cell";
import { toolPose } from "../model/chain";
import { norm, positionOf, scaled, type Vector } from "../model/poses";
import { pngOf } from "../service/save";
import { axisMarks, axisThings } from "./axes";
import { CameraMove, NO_INSETS, type Subject, viewOf } from "./camera";
import { drawing } from "./drawing/picture";
import { floorMapThings } from "./floor-map";
import { Ghost } from "./ghost";
import { Handles } from "./handles";
import type * as face from "./interface";
import { Layer } from "./layer";
import { bodyThings, hazardThings, landingThings, nearestThings, obstacleThings, targetThings } from "./marks";
import { type Palette, paletteOf } from "./palette";
import { PlanMotion, planThings } from "./plan";
import { Stage } from "./stage";
import { studioMaterial } from "./studio";
import { subjectOf } from "./subject";
import { ThrownObject } from "./thrown";

const LAYERS = ["axes", "map", "bodies", "hazard", "plan", "target", "nearest", "landings", "obstacles"] as const;
const SIDES = ["left", "right", "top", "bottom"] as const;
const GRIPPER_OPENS_S = 0.06; // [s] in which the drawn fingers open
const STILL_RAD = 1e-4; // [rad] less than this is not seen to move
const FOLLOWER = 20; // place in the order of drawing of the ghost that moves
const AROUND_ARM = 1.15; // of its reach: what the camera shows without a throw
const GHOST_STRENGTHS = { start: 0.4, release: 0.75, rest: 0.32 } as const;

class ThrowScene implements face.Scene {
  private readonly stage: Stage;
  private readonly layers = Object.fromEntries(LAYERS.map((name) => [name, new Layer()])) as Record<(typeof LAYERS)[number], Layer>;
  private readonly material = studioMaterial();
  private readonly thrown = new ThrownObject();
  private readonly carried = new Layer(); // the target that moves, built where it is as the motion begins
  private readonly handles: Handles;
  private readonly camera: CameraMove;
  private palette: Palette;
  private cell: CellGeometry | null = null;
  private geometry: ArmGeometry | null = null;
  private arm: SolidArm | null = null;
  private ghosts: Ghost[] = [];
  private follower: Ghost | null = null; // the plan while the solid arm is live
  private motion: PlanMotion | null = null;
  private appearance: face.PlanAppearance = "valid";
  private time = 0;
  private live: face.LiveState | null = null;
  private target: face.Target | null = null;
  private handle: face.Handle = "none";
  private nearest: Vector | null = null;
  private obstacles: readonly face.Obstacle[] = [];
  private landings: readonly face.Landing[] = [];
  private ellipse: face.Ellipse | null = null;
  private map: face.FloorMap | null = null;
  private real: boolean;
  private preset: face.CameraPreset = "overview";
  private framed = "";
  private isOwnView = false; // a person has turned or moved the camera
  private extent = 2; // [m] from the origin, up to which the axes have numbers

  constructor(canvas: HTMLCanvasElement, options: face.SceneOptions) {
    this.palette = paletteOf(options.theme);
    this.real = options.realArm ?? false;
    this.stage = new Stage(canvas);
    this.camera = new CameraMove(this.stage.camera, this.stage.lookedAt);
    const drawn = (): void => [...Object.values(this.layers), this.carried, this.handles.layer].forEach((layer) => layer.sweep());
    this.stage.setActors({ step: (now) => this.camera.step(now), drawn });
    this.stage.controls.addEventListener("start", () => {
      this.camera.stop();
      this.isOwnView = true;
    });
    this.stage.still.add(...Object.values(this.layers).map((layer) => layer.root));
    this.stage.moving.add(this.thrown.root, this.carried.root);
    this.handles = new Handles(
      this.stage,
      { ...options, changedTarget: (target) => this.draggedTo(target) },
      () => this.palette,
    );
    canvas.addEventListener("webglcontextlost", () => options.onFailure?.("the browser has taken the graphics context away"));
    this.paint();
  }

  setModel(model: unknown): void {
    this.setPlan(null, "valid");
    this.live = null;
    this.cell = geometryOf(model as CellDocument);
    this.handles.pickingFloor = this.handles.pickingZ = this.cell.floorZ;
    this.thrown.setRadius(this.cell.objectRadius);
    this.buildArm();
    this.setLandings([], null);
    this.setNearest(null);
    this.setObstacles([]);
    this.setMap(null);
    this.framed = ""; // clearing has begun to frame the view, but not at once
    this.look(true);
  }

  setPlan(plan: Parameters<face.Scene["setPlan"]>[0], appearance: face.PlanAppearance): void {
    this.appearance = appearance;
    this.motion = plan && this.cell && plan.trajectory ? new PlanMotion(plan, this.cell) : null;
    if (this.motion) this.time = Math.min(this.time, this.motion.end);
    this.handles.pickingZ = plan?.flight?.landing_point[2] ?? this.cell?.floorZ ?? 0;
    this.drawPlan();
    this.pose();
    if (this.motion && appearance === "valid") this.look(false);
  }

  setTime(time_s: number): void {
    this.time = time_s;
    this.pose();
  }

  setLive(live: face.LiveState | null): void {
    if (isSame(live, this.live)) return; // a robot at rest is reported again and again
    const changed = (live === null) !== (this.live === null);
    this.live = live;
    if (changed) this.drawGhosts();
    this.pose();
  }

  setTarget(target: face.Target | null): void {
    this.target = target;
    this.handles.setTarget(target);
    this.drawTarget();
  }

  setRelease(release: face.ReleaseGizmo | null): void {
    this.handles.setRelease(release);
  }

  setHandle(handle: face.Handle): void {
    this.handle = handle;
    this.handles.setHandle(handle);
    this.drawTarget();
  }

  setLandings(landings: readonly face.Landing[], ellipse: face.Ellipse | null): void {
    [this.landings, this.ellipse] = [landings, ellipse];
    this.show("landings", landingThings(landings, ellipse, this.palette));
  }

  setNearest(position: face.Vector3 | null): void {
    this.nearest = this.handles.nearest = position;
    this.show("nearest", position ? nearestThings(position, this.palette) : []);
    if (!this.handles.held) this.look(false);
  }

  setObstacles(obstacles: readonly face.Obstacle[]): void {
    this.obstacles = obstacles;
    this.show("obstacles", this.cell ? obstacleThings(obstacles, this.cell, this.posture(), this.palette) : []);
  }

  setMap(map: face.FloorMap | null): void {
    this.map = this.handles.map = map;
    this.show("map", map ? floorMapThings(map) : []);
    this.look(false);
  }

  setPicking(on: boolean): void {
    this.handles.picking = on;
    this.stage.canvas.style.cursor = on ? "crosshair" : "";
  }

  setCamera(preset: face.CameraPreset): void {
    this.preset = preset;
    this.isOwnView = false;
    this.framed = "";
    this.look(false);
  }

  zoom(factor: number): void {
    this.camera.finish();
    this.isOwnView = true;
    this.stage.zoom(factor);
  }

  setInsets(insets: face.Insets): void {
    if (SIDES.every((side) => insets[side] === this.stage.insets[side])) return;
    this.stage.insets = insets;
    this.resize();
  }

  setTheme(theme: face.Theme): void {
    this.palette = paletteOf(theme);
    this.paint();
  }

  setRealArm(real: boolean): void {
    this.real = real;
    this.show("hazard", real && this.cell ? hazardThings(this.cell, this.palette) : []);
  }

  resize(): void {
    this.stage.resize();
    this.drawAxes();
    if (this.isOwnView) return;
    this.framed = "";
    this.look(true);
  }

  async png(): Promise<Blob> {
    return this.uncovered(() => {
      this.stage.drawNow(true);
      return pngOf(this.stage.canvas);
    });
  }

  svg(): string {
    if (!this.cell || !this.geometry) throw new Error("there is nothing to draw yet");
    const { motion, landings, ellipse, map, time } = this;
    const target = motion?.targetAt(time) ?? this.target;
    const object = motion?.flies && time >= motion.releaseTime ? motion.objectAt(time) : null;
    const drawn = { cell: this.cell, parts: this.geometry.parts, q: this.posture(), object, motion, target, landings, ellipse, map };
    const { clientWidth, clientHeight } = this.stage.canvas;
    return this.uncovered(() => {
      this.stage.drawNow();
      return drawing(drawn, this.stage.camera, clientWidth, clientHeight, paletteOf("light"));
    });
  }

  /** Keeps to one level of detail, 0 for all of it; null: as fast as the machine is. */
  pinDetail(level: number | null): void {
    this.stage.pin(level);
  }

  get statistics(): face.Scene["statistics"] {
    const { frameMs, level, renderer } = this.stage;
    return { frame_ms: frameMs, detail: level, draw_calls: renderer.info.render.calls };
  }

  dispose(): void {
    this.handles.dispose();
    for (const layer of [...Object.values(this.layers), this.carried]) layer.clear();
    this.clearGhosts();
    this.thrown.dispose();
    this.material.dispose();
    this.stage.dispose();
  }

  /** Draws for a picture of its own, which no panel covers: what is looked at is in its middle. */
  private uncovered<T>(draw: () => T): T {
    this.camera.finish();
    const { insets } = this.stage;
    this.stage.insets = NO_INSETS;
    this.stage.resize();
    const drawn = draw();
    this.stage.insets = insets;
    this.stage.resize();
    return drawn;
  }

  /** Draws everything anew in the present palette. */
  private paint(): void {
    this.stage.setBackground(this.palette.background);
    this.stage.floor.setPalette(this.palette);
    this.thrown.colour = this.palette.object;
    this.drawAxes();
    this.show("bodies", this.cell ? bodyThings(this.cell, this.palette) : []);
    this.setRealArm(this.real);
    this.drawPlan();
    this.drawTarget();
    this.setNearest(this.nearest);
    this.setLandings(this.landings, this.ellipse);
    this.setObstacles(this.obstacles);
    this.handles.show();
  }

  private buildArm(): void {
    if (!this.cell) return;
    if (this.arm) this.stage.moving.remove(this.arm.root);
    for (const { fine, coarse } of [...(this.geometry?.links ?? []), ...(this.geometry?.fingers ?? []).map((finger) => finger.geometry)]) {
      fine.dispose();
      coarse.dispose();
    }
    this.geometry = armGeometry(this.cell, this.palette);
    this.arm = new SolidArm(this.cell, this.geometry, this.material);
    this.stage.moving.add(this.arm.root);
    this.paint();
    this.pose();
  }

  private drawPlan(): void {
    this.show("plan", this.motion ? planThings(this.motion, this.palette, this.appearance === "stale") : []);
    const target = this.motion?.targetAt(0);
    this.carried.show(target ? targetThings(target, this.cell?.floorZ ?? 0, this.palette, false) : []);
    this.drawGhosts();
  }

  private drawGhosts(): void {
    this.clearGhosts();
    if (!this.motion || !this.cell || !this.geometry) return;
    if (this.live) this.follower = this.addGhost(this.motion.at(this.time).positions, this.palette.ghostPlan, 0.7, FOLLOWER);
    if (this.live || this.appearance === "preview") return;
    const stale = this.appearance === "stale";
    const postures = [
      { t: 0, colour: this.palette.ghostStart, strength: GHOST_STRENGTHS.start },
      { t: this.motion.duration, colour: this.palette.ghostRest, strength: GHOST_STRENGTHS.rest },
      { t: this.motion.releaseTime, colour: this.palette.ghostRelease, strength: GHOST_STRENGTHS.release },
    ];
    postures.forEach(({ t, colour, strength }, i) => {
      this.addGhost(this.motion!.at(t).positions, stale ? this.palette.stale : colour, stale ? 0.6 * strength : strength, 10 + i);
    });
  }

  private addGhost(q: readonly number[], colour: Palette["arrow"], strength: number, order: number): Ghost {
    const ghost = new Ghost(frozen(this.cell!, this.geometry!, q), colour, strength, order);
    this.ghosts.push(ghost);
    (order === FOLLOWER ? this.stage.moving : this.stage.ghosts).add(ghost.root);
    return ghost;
  }

  private clearGhosts(): void {
    for (const ghost of this.ghosts) {
      ghost.root.removeFromParent();
      ghost.dispose();
    }
    this.ghosts = [];
    this.follower = null;
  }

  private drawAxes(): void {
    this.show("axes", this.cell ? axisThings(axisMarks(this.cell.floorZ, this.extent), this.palette, this.stage.canvas.clientHeight) : []);
  }

  private drawTarget(): void {
    const floorZ = this.cell?.floorZ ?? 0;
    this.show("target", this.target ? targetThings(this.target, floorZ, this.palette, this.handle === "target") : []);
  }

  private draggedTo(target: face.Target): void {
    this.target = target;
    this.drawTarget();
  }

  /** Returns the joint positions of the solid arm. */
  private posture(): readonly number[] {
    return this.live?.positions ?? this.motion?.at(this.time).positions ?? this.cell?.home ?? [0, 0, 0, 0, 0, 0];
  }

  /** Moves arm, object and the plan's ghost to where they are now. */
  private pose(): void {
    if (!this.cell || !this.arm) return;
    const { motion, live, time } = this;
    const since = motion?.flies ? time - motion.releaseTime : Number.NEGATIVE_INFINITY;
    const gone = live ? live.object === "gone" : since >= 0;
    const q = this.posture();
    this.arm.move(q, gone ? Math.min(1, live ? 1 : since / GRIPPER_OPENS_S) : 0);
    const held = positionOf(toolPose(this.cell.chain, q));
    this.thrown.root.visible = !gone || motion !== null;
    this.thrown.place(gone && motion ? motion.objectAt(Math.max(time, motion.releaseTime)) : held, this.cell.floorZ);
    this.carried.root.position.set(...scaled(motion?.target?.velocity ?? [0, 0, 0], time));
    this.material.color.set(live && !live.connected ? 0x9aa3ad : 0xffffff);
    if (this.follower && motion && this.geometry) frozen(this.cell, this.geometry, motion.at(time).positions, this.follower.geometry);
    this.stage.moved();
  }

  private show(layer: (typeof LAYERS)[number], things: Parameters<Layer["show"]>[0]): void {
    this.layers[layer].show(things);
    this.stage.invalidate();
  }

  /** Turns the camera to the present preset, where the throw is another one or a person asked for it. */
  private look(atOnce: boolean): void {
    if (!this.cell) return;
    const landing = (this.motion?.plan.flight?.landing_point as Vector | undefined) ?? this.target?.position ?? null;
    const refused = this.refused().map((point) => point.map((x) => x.toFixed(1)));
    const key = `${this.cell.name} ${this.preset} ${this.motion ? landing?.map((x) => x.toFixed(1)) : "home"} ${refused} ${this.map?.lower} ${this.map?.upper}`;
    if (key === this.framed) return;
    this.framed = key;
    this.isOwnView = false;
    const still = atOnce || window.matchMedia("(prefers-reduced-motion: reduce)").matches;
    const base = positionOf(this.cell.chain.base);
    this.stage.resize();
    this.placeFloor(base);
    this.stage.drawNow();
    this.camera.start(viewOf(this.preset, this.subject(landing), this.stage.camera, this.stage.freeArea), performance.now(), still);
    this.stage.moved();
    this.stage.invalidate();
  }

  private subject(landing: Vector | null): Subject {
    return subjectOf(this.cell!, this.motion, this.posture(), landing, [...this.mapCorners(), ...this.refused()]);
  }

  /** Returns what a refusal is about: the target that cannot be hit, and the nearest that can. */
  private refused(): Vector[] {
    return this.nearest ? [this.nearest, ...(this.target ? [this.target.position] : [])] : [];
  }

  private mapCorners(): Vector[] {
    if (!this.map) return [];
    const { lower, upper, z } = this.map;
    return [lower, upper, [lower[0], upper[1]] as const, [upper[0], lower[1]] as const].map(([x, y]): Vector => [x, y, z]);
  }

  private placeFloor(base: Vector): void {
    const landing = this.motion?.plan.flight?.landing_point ?? base;
    const centre = [(base[0] + landing[0]!) / 2, (base[1] + landing[1]!) / 2] as const;
    const corners = this.mapCorners().map((corner) => 0.9 * Math.hypot(corner[0] - centre[0], corner[1] - centre[1]));
    const extent = Math.max(1.8, Math.hypot(landing[0]! - base[0], landing[1]! - base[1]), ...corners);
    const numbered = Math.max(2, Math.ceil(Math.hypot(landing[0]!, landing[1]!)));
    if (numbered !== this.extent) {
      this.extent = numbered;
      this.drawAxes();
    }
    this.stage.floor.place(this.cell!.floorZ, centre, extent, [base[0], base[1]], this.reach() * AROUND_ARM);
  }

  /** Returns how far the arm reaches, roughly [m]. */
  private reach(): number {
    const { transforms, tool } = this.cell!.chain;
    return [...transforms, tool].reduce((sum, X) => sum + norm(positionOf(X)), 0);
  }
}

/** Whether two states of the robot look the same. */
function isSame(a: face.LiveState | null, b: face.LiveState | null): boolean {
  if (a === null || b === null) return a === b;
  const near = a.positions.every((q, j) => Math.abs(q - (b.positions[j] ?? Number.NaN)) < STILL_RAD);
  return near && a.connected === b.connected && a.object === b.object;
}

export { createDrawnScene } from "./drawn";

/** Returns the scene on a canvas. */
export const createScene: face.CreateScene = (canvas, options) => new ThrowScene(canvas, options);

/** What a person takes hold of: the target on the floor or in height, the release's pose, the tip of its velocity. */

import { Object3D, Plane, Raycaster, Vector2, Vector3 as ThreeVector } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";
import { plus, type Vector } from "../model/poses";
import type { FloorMap, Handle, ReleaseGizmo, SceneOptions, Target } from "./interface";
import { NEAR_PX, targetGrip } from "./grips";
import { Layer } from "./layer";
import { LIFT_M, TARGET_RADIUS_M } from "./marks";
import type { Palette } from "./palette";
import { arrow, ball } from "./shapes";
import type { Stage } from "./stage";

const VELOCITY_SCALE_S = 0.12; // [s] an arrow shows this much of the flight at its velocity
const CLICK_PX = 4; // [px] a pointer that moves less has clicked
const GIZMO_SIZE = 0.8; // of the release's gizmo, as a share of three's own

type Grip = "floor" | "lift" | "tip";

/** What the handles tell the scene. */
interface HandleEvents extends Pick<SceneOptions, "onTargetMoved" | "onTargetDropped" | "onReleaseMoved" | "onReleaseDropped" | "onFloorPicked" | "onNearestPicked" | "onMapPicked"> {
  changedTarget(target: Target): void;
}

export class Handles {
  readonly layer = new Layer();
  picking = false;
  pickingZ = 0;
  nearest: Vector | null = null;
  map: FloorMap | null = null;
  private handle: Handle = "none";
  private target: Target | null = null;
  private release: ReleaseGizmo | null = null;
  private grip: Grip | null = null;
  private offset: Vector = [0, 0, 0];
  private pressedAt: Vector2 | null = null;
  private due = 0;
  private readonly proxy = new Object3D();
  private readonly gizmos: TransformControls[];
  private readonly removals: (() => void)[] = [];

  constructor(
    private readonly stage: Stage,
    private readonly events: HandleEvents,
    private readonly palette: () => Palette,
  ) {
    this.gizmos = (["translate", "rotate"] as const).map((mode) => this.gizmo(mode));
    stage.still.add(this.layer.root, this.proxy, ...this.gizmos.map((gizmo) => gizmo.getHelper()));
    this.listen("pointerdown", (event) => this.down(event));
    this.listen("pointermove", (event) => this.move(event));
    this.listen("pointerup", (event) => this.up(event));
    this.listen("pointercancel", (event) => this.up(event));
  }

  /** Whether a person holds a handle now. */
  get held(): boolean {
    return this.grip !== null || this.gizmos.some((gizmo) => gizmo.dragging);
  }

  setHandle(handle: Handle): void {
    this.handle = handle;
    this.show();
  }

  setTarget(target: Target | null): void {
    if (!this.grip) this.target = target;
  }

  setRelease(release: ReleaseGizmo | null): void {
    if (this.held) return;
    this.release = release;
    this.show();
  }

  /** Draws the handles anew. */
  show(): void {
    const release = this.handle === "release" ? this.release : null;
    this.gizmos.forEach((gizmo, i) => {
      const wanted = release !== null && (i === 0 || release.quaternion !== null);
      gizmo.enabled = wanted;
      if (wanted) gizmo.attach(this.proxy);
      else gizmo.detach();
    });
    if (release) {
      this.proxy.position.set(...release.position);
      this.proxy.quaternion.set(...(release.quaternion ?? [0, 0, 0, 1]));
    }
    this.layer.show(release ? this.velocityThings(release) : []);
    this.stage.invalidate();
  }

  dispose(): void {
    for (const remove of this.removals) remove();
    for (const gizmo of this.gizmos) gizmo.dispose();
    this.layer.clear();
  }

  private velocityThings(release: ReleaseGizmo): Object3D[] {
    const { arrow: colour, nearest } = this.palette();
    const tip = plus(release.position, release.velocity, VELOCITY_SCALE_S);
    const knob = ball(tip, 0.022, nearest);
    return [...arrow(release.position, plus(tip, release.position, -1), colour), knob];
  }

  private gizmo(mode: "translate" | "rotate"): TransformControls {
    const gizmo = new TransformControls(this.stage.camera, this.stage.canvas);
    gizmo.setMode(mode);
    gizmo.setSpace(mode === "rotate" ? "local" : "world");
    gizmo.size = mode === "rotate" ? 0.8 * GIZMO_SIZE : GIZMO_SIZE;
    gizmo.addEventListener("change", () => this.stage.invalidate());
    gizmo.addEventListener("dragging-changed", ({ value }) => {
      this.stage.controls.enabled = !value;
      if (!value && this.release) this.events.onReleaseDropped?.(this.release);
    });
    gizmo.addEventListener("objectChange", () => this.posed());
    return gizmo;
  }

  /** Takes the pose of the gizmo. */
  private posed(): void {
    if (!this.release) return;
    const position = this.proxy.position.toArray() as Vector;
    const quaternion = this.release.quaternion ? (this.proxy.quaternion.toArray() as [number, number, number, number]) : null;
    this.release = { ...this.release, position, quaternion };
    this.layer.show(this.velocityThings(this.release));
    this.tell(() => this.release && this.events.onReleaseMoved?.(this.release));
  }

  private down(event: PointerEvent): void {
    if (event.button !== 0) return;
    this.pressedAt = new Vector2(event.clientX, event.clientY);
    this.grip = this.gripAt(event);
    if (!this.grip) return;
    this.stage.controls.enabled = false;
    this.stage.canvas.setPointerCapture(event.pointerId);
    const held = this.heldPoint();
    const under = held && this.pointOn(this.planeOf(this.grip, held), event);
    this.offset = held && under ? plus(held, under, -1) : [0, 0, 0];
  }

  private move(event: PointerEvent): void {
    if (!this.grip) {
      const hand = this.gripAt(event) || this.overNearest(event);
      this.stage.canvas.style.cursor = hand ? "grab" : this.picking || (this.map && this.pointOnMap(this.map, event)) ? "crosshair" : "";
      return;
    }
    const held = this.heldPoint();
    const under = held && this.pointOn(this.planeOf(this.grip, held), event);
    if (!held || !under) return;
    this.drag(this.grip, held, plus(under, this.offset));
  }

  private drag(grip: Grip, held: Vector, to: Vector): void {
    if (grip === "tip" && this.release) {
      const velocity = plus([0, 0, 0], plus(to, this.release.position, -1), 1 / VELOCITY_SCALE_S);
      this.release = { ...this.release, velocity };
      this.layer.show(this.velocityThings(this.release));
      this.tell(() => this.release && this.events.onReleaseMoved?.(this.release));
    } else if (this.target) {
      const position: Vector = grip === "lift" ? [held[0], held[1], Math.max(this.pickingFloor, to[2] - LIFT_M)] : [to[0], to[1], held[2]];
      this.target = { ...this.target, position };
      this.events.changedTarget(this.target);
      this.tell(() => this.target && this.events.onTargetMoved?.(this.target.position));
    }
    this.stage.invalidate();
  }

  pickingFloor = 0; // [m] height below which a target is not dragged

  private up(event: PointerEvent): void {
    const [grip, pressed] = [this.grip, this.pressedAt];
    this.grip = this.pressedAt = null;
    this.stage.controls.enabled = true;
    if (grip) this.drop(grip);
    else if (pressed && pressed.distanceTo(new Vector2(event.clientX, event.clientY)) < CLICK_PX) this.click(event);
  }

  private drop(grip: Grip): void {
    cancelAnimationFrame(this.due);
    this.due = 0;
    if (grip === "tip") {
      if (this.release) this.events.onReleaseDropped?.(this.release);
    } else if (this.target) this.events.onTargetDropped?.(this.target.position);
  }

  private click(event: PointerEvent): void {
    if (this.overNearest(event)) this.events.onNearestPicked?.();
    else if (this.picking) {
      const point = this.pointOn(new Plane(new ThreeVector(0, 0, 1), -this.pickingZ), event);
      if (point) this.events.onFloorPicked?.(point);
    } else if (this.map) {
      const point = this.pointOnMap(this.map, event);
      if (point) this.events.onMapPicked?.(point);
    }
  }

  /** Returns the point of the map under the pointer. */
  private pointOnMap({ lower, upper, z }: FloorMap, event: PointerEvent): Vector | null {
    const point = this.pointOn(new Plane(new ThreeVector(0, 0, 1), -z), event);
    const within = point && [0, 1].every((axis) => point[axis]! >= lower[axis]! && point[axis]! <= upper[axis]!);
    return within ? point : null;
  }

  /** Tells what moves, once a frame at most. */
  private tell(what: () => void): void {
    cancelAnimationFrame(this.due);
    this.due = requestAnimationFrame(what);
  }

  private gripAt(event: PointerEvent): Grip | null {
    if (this.handle === "target" && this.target) {
      const at = this.target.position;
      const under = this.pointOn(new Plane(new ThreeVector(0, 0, 1), -at[2]), event);
      const isOnDisc = under !== null && Math.hypot(under[0] - at[0], under[1] - at[1]) < 1.7 * TARGET_RADIUS_M;
      const sight = this.stage.camera.getWorldDirection(new ThreeVector()).toArray() as Vector;
      const tip = this.placeOf(plus(at, [0, 0, LIFT_M]));
      return targetGrip([event.clientX, event.clientY], this.placeOf(at), tip, sight, isOnDisc);
    }
    if (this.handle === "release" && this.release) {
      return this.isNear(plus(this.release.position, this.release.velocity, VELOCITY_SCALE_S), event) ? "tip" : null;
    }
    return null;
  }

  private heldPoint(): Vector | null {
    if (this.grip === "tip") return this.release && plus(this.release.position, this.release.velocity, VELOCITY_SCALE_S);
    return this.target && (this.grip === "lift" ? plus(this.target.position, [0, 0, LIFT_M]) : this.target.position);
  }

  /** Returns the plane in which a grip moves: the target's, an upright one, or the screen's. */
  private planeOf(grip: Grip, through: Vector): Plane {
    const sight = this.stage.camera.getWorldDirection(new ThreeVector());
    const normal = grip === "floor" ? new ThreeVector(0, 0, 1) : sight;
    if (grip === "lift") normal.setZ(0).normalize();
    return new Plane().setFromNormalAndCoplanarPoint(normal, new ThreeVector(...through));
  }

  private pointOn(plane: Plane, event: PointerEvent): Vector | null {
    const caster = new Raycaster();
    caster.setFromCamera(this.onScreen(event), this.stage.camera);
    return (caster.ray.intersectPlane(plane, new ThreeVector())?.toArray() as Vector | undefined) ?? null;
  }

  private onScreen(event: PointerEvent): Vector2 {
    const { left, top, width, height } = this.stage.canvas.getBoundingClientRect();
    return new Vector2((2 * (event.clientX - left)) / width - 1, 1 - (2 * (event.clientY - top)) / height);
  }

  private isNear(point: Vector, event: PointerEvent, within = NEAR_PX): boolean {
    const [x, y] = this.placeOf(point);
    return Math.hypot(x - event.clientX, y - event.clientY) < within;
  }

  /** Returns where on the screen a point is [px]. */
  private placeOf(point: Vector): [number, number] {
    const { left, top, width, height } = this.stage.canvas.getBoundingClientRect();
    const seen = new ThreeVector(...point).project(this.stage.camera);
    return [left + ((seen.x + 1) * width) / 2, top + ((1 - seen.y) * height) / 2];
  }

  private overNearest(event: PointerEvent): boolean {
    if (!this.nearest) return false;
    const under = this.pointOn(new Plane(new ThreeVector(0, 0, 1), -this.nearest[2]), event);
    return (under !== null && Math.hypot(under[0] - this.nearest[0], under[1] - this.nearest[1]) < 0.11) || this.isNear(this.nearest, event);
  }

  private listen(name: "pointerdown" | "pointermove" | "pointerup" | "pointercancel", on: (event: PointerEvent) => void): void {
    this.stage.canvas.addEventListener(name, on);
    this.removals.push(() => this.stage.canvas.removeEventListener(name, on));
  }
}

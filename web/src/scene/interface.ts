// What the page asks of the scene, and what the scene tells the page. The page never touches three.js: it loads
// `scene/index.ts`, which exports `createScene: CreateScene`, after the form has been painted.
//
// Units are SI, positions and velocities in the world frame of the cell, joints from base to wrist 3.

import type { CellModel, Plan } from "../service/types";

export type Vector3 = readonly [number, number, number];
export type Joints = readonly number[]; // (6) [rad] or [rad/s]

export type Theme = "light" | "dark";
export type CameraPreset = "overview" | "side" | "top" | "front" | "target";

/** How the plan on the screen is to be read. */
export type PlanAppearance = "valid" | "stale" | "preview";

/** What a person drags: nothing, the target, or the tool's state at the release. */
export type Handle = "none" | "target" | "release";

export interface Target {
  readonly position: Vector3;
  readonly opening: { readonly radius_m: number; readonly rim_height_m: number } | null;
}

/** Tool's state at the release as it is asked for; the gizmo's arrow is the velocity. */
export interface ReleaseGizmo {
  readonly position: Vector3; // [m]
  readonly quaternion: readonly [number, number, number, number] | null; // x, y, z, w; null: orientation free (`point`)
  readonly velocity: Vector3; // [m/s]
}

/** The arm as its executor reports it. */
export interface LiveState {
  readonly positions: Joints;
  readonly connected: boolean; // false: last known state, drawn pale
  readonly object: "held" | "gone"; // whether the tool still carries the object
}

export interface Landing {
  readonly id: string; // of the execution
  readonly position: Vector3;
  readonly newest: boolean;
}

export interface Ellipse {
  readonly center: readonly [number, number];
  readonly covariance_m2: readonly (readonly number[])[];
  readonly height_m: number;
}

/** What stands in the way of a request, with the thing to be highlighted. */
export interface Obstacle {
  readonly constraint: string; // of a violation
  readonly value: number | null;
  readonly limit: number | null;
  readonly joint: number | null; // 0 to 5
  readonly names: readonly string[]; // that its words tell, those of keep-in and keep-out bodies among them
}

export interface SceneOptions {
  readonly theme: Theme;
  readonly realArm?: boolean;
  /** A person drags: called once a frame at most. */
  onTargetMoved?(position: Vector3): void;
  onTargetDropped?(position: Vector3): void;
  onReleaseMoved?(release: ReleaseGizmo): void;
  onReleaseDropped?(release: ReleaseGizmo): void;
  /** A click on the floor while `setPicking(true)`: where the object landed. */
  onFloorPicked?(position: Vector3): void;
  onNearestPicked?(): void;
  /** A click on the map. */
  onMapPicked?(position: Vector3): void;
  /** Drawing is impossible (no WebGL, context lost): a sentence for people. */
  onFailure?(reason: string): void;
}

/** A picture on the floor. */
export interface FloorMap {
  readonly lower: readonly [number, number]; // its corner with the least x and y [m]
  readonly upper: readonly [number, number];
  readonly z: number; // [m]
  readonly width: number; // [px]
  readonly height: number;
  readonly pixels: Uint8Array; // RGBA, rows along y from the least
}

/** Edges of the canvas that something else covers [px]. */
export interface Insets {
  readonly left: number;
  readonly right: number;
  readonly top: number;
  readonly bottom: number;
}

export interface Scene {
  /** Arm, tool, floor and bodies of a cell; clears everything that belonged to another cell. */
  setModel(model: CellModel): void;
  setPlan(plan: Plan | null, appearance: PlanAppearance): void;
  /** Time on the plan's clock [s]; after the release the object flies along, up to the landing. */
  setTime(time_s: number): void;
  /** The solid arm; with a live state the plan is drawn as a ghost, without one the arm follows `setTime`. */
  setLive(live: LiveState | null): void;
  setTarget(target: Target | null): void;
  setRelease(release: ReleaseGizmo | null): void;
  setHandle(handle: Handle): void;
  setLandings(landings: readonly Landing[], ellipse: Ellipse | null): void;
  /** A throwability map over the floor; a click on it is told by `onMapPicked`. */
  setMap(map: FloorMap | null): void;
  /** Nearest feasible target or release as a ghost ring to click, and what stands in the way. */
  setNearest(position: Vector3 | null): void;
  setObstacles(obstacles: readonly Obstacle[]): void;
  setPicking(on: boolean): void;
  setCamera(preset: CameraPreset): void;
  /** Moves the camera away by a factor; below 1 towards what it looks at. */
  zoom(factor: number): void;
  /** Edges of the canvas that panels cover [px]: the throw is shown between them. */
  setInsets(insets: Insets): void;
  setTheme(theme: Theme): void;
  setRealArm(real: boolean): void;
  /** Size of the canvas in the layout has changed. */
  resize(): void;
  /** Draws now and resolves with the picture. */
  png(): Promise<Blob>;
  svg(): string;
  /** Time of the drawing of the last frame [ms], and its detail, for tests and the benchmark. */
  readonly statistics: { readonly frame_ms: number; readonly detail: number; readonly draw_calls: number };
  dispose(): void;
}

export type CreateScene = (canvas: HTMLCanvasElement, options: SceneOptions) => Scene;

// The region of the scene: loads three.js after the form has been painted, and keeps it in step with the state.

import { effect, useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect, useRef } from "preact/hooks";

import type { DrawnScene } from "../scene/drawn";
import type { CameraPreset, CreateScene, Insets, Landing, LiveState, Obstacle, ReleaseGizmo, Scene, Target, Theme, Vector3 } from "../scene/interface";
import { insetsFrom } from "../scene/insets";
import { type Quaternion, quaternionOf, rotationVectorOf } from "../model/poses";
import { landingCellAt } from "../model/throw-map";
import { save } from "../service/save";
import { drag, drop, reportPointedAt, takeNearest } from "../state/actions";
import type { Draft } from "../state/draft";
import { vector } from "../state/numbers";
import type { StateDraft } from "../state/state-draft";
import {
  answered, cellName, cellState, dark, draft, execution, history, isReal, landings, mapPicture, model, openPassage, picking, preview, problem, runId, running,
  shown, standing, strayed, throwMap, time,
} from "../state/store";
import { seenAt } from "../state/scatter";
import { SceneKey } from "./scene-key";

type CreateDrawnScene = (host: HTMLElement, theme: Theme) => DrawnScene;
type SceneModule = { createScene: CreateScene; createDrawnScene: CreateDrawnScene };
const LOADERS = import.meta.glob<SceneModule>("../scene/index.ts");

const CAMERAS: readonly (readonly [CameraPreset, string])[] = [
  ["overview", "Overview"],
  ["side", "Side"],
  ["top", "Top"],
  ["front", "Front"],
  ["target", "Target"],
];

export function SceneSection(): JSX.Element {
  const canvas = useRef<HTMLCanvasElement>(null);
  const scene = useRef<Scene | null>(null);
  const drawings = useRef<HTMLDivElement>(null);
  const failure = useSignal<string | null>(null);
  const missing = useSignal<string | null>(null);
  useEffect(() => {
    let ends: (() => void) | null = null;
    let over = false;
    const load = (): Promise<SceneModule | null> => loadModule((reason) => (missing.value = reason), () => over);
    void loadScene(canvas.current, load, (reason) => (failure.value = reason)).then((loaded) => {
      if (loaded === null) return;
      if (over) return loaded.dispose();
      scene.current = loaded;
      ends = keepInStep(loaded, canvas.current);
    });
    const drawnInstead = effect(() => {
      if (failure.value === null || drawings.current === null) return;
      void load().then((module) => {
        if (over || module === null || drawings.current === null) return;
        ends?.();
        ends = keepDrawn(module.createDrawnScene(drawings.current, dark.peek() ? "dark" : "light"), drawings.current);
      });
    });
    return () => {
      over = true;
      drawnInstead();
      ends?.();
      scene.current?.dispose();
    };
  }, []);
  return (
    <section class={`scene ${standing.value} ${picking.value ? "picking" : ""}`} aria-label="Scene">
      <canvas ref={canvas} tabIndex={0} role="img" aria-label={sceneWords()} hidden={failure.value !== null} />
      <div class="drawn-views" ref={drawings} hidden={failure.value === null} role="img" aria-label={sceneWords()} />
      {missing.value ? <p class="soft drawn-reason">The scene did not load ({missing.value}). It is asked for again.</p> : null}
      {failure.value ? <p class="soft drawn-reason">This browser draws no moving scene ({failure.value}): two views instead.</p> : null}
      <SceneKey />
      <div class="cameras" role="group" aria-label="Camera" hidden={failure.value !== null}>
        {CAMERAS.map(([preset, text]) => (
          <button key={preset} type="button" class="chip" onClick={() => scene.current?.setCamera(preset)}>
            {text}
          </button>
        ))}
        <button type="button" class="chip" aria-label="Zoom in" onClick={() => scene.current?.zoom(1 / ZOOM)}>
          +
        </button>
        <button type="button" class="chip" aria-label="Zoom out" onClick={() => scene.current?.zoom(ZOOM)}>
          −
        </button>
        <button type="button" class="chip save" aria-label="Save the view as PNG" onClick={() => void saveView(scene.current, "png")}>
          PNG
        </button>
        <button type="button" class="chip save" aria-label="Save the view as SVG" onClick={() => void saveView(scene.current, "svg")}>
          SVG
        </button>
      </div>
    </section>
  );
}

const ZOOM = 1.4; // of a step

/** What the picture shows, for those who do not see it. */
function sceneWords(): string {
  const plan = shown.value;
  const cell = cellName.value ?? "no cell";
  if (plan === null) return `The arm of ${cell}. There is no plan yet.`;
  const landing = plan.flight?.landing_point;
  const where = landing ? `; the object lands at (${landing.map((x) => x.toFixed(2)).join(", ")})` : "";
  return `The arm of ${plan.cell} along its plan of ${plan.duration_s.toFixed(2)} s${where}.`;
}

async function loadScene(
  canvas: HTMLCanvasElement | null,
  load: () => Promise<SceneModule | null>,
  onFailure: (reason: string) => void,
): Promise<Scene | null> {
  await formPainted();
  const module = await load();
  if (canvas === null || module === null) return null;
  try {
    return module.createScene(canvas, {
      theme: dark.value ? "dark" : "light",
      realArm: isReal.value,
      onTargetMoved: (position) => drag(asTarget(position)),
      onTargetDropped: (position) => drop(asTarget(position)),
      onReleaseMoved: (release) => drag(asRelease(release)),
      onReleaseDropped: (release) => drop(asRelease(release)),
      onFloorPicked: (position) => void reportPointedAt(position),
      onNearestPicked: takeNearest,
      onMapPicked: planAt,
      onFailure,
    });
  } catch (error) {
    onFailure(wordsOf(error));
    return null;
  }
}

const AGAIN_MS = 2000; // [ms] until the service is asked again for what did not arrive

/** Returns what draws the scene, null once the page is over; asks again while the service cannot be reached. */
async function loadModule(tell: (reason: string | null) => void, isOver: () => boolean): Promise<SceneModule | null> {
  const [load] = Object.values(LOADERS);
  while (load !== undefined && !isOver()) {
    try {
      const module = await load();
      tell(null);
      return module;
    } catch (error) {
      tell(wordsOf(error));
      await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    }
  }
  return null;
}

const wordsOf = (error: unknown): string => (error instanceof Error ? error.message : String(error));

/** Resolves once the browser says that the form is on the screen; three.js would keep it from there. */
function formPainted(): Promise<void> {
  return new Promise((resolve) => {
    const observer = new PerformanceObserver((list) => {
      if (list.getEntriesByName("first-contentful-paint").length === 0) return;
      observer.disconnect();
      resolve();
    });
    observer.observe({ type: "paint", buffered: true });
    requestAnimationFrame(() => setTimeout(resolve, UNTOLD_MS));
  });
}

const UNTOLD_MS = 3000; // [ms] after a frame: this browser does not tell when it paints

const rounded = (values: readonly number[]): string[] => values.map((value) => String(Number(value.toFixed(3))));

/** The state that is dragged in the scene: the request's, or that of the motion's open passage; null for none. */
function askedState(): StateDraft | null {
  const asked = draft.value;
  if (!asked.isMotion) return asked;
  const passage = asked.passages.find(({ id }) => id === openPassage.value);
  return passage && !passage.isLine ? passage.state : null;
}

/** Returns what changes the state that is dragged in the scene. */
function ofState(fields: Partial<StateDraft>): Partial<Draft> {
  const asked = draft.value;
  if (!asked.isMotion) return { ...fields, frame: "world" };
  const passages = asked.passages.map((each) => (each.id === openPassage.value ? { ...each, state: { ...each.state, ...fields } } : each));
  return { passages, frame: "world" };
}

function asTarget(position: Vector3): Partial<Draft> {
  return ofState({ target: rounded(position) });
}

function asRelease(release: ReleaseGizmo): Partial<Draft> {
  const pose = { position: rounded(release.position), velocity: rounded(release.velocity) };
  if (release.quaternion === null) return ofState(pose);
  if (askedState()?.orientation === "rotation_vector") return ofState({ ...pose, rotationVector: rounded(rotationVectorOf(release.quaternion)) });
  return ofState({ ...pose, quaternion: release.quaternion.map((x) => x.toFixed(6)) });
}

/** Hands every change of the state on to the scene; returns what ends that. */
function keepInStep(scene: Scene, canvas: HTMLCanvasElement | null): () => void {
  const observer = new ResizeObserver(() => {
    scene.resize();
    if (canvas) scene.setInsets(insetsOf(canvas));
  });
  if (canvas?.parentElement) observer.observe(canvas.parentElement);
  let due = 0;
  const scrolled = (): void => {
    clearTimeout(due);
    due = window.setTimeout(() => canvas && scene.setInsets(insetsOf(canvas)), SCROLLED_MS);
  };
  addEventListener("scroll", scrolled, { passive: true });
  const ends = [
    effect(() => {
      if (model.value !== null) scene.setModel(model.value);
    }),
    effect(() => showPlan(scene)),
    effect(() => scene.setTime(time.value)),
    effect(() => showLive(scene)),
    effect(() => showRequest(scene)),
    effect(() => showRefusal(scene)),
    effect(() => showLandings(scene)),
    effect(() => scene.setTheme(dark.value ? "dark" : "light")),
    effect(() => scene.setRealArm(isReal.value)),
    effect(() => scene.setPicking(picking.value !== null)),
    effect(() => showMap(scene)),
  ];
  return () => {
    observer.disconnect();
    removeEventListener("scroll", scrolled);
    clearTimeout(due);
    for (const end of ends) end();
  };
}

/** The same for the two drawn views. */
function keepDrawn(scene: DrawnScene, host: HTMLElement): () => void {
  const observer = new ResizeObserver(() => scene.resize());
  observer.observe(host);
  const ends = [
    effect(() => {
      if (model.value !== null) scene.setModel(model.value);
    }),
    effect(() => {
      void model.value;
      scene.setPlan(shown.value, "valid");
    }),
    effect(() => scene.setTime(time.value)),
    effect(() => scene.setLive(liveArm())),
    effect(() => scene.setTarget(askedTarget())),
    effect(() => scene.setNearest(nearestPlace())),
    effect(() => showLandings(scene)),
    effect(() => scene.setTheme(dark.value ? "dark" : "light")),
    effect(() => showMap(scene)),
  ];
  return () => {
    observer.disconnect();
    for (const end of ends) end();
    scene.dispose();
  };
}

const SCROLLED_MS = 150; // [ms] after a person has scrolled: a sheet may cover more of the scene now

function insetsOf(canvas: HTMLCanvasElement): Insets {
  const panels = [".panel.request", ".side"].map((selector) => document.querySelector(selector)?.getBoundingClientRect());
  return insetsFrom(canvas.getBoundingClientRect(), panels.filter((box) => box !== undefined));
}

function showPlan(scene: Scene): void {
  void model.value; // a new model clears the scene
  const plan = shown.value;
  const dragged = plan !== null && plan === preview.value;
  const own = plan !== null && plan === answered.value;
  scene.setPlan(plan, dragged ? "preview" : own && standing.value === "stale" ? "stale" : "valid");
}

function showLive(scene: Scene): void {
  void model.value;
  scene.setLive(liveArm());
}

/** The solid arm: from telemetry while something runs, from the plan while nothing does (null). */
function liveArm(): LiveState | null {
  const run = execution.value;
  const robot = cellState.value?.robot as { positions?: number[]; connected?: boolean } | null | undefined;
  const sample = run?.samples.at(-1);
  const release = shown.value?.release_time_s ?? Infinity;
  if (running.value) {
    const positions = sample?.positions ?? robot?.positions;
    const object = sample && sample.clock_s > release && !run?.dryRun ? "gone" : "held";
    return positions ? { positions, connected: true, object } : null;
  }
  const beside = strayed.value;
  const stands = shown.value === null || beside !== null;
  const object = beside?.released ? "gone" : "held";
  return stands && robot?.positions ? { positions: robot.positions, connected: robot.connected !== false, object } : null;
}

function askedTarget(): Target | null {
  const asked = askedState();
  const target = asked?.kind === "target" && draft.value.frame === "world" ? vector(asked.target) : null;
  if (asked === null || target === null) return null;
  const opening = asked.bin && !asked.moves ? { radius_m: Number(asked.binRadius) || 0.1, rim_height_m: Number(asked.binRim) || 0 } : null;
  return { position: target, opening };
}

function showRequest(scene: Scene): void {
  void model.value;
  const asked = askedState();
  const target = askedTarget();
  scene.setTarget(target);
  const tool = (asked?.kind === "point" || asked?.kind === "pose") && draft.value.frame === "world" ? asked : null;
  const position = tool && vector(tool.position);
  const velocity = tool && vector(tool.velocity);
  scene.setRelease(position && velocity ? { position, velocity, quaternion: orientationOf(tool) } : null);
  scene.setHandle(running.value ? "none" : target ? "target" : position ? "release" : "none");
}

/** Returns the orientation that is asked for as a unit quaternion; null where it is free or not yet one. */
function orientationOf(asked: StateDraft): Quaternion | null {
  if (asked.kind !== "pose") return null;
  if (asked.orientation === "rotation_vector") {
    const rotation = vector(asked.rotationVector);
    return rotation && quaternionOf(rotation);
  }
  const values = asked.quaternion.map(Number);
  const length = Math.hypot(...values);
  return length > 0 && Number.isFinite(length) ? (values.map((value) => value / length) as unknown as Quaternion) : null;
}

function showRefusal(scene: Scene): void {
  void model.value;
  const refusal = problem.value;
  scene.setNearest(nearestPlace());
  scene.setObstacles((refusal?.violations ?? []).map((violation) => obstacleOf(violation)));
}

function nearestPlace(): Vector3 | null {
  const nearest = problem.value?.nearest?.release as { position?: number[] } | undefined;
  return nearest?.position ? (nearest.position as unknown as Vector3) : null;
}

const JOINT_NAMES = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"];

/** Finds joint and bodies of a violation in its words. */
function obstacleOf(violation: { constraint: string; value: number | null; limit: number | null; detail?: string }): Obstacle {
  const detail = violation.detail ?? "";
  const joint = JOINT_NAMES.findIndex((name) => detail.startsWith(`${name}_joint`) || detail.includes(` ${name}_joint`));
  return {
    constraint: violation.constraint,
    value: violation.value,
    limit: violation.limit,
    joint: joint < 0 ? null : joint,
    names: detail.split(/[,:;]/).map((part) => part.trim()),
  };
}

function showMap(scene: Pick<Scene, "setMap">): void {
  void model.value;
  const [map, picture] = [throwMap.value, mapPicture.value];
  if (map === null || picture === null) return scene.setMap(null);
  const half = map.resolution_m / 2;
  const [x, y] = map.origin;
  const upper = [x - half + picture.width * map.resolution_m, y - half + picture.height * map.resolution_m] as const;
  scene.setMap({ lower: [x - half, y - half], upper, z: map.plane_z_m, ...picture });
}

/** Plans a throw to the landing cell that was clicked on. */
function planAt([x, y, z]: Vector3): void {
  const centre = throwMap.value && landingCellAt(throwMap.value, x, y);
  if (centre) drop({ isMotion: false, kind: "target", frame: "world", target: rounded([...centre, z]) });
}

function showLandings(scene: Pick<Scene, "setLandings">): void {
  void model.value;
  const newest = runId.value;
  const own = new Set(history.value?.filter((run) => run.cell === cellName.value).map((run) => run.id));
  const dots: Landing[] = Object.entries(landings.value).flatMap(([id, list]) => {
    const seen = own.has(id) ? seenAt(list) : null;
    return seen ? [{ id, position: seen as unknown as Vector3, newest: id === newest }] : [];
  });
  scene.setLandings(dots, null); // the plan brings its own ellipse
}

async function saveView(scene: Scene | null, form: "png" | "svg"): Promise<void> {
  if (scene === null) return;
  save(form === "png" ? await scene.png() : new Blob([scene.svg()], { type: "image/svg+xml" }), `scene.${form}`);
}

/** The scene where a browser has no WebGL: the throw from the side and from above, as drawings that follow the time. */

import { PerspectiveCamera } from "three";
import { type CellDocument, type CellGeometry, geometryOf } from "../model/cell";
import { positionOf, type Vector } from "../model/poses";
import { armParts } from "./arm/shape";
import { fingersOf, toolParts } from "./arm/tool";
import type { Turned } from "./arm/turned";
import { viewOf } from "./camera";
import { drawing, type Drawn } from "./drawing/picture";
import type * as face from "./interface";
import { paletteOf } from "./palette";
import { PlanMotion } from "./plan";
import { subjectOf } from "./subject";

const VIEWS = [["side", "From the side"], ["top", "From above"]] as const;
const FIELD_OF_VIEW_DEG = 24;
const REDRAW_MS = 90; // [ms] between two drawings while the time runs
const LEAST_PX = 160;
const FREE = { width: 0.78, height: 0.92 }; // share of a view, beside which labels have room

/** The part of a scene that can be drawn. */
export type DrawnScene = Pick<face.Scene, "setModel" | "setPlan" | "setTime" | "setLive" | "setTarget" | "setLandings" | "setMap" | "setNearest" | "setTheme" | "resize" | "svg" | "dispose">;

/** Returns two drawn views in `host`. */
export function createDrawnScene(host: HTMLElement, theme: face.Theme): DrawnScene {
  return new TwoViews(host, theme);
}

class TwoViews implements DrawnScene {
  private cell: CellGeometry | null = null;
  private parts: readonly Turned[] = [];
  private motion: PlanMotion | null = null;
  private time = 0;
  private live: face.LiveState | null = null;
  private target: face.Target | null = null;
  private landings: readonly face.Landing[] = [];
  private ellipse: face.Ellipse | null = null;
  private map: face.FloorMap | null = null;
  private nearest: Vector | null = null;
  private due = 0;
  private readonly figures: readonly HTMLElement[];

  constructor(
    private readonly host: HTMLElement,
    private theme: face.Theme,
  ) {
    this.figures = VIEWS.map(([, title]) => {
      const figure = document.createElement("figure");
      const caption = document.createElement("figcaption");
      caption.textContent = title;
      const place = document.createElement("div");
      figure.append(caption, place);
      host.append(figure);
      return place;
    });
  }

  setModel(model: unknown): void {
    this.cell = geometryOf(model as CellDocument);
    const tool = this.cell.capsules.filter((capsule) => capsule.name.startsWith("tool_"));
    const fingers = fingersOf(tool, positionOf(this.cell.chain.tool), this.cell.objectRadius);
    this.parts = [...armParts(this.cell), ...toolParts(tool, fingers)];
    this.motion = null;
    this.draw();
  }

  setPlan(plan: Parameters<face.Scene["setPlan"]>[0]): void {
    this.motion = plan && this.cell && plan.trajectory ? new PlanMotion(plan, this.cell) : null;
    this.draw();
  }

  setTime(time_s: number): void {
    this.time = time_s;
    this.draw();
  }

  setLive(live: face.LiveState | null): void {
    this.live = live;
    this.draw();
  }

  setTarget(target: face.Target | null): void {
    this.target = target;
    this.draw();
  }

  setLandings(landings: readonly face.Landing[], ellipse: face.Ellipse | null): void {
    this.landings = landings;
    this.ellipse = ellipse;
    this.draw();
  }

  setMap(map: face.FloorMap | null): void {
    this.map = map;
    this.draw();
  }

  setNearest(position: face.Vector3 | null): void {
    this.nearest = position;
    this.draw();
  }

  setTheme(theme: face.Theme): void {
    this.theme = theme;
    this.draw();
  }

  resize(): void {
    this.draw();
  }

  svg(): string {
    const drawn = this.drawn();
    if (drawn === null) throw new Error("there is nothing to draw yet");
    return this.view("side", drawn, 960, 540, "light");
  }

  dispose(): void {
    clearTimeout(this.due);
    this.host.replaceChildren();
  }

  /** Draws soon, and once for all that has changed until then. */
  private draw(): void {
    if (this.due) return;
    this.due = window.setTimeout(() => {
      this.due = 0;
      this.drawNow();
    }, REDRAW_MS);
  }

  private drawNow(): void {
    const drawn = this.drawn();
    if (drawn === null) return;
    VIEWS.forEach(([preset], i) => {
      const place = this.figures[i]!;
      const [width, height] = [Math.max(LEAST_PX, place.clientWidth), Math.max(LEAST_PX, place.clientHeight)];
      const text = this.view(preset, drawn, width, height, this.theme);
      const picture = new DOMParser().parseFromString(text, "image/svg+xml").documentElement;
      place.replaceChildren(document.importNode(picture, true));
    });
  }

  private view(preset: "side" | "top", drawn: Drawn, width: number, height: number, theme: face.Theme): string {
    const camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, width / height, 0.03, 60);
    camera.up.set(0, 0, 1);
    const landing = (this.motion?.plan.flight?.landing_point as Vector | undefined) ?? this.target?.position ?? null;
    const others = this.nearest ? [this.nearest] : [];
    const view = viewOf(preset, subjectOf(drawn.cell, this.motion, drawn.q, landing, others), camera, FREE);
    camera.position.set(...view.from);
    camera.lookAt(...view.to);
    camera.updateProjectionMatrix();
    return drawing(drawn, camera, width, height, paletteOf(theme), preset);
  }

  private drawn(): Drawn | null {
    const { cell, parts, motion, live, time, landings, ellipse, map } = this;
    const target = motion?.targetAt(time) ?? this.target;
    if (cell === null) return null;
    const q = live?.positions ?? motion?.at(time).positions ?? cell.home;
    const object = motion?.flies && live === null && time >= motion.releaseTime ? motion.objectAt(time) : null;
    return { cell, parts, q, object, motion, target, landings, ellipse, map };
  }
}

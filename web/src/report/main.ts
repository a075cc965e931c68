/**
 * The report that `fling report` writes: scene and curves of one plan in a single file, without a service.
 *
 * Facts, certificate and tables are in the file as plain HTML; this program adds what moves.
 */

import "./report.css";
import { type Chart, createChart } from "../curves/chart";
import { type Quantity, quantitiesOf } from "../curves/quantities";
import { createDrawnScene, createScene } from "../scene/index";
import type { CameraPreset, Ellipse, Landing, Scene, Theme } from "../scene/interface";
import { type Flag, flagsOf, mainTime } from "../model/passages";
import { endOf } from "../model/samples";
import { save } from "../service/save";
import type { CellModel, Curves, Plan } from "../service/types";
import { curveDrawing } from "../curves/drawing";
import { Player } from "./player";

/** What the file carries. */
interface ReportData {
  readonly plan: Plan;
  readonly model: CellModel;
  readonly curves: Curves | null;
  readonly landings: readonly Landing[];
  readonly ellipse: Ellipse | null;
  readonly tracking: Quantity | null; // of an execution: measured less planned
}

const CAMERAS: readonly CameraPreset[] = ["overview", "side", "top", "front", "target"];
const CHART_PX = 170;
const LINES = {
  light: ["#0b6bcb", "#b85c00", "#14804a", "#cf2a3c", "#7a3fbf", "#0b7a8a"],
  dark: ["#62aef7", "#ffab40", "#4cc38a", "#ff6b76", "#c39bff", "#4dd0e1"],
} as const;

function start(): void {
  const text = document.getElementById("report-data")?.textContent;
  const host = document.getElementById("stage");
  if (!text || !host) return;
  const data = JSON.parse(text) as ReportData;
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const scene = mountScene(host, data, dark.matches ? "dark" : "light");
  const player = new Player(host, endOf(data.plan), mainTime(data.plan));
  const quantities = [...quantitiesOf(data.plan, NO_LIMITS, data.curves), ...(data.tracking ? [data.tracking] : [])];
  let charts = mountCharts(quantities, data.plan, dark.matches ? "dark" : "light", player);
  player.onTime((t) => {
    scene.setTime(t);
    for (const chart of charts) chart.setTime(t);
  });
  dark.addEventListener("change", () => {
    scene.setTheme(dark.matches ? "dark" : "light");
    for (const chart of charts) chart.destroy();
    charts = mountCharts(quantities, data.plan, dark.matches ? "dark" : "light", player);
  });
  for (const button of document.querySelectorAll<HTMLButtonElement>("button[data-time]")) {
    button.addEventListener("click", () => player.go(Number(button.dataset["time"])));
  }
  player.go(mainTime(data.plan));
  Object.assign(window, { report: { scene, player } });
}

const NO_LIMITS = { lower: null, upper: null, velocity: null, acceleration: null, jerk: null };

/** Returns the scene in its place; two drawn views where the browser cannot draw it. */
function mountScene(host: HTMLElement, data: ReportData, theme: Theme): Pick<Scene, "setTime" | "setTheme"> {
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { tabIndex: 0, role: "img" });
  canvas.setAttribute("aria-label", `The arm of ${data.plan.cell} along its plan, and the flight of the object`);
  host.prepend(canvas);
  try {
    const scene = createScene(canvas, { theme });
    scene.setModel(data.model);
    scene.setTarget(targetOf(data.plan));
    scene.setPlan(data.plan, "valid");
    scene.setLandings(data.landings, data.ellipse);
    new ResizeObserver(() => scene.resize()).observe(canvas);
    host.append(toolbar(scene, data.plan.id));
    return scene;
  } catch (error) {
    const views = document.createElement("div");
    views.className = "drawn-views";
    canvas.replaceWith(views);
    const drawn = createDrawnScene(views, theme);
    drawn.setModel(data.model);
    drawn.setTarget(targetOf(data.plan));
    drawn.setPlan(data.plan, "valid");
    drawn.setLandings(data.landings, data.ellipse);
    new ResizeObserver(() => drawn.resize()).observe(views);
    views.after(element("p", "drawn-reason", `This browser draws no moving scene (${error instanceof Error ? error.message : error}): two views instead.`));
    return drawn;
  }
}

function targetOf(plan: Plan): Parameters<Scene["setTarget"]>[0] {
  const release = (plan.request as { release?: { kind?: string; position?: number[]; opening?: { radius_m: number; rim_height_m: number } } }).release;
  if (release?.kind !== "target" || !plan.flight || typeof plan.starts_at_s === "number") return null; // one that moves, the motion shows
  return { position: plan.flight.landing_point as unknown as [number, number, number], opening: release.opening ?? null };
}

function toolbar(scene: Scene, name: string): HTMLElement {
  const bar = element("div", "cameras");
  bar.setAttribute("role", "group");
  bar.setAttribute("aria-label", "View");
  for (const preset of CAMERAS) bar.append(button(preset[0]!.toUpperCase() + preset.slice(1), () => scene.setCamera(preset)));
  bar.append(button("PNG", () => void scene.png().then((blob) => save(blob, `${name}.png`))));
  bar.append(button("SVG", () => save(new Blob([scene.svg()], { type: "image/svg+xml" }), `${name}.svg`)));
  return bar;
}

function mountCharts(quantities: readonly Quantity[], plan: Plan, theme: Theme, player: Player): Chart[] {
  const host = document.getElementById("curves");
  if (!host) return [];
  host.replaceChildren();
  const style = getComputedStyle(document.documentElement);
  const colour = (name: string): string => style.getPropertyValue(name).trim();
  const colors = { lines: LINES[theme], ink: colour("--ink"), grid: colour("--line"), limit: colour("--bad"), paper: colour("--paper") };
  const flags = flagsOf(plan);
  return quantities.map((quantity) => {
    const figure = element("figure", "curve");
    const place = element("div", "plot");
    figure.append(caption(quantity, LINES[theme], flags, plan.id, () => chart.png()), place);
    host.append(figure);
    const visible = quantity.lines.map(() => true);
    const chart = createChart(place, quantity, { height: CHART_PX, colors, flags, binding: false, visible, range: [0, endOf(plan)], onTime: (t) => player.go(t) });
    new ResizeObserver(() => chart.resize(place.clientWidth)).observe(place);
    return chart;
  });
}

function caption(quantity: Quantity, lines: readonly string[], flags: readonly Flag[], name: string, png: () => Promise<Blob>): HTMLElement {
  const text = element("figcaption");
  text.append(element("b", "", `${quantity.label} [${quantity.unit}]`));
  quantity.lines.forEach((line, i) => {
    const key = element("span", "key", line.label);
    key.style.color = lines[i % lines.length]!;
    text.append(key);
  });
  const picture = button("SVG", () => save(new Blob([curveDrawing(quantity, flags)], { type: "image/svg+xml" }), `${name}-${quantity.key}.svg`));
  picture.setAttribute("aria-label", `Save ${quantity.label} as SVG`);
  const pixels = button("PNG", () => void png().then((blob) => save(blob, `${name}-${quantity.key}.png`)));
  pixels.setAttribute("aria-label", `Save ${quantity.label} as PNG`);
  const saves = element("span", "saves");
  saves.append(picture, pixels);
  text.append(saves);
  return text;
}

function button(text: string, onClick: () => void): HTMLButtonElement {
  const made = document.createElement("button");
  Object.assign(made, { type: "button", textContent: text });
  made.addEventListener("click", onClick);
  return made;
}

function element(tag: string, name = "", text = ""): HTMLElement {
  const made = document.createElement(tag);
  if (name) made.className = name;
  if (text) made.textContent = text;
  return made;
}

start();

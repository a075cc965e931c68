import { ProblemError, call, events, get, post, setToken } from "/web/service.js";

const $ = (id) => document.getElementById(id);
// The plan on the screen, the number of the request it answers, and the execution that is followed.
const state = { plan: null, request: 0, execution: null };

function element(name, text, className) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (className) made.className = className;
  return made;
}

function rows(body, table) {
  body.replaceChildren(...table.map((cells) => {
    const row = element("tr");
    row.append(...cells.map((cell) => (cell instanceof Node ? cell : element("td", cell))));
    return row;
  }));
}

const figure = (value, digits = 3) => (typeof value === "number" ? Number(value.toPrecision(digits)).toString() : "–");
const number = (text) => element("td", text, "number");

async function showReady() {
  try {
    await get("/readyz");
    $("ready").textContent = "ready";
    $("ready").className = "good";
  } catch (error) {
    $("ready").textContent = error.message || "the service does not answer";
    $("ready").className = "bad";
  }
}

async function showCells() {
  const { cells } = await get("/cells");
  const options = cells.map((cell) => {
    const option = element("option", `${cell.name}${cell.robot ? ` (${cell.robot}${cell.link_kind === "ur" ? ", real arm" : ""})` : ", refused"}`);
    option.value = cell.name;
    option.selected = cell.default;
    option.disabled = Boolean(cell.error);
    return option;
  });
  $("cell").replaceChildren(...options);
}

async function showRobot() {
  const cell = $("cell").value;
  if (!cell) return;
  try {
    const running = await runningExecution();
    $("abort").disabled = !running;
    if (running && running !== state.execution) follow(running).catch(showProblem);
    const { executor, robot, fault, execution_id } = await get(`/cells/${cell}/state`);
    const lines = [];
    if (!executor || !executor.alive) lines.push(`no executor: fling executor --cell ${cell}`);
    if (robot && robot.positions) lines.push(`joints ${robot.positions.map((q) => q.toFixed(2)).join("  ")} rad`);
    for (const reason of (robot && robot.refusals) || []) lines.push(reason);
    for (const warning of (robot && robot.warnings) || []) lines.push(`warning: ${warning}`);
    if (fault) lines.push(`fault: ${fault.reason || JSON.stringify(fault)}`);
    if (execution_id) lines.push("an execution is running");
    $("robot").replaceChildren(...(lines.length ? lines : ["at rest"]).map((line) => element("div", line)));
    $("acknowledge").hidden = !fault;
  } catch (error) {
    $("robot").textContent = error.message;
  }
}

// What runs on the chosen cell, whoever started it; null if nothing does.
async function runningExecution() {
  return (await get(`/cells/${$("cell").value}/state`)).execution_id;
}

async function abort() {
  try {
    const id = await runningExecution();
    if (id) await post(`/executions/${id}/abort`);
  } catch (error) {
    showProblem(error);
  }
}

// Any edit makes the plan on the screen another request's: it must not be thrown.
function discardPlan() {
  state.request += 1;
  if (state.plan) $("summary").textContent = "The request has changed: plan again.";
  state.plan = null;
  $("execute").disabled = true;
  $("execute").textContent = "Throw";
  $("planned").classList.add("stale");
}

function showProblem(error) {
  const box = $("problem");
  box.hidden = !error;
  if (!error) return;
  const problem = error instanceof ProblemError ? error.problem : { detail: String(error) };
  box.textContent = `${problem.title ? `${problem.title}: ` : ""}${problem.detail}`;
  if (problem.nearest && problem.nearest.release && problem.nearest.release.position) {
    const button = element("button", "take the nearest feasible target", "plain");
    button.addEventListener("click", () => {
      ["x", "y", "z"].forEach((axis, i) => { $(axis).value = problem.nearest.release.position[i].toFixed(4); });
      makePlan();
    });
    box.append(element("br"), button);
  }
}

function request() {
  const body = {
    cell: $("cell").value,
    backend: $("backend").value,
    release: { kind: "target", position: ["x", "y", "z"].map((axis) => Number($(axis).value)) },
  };
  if ($("window").value) body.release_window_s = Number($("window").value);
  if ($("soonest").checked) body.release_window_s = 0;
  if ($("radius").value || $("rim").value) body.release.opening = { radius_m: Number($("radius").value), rim_height_m: Number($("rim").value) };
  if ($("tolerance").value) body.landing_tolerance_m = Number($("tolerance").value);
  return body;
}

async function makePlan() {
  $("plan").disabled = true;
  discardPlan();
  showProblem(null);
  $("summary").textContent = "planning …";
  const asked = state.request;
  try {
    const plan = await post("/plan?trajectory=false", request());
    if (asked === state.request) await showPlan(plan);
    else $("summary").textContent = "The request has changed: plan again.";
  } catch (error) {
    $("summary").textContent = "";
    showProblem(error);
  }
  $("plan").disabled = false;
}

// What the plan holds for a release that is not on time.
function timing(flight) {
  const robust = flight.release_window_s > 0 && flight.landing_tolerance_m > 0;
  const held = robust
    ? `a release up to ${figure(1000 * flight.release_window_s)} ms early or late lands within ${figure(1000 * flight.landing_tolerance_m)} mm`
    : "planned for the release on time alone";
  const moved = ["early", "late"].map((when) => flight.landing_shift_10ms_m[when])
    .map((shift) => (shift === null ? "an unknown distance" : `${(1000 * shift).toFixed(0)} mm`));
  return `${held}; 10 ms early or late moves the landing by ${moved.join(" / ")}`;
}

async function showPlan(plan) {
  const asked = state.request;
  const flight = plan.flight;
  $("summary").textContent = `${plan.backend}, ${(1000 * plan.solver.solve_time_s).toFixed(0)} ms: release after ` +
    `${plan.release_time_s.toFixed(3)} s of ${plan.duration_s.toFixed(3)} s` +
    (flight ? `, leaves at ${flight.speed_m_s.toFixed(2)} m/s, flies ${flight.time_of_flight_s.toFixed(2)} s; ${timing(flight)}` : "");
  const svg = await (await call("GET", `/plans/${plan.id}/picture.svg`)).text();
  const drawn = new DOMParser().parseFromString(svg, "image/svg+xml").documentElement;
  $("picture").replaceChildren(document.importNode(drawn, true));
  $("legend").hidden = false;
  const table = element("table");
  const head = element("tr");
  head.append(...["check", "value", "limit", "unit", "margin"].map((title) => element("th", title)));
  const body = element("tbody");
  rows(body, plan.certificate.checks.map((check) => [
    check.name, number(figure(check.value)), number(figure(check.limit)), check.unit, number(figure(check.margin))]));
  table.append(head, body);
  $("checks").hidden = false;
  $("checks").querySelector("div").replaceChildren(table);
  if (asked !== state.request) return;
  state.plan = plan;
  $("planned").classList.remove("stale");
  const place = plan.request.release.position.slice(0, 2).map((x) => x.toFixed(2)).join(", ");
  $("execute").textContent = `Throw on ${plan.cell} to (${place})`;
  $("execute").disabled = false;
}

async function execute() {
  const plan = state.plan;
  if (!plan || plan.cell !== $("cell").value) return;
  $("execute").disabled = true;
  showProblem(null);
  try {
    const execution = await post("/execute", { plan_id: plan.id, mode: $("mode").value });
    $("abort").disabled = false;
    await follow(execution.id);
  } catch (error) {
    showProblem(error);
  }
  $("execute").disabled = state.plan === null;
}

// Shows an execution until it ends, another one is shown, or another cell is chosen.
async function follow(id) {
  if (state.execution === id) return;
  state.execution = id;
  const { plan_id } = await get(`/executions/${id}`);
  const { duration_s } = await get(`/plans/${plan_id}?trajectory=false`);
  $("metrics").replaceChildren();
  $("progress").value = 0;
  for await (const { kind, data } of events(id)) {
    if (state.execution !== id) return;
    if (kind === "state") $("run").textContent = data.outcome ? `${data.outcome}${data.reason ? `: ${data.reason}` : ""}` : `${data.state} …`;
    if (kind === "state" && data.outcome) $("run").className = data.outcome === "completed" ? "good" : "bad";
    if (kind === "telemetry" && data.clock_s !== undefined) $("progress").value = Math.max(0, Math.min(1, data.clock_s / duration_s));
    if (kind === "state" && data.state === "finished") showMetrics(data.metrics);
  }
  $("progress").value = 1;
  state.execution = null;
  await Promise.all([showPast(), showRobot()]);
}

function showMetrics(metrics) {
  const body = element("tbody");
  const text = (value) => (Array.isArray(value) ? value.map((v) => figure(v, 4)).join(", ") : typeof value === "number" ? figure(value, 4) : String(value ?? "–"));
  rows(body, Object.entries(metrics || {}).map(([name, value]) => [name, number(text(value))]));
  const table = element("table");
  table.append(body);
  $("metrics").replaceChildren(table);
}

function download(id, media, ending) {
  const button = element("a", ending);
  button.href = `/executions/${id}/recording`;
  button.addEventListener("click", async (click) => {
    click.preventDefault();
    const response = await fetch(button.href, { headers: { Accept: media, ...($("token").value ? { Authorization: `Bearer ${$("token").value}` } : {}) } });
    if (!response.ok) return showProblem(new ProblemError(await response.json()));
    const link = element("a");
    link.href = URL.createObjectURL(await response.blob());
    link.download = `fling-${id}.${ending}`;
    link.click();
    URL.revokeObjectURL(link.href);
  });
  return button;
}

// What stopped the object on its way, in the words of the metric `landed_on`; empty where nothing did.
const stopper = (surface) => (/^(keep_out|bin wall)/.test(surface || "") ? `, stopped by ${surface}` : "");

async function showPast() {
  const { executions } = await get("/executions?limit=12");
  rows($("past").tBodies[0], executions.map((run) => {
    const metrics = run.metrics || {};
    const links = element("td");
    links.append(download(run.id, "application/octet-stream", "mcap"), " ", download(run.id, "text/csv", "csv"));
    const error = metrics.landing_error_m;
    return [
      new Date(run.created_at).toLocaleTimeString(), run.cell, `${run.mode}${run.dry_run ? ", dry" : ""}`,
      element("td", run.outcome || run.state, run.outcome === "completed" ? "good" : run.outcome ? "bad" : "soft"),
      number(typeof error === "number" ? `${(1000 * error).toFixed(1)} mm${stopper(metrics.landed_on)}` : "–"),
      number(metrics.missed_ticks === undefined ? "–" : String(metrics.missed_ticks)), links];
  }));
}

$("throw").addEventListener("submit", (submit) => { submit.preventDefault(); makePlan(); });
$("execute").addEventListener("click", execute);
$("abort").addEventListener("click", abort);
for (const name of ["x", "y", "z", "backend", "soonest", "window", "tolerance", "radius", "rim", "cell"]) $(name).addEventListener("input", discardPlan);
$("acknowledge").addEventListener("click", () => post(`/cells/${$("cell").value}/acknowledge`).then(showRobot, showProblem));
$("cell").addEventListener("change", () => {
  state.execution = null;
  $("run").textContent = "Nothing is running.";
  showRobot();
});
$("token").addEventListener("change", () => { setToken($("token").value); start(); });

async function start() {
  await showReady();
  try {
    await showCells();
    await Promise.all([showRobot(), showPast()]);
  } catch (error) {
    showProblem(error);
  }
}

await start();
setInterval(showReady, 5000);
setInterval(showRobot, 1000);

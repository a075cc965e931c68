// Runs a throw, reads every document and provokes the errors, with the types that openapi-typescript makes of the
// service's document: tsc refuses this file where the document does not say what is used here.
// Arguments: address of the service, token, ids of every operation.

import { strict as assert } from "node:assert";
import createClient from "openapi-fetch";
import type { paths } from "./schema.js";

const [baseUrl, token, ...operations] = process.argv.slice(2);
assert(baseUrl && token);
const client = createClient<paths>({ baseUrl, headers: { Authorization: `Bearer ${token}` } });
const stranger = createClient<paths>({ baseUrl });
const called = new Set<string>();
const NOTHING = "00000000-0000-7000-8000-000000000000";
const cell = { params: { path: { name: "ur5e-sim" } } };

type Answer<D, E> = { data?: D; error?: E; response: Response };

function done<D, E>(operation: string, answer: Answer<D, E>): D {
  assert(answer.response.ok, `${operation}: ${answer.response.status} ${JSON.stringify(answer.error)}`);
  called.add(operation);
  return answer.data as D;
}

function refused<D, E extends { type: string; status: number }>(name: string, status: number, answer: Answer<D, E>): E {
  const type = answer.response.headers.get("content-type");
  assert.equal(answer.response.status, status, `${name}: ${answer.response.status} ${JSON.stringify(answer.error)}`);
  assert.equal(type, "application/problem+json");
  assert(answer.error);
  assert.equal(answer.error.type, `/problems/${name}`);
  return answer.error;
}

function json<D>(document: D): Exclude<D, string> {
  assert(typeof document !== "string");
  return document as Exclude<D, string>;
}

const target = { release: { kind: "target" as const, position: [1.2, 0.3, 0.0] } };
const planned = done("make_plan", await client.POST("/plan", { body: target as never }));
assert("id" in planned && planned.certificate.valid);
const plan = { params: { path: { id: planned.id } } };

const TRIES = 3; // on an overloaded machine a throw may be `late`
async function thrown(plan_id: string) {
  for (let left = TRIES; ; left--) {
    const series = done("begin_experiment", await client.POST("/experiments", { body: { name: "typescript" } as never }));
    const order = { plan_id, experiment_id: series.id };
    const queued = done("execute_plan", await client.POST("/execute", { body: order as never }));
    refused("robot-busy", 409, await client.POST("/execute", { body: order as never }));
    const run = { params: { path: { id: queued.id } } };
    const events = done("watch_execution", await client.GET("/executions/{id}/events", { ...run, parseAs: "text" }));
    const row = done("read_execution", await client.GET("/executions/{id}", run));
    if (row.outcome === "completed" || left === 1) return { series, order, run, events, row };
    done("acknowledge_fault", await client.POST("/cells/{name}/acknowledge", cell));
  }
}
const { series, order, run, events, row } = await thrown(planned.id);
assert(events.includes("event: telemetry"));
assert.equal(row.outcome, "completed", row.reason ?? "");
assert(row.metrics && (row.metrics.landing_error_m ?? 1) < 0.01);
const landed = { result: "hit" as const, radius_m: 0.1 };
done("report_landing", await client.POST("/executions/{id}/landing", { ...run, body: landed as never }));
done("read_landings", await client.GET("/executions/{id}/landing", run));
const recording = await client.GET("/executions/{id}/recording", { ...run, parseAs: "arrayBuffer" });
assert(new Uint8Array(done("read_recording", recording) as unknown as ArrayBuffer)[0] === 0x89);
done("abort_execution", await client.POST("/executions/{id}/abort", run));

const joint = { kind: "joint", positions: [0.4, -1.4, 1.2, -1.2, -1.57, 0], velocities: [0.8, 0.6, -0.5, 0.3, 0, 0] };
const many = { template: { release: joint }, grid: { "release.positions[0]": [0.4, 0.42, 0.01] } };
const batch = { params: { path: { id: done("make_batch", await client.POST("/batches", { body: many as never })).id } } };
const progress = done("watch_batch", await client.GET("/batches/{id}/events", { ...batch, parseAs: "text" }));
assert(progress.includes("event: progress"));
assert.equal(done("read_batch", await client.GET("/batches/{id}", batch)).counts.planned, 3);
const results = json(done("read_batch_results", await client.GET("/batches/{id}/results", batch)));
assert(results.results.every((result) => result.plan_id));
assert.equal(done("cancel_batch", await client.POST("/batches/{id}/cancel", batch)).outcome, "completed");
done("list_batches", await client.GET("/batches", {}));

const area = { extent_m: [1.0, 1.4, 0.1, 0.5], resolution_m: 0.2, plane_z_m: 0 };
const begun = done("make_cell_map", await client.POST("/cells/{name}/map", { ...cell, body: area as never }));
const made = { params: { ...cell.params, query: { id: begun.id } } };
let map = json(done("read_cell_map", await client.GET("/cells/{name}/map", made)));
for (const patience = Date.now() + 240_000; map.state === "running"; ) {
  assert(Date.now() < patience, "the map takes too long");
  await new Promise((resolve) => setTimeout(resolve, 500));
  map = json(done("read_cell_map", await client.GET("/cells/{name}/map", made)));
}
assert.deepEqual([map.state, map.values.state], ["finished", [[1, 1], [1, 1]]]);
done("cancel_cell_map", await client.POST("/cells/{name}/map/cancel", made));
const fine = { ...area, resolution_m: 0.0001 };
refused("invalid-request", 422, await client.POST("/cells/{name}/map", { ...cell, body: fine as never }));

done("list_plans", await client.GET("/plans", {}));
done("list_executions", await client.GET("/executions", {}));
done("list_experiments", await client.GET("/experiments", {}));
done("read_experiment", await client.GET("/experiments/{id}", { params: { path: { id: series.id } } }));
done("read_plan", await client.GET("/plans/{id}", plan));
const csv = { path: { id: planned.id }, header: { accept: "text/csv" } };
const table = await client.GET("/plans/{id}/trajectory", { params: csv, headers: { accept: "text/csv" }, parseAs: "text" });
assert(String(done("read_trajectory", table)).startsWith("time_from_start_s,"));
const curves = done("read_plan_curves", await client.GET("/plans/{id}/curves", plan));
assert(curves.curves.every((curve) => curve.series.length > 0));
done("list_cells", await client.GET("/cells", {}));
done("read_cell", await client.GET("/cells/{name}", cell));
assert.equal(done("read_cell_model", await client.GET("/cells/{name}/model", cell)).chain.length, 6);
assert(done("read_robot_state", await client.GET("/cells/{name}/state", cell)).robot?.connected);
done("read_timing", await client.GET("/cells/{name}/timing", cell));
done("read_calibration", await client.GET("/cells/{name}/calibration", cell));
done("acknowledge_fault", await client.POST("/cells/{name}/acknowledge", cell));
const power = { action: "power_on" as const };
assert.equal(done("operate_robot", await client.POST("/cells/{name}/robot", { ...cell, body: power })).state, "waiting");
const learnt = done("estimate_profile_of_cell", await client.POST("/cells/{name}/profiles", cell));
const profile = { params: { path: { id: learnt.id } } };
done("list_profiles", await client.GET("/cells/{name}/profiles", cell));
done("read_history", await client.GET("/cells/{name}/history", cell));
done("read_profile", await client.GET("/profiles/{id}", profile));
done("adopt_profile", await client.POST("/profiles/{id}/adopt", profile));
refused("plan-not-executable", 409, await client.POST("/execute", { body: order as never }));
refused("cannot-join", 409, await client.POST("/cells/{name}/retarget", { ...cell, body: target as never }));
const joining = { ...run, body: { plan_id: planned.id } };
refused("cannot-join", 409, await client.POST("/executions/{id}/replace", joining));
called.add("replace_plan").add("retarget_motion");
done("revert_profile", await client.POST("/cells/{name}/profiles/revert", cell));
done("read_health", await client.GET("/healthz", {}));
done("read_readiness", await client.GET("/readyz", {}));
done("read_metrics", await client.GET("/metrics", { parseAs: "text" }));

const fast = { release: { kind: "joint" as const, positions: [0, -1.5, 1.5, -1.5, -1.5, 0], velocities: [9, 0, 0, 0, 0, 0] } };
const impossible = refused("infeasible", 422, await client.POST("/plan", { body: fast as never }));
assert.equal(impossible.violations?.[0]?.constraint, "joint_velocity");
const loose = { ...target, limits: { velocity: 99 } };
assert.equal(refused("invalid-request", 422, await client.POST("/plan", { body: loose as never })).errors?.length, 6);
refused("not-found", 404, await client.GET("/plans/{id}", { params: { path: { id: NOTHING } } }));
refused("not-found", 404, await client.GET("/cells/{name}/model", { params: { path: { name: "nowhere" } } }));
refused("not-acceptable", 406, await client.GET("/plans/{id}/trajectory", { ...plan, headers: { accept: "image/png" } }));
refused("invalid-request", 422, await client.GET("/plans", { params: { query: { cursor: "x" } } }));
refused("unauthenticated", 401, await stranger.GET("/plans", {}));
refused("unauthenticated", 401, await stranger.POST("/executions/{id}/abort", run));

const left = operations.filter((operation) => !called.has(operation));
assert.deepEqual(left, [], "operations that were not called");

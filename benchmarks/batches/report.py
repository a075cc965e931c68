"""The report on batches: identical answers, kills, costs, and the scaling that follows from them."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.batches.cluster import LocalCluster
from benchmarks.batches.costs import EngineCost, StoreCost, engine_cost, store_cost
from benchmarks.batches.problems import batch_requests
from benchmarks.batches.runs import BatchRun, kill_actor, kill_driver, kill_worker, run_batch
from benchmarks.results import machine, machine_words

MILLION = 1_000_000


def batches_report(count: int, cost_count: int, with_ray: bool) -> str:
    """Runs everything and returns the page.

    Args:
        count: requests of each batch in which something is killed.
        cost_count: requests of each measurement of costs.
        with_ray: whether Ray is measured too.
    """
    about = machine()
    asked = batch_requests(count)
    priced = batch_requests(cost_count, seed=1)
    costs, store = _costs(priced, None)
    engines = {"processes": costs}
    if with_ray:  # costs first: a run with kills may take long, and what else the machine does disturbs it less
        with LocalCluster() as cluster:
            engines["Ray, two nodes"] = _costs(priced, cluster.address)[0]
    local_kills = [(0.25, "a worker", kill_worker), (0.5, "the driver", kill_driver), (0.75, "a worker", kill_worker)]
    runs = {"processes": _run(asked, None, local_kills)}
    if with_ray:
        with LocalCluster() as cluster:
            ray_kills = [
                (0.2, "a worker", kill_actor),
                (0.45, "a node", lambda _: cluster.kill_node()),
                (0.7, "the driver", kill_driver),
            ]
            runs["Ray, two nodes"] = _run(asked, cluster.address, ray_kills)
    return _page(about, count, cost_count, runs, engines, store)


def _run(asked: Sequence[dict], ray: str | None, kills: Sequence) -> BatchRun:
    with tempfile.TemporaryDirectory() as folder:
        return run_batch(Path(folder), asked, 2, ray, kills)


def _costs(asked: Sequence[dict], ray: str | None) -> tuple[list[EngineCost], StoreCost]:
    """Returns the engine's costs with one worker and with two, and the store's."""
    one, results = engine_cost(asked, 1, ray)
    two, _ = engine_cost(asked, 2, ray)
    with tempfile.TemporaryDirectory() as folder:
        return [one, two], store_cost(Path(folder), results)


def _page(
    about: dict[str, str],
    count: int,
    cost_count: int,
    runs: dict[str, BatchRun],
    engines: dict[str, list[EngineCost]],
    store: StoreCost,
) -> str:
    sections = [
        "# Batches",
        f"{machine_words(about)} Written by `python -m benchmarks.batches --count {count} --costs {cost_count}`: "
        "60 % releases in joints, 35 % through a point, 5 % targets, some of them out of reach.",
        _answers(count, runs),
        _memory(runs),
        _engines(cost_count, engines),
        _store(store),
        _scaling(engines["processes"], store),
    ]
    return "\n\n".join(sections) + "\n"


def _answers(count: int, runs: dict[str, BatchRun]) -> str:
    lines = [
        "## Identical answers, nothing lost, nothing twice",
        "Every run has a driver with two workers and an empty store; what was killed is named with the number of "
        "results at that time. `answers` is the hash of all trajectories and refusals.",
        "| engine | results | plans | refused | killed | answers |\n|---|---|---|---|---|---|",
    ]
    for name, run in runs.items():
        planned = run.row.counts.get("planned", 0)
        killed = ", ".join(f"{what} at {at}" for what, at in run.killed) or "nothing"
        lines[-1] += (
            f"\n| {name} | {run.row.done} of {count} | {run.plans} | {count - planned} | {killed} | `{_digest(run)}` |"
        )
    same = len({_digest(run) for run in runs.values()}) == 1
    if len(runs) > 1:
        lines.append("The answers are the same." if same else "**The answers differ.**")
    return "\n\n".join(lines)


def _digest(run: BatchRun) -> str:
    return hashlib.sha256("\n".join(run.hashes).encode()).hexdigest()[:16]


def _memory(runs: dict[str, BatchRun]) -> str:
    told = []
    for name, run in runs.items():
        sizes = [size for size in run.memory if size]
        quarters = [_median(sizes[max(0, k * len(sizes) // 4 - 8) : k * len(sizes) // 4]) for k in (1, 2, 3, 4)]
        told.append(f"{name} {', '.join(f'{size / 1e6:.0f}' for size in quarters)} MB")
    head = "Resident memory of driver and workers (of Ray: of the driver alone) after each quarter of a run"
    return f"{head}: {'; '.join(told)}."


def _median(values: Sequence[int]) -> float:
    return sorted(values)[len(values) // 2] if values else 0.0


def _engines(count: int, engines: dict[str, list[EngineCost]]) -> str:
    head = (
        f"{count} requests through the pool alone: overhead is the time of a worker per result beyond its planning; "
        "`alone` the time per result of one worker that answers at once, with as many bytes as a plan has."
    )
    table = "| engine | workers | plans a second | planning | overhead | alone |\n|---|---|---|---|---|---|"
    for name, costs in engines.items():
        for cost in costs:
            table += (
                f"\n| {name} | {cost.workers} | {cost.plans_per_s:.2f} | {cost.planning_ms:.1f} ms "
                f"| {cost.overhead_ms:.2f} ms | {cost.alone_ms:.2f} ms |"
            )
    return "\n\n".join([f"## Engines ({os.cpu_count()} cores)", head, table])


def _store(store: StoreCost) -> str:
    text = (
        f"A plan and its result take {store.time_ms:.2f} ms in transactions of twenty (SQLite, one writer), and "
        f"{store.plan_bytes / 1e3:.1f} kB. The writer is a thread of the driver, beside the planning."
    )
    return "\n\n".join(["## The store", text])


def _scaling(costs: Sequence[EngineCost], store: StoreCost) -> str:
    core_s = 1e-3 * (costs[-1].planning_ms + costs[-1].overhead_ms)
    cores_of_store = core_s / (1e-3 * store.time_ms)
    return (
        f"A plan takes {core_s * 1e3:.0f} ms of a core, and workers share nothing: one writer keeps up with about "
        f"{cores_of_store:.0f} cores. A million plans are {MILLION * store.plan_bytes / 1e9:.0f} GB and "
        f"{MILLION * core_s / 3600:.0f} core hours."
    )

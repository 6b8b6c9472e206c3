"""What evaluations cost: `python -m experiments.cost`. The figures of docs/cost.md.

Plays a grid of approaches through `agents.jobs.gather` with one process and with all cores, measures what a job costs
that does nothing, here and on a Ray cluster, and how long an approach takes with other couplings, tolerances, robots.
What it says of a cluster is extrapolated from these, and says so.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from agents.evaluate import RESULTS
from agents.evaluate.play import play
from agents.jobs import Job, Result, gather
from agents.provenance import circumstances
from agents.setups import load_setup
from experiments.lab.results import REPORTS, whole_folder
from impact_gym.envs import IDS
from impact_gym.envs.scenario import FIELDS as SCENARIO
from impact_gym.robot import default_approach
from impact_gym.validation import whole

SEED = 30_000_000  # of the first scenario: only time is measured, so any will do
CONTROLLERS = {"paper-trapezoid": {"baseline": "paper-trapezoid"}, "linear-blind": {"shipped": "linear-blind"}}
RULE, POLICY = CONTROLLERS
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
EXTRAPOLATED = (1, 10, 100)  # nodes
CORES = 16  # of each of these nodes


@dataclass(frozen=True)
class Settings:
    """Measure what a grid of approaches costs."""

    approaches: int = 400_000
    """Of each measured grid."""
    whole: int = 10_000_000
    """Of the grid that is spoken of."""
    full: bool = False
    """Play that one as well, once, on all cores; its results take 0.7 GB for a while."""
    per_job: int = 5000
    """Approaches of a job."""
    blanks: int = 1000
    """Jobs that do nothing, for what a job costs."""
    growth: int = 10_000
    """Approaches of each row of the tables of growth."""
    rounds: int = 3
    """Each row is the best of so many."""
    ray: bool = True
    """Measure jobs on a Ray cluster of one node that is started here for it."""
    out: Path = REPORTS / "cost"
    """Folder for cost.json and tables.md; one that an earlier run wrote is replaced."""

    def __post_init__(self) -> None:
        for name in ("approaches", "whole", "per_job", "blanks", "growth", "rounds"):
            whole(name, getattr(self, name), at_least=1)
        if self.approaches < 2 * self.per_job:
            raise ValueError(f"approaches must be at least two jobs of {self.per_job}, got {self.approaches}")


def blank(number: int, count: int) -> Result:
    """Return at once what `play` returns for `count` scenarios, as to size; no two are equal."""
    filled = np.random.default_rng(number).random(count)
    kinds = {"contact_count": np.int64, "missed": np.bool_}
    return {name: filled.astype(kinds.get(name, np.float64)) for name in (*RESULTS, *SCENARIO)}


def drawn(count: int, first: int = 0) -> dict[str, Any]:
    """Return scenarios of the test ranges that nothing else uses."""
    return {"ranges": "test", "seed": SEED + first, "count": count}


def grid(controller: str, settings: Settings, approaches: int) -> list[Job]:
    """Return the jobs of a grid of so many approaches."""
    starts = range(0, approaches, settings.per_job)
    return [
        Job(
            "agents.evaluate.play:play",
            {
                "controller": CONTROLLERS[controller],
                "scenarios": drawn(min(settings.per_job, approaches - start), start),
            },
        )
        for start in starts
    ]


def timed(jobs: Sequence[Job], title: str, **engine: Any) -> dict[str, float]:
    """Gather jobs into an empty folder; return what it took.

    That is the time until the first result and until all (s), the rate of the others (1/s), the bytes of each, and the
    time on cores (s) of this process and those that it started, which hardly depends on what else the machine does.
    """
    with tempfile.TemporaryDirectory() as folder:
        load, begun, came = os.getloadavg()[0], time.perf_counter(), []
        cores = _core_seconds()
        for _ in gather(jobs, folder, title=title, **engine):
            came.append(time.perf_counter() - begun)
        size = sum(path.stat().st_size for path in Path(folder).iterdir())
    return {
        "first": came[0],
        "all": came[-1],
        "rate": (len(jobs) - 1) / (came[-1] - came[0]),
        "core_seconds": _core_seconds() - cores,
        "bytes": size / len(jobs),
        "load_before": load,
    }


def _core_seconds() -> float:
    """Return the time on cores so far, of this process and of its children that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def starting() -> float:
    """Return how long a fresh process takes on a core until it has played one scenario, s."""
    before = _core_seconds()
    call = f"from agents.evaluate.play import play; play({CONTROLLERS[RULE]!r}, {drawn(1)!r})"
    subprocess.run([sys.executable, "-c", call], check=True)
    return _core_seconds() - before


def on_ray(settings: Settings) -> dict[str, Any] | None:
    """Measure jobs on a cluster of one node with this machine's cores; None where there is no Ray."""
    if not settings.ray:
        return None
    try:
        import ray
        from ray.cluster_utils import Cluster
    except ImportError:
        return None
    node = {"num_cpus": os.cpu_count() or 1, "object_store_memory": 200 * 2**20, "include_dashboard": False}
    cluster = Cluster(initialize_head=True, head_node_args=node)
    try:
        return {
            "grid": timed(grid(POLICY, settings, settings.approaches), "on Ray", cluster=cluster.address),
            "blank": timed(blanks(settings), "blank, Ray", cluster=cluster.address),
        }
    finally:
        with suppress(Exception):  # whatever it says at its end, the figures are there
            ray.shutdown()
            cluster.shutdown()  # type: ignore[no-untyped-call]  # untyped in Ray


def blanks(settings: Settings) -> list[Job]:
    """Return jobs that do nothing but return as much as real ones."""
    return [
        Job("experiments.cost:blank", {"number": number, "count": settings.per_job})
        for number in range(settings.blanks)
    ]


def growth(settings: Settings) -> dict[str, dict[str, float]]:
    """Return microseconds of an approach on one core: by coupling, by robot, by tolerance."""
    constant, table = default_approach().at_impact(), default_approach().robot_table()
    spring = IDS["ImpactApproach-v0"]
    tables: dict[str, dict[str, dict[str, Any]]] = {
        "coupling": {
            "rigid": IDS["ImpactApproachRigid-v0"],
            "spring and damper (the default)": spring,
            "bistable, the paper's": IDS["ImpactApproachBistable-v0"],
            "bistable, for slow touches": dict(load_setup("bistable-blind").environment),
        },
        "robot, with the default coupling": {
            "rigid (the default)": spring,
            "one mass on a spring": {"robot": {"type": "Robot", **asdict(constant)}},
            "table along the way": {"robot": {"type": "RobotTable", **asdict(table)}},
        },
        "tolerance, with the default coupling": {f"{rtol:.0e}": {"rtol": rtol} for rtol in TOLERANCES},
        "tolerance, with the paper's bistable coupling": {
            f"{rtol:.0e}": {"rtol": rtol, **IDS["ImpactApproachBistable-v0"]} for rtol in TOLERANCES
        },
    }
    result: dict[str, dict[str, float]] = {}
    for title, rows in tables.items():
        result[title] = {}
        for name, environment in rows.items():
            best = np.inf
            for _ in range(settings.rounds):
                begun = time.process_time()
                play(CONTROLLERS[RULE], drawn(settings.growth), environment=environment)
                best = min(best, time.process_time() - begun)
            result[title][name] = 1e6 * float(best) / settings.growth
    return result


def extrapolate(measured: dict[str, Any], settings: Settings) -> list[dict[str, float]]:
    """Return what the whole grid would take on clusters, s; nothing here was measured."""
    one = measured["here"][POLICY]["1"]
    on_cluster = measured["ray"] or {"blank": measured["blank"], "grid": one}
    gathering = settings.whole / settings.per_job / on_cluster["blank"]["rate"]
    rows = []
    for nodes in EXTRAPOLATED:
        compute = settings.whole * one["core_seconds"] / settings.approaches / (nodes * CORES)
        start = on_cluster["grid"]["first"]
        rows.append(
            {
                "nodes": nodes,
                "start": start,
                "compute": compute,
                "gathering": gathering,
                "whole": start + max(compute, gathering),
            }
        )
    return rows


def measure(settings: Settings) -> dict[str, Any]:
    """Return all figures."""
    measured: dict[str, Any] = {"growth": growth(settings), "here": {}}
    for controller in CONTROLLERS:
        counts = sorted({1, os.cpu_count() or 1})
        measured["here"][controller] = {
            str(count): timed(
                grid(controller, settings, settings.approaches), f"{controller}, {count}", processes=count
            )
            for count in counts
        }
    measured["blank"] = timed(blanks(settings), "blank, 1", processes=1)
    measured["starting"] = starting()
    measured["ray"] = on_ray(settings)
    measured["full"] = timed(grid(POLICY, settings, settings.whole), "whole") if settings.full else None
    measured["extrapolated"] = extrapolate(measured, settings)
    given = {name: value for name, value in asdict(settings).items() if name != "out"}
    return measured | {"settings": given, **circumstances("impact-gym", "numpy")}


def markdown(measured: dict[str, Any], settings: Settings) -> str:
    """Return the tables of docs/cost.md."""
    machine = f"Measured on {measured['machine']}, {measured['date']}"
    lines = [
        f"{machine}: {settings.approaches:,} approaches in jobs of {settings.per_job:,}.",
        "",
        f"| controller | processes | first, s | all, s | approaches/s | {settings.whole:,}, min | core hours | load |",
        "|---|---|---|---|---|---|---|---|",
    ]
    rows = [(name, count, one) for name, by in measured["here"].items() for count, one in by.items()]
    if measured["ray"]:
        rows.append((POLICY, f"{os.cpu_count()}, Ray", measured["ray"]["grid"]))
    for name, count, one in rows:
        rate = one["rate"] * settings.per_job
        minutes = (one["first"] + settings.whole / rate) / 60.0
        hours = one["core_seconds"] / 3600.0 * settings.whole / settings.approaches
        told = "" if "Ray" in count else f"{hours:.2f}"  # its workers are not this process's children
        lines.append(
            f"| {name} | {count} | {one['first']:.1f} | {one['all']:.1f} | {rate:,.0f} | {minutes:.1f} "
            f"| {told} | {one['load_before']:.1f} |"
        )
    if full := measured["full"]:
        told = f"All {settings.whole:,} with {POLICY}, played: {full['all'] / 60.0:.1f} min on all cores, "
        lines += ["", told + f"{full['core_seconds'] / 3600.0:.2f} core hours, load {full['load_before']:.1f} before."]
    lines += ["", f"A process: {measured['starting']:.1f} s on a core until it begins."]
    lines += ["", f"| a job that returns {settings.per_job:,} rows at once | ms a job | kB a result |", "|---|---|---|"]
    for name, one in (("one process here", measured["blank"]), ("Ray", (measured["ray"] or {}).get("blank"))):
        if one:
            lines.append(f"| {name} | {1e3 / one['rate']:.2f} | {one['bytes'] / 1e3:.0f} |")
    lines += ["", f"Extrapolated, {settings.whole:,} approaches on nodes of {CORES} such cores:", "",
              "| nodes | start, s | compute, s | gathering, s | in all, s |", "|---|---|---|---|---|"]  # fmt: skip
    for row in measured["extrapolated"]:
        lines.append(f"| {row['nodes']} | {row['start']:.0f} | {row['compute']:.1f} | {row['gathering']:.1f} "
                     f"| {row['whole']:.0f} |")  # fmt: skip
    for title, rows_by_name in measured["growth"].items():
        lines += ["", f"| {title} | microseconds of one core | ratio |", "|---|---|---|"]
        first = next((value for name, value in rows_by_name.items() if "default" in name or name == "1e-08"))
        lines += [f"| {name} | {value:.1f} | {value / first:.2f} |" for name, value in rows_by_name.items()]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Read the settings from the command line, measure, print, write."""
    settings = tyro.cli(Settings, prog="python -m experiments.cost")
    try:
        with whole_folder(settings.out) as folder:
            measured = measure(settings)
            (folder / "cost.json").write_text(json.dumps(measured, indent=2) + "\n")
            (folder / "tables.md").write_text(markdown(measured, settings))
    except (RuntimeError, ValueError) as error:
        sys.exit(f"experiments.cost: {error}")
    print(markdown(measured, settings))
    print(f"results: {(settings.out / 'cost.json').resolve().as_uri()}")


if __name__ == "__main__":
    main()

"""The report: `python -m experiments.report` writes reports/latest/index.html and prints where it is."""

import csv
import json
import shlex
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from agents import load_policy
from agents.baselines import ConstantSpeed, PaperTrapezoid
from agents.evaluation import TEST_SEED, Controller, Episodes, evaluate
from agents.policy import SHIPPED
from experiments import charts
from experiments.replay import replay
from experiments.results import REPORTS, checksum, circumstances, whole_folder
from experiments.statistics import CONFIDENCE, RESAMPLES, mean, mean_reduction, relative_reduction

PAPER = "paper's rule"
LEARNED = "learned policy"
SHARP = "paper's speed, at 20 m/s²"
POLICY = "linear-blind"
TIME_WEIGHT = 2.0  # m/s per s, what the policy was trained for
HERE = Path(__file__).parent


@dataclass(frozen=True)
class Settings:
    """Evaluate the shipped policy and the paper's rule on the same test scenarios and write a page about it."""

    out: Path = REPORTS / "latest"
    """Folder for the page; one that an earlier run wrote is replaced once the new one is complete, no other is."""
    scenarios: int = 1000
    """How many test scenarios to play."""


def controllers() -> dict[str, Controller]:
    """Return who is compared, the baseline first."""
    return {
        PAPER: PaperTrapezoid(),
        LEARNED: load_policy(POLICY),
        SHARP: ConstantSpeed(1.0, acceleration=20.0),
    }


def summary(episodes: Episodes) -> dict[str, Any]:
    """Return both objectives and what stands beside them, over all scenarios of one controller."""
    return {
        "object_velocity": asdict(mean(episodes.object_velocity)),
        "approach_time": asdict(mean(episodes.approach_time)),
        "object_velocity_worst_5_percent": float(np.quantile(episodes.object_velocity, 0.95)),
        "cost": asdict(mean(episodes.cost(TIME_WEIGHT))),
        "peak_force": asdict(mean(episodes.peak_force)),
        "contacts": float(episodes.contact_count.mean()),
        "missed": int(episodes.missed.sum()),
    }


def answer(played: dict[str, Episodes]) -> dict[str, Any]:
    """Return the two numbers the page is about, with their intervals."""
    policy, paper = played[LEARNED], played[PAPER]
    return {
        "object_velocity_reduction": asdict(relative_reduction(policy.object_velocity, paper.object_velocity)),
        "approach_time_saved": asdict(mean_reduction(policy.approach_time, paper.approach_time)),
        "scenarios_with_lower_velocity": float(np.mean(policy.object_velocity < paper.object_velocity)),
        "scenarios_with_earlier_contact": float(np.mean(policy.approach_time < paper.approach_time)),
    }


def typical_scenario(episodes: Episodes) -> int:
    """Return the scenario in the middle: the one whose V_p is the median (of an even count, the lower one)."""
    order = np.argsort(episodes.object_velocity, kind="stable")
    return int(order[(len(order) - 1) // 2])


def draw(folder: Path, played: dict[str, Episodes]) -> dict[str, Any]:
    """Draw the figures into `folder`; return what the page says about the scenario shown."""
    points = {name: (episodes.approach_time, episodes.object_velocity) for name, episodes in played.items()}
    charts.save(charts.trade_off(points, means_only=[SHARP]), folder / "trade_off.svg")

    number = typical_scenario(played[PAPER])
    runs = {}
    ends = []
    for name in (PAPER, LEARNED):
        trace, info = replay(controllers()[name], TEST_SEED + number, time_weight=TIME_WEIGHT)
        if info["object_velocity"] != played[name].object_velocity[number]:
            raise RuntimeError(f"scenario {number}: the replay of {name!r} differs from its evaluation")
        runs[name] = (trace, f"contact at {info['approach_time']:.3f} s, V_p {info['object_velocity']:.3f} m/s")
        touching = trace.time[trace.contact_force > 0]
        ends.append(min(trace.time[-1], touching[-1] + 0.1) if touching.size else trace.time[-1])
    charts.save(charts.time_histories(runs, (0.0, max(ends))), folder / "time_histories.svg")
    scenario = {name: float(values[number]) for name, values in played[PAPER].scenario.items()}
    return {"number": number, "seed": TEST_SEED + number, "scenario": scenario}


def write_episodes(path: Path, played: dict[str, Episodes]) -> None:
    """Write one row per controller and scenario."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        fields = ("object_velocity", "approach_time", "peak_force", "contact_count", "missed")
        scenario_fields = list(next(iter(played.values())).scenario)
        writer.writerow(["controller", "seed", *scenario_fields, *fields])
        for name, episodes in played.items():
            columns = [episodes.scenario[field] for field in scenario_fields]
            columns += [getattr(episodes, field) for field in fields]
            for k, row in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
                writer.writerow([name, TEST_SEED + k, *row])


def write(settings: Settings) -> Path:
    """Evaluate, write the folder, and return the path of its page.

    Raises:
        ValueError: fewer than two scenarios, or a folder that this did not write.
    """
    if settings.scenarios < 2:
        raise ValueError(f"scenarios must be at least 2, got {settings.scenarios}")
    begun = time.perf_counter()
    played = {}
    with whole_folder(settings.out) as folder:
        for name, controller in controllers().items():
            print(f"{name}: playing {settings.scenarios} test scenarios", flush=True)
            played[name] = evaluate(controller, TEST_SEED, settings.scenarios, time_weight=TIME_WEIGHT)
        (folder / "figures").mkdir()
        shown = draw(folder / "figures", played)
        write_episodes(folder / "episodes.csv", played)
        results = {
            "answer": answer(played),
            "controllers": {name: summary(episodes) for name, episodes in played.items()},
            "shown": shown,
            "scenarios": {"count": settings.scenarios, "first_seed": TEST_SEED},
            "interval": f"the {100 * CONFIDENCE:g} % interval of a paired bootstrap over scenarios "
            f"({RESAMPLES:,} resamples)",
            "policy": {
                "name": POLICY,
                "sha256": checksum(SHIPPED / f"{POLICY}.npz"),
                "provenance": load_policy(POLICY).provenance,
            },
            "command": shlex.join(["python", "-m", "experiments.report", *sys.argv[1:]]),
            "seconds": time.perf_counter() - begun,
            **circumstances("impact-gym", "gymnasium", "numba", "numpy", "scipy"),
        }
        (folder / "results.json").write_text(json.dumps(results, indent=2) + "\n")
        pages = Environment(loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined)
        page = pages.get_template("report.html.jinja").render(results=results, sharp=SHARP)
        (folder / "index.html").write_text(page)
    return settings.out / "index.html"


def main() -> None:
    """Read the settings from the command line and write the report."""
    try:
        page = write(tyro.cli(Settings))
    except ValueError as error:
        sys.exit(f"experiments.report: {error}")
    except KeyboardInterrupt:
        print("experiments.report: interrupted; what was there before is unchanged", file=sys.stderr)
        sys.exit(130)
    print(f"report: {page.resolve().as_uri()}")


if __name__ == "__main__":
    main()

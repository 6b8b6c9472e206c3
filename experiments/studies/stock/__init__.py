"""Trainings of stable-baselines3's algorithms, with the settings of rl_zoo3 in this folder: cost over processor time.

Each algorithm trains one policy for each seed in `ImpactApproach-v0`, with `ImpactVecEnv` and one thread of torch. At
each time in MARKS and at the end of the training, the policy plays scenarios that no training used.
"""

import time
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure

from agents.baselines.tuned import load_baseline
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.policies import load_policy
from experiments.lab import grid
from experiments.lab.charts import OTHERS, SERIES
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import Cell, Findings, Frames, Measurement, Row, Study

ALGORITHMS = {
    "ppo": "stable_baselines3:PPO", "sac": "stable_baselines3:SAC", "td3": "stable_baselines3:TD3",
    "tqc": "sb3_contrib:TQC", "crossq": "sb3_contrib:CrossQ",
}  # fmt: skip
OTHER = {"paper's rule": "paper-trapezoid", "tuned profile": "blind-profile", "shipped policy": "linear-blind"}
SEEDS = {"ppo": 5, "sac": 5, "td3": 2, "tqc": 5, "crossq": 2}  # number of trainings of each algorithm
MARKS = (10, 20, 30, 60, 120, 180, 300, 600)  # s of processor time, without the time of the evaluations
FIRST_SEED, SCENARIOS, WEIGHT = 41_000_000, 500, 2.0  # of the test scenarios: first seed, number, time weight in m/s^2


def trainings(algorithm: str, quick: bool, _: Frames) -> Iterable[Cell]:
    """Yield a cell for each seed, with the algorithm's settings."""
    import yaml  # type: ignore[import-untyped]  # here, because only this study needs the package

    settings = yaml.safe_load(Path(__file__).with_name(f"{algorithm}.yml").read_text())["default"]
    settings["n_timesteps"] = round(settings["n_timesteps"] * (0.02 if quick else 1.0))
    for seed in range(2 if quick else SEEDS[algorithm]):
        yield Cell({"algorithm": algorithm, "seed": seed}, {"algorithm": algorithm, "seed": seed, "settings": settings})


def cost_of(controller: Any) -> float:
    """Return the mean cost in the test scenarios, with the charge for missed objects, m/s."""
    scenarios = ScenarioBatch(FIRST_SEED, SCENARIOS, time_weight=[WEIGHT], threads=1)
    return float(scenarios.play(controller).loss(WEIGHT).mean())


def trained(algorithm: str, seed: int, settings: dict[str, Any]) -> list[Row]:
    """Train with settings of rl_zoo3; return the cost at each mark and at the end."""
    import torch
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.vec_env import VecNormalize

    from impact_gym.sb3 import ImpactVecEnv

    torch.set_num_threads(1)
    envs = VecNormalize(ImpactVecEnv(settings.pop("n_envs"), threads=1), **settings.pop("normalize"))
    steps, rate = settings.pop("n_timesteps"), float(settings.pop("learning_rate").removeprefix("lin_"))
    if settings.pop("noise_type", None):
        mean = np.zeros(envs.action_space.shape or ())
        settings["action_noise"] = NormalActionNoise(mean, mean + settings.pop("noise_std"))
    kind = resolve_name(ALGORITHMS[algorithm])
    model = kind(env=envs, seed=seed, device="cpu", learning_rate=lambda left: left * rate, **settings)
    rows, evaluations, begun = list[Row](), 0.0, time.process_time()

    def predict(observation: Any, **_: Any) -> Any:
        return model.predict(envs.normalize_obs(observation), deterministic=True)

    def evaluate(*_: Any, ended: bool = False) -> bool:
        nonlocal evaluations
        paused = time.process_time()
        seconds = paused - begun - evaluations
        if ended or any(mark <= seconds for mark in MARKS[len(rows) :]):
            mark = "end" if ended else f"{MARKS[len(rows)]} s"
            cost = cost_of(SimpleNamespace(predict=predict))
            rows.append({"mark": mark, "seconds": seconds, "steps": model.num_timesteps, "cost": cost})
            evaluations += time.process_time() - paused
        return True  # the training goes on

    model.learn(steps, callback=evaluate)
    evaluate(ended=True)
    return rows


def others(*_: Any) -> Iterable[Cell]:
    """Yield a cell for each controller to compare with."""
    return (Cell({"controller": words}, {"name": name}) for words, name in OTHER.items())


def other_cost(name: str) -> list[Row]:
    """Return the cost of a shipped policy or baseline."""
    policy = name == "linear-blind"
    return [{"cost": cost_of(load_policy(name) if policy else load_baseline(name, WEIGHT))}]


def chart(frame: pl.DataFrame, costs: Mapping[str, float]) -> Figure:
    """Return a figure of cost over time: median, and range over the seeds; other controllers as horizontal lines."""
    figure = Figure(figsize=(8.0, 4.6))
    axes = figure.subplots()
    for algorithm, colour in zip(ALGORITHMS, (SERIES[1], SERIES[3], SERIES[4], SERIES[5], OTHERS), strict=False):
        rows = frame.filter(algorithm=algorithm).group_by("mark")
        spread = [pl.median("cost").alias("median"), pl.min("cost").alias("low"), pl.max("cost").alias("high")]
        found = rows.agg(pl.median("seconds"), *spread).sort("seconds")
        axes.plot(found["seconds"], found["median"], "o-", color=colour, label=algorithm.upper(), markersize=4)
        axes.fill_between(found["seconds"], found["low"], found["high"], color=colour, alpha=0.12, linewidth=0.0)
    for (words, cost), style in zip(costs.items(), ("--", "-", ":"), strict=True):
        axes.axhline(cost, color=SERIES[0], linestyle=style, linewidth=1.2, label=words)
    axes.set(xscale="log", xlabel="processor time of the training (s)", ylabel="cost (m/s)", ylim=(0.8, 1.6))
    axes.set_xticks(MARKS, map(str, MARKS))
    axes.minorticks_off()
    axes.legend(fontsize=8, ncols=2)
    return figure


def analyse(frames: Frames, _: bool) -> Findings:
    """Compare the algorithms at each mark."""
    frame = pl.concat([frames[algorithm] for algorithm in ALGORITHMS], how="diagonal_relaxed")
    costs = dict(frames["others"].select("controller", "cost").iter_rows())
    groups = {key: rows["cost"].to_numpy() for key, rows in grid.groups(frame, "algorithm", "mark")}
    marks = [mark for mark in (*(f"{mark} s" for mark in MARKS), "end") if any(mark in key for key in groups)]
    medians = {key: float(np.median(values)) for key, values in groups.items()}
    cells = {key: f"{medians[key]:.3f} [{values.min():.3f}, {values.max():.3f}]" for key, values in groups.items()}
    ends = dict(frame.filter(mark="end").group_by("algorithm").agg(pl.median("seconds")).iter_rows())
    rows = [(each.upper(), *(cells.get((each, mark), "-") for mark in marks), f"{ends[each]:.0f}",
             f"{frames[each]['seed'].n_unique()}") for each in ALGORITHMS]  # fmt: skip
    best = min(ALGORITHMS, key=lambda name: medians[name, "end"])
    caption = "Cost in m/s after each processor time: median [least, largest] of all trainings of the algorithm"
    table = Table(caption, ("Algorithm", *marks, "end after (s)", "trainings"), rows)
    text = ", ".join(f"{words} {cost:.3f}" for words, cost in costs.items())
    answer = (f"{best.upper()} has the lowest median cost at the end of the training, {medians[best, 'end']:.3f} m/s "
              f"(for comparison, {text} m/s).")  # fmt: skip
    alternative = "cost over the processor time of the training, for each algorithm"
    return Findings(answer, [Section("Trainings", [Picture("stock_agents", chart(frame, costs), alternative), table])])


DEPENDS = ("impact_gym", "agents.evaluate", "agents.baselines", "agents.policies")
STUDY = Study(
    "stock",
    "How good is a policy after 1, 3, 10 minutes of training with stable-baselines3?",
    (
        *(Measurement(each, partial(trainings, each), trained, DEPENDS) for each in ALGORITHMS),
        Measurement("others", others, other_cost, DEPENDS),
    ),
    analyse,
    packages=("torch", "stable-baselines3", "sb3-contrib"),
)

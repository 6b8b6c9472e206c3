"""Measure the cost of policies from stable-baselines3 and sb3-contrib over the processor time of their training.

Each algorithm trains ten policies in `ImpactApproach-v0`, and two in each of three other environments. A training uses
`ImpactVecEnv`, one thread of torch, and this folder's settings for rl_zoo3. At each time in MARKS and at the end, the
policy plays objects that no training used.
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

from agents.evaluate.play import controller_of
from agents.evaluate.scenario_batch import ScenarioBatch
from agents.policies import load_policy
from agents.setups import load_setup
from experiments.lab.charts import OTHERS, SERIES
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.study import Cell, Findings, Frames, Measurement, Row, Study

ALGORITHMS = {
    "ppo": "stable_baselines3:PPO", "sac": "stable_baselines3:SAC", "td3": "stable_baselines3:TD3",
    "tqc": "sb3_contrib:TQC", "crossq": "sb3_contrib:CrossQ",
}  # fmt: skip
FIRST = "linear-blind"
SETUPS = {  # set-ups with the arguments of these ids
    FIRST: "ImpactApproach-v0", "rigid-blind": "ImpactApproachRigid-v0",
    "bistable-paper": "ImpactApproachBistable-v0", "linear-ranged": "ImpactApproachRanged-v0",
}  # fmt: skip
MARKS = (10, 20, 30, 60, 120, 180, 300, 600)  # s of processor time, without the time of the evaluations
FIRST_SEED, SCENARIOS, WEIGHT = 41_000_000, 500, 2.0  # test scenarios: first seed, number, time weight (m/s per s)


def trainings(algorithm: str, quick: bool, _: Frames) -> Iterable[Cell]:
    """Yield a cell for each set-up and seed, with the algorithm's settings."""
    import yaml  # type: ignore[import-untyped]  # here, because only this study needs the package

    settings = yaml.safe_load(Path(__file__).with_name(f"{algorithm}.yml").read_text())["default"]
    settings["n_timesteps"] = round(settings["n_timesteps"] * (0.02 if quick else 1.0))
    for setup in SETUPS:
        for seed in range(1 if quick else 10 if setup == FIRST else 2):
            labels = {"algorithm": algorithm, "setup": setup, "seed": seed}
            yield Cell(labels, labels | {"settings": settings})


def cost_of(controller: Any, setup: str) -> float:
    """Return the mean cost in the test scenarios of a set-up, with the charge for missed objects, m/s."""
    scenarios = ScenarioBatch(FIRST_SEED, SCENARIOS, load_setup(setup).task, time_weight=[WEIGHT], threads=1)
    return float(scenarios.play(controller).loss(WEIGHT).mean())


def trained(algorithm: str, setup: str, seed: int, settings: dict[str, Any]) -> list[Row]:
    """Train with settings for rl_zoo3; return the cost at each time in MARKS and at the end."""
    import torch
    from stable_baselines3.common.noise import NormalActionNoise
    from stable_baselines3.common.vec_env import VecNormalize

    from impact_gym.sb3 import ImpactVecEnv

    torch.set_num_threads(1)
    envs: Any = ImpactVecEnv(settings.pop("n_envs"), threads=1, **load_setup(setup).environment)
    envs = VecNormalize(envs, **settings.pop("normalize"))
    steps, rate = settings.pop("n_timesteps"), float(settings.pop("learning_rate").removeprefix("lin_"))
    if settings.pop("noise_type", None):
        mean = np.zeros(envs.action_space.shape or ())
        settings["action_noise"] = NormalActionNoise(mean, mean + settings.pop("noise_std"))
    kind = resolve_name(ALGORITHMS[algorithm])
    model = kind(env=envs, seed=seed, device="cpu", learning_rate=lambda left: left * rate, **settings)
    rows, evaluations, begun = list[Row](), 0.0, time.process_time()

    player = SimpleNamespace(predict=lambda seen, **_: model.predict(envs.normalize_obs(seen), deterministic=True))

    def evaluate(*_: Any, ended: bool = False) -> bool:
        nonlocal evaluations
        paused = time.process_time()
        seconds = paused - begun - evaluations
        if ended or any(mark <= seconds for mark in MARKS[len(rows) :]):
            mark = "end" if ended else f"{MARKS[len(rows)]} s"
            rows.append(
                {"mark": mark, "seconds": seconds, "steps": model.num_timesteps, "cost": cost_of(player, setup)}
            )
            evaluations += time.process_time() - paused
        return True  # the training goes on

    model.learn(steps, callback=evaluate)
    evaluate(ended=True)
    return rows


def other_costs(setup: str) -> list[Row]:
    """Return the costs of the paper's rule, the tuned profile and the shipped policy in a set-up."""
    about = load_setup(setup)
    names = {"rule": "paper-trapezoid", "profile": about.against[0]}
    compared = {name: controller_of({"baseline": baseline}, WEIGHT, about.task) for name, baseline in names.items()}
    compared["policy"] = load_policy(setup)
    return [{name: cost_of(controller, setup) for name, controller in compared.items()}]


def chart(found: pl.DataFrame, costs: Mapping[str, float]) -> Figure:
    """Return a figure of median and range of the cost over time. Horizontal lines are other controllers."""
    figure = Figure(figsize=(8.0, 4.6))
    axes = figure.subplots()
    for algorithm, colour in zip(ALGORITHMS, (SERIES[1], *SERIES[3:], OTHERS), strict=True):
        rows = found.filter(algorithm=algorithm)
        axes.plot(rows["seconds"], rows["median"], "o-", color=colour, label=algorithm.upper(), markersize=4)
        axes.fill_between(rows["seconds"], rows["low"], rows["high"], color=colour, alpha=0.12, linewidth=0.0)
    for (words, cost), style in zip(costs.items(), ("--", "-", ":"), strict=True):
        axes.axhline(cost, color=SERIES[0], linestyle=style, linewidth=1.2, label=words)
    axes.set(xscale="log", xlabel="processor time of the training (s)", ylabel="cost (m/s)", ylim=(0.8, 1.6))
    axes.set_xticks(MARKS, map(str, MARKS))
    axes.legend(fontsize=8, ncols=2)
    return figure


def analyse(frames: Frames, _: bool) -> Findings:
    """Compare the algorithms at each time in MARKS and at the end."""
    frame = pl.concat([frames[algorithm] for algorithm in ALGORITHMS], how="diagonal_relaxed")
    groups, cost = frame.group_by("algorithm", "setup", "mark", maintain_order=True), pl.col("cost")
    found = groups.agg(pl.median("seconds"), median=cost.median(), low=cost.min(), high=cost.max(), count=pl.len())
    found = found.join(frames["others"], "setup").with_columns(id=pl.col("setup").replace(SETUPS))
    columns = {"Algorithm": "{algorithm}", "at": "{mark}", "processor time (s)": "{seconds:.0f}",
               "cost (m/s)": "{median:.3f} [{low:.3f}, {high:.3f}]", "trainings": "{count}"}  # fmt: skip
    here, elsewhere = found.filter(setup=FIRST), found.filter(pl.col("setup") != FIRST, mark="end")
    table = Table.of("Median [least, largest] cost of the trainings at each mark and at the end", here, columns)
    compared = {"paper's rule": "{rule:.3f}", "tuned profile": "{profile:.3f}", "shipped policy": "{policy:.3f}"}
    columns = {"Environment": "{id}"} | {name: columns[name] for name in columns if name != "at"} | compared
    others = Table.of(
        "The end of the training, beside other controllers", elsewhere.sort("setup", maintain_order=True), columns
    )
    best = here.filter(mark="end").sort("median").row(0, named=True)
    costs = dict(zip(compared, (best["rule"], best["profile"], best["policy"]), strict=True))
    answer = (f"{best['algorithm'].upper()} has the lowest median cost at the end of the training, "
              f"{best['median']:.3f} m/s; {', '.join(f'{name}: {value:.3f} m/s' for name, value in costs.items())}."
              )  # fmt: skip
    picture = Picture("stock_agents", chart(here, costs), "cost of each algorithm over the training's processor time")
    return Findings(answer, [Section("Trainings", [picture, table]), Section("Other environments", [others])])


DEPENDS = ("impact_gym", "agents.evaluate", "agents.baselines", "agents.policies", "agents.setups", "agents.tuned")
STUDY = Study(
    "stock",
    "How good is a policy after 1, 3, 10 minutes of training with stable-baselines3?",
    (
        *(Measurement(each, partial(trainings, each), trained, DEPENDS) for each in ALGORITHMS),
        Measurement(
            "others", lambda *_: [Cell({"setup": name}, {"setup": name}) for name in SETUPS], other_costs, DEPENDS
        ),
    ),
    analyse,
    packages=("torch", "stable-baselines3", "sb3-contrib"),
)

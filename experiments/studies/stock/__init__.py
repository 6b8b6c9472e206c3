"""Measure the cost of policies from stable-baselines3 and sb3-contrib over the processor time of their training.

Each algorithm trains ten policies in `ImpactApproach-v0`, and two in each of three other environments. A training uses
`ImpactVecEnv`, one thread of torch, and this folder's settings for rl_zoo3. At each time in MARKS and at the end, the
policy plays objects that no training used.
"""

import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl

from agents.evaluate.scenario_batch import Episodes, ScenarioBatch
from agents.evaluate.specs import controller_of
from agents.policies import load_policy
from agents.setups import load_setup
from experiments.lab.parts import Section, Table
from experiments.lab.study import Cell, Findings, Frames, Measurement, Row, Study
from experiments.studies import QUESTIONS
from impact_gym.envs import IDS
from impact_gym.task import Task

ALGORITHMS = {
    "ppo": "stable_baselines3:PPO", "sac": "stable_baselines3:SAC", "td3": "stable_baselines3:TD3",
    "tqc": "sb3_contrib:TQC", "crossq": "sb3_contrib:CrossQ",
}  # fmt: skip
LABELS = {name: kind.rpartition(":")[2] for name, kind in ALGORITHMS.items()}
FIRST = "linear-blind"
SETUPS = {  # set-ups with the arguments of these ids
    FIRST: "ImpactApproach-v0", "rigid-blind": "ImpactApproachRigid-v0",
    "bistable-paper": "ImpactApproachBistable-v0", "linear-ranged": "ImpactApproachRanged-v0",
}  # fmt: skip
MARKS = (10, 30, 60, 120, 180)  # s of processor time, without the time of the evaluations
COMPARED = ("paper's rule", "tuned profile", "shipped policy")
PLAYED = SETUPS | {"teleop-spring": "ImpactTeleop-v0"}  # also played by controllers that nothing here trains
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


def played(controller: Any, task: Task) -> Episodes:
    """Return the episodes of the test scenarios of a task."""
    return ScenarioBatch(FIRST_SEED, SCENARIOS, task, time_weight=[WEIGHT], threads=1).play(controller)


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
            mark, steps = "end" if ended else f"{MARKS[len(rows)]} s", model.num_timesteps
            cost = float(played(player, load_setup(setup).task).loss(WEIGHT).mean())  # m/s
            rows.append({"mark": mark, "seconds": seconds, "steps": steps, "cost": cost})
            evaluations += time.process_time() - paused
        return True  # the training goes on

    model.learn(steps, callback=evaluate)
    evaluate(ended=True)
    return rows


def scores(setup: str) -> list[Row]:
    """Return the mean return (m/s) and the share of missed objects of four controllers in the environment of an id.

    In teleoperation the operator alone stands for the paper's rule, which steers no arm.
    """
    task, tuned = Task(**IDS[PLAYED[setup]]), load_setup(setup).against[0]
    names = ("random", "operator-alone" if task.operator else "paper-trapezoid", tuned)
    rules = (controller_of({"baseline": name}, WEIGHT, task) for name in names)
    rows = list[Row]()
    for name, controller in zip(("random", *COMPARED), (*rules, load_policy(setup)), strict=True):
        episodes = played(controller, task)
        mean = -float(episodes.loss(WEIGHT).mean())
        rows.append({"controller": name, "return": mean, "missed": float(episodes.missed.mean())})
    return rows


def analyse(frames: Frames, _: bool) -> Findings:
    """Compare the algorithms at each time in MARKS and at the end."""
    frame = pl.concat([frames[algorithm] for algorithm in ALGORITHMS], how="diagonal_relaxed")
    groups, cost = frame.group_by("setup", "algorithm", "mark", maintain_order=True), pl.col("cost")
    found = groups.agg(pl.median("seconds"), median=cost.median(), low=cost.min(), high=cost.max(), count=pl.len())
    ends = {(row["setup"], row["algorithm"]): row for row in found.filter(mark="end").to_dicts()}
    text = {  # without the marks before which some trainings had ended
        (row["setup"], row["algorithm"], row["mark"]): "{median:.3f} [{low:.3f}, {high:.3f}]".format(**row)
        for row in found.to_dicts() if row["count"] == ends[row["setup"], row["algorithm"]]["count"]
    }  # fmt: skip
    first = {name: end for (setup, name), end in ends.items() if setup == FIRST}
    marks = [*(f"{mark} s" for mark in MARKS), "end"]
    score = {(row["setup"], row["controller"]): row for row in frames["scores"].to_dicts()}
    compared = {setup: [-score[setup, name]["return"] for name in COMPARED] for setup in SETUPS}
    caption = (f"Cost V_p + {WEIGHT:g} T in {SETUPS[FIRST]} over the processor time of the training: median [least, "
               "largest] of the trainings; -: some had ended before")  # fmt: skip
    costs = Table.joined(caption, [
        {"algorithm": LABELS[name]} | {f"{mark} (m/s)": text.get((FIRST, name, mark), "-") for mark in marks}
        | {"processor time to the end (s)": f"{end['seconds']:.0f}", "trainings": f"{end['count']}"}
        for name, end in first.items()
    ], "stock-costs")  # fmt: skip
    others = Table.joined("Cost at the end of the trainings, median [least, largest], beside other controllers", [
        {"environment": SETUPS[setup]} | {f"{LABELS[name]} (m/s)": text[setup, name, "end"] for name in first}
        | {f"{name} (m/s)": f"{cost:.3f}" for name, cost in zip(COMPARED, values, strict=True)}
        for setup, values in compared.items()
    ], "stock-others")  # fmt: skip

    def shown(name: str, setup: str) -> str:
        if name in ("ppo", "sac"):
            return f"{-ends[setup, name]['median']:.3f}" if setup in SETUPS else "-"
        return "{return:.3f}, {missed:.1%}".format(**score[setup, name]).replace("%", " %")

    columns = {name: LABELS.get(name, name) for name in ("random", *COMPARED[:2], "ppo", "sac", COMPARED[2])}
    caption = (f"Mean return (m/s) at a time weight of {WEIGHT:g} m/s per s, and missed objects; PPO and SAC: median "
               "of the trainings")  # fmt: skip
    scored = Table.joined(caption, [
        {"environment": environment} | {head: shown(name, setup) for name, head in columns.items()}
        for setup, environment in PLAYED.items()
    ], "stock-scores")  # fmt: skip
    best = min(first, key=lambda name: first[name]["median"])
    beside = ", ".join(f"{name}: {cost:.3f} m/s" for name, cost in zip(COMPARED, compared[FIRST], strict=True))
    answer = (f"{LABELS[best]} has the lowest median cost at the end of the training, {first[best]['median']:.3f} m/s; "
              f"{beside}.")  # fmt: skip
    return Findings(answer, [Section("Trainings", [costs]), Section("All environments", [others, scored])])


DEPENDS = ("impact_gym", "agents.evaluate", "agents.baselines", "agents.policies", "agents.setups", "agents.tuned")
SCORES = Measurement("scores", lambda *_: [Cell({"setup": name}, {"setup": name}) for name in PLAYED], scores, DEPENDS)
TRAININGS = [Measurement(each, partial(trainings, each), trained, DEPENDS) for each in ALGORITHMS]
STUDY = Study("stock", QUESTIONS["stock"], [*TRAININGS, SCORES], analyse, ("torch", "stable-baselines3", "sb3-contrib"))

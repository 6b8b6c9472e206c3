"""`impact-gym study bench`: steps per second beside Gymnasium's environments, what a batch and an approach cost.

The rates of batches by size tell how many environments are enough. A set-up has three rates, beside those of CartPole
and Pendulum in batches of the same size. *environment*: Gymnasium's own benchmark, random actions. *environment with
inference*: the set-up's shipped policy acts, beside them one of stable-baselines3. *training*: all that `agents.train`
does from the first rollout to the end, updates and validation included (`metrics.json` has it too), beside them PPO of
stable-baselines3 on the batch that it makes. Random actions play other episodes than a policy, so the first rate need
not be the highest.
"""

import io
import json
import os
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import asdict, replace
from itertools import cycle
from pathlib import Path
from timeit import repeat
from typing import Any

import gymnasium as gym
import numpy as np
import polars as pl
import torch
from gymnasium.utils.performance import benchmark_vector_step
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from agents import load_policy
from agents.baselines import PaperTrapezoid
from agents.evaluate import VALIDATION_SEED, ScenarioBatch
from agents.evaluate.play import play
from agents.setups import load_setup
from agents.train.ppo import Run, train
from experiments.lab.parts import Section, Table
from experiments.lab.study import Cell, Findings, Frames, Measurement, Row, Study
from impact_gym.envs import IDS
from impact_gym.robot import IMPACT, default_approach
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import Task

ID, SCALE, BATCH_SCALE, BATCH = "ImpactApproach-v0", "Pendulum-v1", "CartPole-v1", 1024
SIZES = (64, 256, 1024, 4096, 16384)  # environments in a batch
LEARN_ENVS = 512  # environments of a training
SETUPS = ("linear-blind", "bistable-blind")
STEPS = 1_000_000  # of training
RTOL = 1e-6  # of the batch: the largest power of ten with an error in V_p below 1e-6 m/s
MIX = 80  # steps before a measurement: episodes have 20 to 75, and slots begin in step
RULE = "paper-trapezoid"
COUNT, SEED = 10_000, 30_000_000  # of the scenarios: only time is measured, so any will do
RTOLS = {"1e-4": 1e-4, "1e-6": 1e-6, "1e-8 (the default)": 1e-8, "1e-10": 1e-10, "1e-12": 1e-12}

Step = Callable[[], Any]


def rate(
    call: Step, steps: int, seconds: float, rounds: int = 3, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the steps per second of `call`, which makes `steps`: the best of `rounds`, together of `seconds`."""
    best = 0.0
    for _ in range(rounds):
        calls, spent, begun = 0, 0.0, clock()
        while spent < seconds / rounds or calls == 0:
            call()
            calls += 1
            spent = clock() - begun
        best = max(best, calls * steps / spent)
    return best


def stepping(env: Any, act: Callable[[Any], Any] | None = None) -> Step:
    """Return a call that steps `env` by `act` of its last return, at random without it; episodes are in all phases."""
    actions = cycle([env.action_space.sample() for _ in range(32)])  # drawn before time is taken
    last = env.reset()

    def step() -> None:
        nonlocal last
        last = env.step(act(last) if act else next(actions))

    for _ in range(MIX):
        step()
    return step


def single(name: str) -> Step:
    """Return a call that steps `gym.make(name)`; a reset is a step of its own, as in Gymnasium's batches."""
    return stepping(gym.wrappers.Autoreset(gym.make(name)))


def batch(name: str, size: int) -> Step:
    """Return a call that steps the native batch of `gym.make_vec(name)`."""
    return stepping(gym.make_vec(name, num_envs=size, vectorization_mode="vector_entry_point"))


def stepped(quick: bool) -> pl.DataFrame:
    """Return step rates beside Gymnasium's, the best of some rounds in which the environments take turns."""
    batched, rule = gym.make_vec(ID, num_envs=BATCH, rtol=RTOL), PaperTrapezoid()
    of_library = ImpactVecEnv(LEARN_ENVS)
    alike = np.tile(of_library.action_space.sample(), (LEARN_ENVS, 1))  # the same action everywhere
    steps = [
        (f"{ID}, the paper's rule", BATCH, stepping(batched, lambda last: rule.predict(last[0])[0])),
        (BATCH_SCALE, BATCH, batch(BATCH_SCALE, BATCH)),
        (ID, 1, single(ID)),
        (SCALE, 1, single(SCALE)),
        ("ImpactVecEnv", LEARN_ENVS, stepping(of_library, lambda _: alike)),
        *((ID, size, batch(ID, size)) for size in (SIZES[::2] if quick else SIZES)),
    ]
    rounds, seconds = (1, 0.03) if quick else (5, 0.5)
    rates = np.max([[rate(step, envs, seconds, rounds=1) for _, envs, step in steps] for _ in range(rounds)], axis=0)
    rows = [(name, envs, best) for (name, envs, _), best in zip(steps, rates, strict=True)]
    table = pl.DataFrame(rows, ["environment", "in a batch", "steps per second"], orient="row")
    ratio = pl.col("steps per second").first().over("in a batch") / pl.col("steps per second")
    return table.with_columns(ratio.alias("ours over it"))


def weighed() -> list[Row]:
    """Return the largest error in V_p of a batch at RTOL, and its memory."""
    played = (ScenarioBatch(VALIDATION_SEED, BATCH, Task(rtol=rtol)).play(PaperTrapezoid()) for rtol in (1e-12, RTOL))
    exact, rough = (episodes.object_velocity for episodes in played)
    envs: Any = gym.make_vec(ID, num_envs=BATCH).unwrapped
    envs.reset(seed=0)
    held = sum(array.nbytes for array in vars(envs.batch).values() if isinstance(array, np.ndarray))
    actions, skip = np.zeros((BATCH, 2)), np.zeros(BATCH, np.bool_)
    envs.batch.step(actions, skip)
    tracemalloc.start()
    envs.batch.step(actions, skip)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return [{
        "rtol": RTOL,
        "largest error in V_p, µm/s": 1e6 * float(np.abs(rough - exact).max()),
        "bytes held for a row": held / BATCH,
        "bytes allocated for it in a step": peak / BATCH,
    }]  # fmt: skip


def rates(envs: Sequence[Any], act: Callable[[Any], Any], quick: bool) -> dict[str, Any]:
    """Return the rates of two batches without training, one for random actions, one that `act` steps."""
    count, seconds = envs[0].num_envs, 0.1 if quick else 3.0
    random: Any = benchmark_vector_step(envs[0], seconds, seed=0)  # type: ignore[arg-type]  # parts of a second, too
    inference = rate(stepping(envs[1], act), count, seconds)
    return {"environments": count, "environment": random, "environment with inference": inference}


def of_setup(name: str, quick: bool) -> list[Row]:
    """Return the three rates of a set-up, with as many environments side by side as its training has."""
    steps, threads = (STEPS // 100, {1}) if quick else (STEPS, {1, len(os.sched_getaffinity(0))})
    setup, policy = load_setup(name), load_policy(name)
    envs = [setup.make_vec(setup.training.envs) for _ in range(2)]
    row = rates(envs, lambda last: policy.predict(last[0])[0], quick)
    for number in sorted(threads):
        asked = Run(setup, replace(setup.training, steps=steps, threads=number))
        with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
            metrics = json.loads((train(asked, Path(folder) / "run") / "metrics.json").read_text())
        row[f"training, torch threads: {number}"] = metrics["steps_per_second"]
    torch.set_num_threads(1)
    return [row]


def of_neighbour(name: str, quick: bool) -> list[Row]:
    """Return the three rates of one of Gymnasium's environments, in a batch as large as that of the first set-up."""
    count, mode = load_setup(SETUPS[0]).training.envs, "vector_entry_point"
    mode = "sync" if gym.spec(name).vector_entry_point is None else mode
    learner = PPO("MlpPolicy", make_vec_env(name, count), n_steps=32, batch_size=4096, n_epochs=4, device="cpu")
    envs = [gym.make_vec(name, count, mode) for _ in range(2)]
    row = rates(envs, lambda last: learner.predict(last[0], deterministic=True)[0], quick)
    begun = time.perf_counter()
    learner.learn(2 * count if quick else STEPS // 2)
    return [row | {"training, torch threads: 1": learner.num_timesteps / (time.perf_counter() - begun)}]


def three_rates(name: str, quick: bool) -> list[Row]:
    """Return the three rates of a set-up, or of one of Gymnasium's environments."""
    return (of_setup if name in SETUPS else of_neighbour)(name, quick)


def approached(environment: dict[str, Any], quick: bool) -> list[Row]:
    """Return the processor time of an approach of the paper's rule on one core, the best of some rounds."""
    rounds, count = (1, 500) if quick else (3, COUNT)
    scenarios = {"ranges": "test", "seed": SEED, "count": count}

    def call() -> Any:
        return play({"baseline": RULE}, scenarios, environment=environment)

    return [{"microseconds": 1e6 * min(repeat(call, timer=time.process_time, repeat=rounds, number=1)) / count}]


def cases() -> dict[str, dict[str, dict[str, Any]]]:
    """Return arguments of the environment by what is varied and by case."""
    robot = default_approach().at(IMPACT)
    spring, bistable = IDS["ImpactApproach-v0"], IDS["ImpactApproachBistable-v0"]
    return {
        "coupling": {
            "rigid": IDS["ImpactApproachRigid-v0"],
            "spring and damper (the default)": spring,
            "bistable, the paper's": bistable,
            "bistable, for slow touches": dict(load_setup("bistable-blind").environment),
        },
        "robot, with the default coupling": {
            "rigid (the default)": spring,
            "one mass on a spring": {"robot": {"type": "Robot", **asdict(robot)}},
        },
        "rtol, with the default coupling": {name: {"rtol": rtol} for name, rtol in RTOLS.items()},
        "rtol, with the paper's bistable coupling": {name: {"rtol": rtol, **bistable} for name, rtol in RTOLS.items()},
    }


def cells_of_cost(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield every case."""
    for by, varied in cases().items():
        for case, environment in varied.items():
            yield Cell({"by": by, "case": case}, {"environment": environment, "quick": quick})


def cells_of_rates(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield set-ups and their neighbours."""
    for name in (*SETUPS, BATCH_SCALE, SCALE):
        yield Cell({"set-up": name}, {"name": name, "quick": quick})


def words(value: Any) -> str:
    """Return a cell of a table, numbers to three digits; nothing for None."""
    if isinstance(value, float):
        return f"{float(f'{value:.3g}'):,.15g}"
    return "" if value is None else f"{value:,}" if isinstance(value, int) else str(value)


def table(caption: str, frame: pl.DataFrame) -> Table:
    """Return a frame as a table of a page."""
    return Table(caption, frame.columns, [[words(value) for value in row] for row in frame.iter_rows()])


def with_ratio(costs: pl.DataFrame) -> pl.DataFrame:
    """Return the costs of cases that vary one thing, each over that of the default."""
    default = pl.col("microseconds").filter(pl.col("case").str.ends_with("(the default)")).first()
    return costs.select("case", "microseconds", ratio=pl.col("microseconds") / default)


def analyse(frames: Frames, quick: bool) -> Findings:
    """Show what was measured."""
    sections, answer = [], "Step rates and costs, see below."
    if "environments" in frames:
        steps = frames["environments"]
        best = steps.filter(pl.col("environment") == ID).sort("steps per second").row(-1, named=True)
        answer = (
            f"{words(best['steps per second'] / 1e6)} million steps per second in a batch of {best['in a batch']:,} "
            f"with random actions. A single environment steps "
            f"{words(steps.filter(environment=SCALE)['ours over it'].item())} times as fast as {SCALE}."
        )
        sections.append(Section("Environments", [table("Steps per second", steps)]))
    if "batch" in frames:
        sections.append(Section("The batch", [table(f"{BATCH:,} environments", frames["batch"])]))
    if "rates" in frames:
        what = (
            "Environment: random actions. With inference: a policy acts. Training: from the first rollout to the end."
        )
        sections.append(Section("The three rates", [table("Steps per second", frames["rates"]), what]))
    if "cost" in frames:
        groups = frames["cost"].partition_by("by", as_dict=True).items()
        tables = [table(f"By {by}", with_ratio(costs)) for (by,), costs in groups]
        sections.append(Section(f"What an approach of {RULE} costs", [*tables, "Processor time on one core."]))
    return Findings(answer, sections)


STUDY = Study(
    name="bench",
    question="How many steps per second, and what does an approach cost?",
    measurements=(
        # one after the other in this process, whose threads are not limited to one
        Measurement(
            "environments", lambda quick, _: [Cell({}, {"quick": quick})], stepped, ("impact_gym",), processes=0
        ),
        Measurement("batch", lambda *_: [Cell({}, {})], weighed, ("impact_gym", "agents"), processes=0),
        Measurement("rates", cells_of_rates, three_rates, ("impact_gym", "agents"), processes=0),
        Measurement("cost", cells_of_cost, approached, ("impact_gym", "agents"), processes=0),
    ),
    analyse=analyse,
    packages=("gymnasium", "torch", "stable-baselines3"),
)

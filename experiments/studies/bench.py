"""`impact-gym study bench`: steps per second of our environments and of environments of Gymnasium."""

import io
import json
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import polars as pl
from gymnasium.utils.performance import benchmark_vector_step

from agents import load_policy
from agents.baselines import PaperTrapezoid
from agents.setups import load_setup
from agents.train.ppo import Run, train
from experiments.lab.parts import Section, Table
from experiments.lab.study import Cell, Findings, Frames, Measurement, Row, Study

ID, SCALE, BATCH_SCALE, BATCH = "ImpactApproach-v0", "Pendulum-v1", "CartPole-v1", 1024
SIZES = (64, 256, 1024, 4096, 16384)  # numbers of environments in a batch
SETUPS = ("linear-blind", "bistable-blind")
STEPS = 1_000_000  # number of environment steps of a training
RTOL = 1e-6  # `rtol` for the paper's rule: the largest power of ten with an error of V_p below 1e-6 m/s
MIX = 80  # number of steps before a measurement, so that episodes of 20 to 75 steps do not begin together
Step = Callable[[], Any]


def rate(call: Step, steps: int, seconds: float, clock: Callable[[], float] = time.perf_counter) -> float:
    """Repeat `call`, which makes `steps` steps, for `seconds` (at least once); return the steps per second."""
    calls, spent, begun = 0, 0.0, clock()
    while spent < seconds or calls == 0:
        call()
        calls += 1
        spent = clock() - begun
    return calls * steps / spent


def stepping(env: Any, act: Callable[[Any], Any] | None = None) -> Step:
    """Return a function that steps `env`. `act` chooses actions from the last step's result; None: random actions."""
    actions = cycle([env.action_space.sample() for _ in range(32)])  # drawn before the timing
    last = env.reset()

    def step() -> None:
        nonlocal last
        last = env.step(act(last) if act else next(actions))

    for _ in range(MIX):
        step()
    return step


def stepped(quick: bool) -> pl.DataFrame:
    """Return step rates of our and Gymnasium's environments; each rate is the highest of several measurements."""
    batched, rule = gym.make_vec(ID, num_envs=BATCH, rtol=RTOL), PaperTrapezoid()
    steps = [
        (f"{ID}, the paper's rule", BATCH, stepping(batched, lambda last: rule.predict(last[0])[0])),
        *((name, 1, stepping(gym.wrappers.Autoreset(gym.make(name)))) for name in (ID, SCALE)),
    ]
    for name, size in [(BATCH_SCALE, BATCH), *((ID, size) for size in (SIZES[::2] if quick else SIZES))]:
        steps.append((name, size, stepping(gym.make_vec(name, size, vectorization_mode="vector_entry_point"))))
    rounds, seconds = (1, 0.03) if quick else (5, 0.5)
    rates = np.max([[rate(step, envs, seconds) for _, envs, step in steps] for _ in range(rounds)], axis=0)
    rows = [(name, envs, best) for (name, envs, _), best in zip(steps, rates, strict=True)]
    table = pl.DataFrame(rows, ["environment", "in a batch", "steps per second"], orient="row")
    ratio = pl.col("steps per second").first().over("in a batch") / pl.col("steps per second")
    return table.with_columns(ratio.alias("ours over it"))


def three_rates(name: str, quick: bool) -> list[Row]:
    """Return three step rates of a set-up: of the environment, of the environment with inference, of the training."""
    setup, policy, seconds = load_setup(name), load_policy(name), 0.1 if quick else 3.0
    count = setup.training.envs
    envs: list[Any] = [setup.make_vec(count) for _ in range(2)]
    row: dict[str, Any] = {"environments": count}
    row["environment"] = benchmark_vector_step(envs[0], seconds, seed=0)  # type: ignore[arg-type]  # a fraction of a second works
    acting = stepping(envs[1], lambda last: policy.predict(last[0])[0])
    row["environment with inference"] = max(rate(acting, count, seconds / 3) for _ in range(3))
    run = Run(setup, replace(setup.training, steps=STEPS // 100 if quick else STEPS, threads=1))
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        metrics = json.loads((train(run, Path(folder) / "run") / "metrics.json").read_text())
    row["training"] = metrics["steps_per_second"]
    return [row]


def words(value: Any) -> str:
    """Return a value as text for a table: floats with three significant digits, an empty text for None."""
    if isinstance(value, float):
        return f"{float(f'{value:.3g}'):,.15g}"
    return "" if value is None else f"{value:,}" if isinstance(value, int) else str(value)


def table(caption: str, frame: pl.DataFrame) -> Table:
    """Return a frame as a table of a page."""
    return Table(caption, frame.columns, [[words(value) for value in row] for row in frame.iter_rows()])


def analyse(frames: Frames, quick: bool) -> Findings:
    """Return the tables, and in words the highest rate."""
    sections, answer = [], "Step rates, see below."
    if "environments" in frames:
        steps = frames["environments"]
        best = steps.filter(pl.col("environment") == ID).sort("steps per second").row(-1, named=True)
        answer = (
            f"{words(best['steps per second'] / 1e6)} million steps per second in a batch of {best['in a batch']:,} "
            f"with random actions. A single environment steps "
            f"{words(steps.filter(environment=SCALE)['ours over it'].item())} times as fast as {SCALE}."
        )
        sections.append(Section("Environments", [table("Steps per second", steps)]))
    if "rates" in frames:
        what = (
            "Environment: random actions. With inference: a policy acts. Training: from the first rollout to the end."
        )
        sections.append(Section("The three rates", [table("Steps per second", frames["rates"]), what]))
    return Findings(answer, sections)


STUDY = Study(
    name="bench",
    question="How many steps per second do the environments make?",
    measurements=(
        # processes=0, because other processes are limited to one thread
        Measurement(
            "environments", lambda quick, _: [Cell({}, {"quick": quick})], stepped, ("impact_gym", "agents.baselines"),
            processes=0,
        ),
        Measurement(
            "rates", lambda quick, _: [Cell({"set-up": name}, {"name": name, "quick": quick}) for name in SETUPS],
            three_rates, ("impact_gym", "agents"), processes=0,
        ),
    ),
    analyse=analyse,
    packages=("gymnasium", "torch", "stable-baselines3"),
)  # fmt: skip

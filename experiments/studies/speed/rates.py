"""Time of an approach by coupling, robot and tolerance; steps per second of environments and trainings."""

import io
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import polars as pl

import impact_gym as ig
from agents import load_policy
from agents.baselines import PaperTrapezoid
from agents.setups import load_setup
from agents.train.__main__ import TrainOptions
from agents.train.__main__ import run as train
from experiments.lab.parts import Section, Table
from experiments.lab.scenes import BISTABLE, LINEAR, MOTION, scene
from experiments.lab.study import Row
from impact_gym.robot import IMPACT, default_approach
from impact_gym.task import evaluation_sets

SCENES, ROUNDS = 500, 40  # number of scenes whose approaches are timed, and how many times
ID, SCALE, BATCH_SCALE = "ImpactApproach-v0", "Pendulum-v1", "CartPole-v1"
SIZES, BATCH = (64, 1024, 16384), 1024  # numbers of environments in a batch
SETUPS, STEPS = ("linear-blind", "bistable-blind"), 1_000_000  # set-ups of the trainings; steps of each
RTOL = 1e-6  # `rtol` for the paper's rule: the largest power of ten with an error of V_p below 1e-6 m/s
MIX = 80  # number of steps before a measurement, so that episodes of 20 to 75 steps do not begin together
Step = Callable[[], Any]


def cases() -> dict[str, dict[str, Any]]:
    """Return for each case what differs from the default: coupling, robot or rtol."""
    arm = default_approach()
    return {
        "spring and damper, rigid robot, rtol 1e-8": {},
        "rigid coupling": {"coupling": ig.Rigid()},
        "bistable coupling, the paper's": {"coupling": BISTABLE},
        "bistable coupling for slow touches": {"coupling": load_setup("bistable-blind").task.coupling},
        "robot: one mass on a spring": {"robot": arm.at(IMPACT)},
        "robot: table along the path": {"robot": arm.robot_table()},
        "rtol 1e-12": {"rtol": 1e-12},
    }


def cost(quick: bool) -> list[Row]:
    """Return the time (µs) of `simulate` in each case: for each scene the least of ROUNDS, mean over SCENES."""
    count, rounds = (SCENES // 10, 2) if quick else (SCENES, ROUNDS)
    drawn, chosen = evaluation_sets.load("test").scenario, cases()
    columns = (drawn[name][:count] for name in ("contact_stiffness", "restitution", "object_mass", "distance"))
    numbers = list(zip(*columns, strict=True))
    times = np.full((len(chosen), count), np.inf)
    for _ in range(rounds):
        for least, case in zip(times, chosen.values(), strict=True):
            coupling, robot, rtol = case.get("coupling", LINEAR), case.get("robot"), case.get("rtol", 1e-8)
            for k, (k_c, e, m_p, distance) in enumerate(numbers):
                approach = scene(k_c, e, coupling, robot, object_mass=m_p, distance=distance)
                begun = time.perf_counter()
                ig.simulate(approach, MOTION, rtol=rtol)
                least[k] = min(least[k], time.perf_counter() - begun)
    return [{"case": case, "microseconds": 1e6 * least.mean()} for case, least in zip(chosen, times, strict=True)]


def rate(call: Step, steps: int, seconds: float, clock: Callable[[], float] = time.process_time) -> float:
    """Repeat `call`, which makes `steps` steps, for `seconds` of `clock` (at least once); return steps per second."""
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


def stepped(quick: bool) -> list[Row]:
    """Return step rates of our and Gymnasium's environments; each rate is the highest of several measurements."""
    batched, rule = gym.make_vec(ID, num_envs=BATCH, rtol=RTOL, threads=1), PaperTrapezoid()
    steps = [(name, 1, stepping(gym.wrappers.Autoreset(gym.make(name)))) for name in (ID, SCALE)]
    one: Any = {"threads": 1}
    for name, size, options in [*((ID, size, one) for size in SIZES), (BATCH_SCALE, BATCH, {})]:
        env = gym.make_vec(name, size, vectorization_mode="vector_entry_point", **options)
        steps.append((name, size, stepping(env)))
    steps.append((f"{ID}, rtol 1e-6, paper's rule", BATCH, stepping(batched, lambda last: rule.predict(last[0])[0])))
    rounds, seconds = (1, 0.03) if quick else (20, 0.1)
    found = np.max([[rate(step, envs, seconds) for _, envs, step in steps] for _ in range(rounds)], axis=0)
    ours = {size: best for (name, size, _), best in zip(steps, found, strict=True) if name == ID}
    return [{"environment": f"{name}, {f'batch of {size:,}' if size > 1 else 'single'}", "rate": best,
             "ratio": best / ours[size]} for (name, size, _), best in zip(steps, found, strict=True)]  # fmt: skip


def three_rates(name: str, quick: bool) -> list[Row]:
    """Return three step rates of a set-up: of the environment, of the environment with inference, of the training."""
    setup, policy = load_setup(name), load_policy(name)
    count, steps, rounds = setup.training.envs, *((STEPS // 100, 1) if quick else (STEPS, 20))
    acts = {"random": None, "inference": lambda last: policy.predict(last[0])[0]}
    steps_of = {what: stepping(setup.make_vec(count, threads=1), act) for what, act in acts.items()}
    rates = {what: max(rate(step, count, 0.1) for _ in range(rounds)) for what, step in steps_of.items()}
    training = replace(setup.training, steps=steps, threads=1, simulation_threads=1)
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(io.StringIO()):
        rates["training"] = rate(partial(train, TrainOptions(name, training, out=Path(folder) / "run")), steps, 0.0)
    return [{"batch": count, **rates}]


TABLES = {  # for each table its heading, its caption, and the heads of its columns
    "cost": (
        "By coupling, robot and tolerance", "Time of an approach of the paper's rule (a call of simulate on one core), "
        "mean over random objects; rows below the first differ from it in what they name", ("case", "time (µs)"),
    ),
    "environments": (
        "Environments", "Steps per second of processor time (one core), with random actions if no rule is named",
        ("environment", "steps per second", f"ratio to {ID} in a batch of this size"),
    ),
    "rates": (
        "Set-ups", "Steps per second of processor time (one core): environments with random actions, with the shipped "
        "policy, and a training",
        ("set-up", "environments", *(f"{what} (steps per second)" for what in ("random", "policy", "training"))),
    ),
}  # fmt: skip


def about(name: str, frame: pl.DataFrame) -> tuple[str, list[Section]]:
    """Return answer and sections of a table in TABLES: each row is a name and numbers."""
    heading, caption, head = TABLES[name]
    rows = [[row, *(f"{float(f'{each:.3g}'):,.15g}" for each in numbers)] for row, *numbers in frame.iter_rows()]
    answer = f"{rows[0][0]}: {', '.join(map(' '.join, zip(head[1:], rows[0][1:], strict=True)))}."
    return answer, [Section(heading, [Table(caption, head, rows, f"speed-{name}")])]

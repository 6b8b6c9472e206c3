"""What this machine makes of the environment, and what to do about it: `python -m impact_gym.doctor`."""

import argparse
import importlib
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym

from impact_gym import __version__

ID, SCALE, BATCH_SCALE = "ImpactApproach-v0", "Pendulum-v1", "CartPole-v1"
LEARNING = ("torch", "stable-baselines3")
PACKAGES = ("numpy", "scipy", "gymnasium", *LEARNING, "pygame", "mujoco")
THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
SIZES, QUICK_SIZES = (64, 256, 1024, 4096, 16384), (64, 1024)  # environments in a batch
LEARN_ENVS, ROLLOUT = 512, 64  # environments of PPO, and steps of each between two updates, as in `agents.train`
MIX = 80  # steps before a measurement: episodes have 20 to 75, and slots begin in step
NEAR_BEST = 0.9  # share of the best rate that is good enough
LITTLE_MEMORY = 2.0  # GiB, torch and a rollout want about one
FRESH = f"""
import time
begun = time.perf_counter()
import gymnasium, impact_gym
imported = time.perf_counter()
env = gymnasium.make("{ID}")
env.reset(seed=0)
env.step(env.action_space.sample())
print(imported - begun, time.perf_counter() - imported)
"""


class Rate(NamedTuple):
    """What one front end does."""

    name: str
    envs: int  # in its batch, 1 without one
    steps: float  # environment steps a second


def installed(name: str) -> str | None:
    """Return the version of a package, None if it is not there or cannot be imported."""
    with suppress(PackageNotFoundError):  # any folder of that name can be imported
        return version(name) if find_spec(name.replace("-", "_")) else None
    return None


def group_limit(file: Path = Path("/sys/fs/cgroup/cpu.max")) -> float:
    """Return how many cores the control group may use, inf without a limit; containers often have one."""
    with suppress(OSError, ValueError):
        quota, period = map(float, file.read_text().split())
        return quota / period
    return float("inf")


def free_memory(file: Path = Path("/proc/meminfo")) -> float:
    """Return the memory available, GiB; nan where it is not said."""
    with suppress(OSError, KeyError, ValueError):
        entries = dict(line.split(":") for line in file.read_text().splitlines())
        return float(entries["MemAvailable"].split()[0]) / 2**20
    return float("nan")


def first_start() -> tuple[float, float]:
    """Return how long a fresh process imports, and then takes to `make`, `reset` and step once, s.

    Raises:
        RuntimeError: it fails; says what it said.
    """
    done = subprocess.run([sys.executable, "-c", FRESH], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"a fresh process cannot make {ID}:\n{done.stderr}")
    importing, making = map(float, done.stdout.split()[-2:])
    return importing, making


def rate(call: Callable[[], Any], steps: int, seconds: float, rounds: int = 3) -> float:
    """Return the steps per second of `call`, which makes `steps`: the best of `rounds`, together of `seconds`."""
    best = 0.0
    for _ in range(rounds):
        calls, spent, begun = 0, 0.0, time.perf_counter()
        while spent < seconds / rounds or calls == 0:
            call()
            calls += 1
            spent = time.perf_counter() - begun
        best = max(best, calls * steps / spent)
    return best


def stepping(env: Any, act: Callable[[Any], Any]) -> Callable[[], None]:
    """Return a call that steps `env` by `act` of what it returned last; by now its episodes are in all phases."""
    last = env.reset()

    def step() -> None:
        nonlocal last
        last = env.step(act(last))

    for _ in range(MIX):
        step()
    return step


def at_random(space: gym.Space[Any]) -> Callable[[Any], Any]:
    """Return what answers anything with the next of some actions, drawn before time is taken."""
    actions = cycle([space.sample() for _ in range(32)])
    return lambda _: next(actions)


def single(name: str) -> Callable[[], None]:
    """Return a call that steps `gym.make(name)`; a reset is a step of its own, as in Gymnasium's batches."""
    env: Any = gym.wrappers.Autoreset(gym.make(name))
    return stepping(env, at_random(env.action_space))


def batch(name: str, num_envs: int) -> Callable[[], None]:
    """Return a call that steps the native batch of `gym.make_vec(name)`."""
    envs = gym.make_vec(name, num_envs=num_envs, vectorization_mode="vector_entry_point")
    return stepping(envs, at_random(envs.action_space))


def stable_baselines3(num_envs: int) -> Callable[[], None]:
    """Return a call that steps `ImpactVecEnv`."""
    from impact_gym.envs.sb3 import ImpactVecEnv

    envs = ImpactVecEnv(num_envs)
    return stepping(envs, at_random(gym.vector.utils.batch_space(envs.action_space, num_envs)))


def ppo(num_envs: int, threads: int) -> Callable[[], Any]:
    """Return a call that plays a rollout and learns from it with a net of 64x64; torch stays on `threads`."""
    import torch
    from stable_baselines3 import PPO

    from impact_gym.envs.sb3 import ImpactVecEnv

    torch.set_num_threads(threads)
    envs, rollout = ImpactVecEnv(num_envs), num_envs * ROLLOUT
    size = min(2048, rollout)
    model = PPO("MlpPolicy", envs, n_steps=ROLLOUT, batch_size=size, n_epochs=3, gamma=1.0, seed=0, device="cpu")
    model.learn(rollout)
    return partial(model.learn, rollout, reset_num_timesteps=False)


def warnings(*, cores: int, usable: float, memory: float, load: float, debug: bool) -> list[str]:
    """Return what is wrong with a machine's cores, those usable by this process, free memory (GiB), load, or Python."""
    wrong = {
        "Python is a debug build: the rates are too low.": debug,
        f"{memory:.1f} GiB of memory are free; training wants {LITTLE_MEMORY:g} GiB.": memory < LITTLE_MEMORY,
        f"others keep this machine busy (load {load:.1f} on {usable:g} cores): the rates are lower than it could make, "
        "and vary.": load > 0.5 * usable,
        f"this process may use {usable:g} of {cores} cores; batches start a thread per core: pass "
        f"threads={max(1, int(usable))} to make_vec and to ImpactVecEnv.": usable < cores,
    }
    return [text for text, holds in wrong.items() if holds]


def advice(batches: Sequence[Rate], stable: Rate | None, learners: Mapping[int, Rate]) -> list[str]:
    """Return what follows from the rates of `make_vec`, of `ImpactVecEnv`, and of PPO by its threads of torch."""
    best = max(one.steps for one in batches)
    envs = min(one.envs for one in batches if one.steps >= NEAR_BEST * best)
    told = [
        f"{envs:,} environments are enough: the smallest batch measured within 10 % of the best rate. Take as "
        "many where stepping is all, as in an evaluation. PPO plays n_steps of each between two updates; with 32, "
        f"about an episode, its rollout would be {32 * envs:,} samples."
    ]
    if len(learners) > 1:
        threads = max(learners, key=lambda count: learners[count].steps)
        rates = ", ".join(f"{one.steps:,.0f} steps/s with {count}" for count, one in learners.items())
        told.append(f"torch.set_num_threads({threads}) is the faster here for a 64x64 net: {rates}.")
    if stable:
        share = max(one.steps for one in learners.values()) / stable.steps
        told.append(
            f"of PPO's time {share:.0%} goes into stepping {stable.envs:,} environments, the rest into the net: "
            "a faster batch gains no more than that, so let learning decide on their number."
        )
    return told


def show(title: str, lines: Iterable[str]) -> None:
    """Print a part of the findings."""
    print("\n  ".join([title, *lines]) + "\n")


def progress(text: str) -> None:
    """Say on stderr what takes time, so that stdout holds the findings alone."""
    print(f"  {text} ...", file=sys.stderr, flush=True)


def examine_rates(seconds: float, sizes: Sequence[int], learn_envs: int, learn_threads: Sequence[int]) -> list[str]:
    """Measure and print the rates; return advice. Without `learn_threads` of torch the extra `train` is not needed."""

    def timed(name: str, envs: int, call: Callable[[], Callable[[], Any]], steps: int = 1, rounds: int = 3) -> Rate:
        progress(f"{name}, {envs:,}")
        return Rate(name, envs, rate(call(), steps * envs, seconds, rounds))

    one, scale = (timed(f"gym.make({name!r})", 1, partial(single, name)) for name in (ID, SCALE))
    batches = [timed(f"gym.make_vec({ID!r})", size, partial(batch, ID, size)) for size in sizes]
    batch_scale = timed(f"gym.make_vec({BATCH_SCALE!r})", 1024, partial(batch, BATCH_SCALE, 1024))
    stable = timed("ImpactVecEnv", learn_envs, partial(stable_baselines3, learn_envs)) if learn_threads else None
    learners = {}
    for threads in learn_threads:
        name = f"PPO on ImpactVecEnv, {threads} torch thread{'s' * (threads > 1)}"
        learners[threads] = timed(name, learn_envs, partial(ppo, learn_envs, threads), ROLLOUT, 1)
    found = [one, *batches, *([stable] if stable else []), *learners.values(), scale, batch_scale]
    rows = [f"{name:<37}{envs:>7,}{steps:>13,.0f}" for name, envs, steps in found]
    show("environments, steps per second (random actions, resets included)", rows)
    print(f"  one environment steps {one.steps / scale.steps:.2f} times as fast as {SCALE}\n")
    return advice(batches, stable, learners)


def examine(seconds: float, sizes: Sequence[int], learn_envs: int) -> None:
    """Measure and print, as it goes."""
    versions = {"python": platform.python_version(), "impact-gym": __version__}
    versions |= {name: installed(name) or "not installed" for name in PACKAGES}
    show("versions", [f"{name:<19}{found}" for name, found in versions.items()])
    missing = [name for name in LEARNING if versions[name] == "not installed"]
    cores, memory, load = os.cpu_count() or 1, free_memory(), os.getloadavg()[0]
    usable = min(len(os.sched_getaffinity(0)), group_limit(), cores)
    machine = {
        "platform": f"{platform.system()} {platform.machine()}",
        "cores, usable by this process": f"{cores}, {usable:g}",
        "load, memory free": f"{load:.2f}, {memory:.1f} GiB",
        "threads of a batch": f"{cores} (argument threads; small batches use fewer)",
    }
    if "torch" not in missing:
        machine["threads of torch"] = str(importlib.import_module("torch").get_num_threads())
    machine |= {name: os.environ.get(name, "not set") for name in THREAD_VARIABLES}
    show("machine", [f"{name:<31}{fact}" for name, fact in machine.items()])
    progress("starting a fresh process")
    importing, making = first_start()
    show("a fresh process", [f"import              {importing:.2f} s", f"make to first step  {making:.2f} s"])
    told = examine_rates(seconds, sizes, learn_envs, [] if missing else sorted({1, max(1, int(usable))}))
    if missing:
        unmeasured = "ImpactVecEnv and PPO not measured. pip install 'impact-gym[train]'"
        told.append(f"{' and '.join(missing)} missing: {unmeasured}")
    wrong = warnings(cores=cores, usable=usable, memory=memory, load=load, debug=hasattr(sys, "gettotalrefcount"))
    for title, texts in {"warnings": wrong, "advice": told}.items():
        show(title, [f"- {text}" for text in texts or ["none"]])


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, examine, print."""
    parser = argparse.ArgumentParser(prog="python -m impact_gym.doctor", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="measure so briefly that the rates mean little")
    quick = parser.parse_args(arguments).quick
    try:
        examine(*((0.03, QUICK_SIZES, 16) if quick else (1.0, SIZES, LEARN_ENVS)))
    except RuntimeError as error:
        sys.exit(f"impact_gym.doctor: {error}")


if __name__ == "__main__":
    main()

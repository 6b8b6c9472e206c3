"""What this machine makes of the environment, and what to do about it: `python -m impact_gym.doctor`."""

import argparse
import importlib.util
import os
import platform
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import impact_gym
from impact_gym.envs import doctor as measure
from impact_gym.envs.doctor import LEARN_ENVS, Rate

PACKAGES = ("numpy", "scipy", "gymnasium")
EXTRAS = ("torch", "stable-baselines3", "sb3-contrib", "pygame", "mujoco")
THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
SIZES = (64, 256, 1024, 4096, 16384)  # environments in a batch
QUICK_SIZES = (64, 1024)
NEAR_BEST = 0.9  # share of the best rate that is good enough
LITTLE_MEMORY = 2.0  # GiB, torch and a rollout want about one


@dataclass(frozen=True)
class Machine:
    """What it runs on."""

    cores: int
    usable: float  # cores that this process may use: affinity and the limit of its control group
    memory: float  # GiB free
    load: float  # mean number of processes that wanted a core in the last minute
    debug: bool  # Python was built for debugging
    packages: frozenset[str]  # extras that are there

    @classmethod
    def here(cls) -> "Machine":
        """Return what this process runs on."""
        cores = os.cpu_count() or 1
        return cls(
            cores=cores,
            usable=min(len(os.sched_getaffinity(0)), group_limit(), cores),
            memory=free_memory(),
            load=os.getloadavg()[0],
            debug=hasattr(sys, "gettotalrefcount"),
            packages=frozenset(name for name in EXTRAS if installed(name)),
        )


def installed(name: str) -> str | None:
    """Return the version of a package, None if it is not there or cannot be imported."""
    try:
        if importlib.util.find_spec(name.replace("-", "_")) is None:
            return None
        return version(name)
    except (PackageNotFoundError, ValueError):  # ValueError: barred in sys.modules
        return None


def group_limit(file: Path = Path("/sys/fs/cgroup/cpu.max")) -> float:
    """Return how many cores the control group may use, inf without a limit; containers often have one."""
    try:
        quota, period = file.read_text().split()
        return float("inf") if quota == "max" else float(quota) / float(period)
    except (OSError, ValueError):
        return float("inf")


def free_memory(file: Path = Path("/proc/meminfo")) -> float:
    """Return the memory available, GiB; nan where it is not said."""
    try:
        entries = dict(line.split(":") for line in file.read_text().splitlines())
        return float(entries["MemAvailable"].split()[0]) / 2**20
    except (OSError, KeyError, ValueError):
        return float("nan")


def enough(batches: Sequence[Rate]) -> Rate:
    """Return the smallest batch whose rate is within 10 % of the best."""
    best = max(one.steps for one in batches)
    return min((one for one in batches if one.steps >= NEAR_BEST * best), key=lambda one: one.envs)


def warnings(machine: Machine) -> list[str]:
    """Return what is wrong with this machine or with how Python runs on it."""
    found = []
    if machine.debug:
        found.append("Python is a debug build: the rates are too low.")
    if machine.memory < LITTLE_MEMORY:
        found.append(f"{machine.memory:.1f} GiB of memory are free; training wants {LITTLE_MEMORY:g} GiB.")
    if machine.load > 0.5 * machine.usable:
        found.append(
            f"others keep this machine busy (load {machine.load:.1f} on {machine.usable:g} cores): "
            "the rates are lower than it could make, and vary."
        )
    if machine.usable < machine.cores:
        found.append(
            f"this process may use {machine.usable:g} of {machine.cores} cores; batches start a thread per core: "
            f"pass threads={max(1, int(machine.usable))} to make_vec and to ImpactVecEnv."
        )
    return found


def advice(batches: Sequence[Rate], stable: Rate | None, learners: Sequence[tuple[int, Rate]]) -> list[str]:
    """Return what the rates mean: how many environments, how many threads of torch.

    Args:
        batches: of `make_vec`.
        stable: of `ImpactVecEnv`, with as many environments as the learners have.
        learners: threads of torch, and the rate of PPO with so many.
    """
    told = []
    if batches:
        best = enough(batches)
        told.append(
            f"{best.envs:,} environments are enough: the smallest batch measured within 10 % of the best rate. Take as "
            "many where stepping is all, as in an evaluation. PPO plays n_steps of each between two updates; with 32, "
            f"about an episode, its rollout would be {32 * best.envs:,} samples."
        )
    if learners:
        threads, fastest = max(learners, key=lambda one: one[1].steps)
        if len(learners) > 1:
            rates = ", ".join(f"{one.steps:,.0f} steps/s with {count}" for count, one in learners)
            told.append(f"torch.set_num_threads({threads}) is the faster here for a 64x64 net: {rates}.")
        if stable is not None and stable.steps > 0:
            share = fastest.steps / stable.steps
            told.append(
                f"of PPO's time {share:.0%} goes into stepping {stable.envs:,} environments, the rest into the net: "
                "a faster batch gains no more than that, so let learning decide on their number."
            )
    return told


def table(title: str, rows: Sequence[Sequence[str]], align: str = "<") -> str:
    """Return a plain table; `align` says to which side columns after the first go."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    aligned = [f"{'<' if place == 0 else align}{width}" for place, width in enumerate(widths)]
    lines = ["  ".join(f"{cell:{one}}" for cell, one in zip(row, aligned, strict=True)).rstrip() for row in rows]
    return "\n  ".join([title, *lines]) + "\n"


def listed(title: str, texts: Sequence[str]) -> str:
    """Return texts, one a line."""
    return "\n".join([title, *(f"  - {text}" for text in texts or ["none"])]) + "\n"


def progress(text: str) -> None:
    """Say on stderr what takes time, so that stdout holds the findings alone."""
    print(f"  {text} ...", file=sys.stderr, flush=True)


def examine(machine: Machine, seconds: float, sizes: Sequence[int], learn_envs: int) -> None:
    """Measure and print, as it goes."""
    found = [(name, installed(name) or "not installed") for name in (*PACKAGES, *EXTRAS)]
    ours = [("python", platform.python_version()), ("impact-gym", impact_gym.__version__)]
    print(table("versions", [*ours, *found]))
    print(table("machine", _machine_rows(machine)))
    progress("starting a fresh process")
    start = measure.first_start()
    rows = [("import", f"{start.importing:.2f} s"), ("make to first step", f"{start.making:.2f} s")]
    print(table("a fresh process", rows))
    told = _rates(machine, seconds, sizes, learn_envs)
    print(listed("warnings", warnings(machine)))
    print(listed("advice", [*told, *_missing(machine)]))


def _rates(machine: Machine, seconds: float, sizes: Sequence[int], learn_envs: int) -> list[str]:
    """Measure, print the rates, return advice."""

    def watched(text: str, call: Callable[[], Rate]) -> Rate:
        progress(text)
        return call()

    single = watched("gym.make", partial(measure.single, measure.ID, seconds))
    pendulum = watched("Pendulum-v1, for scale", partial(measure.single, "Pendulum-v1", seconds))
    batches = [watched(f"make_vec, {size} environments", partial(measure.batch, size, seconds)) for size in sizes]
    stable, learners = None, []
    if {"torch", "stable-baselines3"} <= machine.packages:
        stable = watched("ImpactVecEnv", partial(measure.stable_baselines3, learn_envs, seconds))
        for threads in sorted({1, max(1, int(machine.usable))}):
            learner = watched(f"PPO, torch on {threads}", partial(measure.ppo, learn_envs, threads, seconds))
            learners.append((threads, learner))
    cart_pole = watched("CartPole-v1, for scale", partial(measure.cart_pole, seconds))
    rates = [single, *batches, *([stable] if stable else []), *(one for _, one in learners), pendulum, cart_pole]
    rows = [(one.name, f"{one.envs:,}", f"{one.steps:,.0f}") for one in rates]
    print(table("environments, steps per second (random actions, resets included)", rows, ">"))
    print(f"  one environment steps {single.steps / pendulum.steps:.2f} times as fast as Pendulum-v1\n")
    return advice(batches, stable, learners)


def _missing(machine: Machine) -> list[str]:
    lacking = [name for name in ("torch", "stable-baselines3") if name not in machine.packages]
    if not lacking:
        return []
    return [f"{' and '.join(lacking)} missing: ImpactVecEnv and PPO not measured. pip install 'impact-gym[train]'"]


def _machine_rows(machine: Machine) -> list[tuple[str, str]]:
    rows = [
        ("platform", f"{platform.system()} {platform.machine()}"),
        ("cores, usable by this process", f"{machine.cores}, {machine.usable:g}"),
        ("load, memory free", f"{machine.load:.2f}, {machine.memory:.1f} GiB"),
        ("threads of a batch", f"{machine.cores} (argument threads; small batches use fewer)"),
    ]
    if "torch" in machine.packages:
        rows.append(("threads of torch", f"{measure.torch_threads()}"))
    return rows + [(name, os.environ.get(name, "not set")) for name in THREAD_VARIABLES]


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, examine, print."""
    parser = argparse.ArgumentParser(prog="python -m impact_gym.doctor", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="measure so briefly that the rates mean little")
    quick = parser.parse_args(arguments).quick
    try:
        examine(Machine.here(), *((0.03, QUICK_SIZES, 16) if quick else (1.0, SIZES, LEARN_ENVS)))
    except RuntimeError as error:
        sys.exit(f"impact_gym.doctor: {error}")


if __name__ == "__main__":
    main()

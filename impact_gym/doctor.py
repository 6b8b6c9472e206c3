"""What this machine has, what a first start costs, and what to do about it: `impact-gym doctor`."""

import argparse
import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

from impact_gym import __version__

LEARNING = ("torch", "stable-baselines3")
PACKAGES = ("numpy", "scipy", "gymnasium", *LEARNING, "pygame", "mujoco")
THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
LITTLE_MEMORY = 2.0  # GiB, torch and a rollout want about one
RATES = "the steps per second of environments and of training: impact-gym bench environments rates"
FRESH = """
import time
begun = time.perf_counter()
import gymnasium, impact_gym
imported = time.perf_counter()
env = gymnasium.make("ImpactApproach-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
print(imported - begun, time.perf_counter() - imported)
"""


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
    """Return the memory available, GiB; nan where the system does not say."""
    with suppress(OSError, KeyError, ValueError):
        entries = dict(line.split(":") for line in file.read_text().splitlines())
        return float(entries["MemAvailable"].split()[0]) / 2**20
    return float("nan")


def first_start(program: str = FRESH) -> tuple[float, float]:
    """Return how long a fresh process imports, and then takes to `make`, `reset` and step once, s.

    Raises:
        RuntimeError: the process fails; with its error.
    """
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    if ended.returncode:
        raise RuntimeError(f"a fresh process cannot make an environment:\n{ended.stderr}")
    importing, making = map(float, ended.stdout.split()[-2:])
    return importing, making


def warnings(
    *, cores: int, usable: float, memory: float, load: float, debug: bool, missing: Sequence[str] = ()
) -> list[str]:
    """Return what is wrong, and the remedy, a sentence each.

    Args:
        cores: of the machine.
        usable: cores that this process may use.
        memory: free, GiB.
        load: of the machine, cores.
        debug: whether Python is a debug build.
        missing: packages for training that are not installed.
    """
    wrong = {
        "Python is a debug build: all is slower than it need be.": debug,
        f"{memory:.1f} GiB of memory are free; training wants {LITTLE_MEMORY:g} GiB.": memory < LITTLE_MEMORY,
        f"others keep this machine busy (load {load:.1f} on {usable:g} cores): all is slower than it could be, and "
        "varies.": load > 0.5 * usable,
        f"this process may use {usable:g} of {cores} cores; batches start a thread per core: pass "
        f"threads={max(1, int(usable))} to make_vec and to ImpactVecEnv.": usable < cores,
        f"{' and '.join(missing)} missing, for training: pip install 'impact-gym[train]'": bool(missing),
    }
    return [text for text, holds in wrong.items() if holds]


def show(title: str, lines: Iterable[str]) -> None:
    """Print a section."""
    print("\n  ".join([title, *lines]) + "\n", flush=True)


def examine(quick: bool = False) -> None:
    """Look at the machine and print, as it goes; a `quick` look leaves out the first start."""
    versions = {"python": platform.python_version(), "impact-gym": __version__}
    versions |= {name: installed(name) or "not installed" for name in PACKAGES}
    show("versions", [f"{name:<19}{number}" for name, number in versions.items()])
    missing = [name for name in LEARNING if versions[name] == "not installed"]
    cores, memory, load = os.cpu_count() or 1, free_memory(), os.getloadavg()[0]
    usable = min(len(os.sched_getaffinity(0)), group_limit(), cores)
    machine = {
        "platform": f"{platform.system()} {platform.machine()}",
        "cores, usable by this process": f"{cores}, {usable:g}",
        "load, memory free": f"{load:.2f}, {memory:.1f} GiB",
        "threads of a batch": f"{cores} (argument threads; small batches use fewer)",
    }
    machine |= {name: os.environ.get(name, "not set") for name in THREAD_VARIABLES}
    show("machine", [f"{name:<31}{fact}" for name, fact in machine.items()])
    if not quick:
        importing, making = first_start()
        show("a fresh process", [f"import              {importing:.2f} s", f"make to first step  {making:.2f} s"])
    debug = hasattr(sys, "gettotalrefcount")
    wrong = warnings(cores=cores, usable=usable, memory=memory, load=load, debug=debug, missing=missing)
    show("warnings", [f"- {text}" for text in wrong or ["none"]])
    print(RATES)


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line, examine, print."""
    parser = argparse.ArgumentParser(prog="impact-gym doctor", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="leave out the first start")
    try:
        examine(parser.parse_args(arguments).quick)
    except RuntimeError as error:
        sys.exit(f"impact-gym doctor: {error}")


if __name__ == "__main__":
    main()

"""From a set-up to a controller: `python -m agents.controller my.toml --out DIR`, or `make controller SETUP=my.toml`.

Tunes the baselines, trains the seeds, writes the report and exports the median policy, each by the command that it
prints. What a stage leaves in DIR is kept: the same command goes on where it was stopped. `--quick` does all of it with
a fraction of the work, which the report says.
"""

import shlex
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

import tyro

from agents.command_line import command_line
from agents.setup import check
from agents.setups import Setup, load_setup
from impact_gym.files import whole_file

MADE_FOR = attrgetter("environment", "training", "tuned", "budget", "evaluation.weights")
QUICK_BUDGET, QUICK_STEPS, QUICK_SEEDS = 320, 1_000_000, 3


@dataclass(frozen=True)
class Wanted:
    """Make a controller for a set-up: baselines, policies, report and export."""

    setup: tyro.conf.Positional[str]
    """A name or a file."""
    out: Path
    """Folder for all of it; one that an earlier run for this set-up wrote is gone on with."""
    quick: bool = False
    """A first look in a few minutes: less tuning, three seeds of a million steps, 200 scenarios. Use another folder
    than for the whole."""
    processes: int = 2
    """Tunings and trainings at a time on this machine; each uses one core."""
    cluster: str | None = None
    """Tune, train and play on this Ray cluster instead: "ray" for the one that runs here, or its address."""


def kept(setup: Setup, out: Path, quick: bool = False) -> Path:
    """Return the copy of the set-up's file in `out`, by which every stage goes.

    Words, rivals, the bound and what is varied may change from one run to the next, but nothing that what is there was
    made for.

    Raises:
        ValueError: the folder holds something else.
    """
    copy, text = out / f"{setup.path.stem}.toml", setup.path.read_bytes()
    sign = out / "quick"
    if out.exists() and not out.is_dir():
        raise ValueError(f"{out} is no folder")
    there = sorted(out.iterdir()) if out.is_dir() else []
    if there and copy not in there:
        raise ValueError(f"{out} holds something else ({there[0].name}): name another folder with --out")
    if copy.is_file():
        before = load_setup(copy)
        if MADE_FOR(before) != MADE_FOR(setup):
            raise ValueError(f"{out} holds results of {copy.name} as it was: it has changed since, name another folder")
        if sign.exists() != quick:
            kind = "a quick look" if sign.exists() else "the whole"
            raise ValueError(f"{out} holds {kind}: name another folder with --out")
    with whole_file(copy) as file:
        file.write(text)
    if quick:
        sign.touch()
    return copy


def stages(copy: Path, wanted: Wanted) -> Iterator[list[str]]:
    """Yield the command of each stage, without the interpreter."""
    out, setup, name = wanted.out, load_setup(copy), copy.stem
    elsewhere = ["--cluster", wanted.cluster] if wanted.cluster else []
    at_a_time = ["--processes", str(wanted.processes)]
    less: dict[str, list[str]] = {"tune": ["--bound"] if setup.bound == name else [], "seeds": [], "report": []}
    if wanted.quick:
        less["tune"] = ["--scenarios", "100", "--budget", f"{min(QUICK_BUDGET, setup.budget)}"]
        less["seeds"] = ["--seeds", f"{min(QUICK_SEEDS, setup.seeds)}", "--steps", f"{QUICK_STEPS}"]
        less["report"] = ["--count", "200"]
    yield ["-m", "agents.tune", f"{copy}", "--out", f"{out / 'tuned'}", "--jobs", f"{out / 'searches'}",
           *at_a_time, *elsewhere, *less["tune"]]  # fmt: skip
    folders = ["--runs", f"{out / 'runs'}", "--policies", f"{out / 'policies'}"]
    yield ["-m", "agents.train_seeds", f"{copy}", *folders, *at_a_time, *elsewhere, *less["seeds"]]
    page = ["--folder", f"{out}", "--out", f"{out / 'report'}", "--force"]
    yield ["-m", "experiments.report", f"{copy}", *page, *elsewhere, *less["report"]]
    yield ["-m", "agents.export", f"{out / 'policies' / f'{name}.npz'}", "--out", f"{out / 'export'}"]


def main() -> None:
    """Read from the command line what is wanted, and do one stage after the other."""
    with command_line("agents.controller"):
        wanted = tyro.cli(Wanted, prog="python -m agents.controller")
        check(load_setup(wanted.setup), wanted.setup)
        setup = kept(load_setup(wanted.setup), wanted.out, wanted.quick)
        for command in stages(setup, wanted):
            print(f"$ {shlex.join(['python', *command])}", flush=True)
            if ended := subprocess.run([sys.executable, *command], check=False).returncode:
                sys.exit(f"agents.controller: that failed ({ended}); once mended, the same command goes on here")
    print(f"report: {(wanted.out / 'report' / 'index.html').resolve().as_uri()}")
    print(f"controller: {wanted.out / 'export'}")


if __name__ == "__main__":
    main()

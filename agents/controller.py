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
class ControllerOptions:
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


def copy_setup(setup: Setup, out: Path, quick: bool = False) -> Path:
    """Return the copy of the set-up's file in `out`, by which every stage goes.

    Words, rivals, the bound and what is varied may change from one run to the next, but nothing that the results in
    the folder were made for.

    Raises:
        ValueError: the folder holds something else.
    """
    copy, text = out / f"{setup.path.stem}.toml", setup.path.read_bytes()
    sign = out / "quick"
    if out.exists() and not out.is_dir():
        raise ValueError(f"{out} is no folder")
    content = sorted(out.iterdir()) if out.is_dir() else []
    if content and copy not in content:
        raise ValueError(f"{out} holds something else ({content[0].name}): name another folder with --out")
    if copy.is_file():
        if MADE_FOR(load_setup(copy)) != MADE_FOR(setup):
            raise ValueError(f"{out} holds results of {copy.name} as it was: it has changed since, name another folder")
        if sign.exists() != quick:
            kind = "a quick look" if sign.exists() else "the whole"
            raise ValueError(f"{out} holds {kind}: name another folder with --out")
    with whole_file(copy) as file:
        file.write(text)
    if quick:
        sign.touch()
    return copy


def stages(copy: Path, options: ControllerOptions) -> Iterator[list[str]]:
    """Yield the command of each stage, without the interpreter."""
    out, setup, name = options.out, load_setup(copy), copy.stem
    cluster = ["--cluster", options.cluster] if options.cluster else []
    workers = ["--processes", str(options.processes), *cluster]
    tune, seeds, report = ["--bound"] if setup.bound == name else [], [], []
    if options.quick:
        tune = ["--scenarios", "100", "--budget", f"{min(QUICK_BUDGET, setup.budget)}"]
        seeds = ["--seeds", f"{min(QUICK_SEEDS, setup.seeds)}", "--steps", f"{QUICK_STEPS}"]
        report = ["--count", "200"]
    folders = ["--out", f"{out / 'tuned'}", "--jobs", f"{out / 'searches'}"]
    yield ["-m", "agents.tune", f"{copy}", *folders, *workers, *tune]
    folders = ["--runs", f"{out / 'runs'}", "--policies", f"{out / 'policies'}"]
    yield ["-m", "agents.train_seeds", f"{copy}", *folders, *workers, *seeds]
    folders = ["--folder", f"{out}", "--out", f"{out / 'report'}", "--episodes", f"{out / 'episodes'}", "--force"]
    yield ["-m", "experiments.report", f"{copy}", *folders, *cluster, *report]
    yield ["-m", "agents.export", f"{out / 'policies' / f'{name}.npz'}", "--out", f"{out / 'export'}"]


def main() -> None:
    """Make the controller that the command line asks for, one stage after the other."""
    with command_line("agents.controller"):
        options = tyro.cli(ControllerOptions, prog="python -m agents.controller")
        setup = load_setup(options.setup)
        check(setup, options.setup)
        for command in stages(copy_setup(setup, options.out, options.quick), options):
            print(f"$ {shlex.join(['python', *command])}", flush=True)
            if ended := subprocess.run([sys.executable, *command], check=False).returncode:
                sys.exit(f"agents.controller: that failed ({ended}); once mended, the same command goes on here")
    print(f"report: {(options.out / 'report' / 'index.html').resolve().as_uri()}")
    print(f"controller: {options.out / 'export'}")


if __name__ == "__main__":
    main()

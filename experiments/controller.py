"""From a set-up to a controller: `impact-gym controller my.toml --out DIR`.

Tunes the baselines, trains the seeds, writes the report and exports the median policy; each stage is the command that
is printed. Results of a stage are kept in DIR: the same command resumes where it was stopped. `--quick` does all of it
with a fraction of the work, as the report states.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import tyro

from agents import tune
from agents.command_line import command_of, run_command
from agents.export import __main__ as export
from agents.setups import Setup, load_setup
from agents.train import __main__ as train
from experiments.report import __main__ as report
from impact_gym.files import write_file

MADE_FOR = attrgetter("environment", "training", "tuned", "budget", "evaluation.weights")
QUICK_BUDGET, QUICK_STEPS, QUICK_SEEDS, QUICK_SCENARIOS, QUICK_CALLS = 320, 1_000_000, 3, 200, 10_000


@dataclass(frozen=True)
class ControllerOptions:
    """Make a controller for a set-up: baselines, policies, report and export."""

    setup: tyro.conf.Positional[str]
    """A name or a file."""
    out: Path
    """Folder for all results; an earlier run there for this set-up is resumed."""
    quick: bool = False
    """A first look in a few minutes: less tuning, three seeds of a million steps, 200 scenarios. Use a folder
    other than for the full run."""
    processes: int = 2
    """Tunings and trainings at a time on this machine; each uses one core."""
    cluster: str | None = None
    """Tune, train and play on this Ray cluster instead: "ray" for the one that runs here, or its address."""


def copy_setup(setup: Setup, out: Path, quick: bool = False) -> Path:
    """Return the copy of the set-up's file in `out`, which all stages read.

    Texts, rivals, the bound and the variations may change between runs; the settings in MADE_FOR may not.

    Raises:
        ValueError: the folder holds other files or results of other settings.
    """
    copy, sign = out / f"{setup.path.stem}.toml", out / "quick"
    if out.exists() and not out.is_dir():
        raise ValueError(f"{out} is no folder")
    content = sorted(out.iterdir()) if out.is_dir() else []
    if content and copy not in content:
        raise ValueError(f"{out} holds something else ({content[0].name}): name another folder with --out")
    if copy.is_file():
        if MADE_FOR(load_setup(copy)) != MADE_FOR(setup):
            raise ValueError(f"{out} holds results of {copy.name} as it was: it has changed since, name another folder")
        if sign.exists() != quick:
            kind = "a quick look" if sign.exists() else "a full run"
            raise ValueError(f"{out} holds {kind}: name another folder with --out")
    write_file(copy, setup.path.read_bytes())
    if quick:
        sign.touch()
    return copy


def stages(copy: Path, options: ControllerOptions) -> dict[str, tuple[Callable[[Any], object], Any]]:
    """Return the function and the options of each stage, by the name of its command."""
    out, setup, copies = options.out, load_setup(copy), (str(copy),)
    where: dict[str, Any] = {"processes": options.processes, "cluster": options.cluster}
    tuning = tune.Tune(copies, bound=setup.bound == copy.stem, out=out / "tuned", jobs=out / "searches", **where)
    training = train.default_options(copies[0])
    training = replace(training, seeds=setup.seeds, out=out / "runs", policies=out / "policies", **where)
    page = report.ReportOptions(copies, folder=out, out=out / "report", cluster=options.cluster)
    exported = export.Export(str(out / "policies" / f"{copy.stem}.npz"), out / "export")
    if options.quick:
        tuning = replace(tuning, bound=False, scenarios=100, budget=min(QUICK_BUDGET, setup.budget))
        steps = min(QUICK_STEPS, setup.training.steps)
        few = replace(setup.training, steps=steps, validate_every=min(steps, setup.training.validate_every),
                      imitation_steps=min(steps, setup.training.imitation_steps))  # fmt: skip
        training = replace(training, training=few, seeds=min(QUICK_SEEDS, setup.seeds))
        page = replace(page, count=QUICK_SCENARIOS)
        exported = replace(exported, episodes=QUICK_SCENARIOS, calls=QUICK_CALLS)
    return {
        "tune": (tune.run, tuning),
        "train": (train.run, training),
        "report": (report.run, page),
        "export": (export.run, exported),
    }


def run(options: ControllerOptions) -> None:
    """Make a controller, one stage after the other."""
    copy = copy_setup(load_setup(options.setup), options.out, options.quick)
    for name, (work, stage) in stages(copy, options).items():
        usual = train.default_options(str(copy)) if name == "train" else None
        print(f"$ {command_of(name, stage, usual)}", flush=True)
        work(stage)
    print(f"report: {(options.out / 'report' / 'index.html').resolve().as_uri()}")
    print(f"controller: {options.out / 'export'}")


if __name__ == "__main__":
    run_command("controller", ControllerOptions, run)

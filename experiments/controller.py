"""`impact-gym controller SETUP --out DIR`: tune, train, report, export the controller that the report recommends.

With limits, such as `--max-velocity 0.3`, it takes the soonest controller that keeps them, see `experiments.limits`.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import tyro

from agents import tune
from agents.baselines import FIXED
from agents.export import __main__ as export
from agents.setups import Setup, load_setup
from agents.train import __main__ as train
from experiments.lab.study import last_run
from experiments.limits import Search
from experiments.report import __main__ as report
from experiments.report.comparisons import PAPER, RULE
from experiments.report.limits import Limits
from impact_gym.support.command_line import command_of, run_command
from impact_gym.support.files import write_file
from impact_gym.support.validation import number

MADE_FOR = attrgetter("environment", "training", "tuned", "budget", "evaluation.weights")
RECOMMENDED = "recommended.json"
QUICK_BUDGET, QUICK_STEPS, QUICK_SEEDS, QUICK_SCENARIOS, QUICK_CALLS = 320, 1_000_000, 3, 200, 10_000


@dataclass(frozen=True)
class ControllerOptions(Limits):
    """Make a controller for a set-up: tune baselines, train policies, write a report and export the best controller."""

    setup: tyro.conf.Positional[str]
    """Name of a shipped set-up, or file of a set-up."""
    out: Path
    """Folder for all results. The command continues an unfinished run in this folder."""
    quick: bool = False
    """Make a first controller in a few minutes: tune for a shorter time, train at most three policies with at most a
    million steps each, and compare in 200 scenarios. For the full run, use another folder."""
    processes: int = 2
    """Number of tunings or trainings at the same time on this machine, each on one core."""
    time_weight: float | None = None
    """Time weight: cost of a second until the touch, m/s per s. The command exports the simplest controller whose mean
    cost at this weight is not significantly above the lowest. Default: `evaluation.typical` of the set-up (2)."""
    all: bool = False
    """Export all controllers, not only the best one."""
    cluster: str | None = None
    """Address of a Ray cluster that tunes, trains and plays. "ray": the address in RAY_ADDRESS, or else the cluster of
    this machine."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.given and self.share != Limits.share:
            raise ValueError(f"share, got {self.share:g}, needs a limit, such as max_velocity")
        if self.given and self.time_weight is not None:
            raise ValueError(f"time_weight, got {self.time_weight:g} m/s per s, must be left out with "
                             f"{', '.join(self.given)}: limits need their own time weight")  # fmt: skip


def copy_setup(setup: Setup, out: Path, quick: bool = False) -> Path:
    """Copy the set-up's file to `out` and return the new path; ValueError: `out` is a file or has other content."""
    copy, sign = out / f"{setup.path.stem}.toml", out / "quick"
    if out.exists() and not out.is_dir():
        raise ValueError(f"out must be a folder, but {out} is a file")
    content = sorted(out.iterdir()) if out.is_dir() else []
    if content and copy not in content:
        raise ValueError(f"{out} has {content[0].name}, but no {copy.name}: name another folder with --out")
    if copy.is_file():
        if MADE_FOR(load_setup(copy)) != MADE_FOR(setup):
            raise ValueError(f"{out} holds results of another version of {copy.name}: name another folder with --out")
        if sign.exists() != quick:
            kind = "with" if sign.exists() else "without"
            raise ValueError(f"{out} holds results of a run {kind} --quick: name another folder with --out")
    write_file(copy, setup.path.read_bytes())
    if quick:
        sign.touch()
    return copy


def stages(copy: Path, options: ControllerOptions) -> dict[str, tuple[Callable[[Any], object], Any]]:
    """Return the function and the options of each stage, by the name of the stage's command."""
    out, setup, copies, weight = options.out, load_setup(copy), (str(copy),), options.time_weight
    where: dict[str, Any] = {"processes": options.processes, "cluster": options.cluster}
    tuning = tune.Tune(copies, bound=setup.bound == copy.stem, out=out / "tuned", jobs=out / "searches", **where)
    training = train.TrainOptions(copies[0], setup.training)
    training = replace(training, seeds=setup.seeds, out=out / "runs", policies=out / "policies", **where)
    page = report.ReportOptions(setups=copies, folder=out, out=out / "report", time_weight=weight, **where)
    if weight is not None and weight not in setup.evaluation.weights:
        tuning = replace(tuning, weights=tuple(sorted({*setup.evaluation.weights, weight})))
    if options.quick:
        tuning = replace(tuning, bound=False, scenarios=100, budget=min(QUICK_BUDGET, setup.budget))
        steps = min(QUICK_STEPS, setup.training.steps)
        few = replace(setup.training, steps=steps, validate_every=min(steps, setup.training.validate_every),
                      imitation_steps=min(steps, setup.training.imitation_steps))  # fmt: skip
        training = replace(training, training=few, seeds=min(QUICK_SEEDS, setup.seeds))
        page = replace(page, count=QUICK_SCENARIOS)
    return {"tune": (tune.run, tuning), "train": (train.run, training), "report": (report.write, page)}


def source_of(best: str, copy: Path, out: Path) -> Path | str:
    """Return the file or the name of a contestant for `load_policy` or `load_baseline`."""
    files: dict[str, Path | str] = {name: out / "tuned" / f"{name}.json" for name in load_setup(copy).tuned}
    policy = out / "policies" / f"{copy.stem}.npz"
    return files.get(best, policy if best.startswith("seed-") else RULE if best == PAPER else best)


def exporting(copy: Path, options: ControllerOptions) -> export.Export:
    """Return the options for the export of the report's choice, or of all controllers."""
    out = options.out
    source = source_of(last_run(out / "report")["numbers"]["choices"][copy.stem]["controller"], copy, out)
    exported = export.Export(str(source), out / "export", setup=None if str(source).endswith(".npz") else str(copy))
    if options.all:
        exported = replace(exported, controller=str(copy), setup=None, all=True, folder=out)
    return replace(exported, episodes=QUICK_SCENARIOS, calls=QUICK_CALLS) if options.quick else exported


def write_recommended(copy: Path, options: ControllerOptions, chosen: Mapping[str, Any]) -> Path:
    """Write `out`/recommended.json: the report's choice, and its results in the report's scenarios."""
    source = source_of(chosen["controller"], copy, options.out)
    kind = "rule" if source in FIXED else "policy" if str(source).endswith(".npz") else "baseline"
    content = {
        "controller": str(source.resolve() if isinstance(source, Path) else source), "kind": kind,
        "time_weight": chosen["time_weight"], "limits": options.given and options.given | {"share": options.share},
        "measured": chosen["measured"],
    }  # fmt: skip
    return write_file(options.out / RECOMMENDED, json.dumps(content, indent=2) + "\n")


def run(options: ControllerOptions) -> None:
    """Make a controller, stage by stage."""
    setup = load_setup(options.setup)
    if options.time_weight is not None:
        low, high = setup.training.time_weight
        number("time_weight", options.time_weight, "m/s per s", at_least=low, at_most=high)
    if options.max_slide is not None and not setup.task.friction:
        raise ValueError(
            f"max_slide, got {options.max_slide:g} m, needs environment.friction, which {setup.cli_name} lacks"
        )
    copy = copy_setup(setup, options.out, options.quick)
    (options.out / RECOMMENDED).unlink(missing_ok=True)
    each = stages(copy, options)
    (_, tuning), *_, (_, page) = each.values()
    for name, (work, stage) in each.items():
        usual = train.TrainOptions(str(copy), load_setup(copy).training) if name == "train" else None
        if name == "report" and options.given:
            stage = replace(page, limited=Search(page, options, tuning).write(options.out))
        print(f"$ {command_of(name, stage, usual)}", flush=True)
        work(stage)
    chosen, last = last_run(options.out / "report")["numbers"]["choices"][copy.stem], exporting(copy, options)
    print(f"$ {command_of('export', last)}", flush=True)
    files = [*export.run(last)]
    files.append(write_recommended(copy, options, chosen))
    print(f"report: {(options.out / 'report' / 'index.html').resolve().as_uri()}")
    print(chosen["sentence"])
    if not options.all:
        print("the other controllers are not exported: run the same command with --all to export them")
    print(f"files: {', '.join(map(str, files))}")


if __name__ == "__main__":
    run_command("controller", ControllerOptions, run)

"""`impact-gym report`: write a page that compares controllers, and print its address."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from agents.evaluate.specs import pairs
from agents.setups import README, load_setup
from agents.setups.evaluation import RESERVED
from agents.setups.keys import prefixed_errors
from experiments.lab.study import Measurement, RunOptions, Study, run
from experiments.report.comparisons import Comparison, of_policies, of_setup
from experiments.report.limits import read_limited
from impact_gym.parameters import SI
from impact_gym.support.command_line import command_of, run_command
from impact_gym.support.files import parsed
from impact_gym.support.provenance import digest_of
from impact_gym.support.validation import distinct, number, whole
from impact_gym.task import Task, evaluation_sets

QUESTION = ("How should a remote-controlled tool approach and brake so that it arrives soon and does not shoot the "
            "object away?")  # fmt: skip
PACKAGES = ("gymnasium", "matplotlib", "polars", "jinja2")


@dataclass(frozen=True)
class ReportOptions(RunOptions):
    """Play policies and baselines in the same scenarios, and write a page that compares them.

    If you name neither set-ups nor policies, the command compares controllers for the set-ups linear-blind,
    linear-ranged, bistable-blind and paper-limits. A set-up is a file that describes an arm and its objects.
    """

    setups: tyro.conf.Positional[tuple[str, ...]] = ()
    """Names of shipped set-ups, or files of set-ups. The page compares the policy of each set-up with the set-up's
    baselines (controllers that are not learned)."""

    folder: Path | None = None
    """Folder with the subfolders `policies` and `tuned`. Without this option, the command uses the folder into which
    `impact-gym train --seeds` and `impact-gym tune` write these subfolders."""
    policy: tuple[str, ...] = ()
    """Policies to compare: files of policies, folders of trainings, or names of shipped policies. With this option,
    name no set-ups."""
    baseline: tuple[str, ...] = ()
    """With --policy: baselines to compare in addition to the paper's rule. Give the name of a shipped baseline, or
    module:object. The object must have the method `predict`, or be a function or class that returns such an object.
    Without this option, if a shipped set-up has the policy's environment, the page uses the set-up's baselines."""
    scenarios: str | None = None
    """Scenarios to play instead of the usual scenarios. Give the name or the CSV file of a fixed set of scenarios,
    or a JSON file {"ranges": {...}, "seed": s, "count": n, "environment": {...}}. The JSON file may leave out any key.
    "environment" holds arguments of gym.make, for example your tool and coupling."""
    count: Annotated[int | None, SI("-", at_least=2)] = None
    """Number of scenarios. Without this option, the number comes from the JSON file (1000 if "count" is missing), the
    fixed set, or the set-up."""
    time_weight: Annotated[float | None, SI("m/s per s", above=0)] = None
    """Time weight: cost of a second until the touch, m/s per s. The page recommends the simplest controller whose mean
    cost is not significantly above the lowest. Default: `evaluation.typical` of the set-up (2)."""
    limited: Path | None = None
    """With one set-up: file limits.json of `impact-gym controller`. The page then recommends by its limits, and shows
    what each controller reaches at the time weight of the recommended controller."""
    out: Path = Path("reports/latest")
    """Folder for the page and the results of the episodes. To continue after an interruption, repeat the command."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.setups and self.policy:
            raise ValueError("name set-ups or policies, not both")
        if self.baseline and not self.policy:
            raise ValueError("baseline needs --policy: a set-up has its own baselines")
        if self.limited is not None and (len(self.setups) != 1 or self.time_weight is not None):
            raise ValueError(f"limited, got {self.limited}, needs one set-up and no time_weight")


def scenarios_from(source: str, count: int | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return scenarios and changes of the environment in `source`, see `ReportOptions`; ValueError: it is invalid."""
    path = Path(source)
    if path.suffix == ".json":
        content = parsed(path, "scenarios, JSON", json.loads)
        keys = {"ranges", "seed", "count", "environment"}
        if not isinstance(content, dict) or set(content) - keys:
            raise ValueError(f"{path} must be a JSON object with some of {sorted(keys)}, got {str(content)[:200]}")
        environment = content.get("environment", {})
        with prefixed_errors(f"{path}: ranges"):
            ranges = pairs(content.get("ranges", "test"))
        with prefixed_errors(str(path)):
            count = whole("count", count or content.get("count", 1000), at_least=2)
            seed = whole("seed", content.get("seed", 2_000_000), at_least=0)
            Task.of("environment", environment)
        if reserved := sorted(set(environment) & {"scenario", *RESERVED}):
            raise ValueError(f"{path}: environment must not have {reserved}: the key ranges and the report set these")
        return {"ranges": ranges, "seed": seed, "count": count}, environment
    with prefixed_errors("scenarios, a fixed set or a JSON file of ranges"):
        frozen = evaluation_sets.load(source)
    count = whole("scenarios", count or frozen.count, at_least=2)
    number("scenarios", count, "(no unit)", at_most=frozen.count)
    if (evaluation_sets.SHIPPED / f"{source}.csv").is_file():
        return {"set": source, "count": count}, {}
    table = {name: values[:count].tolist() for name, values in frozen.scenario.items()}
    return {"table": table, "seed": frozen.seed, "count": count}, {}


def comparisons_of(options: ReportOptions) -> list[Comparison]:
    """Return the comparisons of the options; ValueError: an option is invalid, or a file is missing or invalid."""
    if options.policy:
        scenarios, changes = scenarios_from(options.scenarios or "test", options.count)
        return of_policies(options.policy, options.baseline, scenarios, changes, options.time_weight)
    setups = list(map(load_setup, options.setups or README))
    distinct("names of set-ups", [setup.name for setup in setups])
    comparisons, limited = [], read_limited(options.limited) if options.limited else {}
    for setup in setups:
        count = options.count or (setup.evaluation.scenarios if options.scenarios is None else None)
        scenarios, changes = scenarios_from(options.scenarios or setup.evaluation.set, count)
        if changes:
            raise ValueError("scenarios with an environment need --policy: a set-up has its own environment")
        comparisons.append(of_setup(setup, scenarios, options.folder, options.time_weight, limited))
    return comparisons


def study_of(comparisons: Sequence[Comparison], own: bool) -> Study:
    """Return the study of comparisons; `own`: whether policies or set-ups are the user's."""
    from experiments.report import episodes, page  # here, because the imports take a second

    objects = (each.controller.get("object") for comparison in comparisons for each in comparison.baselines)
    modules = {name.partition(":")[0] for name in objects if name}
    depends = f"{[*map(repr, comparisons)]} {own} {digest_of('impact_gym', 'agents', 'experiments.report')}"
    # the last default set-up has the longest cells, so its cells start first
    cells = [cell for comparison in reversed(comparisons) for cell in episodes.cells_of(comparison)]
    played = Measurement("episodes", lambda *_: cells, episodes.measured, (*episodes.DEPENDS, *modules))
    return Study("report", QUESTION, [played], lambda frames, _: page.analyse(comparisons, own, frames), PACKAGES,
                 depends)  # fmt: skip


def write(options: ReportOptions) -> Path:
    """Write the report unless it is up to date, print answers, return the page's path; ValueError: invalid options."""
    own = bool(options.policy) or not all(load_setup(name).shipped for name in options.setups)
    return run(study_of(comparisons_of(options), own), options, command_of("report", options))


if __name__ == "__main__":
    run_command("report", ReportOptions, write)

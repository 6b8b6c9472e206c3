"""`impact-gym report`: write a page that compares controllers, and print its address."""

import hashlib
import json
import shutil
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import tyro

from agents.command_line import command_of, run_command
from agents.evaluate.play import pairs
from agents.provenance import circumstances, digest_of, revision
from agents.setups import README, load_setup
from agents.setups.evaluation import RESERVED
from agents.setups.keys import within
from experiments.lab.statistics import RESAMPLES
from experiments.report.matchups import Matchup, of_policies, of_setup
from impact_gym.files import locked, parsed, whole_file, write_file
from impact_gym.sources import compiled_from
from impact_gym.task import Task, evaluation_sets
from impact_gym.validation import distinct, number, whole

RESULTS = "results.json"
MARK = ".impact_gym"  # lock file; a report may be written to a new or empty folder, or to a folder with this file
DEPENDS = ("impact_gym", "agents", "experiments.report", "experiments.lab")  # modules on which a page depends
PACKAGES = ("impact-gym", "gymnasium", "numpy", "scipy", "matplotlib", "polars", "jinja2")


@dataclass(frozen=True)
class ReportOptions:
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
    count: int | None = None
    """Number of scenarios. Without this option, the number comes from the JSON file (1000 if "count" is missing), the
    fixed set, or the set-up."""
    time_weight: float | None = None
    """Cost of a second until the touch, in m/s of the object's final velocity. The page recommends the simplest
    controller whose mean cost is not significantly above the lowest. Without this option, the value is
    `evaluation.typical` of the set-up (2 by default)."""
    out: Path = Path("reports/latest")
    """Folder for the page. A hidden folder next to it stores the results of episodes. To continue after an
    interruption, repeat the command."""
    force: bool = False
    """Play all episodes and write the page again, even if the page is up to date."""
    processes: int | None = None
    """Number of processes on this machine that play episodes. Without this option, there is one process for each core.
    0: this process plays all episodes."""
    cluster: str | None = None
    """Address of a Ray cluster that plays the episodes. "ray": the address in RAY_ADDRESS, or else the cluster of this
    machine. The module of each module:object must be installed on all nodes."""

    def __post_init__(self) -> None:
        for name, least in (("count", 2), ("processes", 0)):
            if (value := getattr(self, name)) is not None:
                whole(name, value, at_least=least)
        if self.time_weight is not None:
            number("time_weight", self.time_weight, "m/s per s", above=0)
        if self.setups and self.policy:
            raise ValueError("name set-ups or policies, not both")
        if self.baseline and not self.policy:
            raise ValueError("baseline needs --policy: a set-up has its own baselines")


def scenarios_from(source: str, count: int | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return scenarios and changes of the environment in `source`, see `ReportOptions`; ValueError: it is invalid."""
    path = Path(source)
    if path.suffix == ".json":
        content = parsed(path, "scenarios, JSON", json.loads)
        keys = {"ranges", "seed", "count", "environment"}
        if not isinstance(content, dict) or set(content) - keys:
            raise ValueError(f"{path} must be a JSON object with some of {sorted(keys)}, got {str(content)[:200]}")
        environment = content.get("environment", {})
        with within(f"{path}: ranges"):
            ranges = pairs(content.get("ranges", "test"))
        with within(str(path)):
            count = whole("count", count or content.get("count", 1000), at_least=2)
            seed = whole("seed", content.get("seed", 2_000_000), at_least=0)
            Task.of("environment", environment)
        if reserved := sorted(set(environment) & {"scenario", *RESERVED}):
            raise ValueError(f"{path}: environment must not have {reserved}: the key ranges and the report set these")
        return {"ranges": ranges, "seed": seed, "count": count}, environment
    with within("scenarios, a fixed set or a JSON file of ranges"):
        frozen = evaluation_sets.load(source)
    count = whole("scenarios", count or frozen.count, at_least=2)
    number("scenarios", count, "(no unit)", at_most=frozen.count)
    if (evaluation_sets.SHIPPED / f"{source}.csv").is_file():
        return {"set": source, "count": count}, {}
    table = {name: values[:count].tolist() for name, values in frozen.scenario.items()}
    return {"table": table, "seed": frozen.seed, "count": count}, {}


def matchups_of(options: ReportOptions) -> list[Matchup]:
    """Return the matchups of the options; ValueError: an option is invalid, or a file is missing or invalid."""
    if options.policy:
        scenarios, changes = scenarios_from(options.scenarios or "test", options.count)
        return of_policies(options.policy, options.baseline, scenarios, changes, options.time_weight)
    setups = list(map(load_setup, options.setups or README))
    distinct("names of set-ups", [setup.name for setup in setups])
    matchups = []
    for setup in setups:
        count = options.count or (setup.evaluation.scenarios if options.scenarios is None else None)
        scenarios, changes = scenarios_from(options.scenarios or setup.evaluation.set, count)
        if changes:
            raise ValueError("scenarios with an environment need --policy: a set-up has its own environment")
        matchups.append(of_setup(setup, scenarios, options.folder, options.time_weight))
    return matchups


def write(options: ReportOptions) -> Path:
    """Write the report unless it is up to date, print answers, return the page's path; ValueError: invalid options."""
    there = next(path for path in (options.out, *options.out.absolute().parents) if path.exists())
    if not there.is_dir():
        raise ValueError(f"out must be a folder, but {there} is a file")
    if there == options.out and not (there / MARK).is_file() and any(there.iterdir()):
        raise ValueError(f"out must be a new or empty folder, or the folder of an earlier report, got {there}")
    return publish(matchups_of(options), options)


def publish(matchups: Sequence[Matchup], options: ReportOptions) -> Path:
    """Write the report of `matchups` into the folder `options.out`, as `write` does; return the path of the page."""
    begun = time.perf_counter()
    own = {each.controller["object"].partition(":")[0]
           for matchup in matchups for each in matchup.baselines if "object" in each.controller}  # fmt: skip
    inputs = (*map(repr, matchups), bool(options.policy), compiled_from(), digest_of(*DEPENDS, *own))
    made_from = hashlib.sha256(repr(inputs).encode()).hexdigest()
    page = options.out / "index.html"
    if options.force or not page.is_file() or results_of(options.out).get("made from") != made_from:
        from experiments.report.jobs import PLAYING, play_matchups  # the import takes seconds

        playing = f"{compiled_from()} {digest_of(*PLAYING)}"
        kept = options.out.with_name(f".{options.out.name}.episodes")
        current = kept / hashlib.sha256(playing.encode()).hexdigest()[:16]
        for folder in kept.glob("*"):  # delete results of other versions of the sources; with --force, all results
            if options.force or folder != current:
                shutil.rmtree(folder, ignore_errors=True)
        depends = f"{playing} {digest_of(*own)}"
        played = play_matchups(matchups, current, depends, options.processes, options.cluster)
        print("writing the page", flush=True)
        with locked(options.out / MARK):
            write_folder(played, options, made_from, begun)
    print(*results_of(options.out)["sentences"], f"report: {page.resolve().as_uri()}", sep="\n")
    return page


def results_of(folder: Path) -> dict[str, Any]:
    """Return the content of a folder's results.json; empty if the file is missing or damaged."""
    with suppress(OSError, TypeError, ValueError):
        return dict(json.loads((folder / RESULTS).read_text()))
    return {}


def write_folder(played: Sequence[Any], options: ReportOptions, made_from: str, begun: float) -> None:
    """Write the files of the report over those of an earlier report; write results.json last."""
    from experiments.lab.page import write as write_page
    from experiments.report import page
    from experiments.report.played import episodes

    folder, matchups = options.out, [results.matchup for results in played]
    versions = [item for matchup in matchups for item in matchup.provenance.get("versions", {}).items()]
    shutil.rmtree(folder / "figures", ignore_errors=True)
    rows = episodes(played)
    with whole_file(folder / "episodes.parquet") as file:
        rows.write_parquet(file, compression="zstd")
    checksum = hashlib.sha256((folder / "episodes.parquet").read_bytes()).hexdigest()
    tabs = [page.tab(results) for results in played]
    results = {
        "choices": {tab.matchup.name: asdict(tab.choice) for tab in tabs},
        "answers": {tab.matchup.name: asdict(tab.answer) for tab in tabs},
        "ablations": {tab.matchup.name: [asdict(step) for step in tab.steps] for tab in tabs},
        "sentences": [
            sentence for tab in tabs for sentence in (f"{tab.matchup.name}: {tab.choice.sentence}", tab.summary)
        ],
        "episodes": {"rows": len(rows), "sha256": checksum},
        "contestants": {
            matchup.name: {each.name: each.checksum for each in (*matchup.seeds, *matchup.baselines)}
            for matchup in matchups
        },
        "scenarios": "; ".join(dict.fromkeys(_scenarios(matchup.scenarios) for matchup in matchups)),
        "made from": made_from,
        "command": command_of("report", options),
        **revision(),
        "seconds": time.perf_counter() - begun,
        **circumstances(*PACKAGES),
    }
    about = {
        **results,
        "limits": _limits(matchups),
        "own": bool(options.policy) or not all(load_setup(name).shipped for name in options.setups),
        "trained_with": ", ".join(dict.fromkeys(map(" ".join, versions))) or "versions that their files do not name",
        "resamples": f"{RESAMPLES:,}",
        "policies": page.policies_table(played),
        "seeds": max(len(each.seeds) for each in played),
    }
    write_page(folder, "report/page.html.jinja", runs=[about], about=about, tabs=tabs)
    write_file(folder / RESULTS, json.dumps(results, indent=2) + "\n")


def _limits(matchups: Sequence[Matchup]) -> str:
    names = defaultdict(list)
    for matchup in matchups:
        task = Task(**matchup.environment)
        names[f"{task.acceleration_range[1]:g} m/s² and {task.velocity_range[1]:g} m/s"].append(matchup.name)
    clauses = [f"{limits} ({', '.join(users)})" if len(names) > 1 else limits for limits, users in names.items()]
    return f"Policies and tuned baselines may use up to {'; '.join(clauses)}."


def _scenarios(scenarios: Mapping[str, Any]) -> str:
    if "set" in scenarios:
        return f"the first {scenarios['count']:,} of the frozen set {scenarios['set']}"
    source = "from a file" if "table" in scenarios else f"drawn from {json.dumps(scenarios['ranges'])}"
    return f"{scenarios['count']:,} {source}, with seeds from {scenarios['seed']:,} on"


if __name__ == "__main__":
    run_command("report", ReportOptions, write)

"""`impact-gym report` writes reports/latest/index.html and prints where it is."""

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
from agents.jobs import digest_of
from agents.provenance import circumstances, revision
from agents.setups import README, Setup, load_setup
from agents.setups.evaluation import RESERVED
from agents.setups.keys import within
from experiments.lab.results import REPORTS
from experiments.lab.statistics import RESAMPLES
from experiments.report.matchups import Matchup, of_policies, of_setup
from impact_gym.files import locked, parsed, whole_file, write_file
from impact_gym.sources import compiled_from
from impact_gym.task import Task, evaluation_sets
from impact_gym.validation import number, whole

RESULTS = "results.json"
MARK = ".impact_gym"
"""Lock file that marks a folder of a report, which another report may overwrite."""
DEPENDS = ("impact_gym", "agents", "experiments.report", "experiments.lab")
"""Packages that the page depends on."""
PACKAGES = ("impact-gym", "gymnasium", "numpy", "scipy", "altair", "vl-convert-python", "polars", "jinja2")


@dataclass(frozen=True)
class ReportOptions:
    """Compare policies and baselines in the same scenarios, on a page.

    Default: all seeds of the set-ups in the README.
    """

    setups: tyro.conf.Positional[tuple[str, ...]] = ()
    """Set-ups by name or file, with the policies and baselines that `impact-gym train` and `tune` wrote."""

    folder: Path | None = None
    """Folder with `policies` and `tuned` of the set-ups. Default: where these commands write them."""
    policy: tuple[str, ...] = ()
    """Policies instead of set-ups: files, run folders or names of shipped ones, each against its baselines."""
    baseline: tuple[str, ...] = ()
    """Further baselines: tuned names, or module:object with `predict`, or a function or class that returns one.
    Default: those of the policy's set-up."""
    scenarios: str | None = None
    """Scenarios instead of those of the set-ups: a frozen set by name or file (CSV), or a JSON file
    {"ranges": {...}, "seed": s, "count": n, "environment": {...}} with some of these keys; the environment holds
    arguments of gym.make, such as your tool and coupling."""
    count: int | None = None
    """Number of scenarios. Default: as in the set-up, or all of `scenarios`."""
    time_weight: float | None = None
    """What a second of approach costs, m/s per s, where one controller is to be recommended. Default: the set-up's
    typical one."""
    out: Path = REPORTS / "latest"
    """Folder for the page; results are kept in a hidden folder beside it, from which the same command resumes."""
    force: bool = False
    """Play and write everything again, even if kept results are up to date."""
    processes: int | None = None
    """Jobs at the same time on this machine. Default: one a core; 0: none but this process."""
    cluster: str | None = None
    """A Ray cluster instead: "ray", or its address. A module:object must be installed on its nodes."""

    def __post_init__(self) -> None:
        if self.count is not None:
            whole("count", self.count, at_least=2)
        if self.processes is not None:
            whole("processes", self.processes, at_least=0)
        if self.time_weight is not None:
            number("time_weight", self.time_weight, "m/s per s", above=0)
        if self.setups and self.policy:
            raise ValueError("name set-ups or policies, not both")
        if self.baseline and not self.policy:
            raise ValueError("baseline needs --policy: the shipped recipes have theirs")


def scenarios_from(source: str, count: int | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return scenarios as JSON and changes of the environment: from a frozen set's name or file, or from a JSON file.

    `ReportOptions.scenarios` describes the file.

    Raises:
        ValueError: no such set or file, or a key or value in it is unknown or out of range.
    """
    path = Path(source)
    if path.suffix == ".json":
        content = parsed(path, "scenarios, JSON", json.loads)
        keys = {"ranges", "seed", "count", "environment"}
        if not isinstance(content, dict) or set(content) - keys:
            raise ValueError(f"{path} must be a JSON object with some of {sorted(keys)}, got {str(content)[:200]}")
        environment = content.get("environment", {})
        with within(f"{path}: ranges"):
            ranges = pairs(content.get("ranges", "test"))
        count = whole("count", count or content.get("count", 1000), at_least=2)
        seed = whole("seed", content.get("seed", 2_000_000), at_least=0)
        with within(str(path)):
            Task.of("environment", environment)
        taken = sorted(set(environment) & {"scenario", *RESERVED})
        if taken:
            raise ValueError(f"{path}: environment must leave out {taken}: ranges and the report see to that")
        return {"ranges": ranges, "seed": seed, "count": count}, environment
    frozen = evaluation_sets.load(source)
    count = whole("scenarios", count or frozen.count, at_least=2)
    number("scenarios", count, "(no unit)", at_most=frozen.count)
    if (evaluation_sets.SHIPPED / f"{source}.csv").is_file():
        return {"set": source, "count": count}, {}
    table = {name: values[:count].tolist() for name, values in frozen.scenario.items()}
    return {"table": table, "seed": frozen.seed, "count": count}, {}


def matchups_of(options: ReportOptions) -> list[Matchup]:
    """Return the matchups of the options.

    Raises:
        ValueError: a policy, a baseline or the scenarios are missing or invalid; nothing has been played yet.
    """
    if options.policy:
        scenarios, changes = scenarios_from(options.scenarios or "test", options.count)
        return of_policies(options.policy, options.baseline, scenarios, changes, options.time_weight)
    setups = [load_setup(name) for name in options.setups or README]
    if not options.setups:
        setups = [setup for setup in setups if _trained(setup, options.folder or setup.folder)]
    if not setups:
        raise ValueError("no set-up has policies yet: impact-gym train SETUP --seeds 10")
    if len({setup.name for setup in setups}) < len(setups):
        raise ValueError(f"two set-ups would have the same name: {', '.join(options.setups)}")
    matchups = []
    for setup in setups:
        count = options.count or (setup.evaluation.scenarios if options.scenarios is None else None)
        scenarios, changes = scenarios_from(options.scenarios or setup.evaluation.set, count)
        if changes:
            raise ValueError("scenarios with an environment of their own need --policy: set-ups have theirs")
        matchups.append(of_setup(setup, scenarios, options.folder, options.time_weight))
    return matchups


def _trained(setup: Setup, folder: Path) -> bool:
    """Return whether a set-up of the README has policies; print a line where it has none."""
    trained = (folder / "policies" / f"{setup.name}.npz").is_file()
    if not trained:
        train = f"impact-gym train {setup.called} --seeds {setup.seeds}"
        print(f"{setup.name} is left out, it has no policies yet: {train}")
    return trained


def write(options: ReportOptions) -> Path:
    """Play what is missing, write the folder unless it is up to date, and return the path of its page.

    Raises:
        ValueError: an option is invalid, or `out` is a file, below a file, or a folder with other content.
    """
    there = next(path for path in (options.out, *options.out.absolute().parents) if path.exists())
    if not there.is_dir():
        raise ValueError(f"out must be a folder, but {there} is a file")
    if there == options.out and not (there / MARK).is_file() and any(there.iterdir()):
        raise ValueError(f"out must be a new or empty folder or one that a report wrote, got {there}")
    return publish(matchups_of(options), options)


def publish(matchups: Sequence[Matchup], options: ReportOptions) -> Path:
    """Play what is missing of matchups, write the folder unless it is up to date, and return the path of its page."""
    begun = time.perf_counter()
    modules = {module for matchup in matchups for module in matchup.modules}
    inputs = (*map(repr, matchups), bool(options.policy), compiled_from(), digest_of(*DEPENDS, *modules))
    made_from = hashlib.sha256(repr(inputs).encode()).hexdigest()
    page = options.out / "index.html"
    if options.force or not page.is_file() or results_of(options.out).get("made from") != made_from:
        from experiments.report.jobs import play_matchups  # takes seconds to import

        played = play_matchups(matchups, _kept(options), options.processes, options.cluster)
        print("writing the page", flush=True)
        with locked(options.out / MARK):
            write_folder(played, options, made_from, begun)
    print(*results_of(options.out)["sentences"], sep="\n")
    return page


def results_of(folder: Path) -> dict[str, Any]:
    """Return results.json of a folder; empty if it is missing or damaged."""
    with suppress(OSError, ValueError):
        return dict(json.loads((folder / RESULTS).read_text()))
    return {}


def _kept(options: ReportOptions) -> Path:
    """Return the hidden folder of results beside a page; delete results of other sources, or all if `force`."""
    from experiments.report.jobs import sources

    parent, current = options.out.with_name(f".{options.out.name}.episodes"), sources()[:16]
    for folder in parent.glob("*"):
        if options.force or folder.name != current:
            shutil.rmtree(folder, ignore_errors=True)
    return parent / current


def write_folder(played: Sequence[Any], options: ReportOptions, made_from: str, begun: float) -> None:
    """Write the folder of `Played` results; last results.json, with the digest of its inputs.

    A user's own files stay; figures of an earlier report that are not in this one are deleted.
    """
    from experiments.report import page
    from experiments.report.played import episodes

    folder, matchups = options.out, [results.matchup for results in played]
    versions = [item for matchup in matchups for item in matchup.provenance.get("versions", {}).items()]
    (folder / "figures").mkdir(parents=True, exist_ok=True)
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
        "weights": {matchup.name: list(matchup.policy.weights) for matchup in matchups},
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
        "trained_with": ", ".join(dict.fromkeys(map(" ".join, versions))) or "what their files do not say",
        "resamples": f"{RESAMPLES:,}",
    }
    results["figures"] = page.write(folder, about, tabs, played)
    for name in {*results_of(folder).get("figures", [])} - {*results["figures"]}:
        (folder / "figures" / Path(name).name).unlink(missing_ok=True)
    write_file(folder / RESULTS, json.dumps(results, indent=2) + "\n")


def _limits(matchups: Sequence[Matchup]) -> str:
    """Return a sentence with the limits of the arms."""
    names = defaultdict(list)
    for matchup in matchups:
        task = Task(**matchup.environment)
        names[f"{task.acceleration_range[1]:g} m/s² and {task.velocity_range[1]:g} m/s"].append(matchup.name)
    clauses = [f"{limits} ({', '.join(users)})" if len(names) > 1 else limits for limits, users in names.items()]
    return f"Policies and tuned baselines may use up to {'; '.join(clauses)}."


def _scenarios(scenarios: Mapping[str, Any]) -> str:
    if "set" in scenarios:
        return f"the frozen set {scenarios['set']}, its first {scenarios['count']:,}"
    if "table" in scenarios:
        return f"{scenarios['count']:,} from a file, seeded from {scenarios['seed']:,} on"
    return f"{scenarios['count']:,} drawn from {json.dumps(scenarios['ranges'])}, seeded from {scenarios['seed']:,} on"


def run(options: ReportOptions) -> None:
    """Write the report, and print where it is."""
    print(f"report: {write(options).resolve().as_uri()}")


if __name__ == "__main__":
    run_command("report", ReportOptions, run)

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
from agents.jobs import digest_of
from agents.provenance import circumstances, revision
from agents.setups import README, Setup, load_setup
from experiments.lab.results import REPORTS
from experiments.lab.statistics import RESAMPLES
from experiments.report.matchups import Matchup, of_policies, of_setup
from experiments.report.scenarios import scenarios_from
from impact_gym.files import locked, whole_file, write_file
from impact_gym.sources import compiled_from
from impact_gym.task import Task
from impact_gym.validation import whole

RESULTS = "results.json"
MARK = ".impact_gym"
"""File of a folder that a report wrote, into which another may be written; its lock."""
FOLLOWS_FROM = ("impact_gym", "agents", "experiments.report", "experiments.lab")
"""Packages that the page follows from."""
PACKAGES = ("impact-gym", "gymnasium", "numpy", "scipy", "altair", "vl-convert-python", "polars", "jinja2")


@dataclass(frozen=True)
class ReportOptions:
    """Compare policies and baselines in the same scenarios, on a page.

    Without a set-up and --policy it is about the set-ups of the README, all their seeds.
    """

    setups: tyro.conf.Positional[tuple[str, ...]] = ()
    """Set-ups by name or file, whose policies and baselines are where `impact-gym train` and `tune` left them."""

    folder: Path | None = None
    """Where `policies` and `tuned` of the set-ups are, if not where these commands leave them."""
    policy: tuple[str, ...] = ()
    """Your own policies instead: files, run folders or names of shipped ones, each against its baselines."""
    baseline: tuple[str, ...] = ()
    """Further baselines: tuned names, or module:object with `predict`; a function or class that returns one will do.
    Default: those of the set-up of the policy."""
    scenarios: str | None = None
    """Scenarios to play, instead of those of the set-ups: a frozen set by name or file (CSV), or a JSON file
    {"ranges": {...}, "seed": s, "count": n, "environment": {...}} of which all may be left out; the environment holds
    arguments of gym.make, your tool and coupling."""
    count: int | None = None
    """How many of the scenarios; as many as the set-up says, or all of `scenarios`, unless given."""
    out: Path = REPORTS / "latest"
    """Folder for the page; results are kept in a hidden one beside it, and the same command continues from there."""
    force: bool = False
    """Play and write everything again, instead of keeping what the same sources and options have given."""
    processes: int | None = None
    """Jobs at the same time on this machine. Default: one a core; 0: none but this process."""
    cluster: str | None = None
    """A Ray cluster instead: "ray", or its address. A module:object must be installed on its nodes."""

    def __post_init__(self) -> None:
        if self.count is not None:
            whole("count", self.count, at_least=2)
        if self.processes is not None:
            whole("processes", self.processes, at_least=0)
        if self.setups and self.policy:
            raise ValueError("name set-ups or policies, not both")
        if self.baseline and not self.policy:
            raise ValueError("baseline needs --policy: the shipped recipes have theirs")


def matchups_of(options: ReportOptions) -> list[Matchup]:
    """Return the matchups that are asked for.

    Raises:
        ValueError: a policy, a baseline or the scenarios are not what they should be; nothing has been played yet.
    """
    if options.policy:
        scenarios, changes = scenarios_from(options.scenarios or "test", options.count)
        return of_policies(options.policy, options.baseline, scenarios, changes)
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
        matchups.append(of_setup(setup, scenarios, options.folder))
    return matchups


def _trained(setup: Setup, folder: Path) -> bool:
    """Return whether a set-up of the README has policies; print a line where it has none."""
    trained = (folder / "policies" / f"{setup.name}.npz").is_file()
    if not trained:
        train = f"impact-gym train {setup.called} --seeds {setup.seeds}"
        print(f"{setup.name} is left out, it has no policies yet: {train}")
    return trained


def write(options: ReportOptions) -> Path:
    """Play what is missing, write the folder unless it says the same already, and return the path of its page.

    Raises:
        ValueError: something asked for is not there or makes no sense, or the folder is a file, below one, or of
            something else.
    """
    there = next(path for path in (options.out, *options.out.absolute().parents) if path.exists())
    if not there.is_dir():
        raise ValueError(f"out must be a folder, but {there} is a file")
    if there == options.out and not (there / MARK).is_file() and any(there.iterdir()):
        raise ValueError(f"out must be a new or empty folder or one that a report wrote, got {there}")
    return publish(matchups_of(options), options)


def publish(matchups: Sequence[Matchup], options: ReportOptions) -> Path:
    """Play what is missing of matchups, write the folder unless it says the same already, and return its page."""
    made_from, begun = _made_from(matchups, options), time.perf_counter()
    page = options.out / "index.html"
    if options.force or not page.is_file() or _written(options.out).get("made from") != made_from:
        from experiments.report.jobs import play_matchups  # what plays and draws takes seconds to import

        played = play_matchups(matchups, _kept(options), options.processes, options.cluster)
        print("writing the page", flush=True)
        with locked(options.out / MARK):
            write_folder(played, options, made_from, begun)
    print(*_written(options.out)["sentences"], sep="\n")
    return page


def _written(folder: Path) -> dict[str, Any]:
    """Return what a folder says of itself; nothing where that is missing or damaged."""
    with suppress(OSError, ValueError):
        return dict(json.loads((folder / RESULTS).read_text()))
    return {}


def _kept(options: ReportOptions) -> Path:
    """Return the hidden folder of results beside a page, rid of those of other sources, or of all by force."""
    from experiments.report.jobs import sources

    parent, current = options.out.with_name(f".{options.out.name}.episodes"), sources()[:16]
    for folder in parent.glob("*"):
        if options.force or folder.name != current:
            shutil.rmtree(folder, ignore_errors=True)
    return parent / current


def _made_from(matchups: Sequence[Matchup], options: ReportOptions) -> str:
    """Return SHA-256 of all that the folder follows from: contestants, scenarios, words, sources."""
    own = {module for matchup in matchups for module in matchup.modules}
    content = (*map(repr, matchups), bool(options.policy), compiled_from(), digest_of(*FOLLOWS_FROM, *own))
    return hashlib.sha256(repr(content).encode()).hexdigest()


def write_folder(played: Sequence[Any], options: ReportOptions, made_from: str, begun: float) -> None:
    """Write the folder of what was `Played` since `begun`: `results.json` last, which says what it was made from.

    A user's own files stay; figures of an earlier report that this one does not have go.
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
        "answers": {tab.matchup.name: asdict(tab.answer) for tab in tabs},
        "ablations": {tab.matchup.name: [asdict(step) for step in tab.steps] for tab in tabs},
        "sentences": [tab.summary for tab in tabs],
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
    for name in {*_written(folder).get("figures", [])} - {*results["figures"]}:
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

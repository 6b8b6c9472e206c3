"""The command `impact-gym`: its names, commands as text, and the way from a set-up to its controller."""

import json
import shlex
import sys
import warnings
from errno import ENOSPC
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from made_up_policies import made_up_policy
from own_set_up import change
from refusal import refused
from scipy.stats import ttest_1samp

from agents.command_line import command_line, command_of, joined, read_command
from agents.evaluate.play import pairs, play
from agents.export.__main__ import Export
from agents.policies import load_ensemble
from agents.setups import Training, load_setup, shipped
from agents.train.__main__ import TrainOptions
from agents.tune import Tune
from experiments import command, policies
from experiments.controller import copy_setup
from experiments.design.options import DesignOptions
from experiments.design.search import SearchBudget
from experiments.lab import grid
from experiments.lab.statistics import Comparison
from experiments.lab.study import StudyOptions
from experiments.report import matchups
from experiments.report.__main__ import ReportOptions
from experiments.report.played import Run

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning:runpy")  # of a module that was imported before it runs


@pytest.fixture
def exit_of(monkeypatch):
    """Run `impact-gym` with words; return its exit code or message."""

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["impact-gym", *words])
        try:
            command.main()
        except SystemExit as ended:
            return ended.code
        return 0

    return run


NAMES = [name for group in command.COMMANDS.values() for name in group]


@pytest.mark.parametrize("name", [*NAMES, "study gain"])
def test_help_of_a_command_is_in_words_of_a_user(name, exit_of, capsys):
    assert not exit_of(*name.split(), "--help")
    text = capsys.readouterr().out
    assert text.startswith(f"usage: impact-gym {name} ")
    for jargon in ("STR", "[[", "{None}", "experiments.", "agents."):
        assert jargon not in text, jargon
    assert joined(lambda: "the lines\n    of a text") == "the lines of a text"


def test_commands_are_listed_for_no_or_an_unknown_name(exit_of, capsys):
    assert exit_of("study", "telop") == 2
    assert "no study 'telop': did you mean teleop?" in capsys.readouterr().err
    for words, status in (((), 0), (("--help",), 0), (("reprot",), 2)):
        assert exit_of(*words) == status
        text = capsys.readouterr()[status // 2]
        assert [line.split()[0] for line in text.splitlines() if line.startswith("  ")] == NAMES
        assert ("'reprot': did you mean report?" in text) == (status == 2)
    assert exit_of("--version") == 0
    assert {f"impact-gym {version('impact-gym')}", f"numpy {np.__version__}"} <= {*capsys.readouterr().out.splitlines()}


def test_command_names_the_packages_it_lacks(exit_of, monkeypatch):
    there = command.Distribution.discover
    monkeypatch.setattr(
        command.Distribution, "discover", lambda name: () if name in ("torch", "cma") else there(name=name)
    )
    assert exit_of("tune") == "impact-gym tune needs torch, cma: pip install 'impact-gym[train]'"
    assert not exit_of("policies", "rigid-blind")  # needs no extra


@pytest.mark.parametrize(("name", "options"), [
    ("tune", Tune(("linear-blind",), names=("blind-profile",), weights=(0.5, 2.0), budget=8, bound=True)),
    ("train", TrainOptions("rigid-blind", Training(width=24), seeds=2, cluster="ray", out=Path("there"))),
    ("report", ReportOptions(("linear-blind",), folder=Path("a b"), force=True, count=200)),
    ("export", Export("linear-blind", Path("out"))),
    ("design", DesignOptions("linear-blind", ("tool_mass=0.1:0.2",), Path("out"), search=SearchBudget(budget=8))),
    ("study gain", StudyOptions(Path("out"), quick=True, only=("priors",), processes=1)),
], ids=lambda value: value if isinstance(value, str) else "")  # fmt: skip
def test_command_of_options_is_read_into_the_same_options(name, options):
    called, *first = name.split()
    words = shlex.split(command_of(called, options, None, *first))
    assert words[: 2 + len(first)] == ["impact-gym", called, *first]
    assert read_command(name, type(options), words[2 + len(first) :]) == options


def warned_and_interrupted():
    for _ in range(2):
        warnings.warn("odd", stacklevel=1)
    raise KeyboardInterrupt


@pytest.mark.filterwarnings("always:odd")
def test_command_line_says_in_one_line_what_went_wrong(capsys):
    with pytest.raises(SystemExit, match=r"impact-gym tune: no such thing$"), command_line("tune"):
        raise ValueError("no such thing")
    with pytest.raises(SystemExit, match=r"tune: .*yaml.*pip install 'impact-gym\[train"), command_line("tune"):
        version("no-package-yaml")
    with pytest.raises(SystemExit, match=r"tune: .*a file.*make room: go on$"), command_line("tune", "go on"):
        raise OSError(ENOSPC, "full")
    with pytest.raises(SystemExit, match="130"), command_line("tune"):
        warned_and_interrupted()
    said = ["warning: odd", "interrupted; the same command continues"]
    assert capsys.readouterr().err.splitlines() == [f"impact-gym tune: {each}" for each in said]


def test_cards_tell_purpose_failures_and_what_seeds_do(mine):
    for name in shipped():
        setup, text = load_setup(name), "\n".join(policies.card(name))
        assert text.startswith(f"{name}: {setup.title}\n  for: {setup.about}\n  fails: {setup.fails}\n")
        ensemble = load_ensemble(name)
        validations = [policy.provenance["validation"] for policy in ensemble.policies]
        for place, weight in enumerate(validations[0]["time_weight"]):
            means = []
            for key in ("approach_time", "object_velocity"):
                values = [validation[key][place] for validation in validations]
                low, high = ttest_1samp(values, 0.0).confidence_interval(0.95)
                means.append(f"{np.mean(values):.3f} [{low:.3f}, {high:.3f}]")
            assert f"w = {weight:g} m/s per s: T {means[0]} s, V_p {means[1]} m/s\n" in text
        assert f"{len(validations)} seeds, seed {ensemble.chosen} is the median" in text
    refused(lambda: [*policies.card(str(mine))], "mine.toml has no policy yet", "impact-gym train", "--seeds")


def test_copy_setup_keeps_a_folder_for_its_set_up(mine, tmp_path):
    out = tmp_path / "out"
    copy = copy_setup(load_setup(mine), out)
    assert copy.read_bytes() == mine.read_bytes()
    change(mine, "A slow arm", "A slower arm")
    assert "slower" in copy_setup(load_setup(mine), out).read_text()
    refused(lambda: copy_setup(load_setup(mine), out, quick=True), "run without --quick: name another folder")
    change(mine, "0.7", "0.8")
    refused(lambda: copy_setup(load_setup(mine), out), "another version of mine.toml", "name another folder")
    refused(lambda: copy_setup(load_setup("linear-blind"), out), "has mine.toml, but no linear-blind.toml")
    assert "0.7" in copy.read_text()
    refused(lambda: copy_setup(load_setup(mine), mine), "out must be a folder")


@pytest.mark.slow
def test_controller_goes_from_a_file_to_the_best_controller(mine, tmp_path, exit_of, capsys):
    out = tmp_path / "out"
    trained, tuned, results = (out / name for name in ("policies/mine.npz", "tuned/mine-profile.json", "report"))
    words = ("controller", str(mine), "--out", str(out), "--quick")
    assert exit_of(*words) == 0
    (choice,) = json.loads((results / "results.json").read_text())["choices"].values()
    exported = {"paper's rule": "paper-trapezoid"}.get(choice["controller"], choice["controller"])
    exported = "mine" if exported.startswith("seed-") else exported
    assert [path.stem for path in (out / "export").glob("*.h")] == [exported]
    assert choice["sentence"] in capsys.readouterr().out
    searches = [entry["search"] for entry in json.loads(tuned.read_text())["weights"].values()]
    assert {search["budget"] for search in searches} == {16}  # no more than the set-up says
    own, first = load_setup(out / mine.name), trained.read_bytes()
    assert len(load_ensemble(trained).policies) == 2
    unseen = {"ranges": pairs(own.environment["scenario"]), "seed": 90_000_000, "count": 2000}
    matchup, weight, costs = matchups.of_setup(own, unseen, out), own.evaluation.typical, {}
    for each in (*matchup.baselines, matchup.policy):
        played = play(each.controller, unseen, [weight], matchup.environment)
        costs[each.name] = Run((weight,), played, grid.missed_cost(matchup.environment)).loss(weight)
    best = min(costs.values(), key=np.mean)
    assert Comparison.of_means(best, costs[choice["controller"]]).less.low <= 0.0
    assert exit_of(*words) == 0
    assert trained.read_bytes() == first
    assert "training for" not in capsys.readouterr().out
    assert exit_of(*words, "--time-weight", "3", "--all") == 0
    assert {"mine", "mine-profile", "paper-trapezoid"} <= {path.stem for path in (out / "export").glob("*.h")}
    assert json.loads((results / "results.json").read_text())["choices"]["mine"]["time_weight"] == 3.0
    assert "time_weight must be" in exit_of(*words, "--time-weight", "99")


def test_matchup_refuses_a_policy_of_another_arm(mine, tmp_path):
    made_up_policy(environment={"range_noise": 0.01}).save(tmp_path / "policies" / "mine.npz")
    own, test = load_setup(mine), {"set": "test", "count": 5}
    refused(lambda: matchups.of_setup(own, test, tmp_path), "mine.npz was trained for another environment", str(mine))

"""The page of the report: a tab for each set-up, with the answer on the first screen and the details below."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from markupsafe import Markup

from agents.evaluate.specs import controller_of, frozen_of
from experiments.lab.parts import Section, Tab, Table
from experiments.lab.player import choose, films, fragment
from experiments.lab.statistics import RESAMPLES
from experiments.lab.study import Findings, Frames
from experiments.report import ablation, choice, robustness, summary
from experiments.report.comparisons import PAPER, POLICY, Comparison
from experiments.report.episodes import ComparisonResults
from experiments.report.limits import front
from impact_gym.task import Task

OF_OTHERS = 3  # number of scenarios in the film of a controller that is not recommended
TERMS = {
    "V_p": "final velocity of the object; with friction, its largest velocity. Means are over the touched objects.",
    "T": "time until the first touch; with an operator, until all is done.",
    "the paper's rule": "accelerates to 1 m/s at 8 m/s², and brakes at 8 m/s² from 16 ms after the contact force "
    "exceeds 1 N, within the limits of the arm.",
    "time weight w": "cost of a second of approach, in m/s of V_p. A policy observes the weight, so one policy covers "
    "the whole trade-off; a baseline is tuned for each weight.",
    "seed": "one training of a set-up. The policy of the set-up is the median seed, by its score on the validation set "
    "(of an even number, the worse of the middle two).",
    "95 % of trainings": "tolerance bound: with 95 % confidence, 95 % of further trainings reach it, if seeds scatter "
    "normally. The interval beside it is an interval of the mean.",
    "at the paper's approach time": "at the weight at which the policy has the mean approach time of the paper's rule.",
    "clairvoyant search": "the best approach that a search found for each scenario; it knows the object.",
    "impact-gym train SETUP --seeds N": "trains the policies, and resumes where it was stopped",
    "impact-gym tune SETUP --bound": "tunes the baselines and searches the clairvoyant approaches",
}  # fmt: skip


class Analysis:
    """The results of one comparison, and what the report says of them."""

    def __init__(self, results: ComparisonResults) -> None:
        self.results, self.comparison = results, results.comparison
        self.summary, self.choice = summary.summary(results), choice.choice(results)
        self.steps = ablation.steps_of(results)
        operated = self.comparison.operated
        short = summary.assisted(results) if operated else summary.sentence(self.summary, self.comparison)
        self.aside = short  # at the time of the paper's rule
        self.fails = robustness.where_it_fails(results, self.choice.controller)
        rivals = {each.checksum or each.controller.get("baseline", ""): each.name for each in self.comparison.rivals}
        self.each_fails = {key: " ".join(robustness.where_it_fails(results, name)[1:]) for key, name in rivals.items()}


def analyse(comparisons: Sequence[Comparison], own: bool, frames: Frames) -> Findings:
    """Return the findings of a report; `own`: whether policies or set-ups are the user's."""
    played = (ComparisonResults.of_rows(each, frames["episodes"]) for each in comparisons)
    found = {results.comparison.name: Analysis(results) for results in played}
    everyone = {each.name: (*each.seeds, *each.baselines) for each in comparisons}
    numbers = {
        "fails": {name: each.each_fails for name, each in found.items()},
        "choices": {name: asdict(each.choice) for name, each in found.items()},
        "answers": {name: asdict(each.summary) for name, each in found.items()},
        "ablations": {name: [asdict(step) for step in each.steps] for name, each in found.items()},
        "contestants": {name: {each.name: each.checksum for each in group} for name, group in everyone.items()},
    }
    text = "\n".join(f"{name}: {each.choice.sentence} {each.aside}" for name, each in found.items())
    return Findings(text, [_method([*found.values()], own)], {}, [*map(_tab, found.values())], numbers)


def _tab(found: Analysis) -> Tab:
    results, chosen, comparison = found.results, found.choice, found.comparison
    note = [f"{comparison.name}: {comparison.note}."] * bool(comparison.note)
    caption = ("Policy and baselines are not trained or tuned again. A stiffer coupling keeps its damping ratio. "
               "Objects outside the training ranges are lighter, stiffer, less elastic and nearer")  # fmt: skip
    words = comparison.words
    everyone = {words[each.name]: POLICY if each is comparison.policy else each.name for each in comparison.rivals}
    judged = words[chosen.controller] if words[chosen.controller] in everyone else POLICY
    changed = Table.joined(caption, robustness.rows(results, everyone, judged))
    steps = ablation.table(found.steps, comparison.labels)
    sections = [
        Section("Choice: all controllers", [chosen.reason, found.aside, *note, choice.contestants(chosen, results)],
                folded=True, key="choice"),
        *[Section("Ablation: where the gain comes from", [steps], folded=True, key="ablation")]
        * (not comparison.operated),
        Section("Robustness: mean cost (m/s) with one thing changed", [changed], folded=True, key="robustness"),
    ]  # fmt: skip
    films = {label: Markup(fragment(film, f"watch-{comparison.name}-{place}"))
             for place, (label, film) in enumerate(watch(results, chosen.controller).items())}  # fmt: skip
    chart = (front(comparison.limited, words, f"figures/{comparison.name}_answer") if comparison.limited
             else summary.trade_off(results, chosen.controller))  # fmt: skip
    taken = next(each for each in (*comparison.baselines, comparison.policy) if each.name == chosen.controller)
    task, name = Task(**comparison.environment), words[taken.name]
    delay = " to ".join(f"{1e3 * end:g}" for end in dict.fromkeys(np.ravel(task.reaction_delay)))
    about = (f"{name[0].upper()}{name[1:]}: {taken.about} The alarm tells the controller of the touch, {delay} ms "
             f"after the force passes {task.alarm_threshold:g} N.")  # fmt: skip
    return Tab(
        comparison.name, comparison.title, chosen.sentence, comparison.note.partition("A QUICK LOOK, ")[2],
        found.fails, chart, films, sections, choice.numbers(chosen, results), about,
    )  # fmt: skip


def _method(found: Sequence[Analysis], own: bool) -> Section:
    comparisons = [each.comparison for each in found]
    alone = [each for each in found if not each.comparison.operated]
    scenarios = "; ".join(dict.fromkeys(_scenarios(comparison.scenarios) for comparison in comparisons))
    over = "training seeds and scenarios"
    if max(len(comparison.seeds) for comparison in comparisons) == 1:
        over = "scenarios; they do not include the scatter of trainings, as there is one policy"
    measure = ("" if own else " This measure was fixed before the first results. Earlier versions of these policies "
               "were reported on the same test set; later changes were chosen on the validation set.")  # fmt: skip
    return Section("All set-ups: method", [
        f"All contestants meet the same scenarios: {scenarios}. Intervals are 95 %, of a bootstrap over {over} "
        f"({RESAMPLES:,} resamples). The primary measure is V_p at the paper's mean approach time, interpolated "
        f"linearly between two time weights of the policy.{measure} {_limits(comparisons)}",
        Table.joined("V_p at the mean time of the paper's rule, against the rule",
                     [summary.row(each.summary, each.results) for each in alone], "report-answers"),
        Table.joined("Share of each step from the rule to the policy in the reduction of V_p; 95 % intervals",
                     [ablation.row(each.steps, each.results) for each in alone], "report-ablation"),
        Table.joined("The simplest controller whose cost is not clearly above the lowest, at the typical time weight",
                     [choice.row(each.choice, each.results) for each in found], "report-choices"),
        Table.joined("Mean cost (m/s) and missed objects with one thing changed",
                     [row for each in found for row in robustness.rows(each.results)], "report-robustness"),
        Section("Glossary and commands", [TERMS], folded=True),
    ], folded=True, key="all")  # fmt: skip


def _limits(comparisons: Sequence[Comparison]) -> str:
    names = defaultdict(list)
    for comparison in comparisons:
        task = Task(**comparison.environment)
        names[f"{task.acceleration_range[1]:g} m/s² and {task.velocity_range[1]:g} m/s"].append(comparison.name)
    clauses = [f"{limits} ({', '.join(users)})" if len(names) > 1 else limits for limits, users in names.items()]
    return f"Policies and tuned baselines may use up to {'; '.join(clauses)}."


def _scenarios(scenarios: Mapping[str, Any]) -> str:
    if "set" in scenarios:
        return f"the first {scenarios['count']:,} of the frozen set {scenarios['set']}"
    source = "from a file" if "table" in scenarios else f"drawn from {json.dumps(scenarios['ranges'])}"
    return f"{scenarios['count']:,} {source}, with seeds from {scenarios['seed']:,} on"


def watch(results: ComparisonResults, recommended: str) -> dict[str, dict[str, Any]]:
    """Return films of the rule beside each other contestant, first the recommended, by label, at the typical weight.

    The films after the first show only its first scenarios.
    """
    comparison, weight = results.comparison, results.comparison.typical
    frozen, task = frozen_of(comparison.scenarios), Task(**comparison.environment)
    seed, environment = frozen.seed if frozen else comparison.scenarios["seed"], dict(comparison.environment)
    others = sorted((comparison.policy, *comparison.baselines[1:]), key=lambda each: each.name != recommended)
    rule, scenes, watched = results.paper[weight], dict[str, int](), {}
    for other in others:
        played = {PAPER: rule, comparison.words[other.name]: results.runs[other.name][weight]}
        contestants = zip(played, (comparison.baselines[0], other), strict=True)
        controllers = {name: controller_of(each.controller, weight, task) for name, each in contestants}
        scenes = dict(list(scenes.items())[:OF_OTHERS]) if scenes else choose(*played.values())
        film = films(controllers, scenes, played, seed, {**environment, "time_weight": weight})
        about = {PAPER: comparison.baselines[0].about, comparison.words[other.name]: other.about}
        for run in (run for scene in film["scenes"] for run in scene["runs"] if not comparison.operated):
            run["sentence"] = about[run["name"]]
        watched[comparison.words[other.name] + ", recommended" * (other.name == recommended)] = film
    return watched

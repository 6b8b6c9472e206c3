"""The page of the report: a tab for each set-up, with the answer on the first screen and the details below."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from agents.evaluate.play import controller_of, frozen_of
from agents.provenance import todays
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.player import choose, films, fragment
from experiments.report import ablation, answer, choice, holds, tables
from experiments.report.matchups import PAPER, POLICY, Matchup
from experiments.report.played import Played
from impact_gym.task import Task

CHOSEN_ON = {  # words for the scenarios of `jobs.calibration_scenarios`; the keys are keys of `Matchup.scenarios`
    "table": "these scenarios themselves", "set": "the first scenarios of the validation set",
    "ranges": "other scenarios from the same ranges",
}  # fmt: skip

ABOUT = {  # captions of the contestants in the film
    PAPER: "constant speed; brakes once it senses the touch",
    POLICY: "neural network, trained to touch soon and gently",
}


@dataclass(frozen=True)
class Tab:
    """Content of the page about one set-up."""

    matchup: Matchup
    answer: answer.Answer
    choice: choice.Choice
    steps: Sequence[ablation.Step]
    headline: str  # the recommended controller, and the answer without intervals
    fails: holds.Failing
    chart: Picture
    summary: str  # the answer with intervals
    engineer: Sequence[Section]
    statistician: Sequence[Section]
    film: Markup


def tab(played: Played) -> Tab:
    """Return the tab of a matchup."""
    matchup, steps, result = played.matchup, ablation.steps_of(played), answer.answer(played)
    chosen = choice.choice(played)
    engineer = [Section("Which controller to take", [choice.table(chosen, played)], key="choice")]
    if matchup.operated:  # the page of a set-up with an operator shows no ablation
        short = answer.assisted(played)
        summary = f"{matchup.name} ({matchup.note}): {answer.assisted(played, intervals=True)}"
    else:
        short = answer.at_rule_time(result, played)
        summary = answer.sentence(result, matchup) + ablation.sentence(steps)
        engineer += [
            Section("At about the paper's approach time: mean and tail", [tables.at_one_time(played)]),
            Section("Ablation: where the gain comes from", [ablation.table(steps, matchup.labels)]),
        ]
    engineer += [
        Section("Times, velocities and forces", [tables.measures(played)], key="forces"),
        Section("Robustness", [holds.heat_map(played)], key="robustness"),
        Section("Robustness: every change", [holds.table(played)], folded=True),
    ]
    chosen_on = next(words for kind, words in CHOSEN_ON.items() if kind in matchup.scenarios)
    note = (f"The weight for the paper's approach time was chosen on {chosen_on}, so the mean times of policy and "
            "rule differ slightly here.")  # fmt: skip
    answered = [summary] if matchup.operated else [tables.answered(result, played), note]
    statistician = [
        Section("The answer", answered, key="answer"),
        Section("Trade-off of all seeds and baselines", [tables.trade_off(played), tables.by_weight(played)],
                folded=True, key="trade-off"),
    ]  # fmt: skip
    return Tab(
        matchup, result, chosen, steps, f"{chosen.sentence} {short}",
        holds.where_it_fails(played, chosen.controller), tables.trade_off(played, first_screen=True), summary, engineer,
        statistician, Markup(fragment(watch(played), f"watch-{matchup.name}")),
    )  # fmt: skip


def policies_table(all_played: Sequence[Played]) -> Table:
    """Return the table of the median seeds of all set-ups."""
    body = []
    for played in all_played:
        matchup, (weight,) = played.matchup, played.as_late[played.matchup.chosen].weights
        name = f"{matchup.title} ({matchup.name})" if matchup.title else matchup.name
        trained_by, checksum = todays(matchup.provenance.get("command", "-")), matchup.policy.checksum[:16]
        body.append((name, matchup.chosen, str(len(matchup.seeds)), trained_by, f"{weight:.4g}", checksum))
    head = ("set-up", "median seed", "seeds", "trained by", "weight at the paper's approach time (m/s per s)",
            "checksum")  # fmt: skip
    return Table("The policies; checksums of all contestants are in results.json", head, body)


def watch(played: Played) -> dict[str, Any]:
    """Return films of notable scenarios: the paper's rule, and the policy at about the rule's mean approach time."""
    matchup, as_late = played.matchup, played.as_late[played.matchup.chosen]
    (weight,) = as_late.weights
    runs = {PAPER: played.paper.at(weight), POLICY: as_late.at(weight)}
    frozen, task = frozen_of(matchup.scenarios), Task(**matchup.environment)
    specs = {PAPER: matchup.baselines[0].controller, POLICY: matchup.policy.controller}
    controllers = {name: controller_of(spec, weight, task) for name, spec in specs.items()}
    seed = frozen.seed if frozen else matchup.scenarios["seed"]
    watched = films(controllers, choose(*runs.values()), runs, seed, {**matchup.environment, "time_weight": weight})
    if not matchup.operated:
        for run in (run for scene in watched["scenes"] for run in scene["runs"]):
            run["sentence"] = ABOUT[run["name"]]
    return watched

"""The page: a tab for each set-up, with the answer on one screen, then parts for the engineer and the statistician."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import vl_convert
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from agents.evaluate.controllers import controller_of
from agents.evaluate.play import frozen_of
from experiments.lab import page, player
from experiments.lab.player import choose, films, fragment
from experiments.report import answer, bars, chain, differences, first_screen, robustness, shield, weaknesses
from experiments.report.figures import Figure
from experiments.report.matchups import PAPER, POLICY, Matchup
from experiments.report.played import Played
from experiments.report.tables import HeatMap, Table
from impact_gym.task.scenario import FIELDS

Part = Figure | Table | HeatMap | str
KINDS = {Figure: "figure", Table: "table", HeatMap: "heat_map", str: "paragraph"}
"""Macros of parts.html.jinja that show a part of a fold."""
ONE_AT_A_TIME = ("One thing is changed at a time; policy and baselines stay as they were trained and tuned. The alarm "
                 "is a switch that noise of the force does not reach, so a baseline that looks at nothing else is the "
                 "same at any noise. A stiffer coupling keeps its damping ratio.")  # fmt: skip
SOLVERS = ("Every policy once more with a hundredth of the tolerance and with the dissipation that delivers the "
           "nominal restitution exactly instead of Hu and Guo's; and the median seed and two baselines in an "
           "independent solver of the whole episode, written with SciPy's integrators.")  # fmt: skip


@dataclass(frozen=True)
class Fold:
    """A part of a tab, open or folded."""

    heading: str
    parts: Sequence[Part]
    closed: bool = True
    key: str = ""  # of a link to it


@dataclass(frozen=True)
class Tab:
    """Content of the page about one set-up."""

    matchup: Matchup
    answer: answer.Answer
    steps: Sequence[chain.Step]
    bars: Sequence[bars.Bar]
    headline: str
    fails: weaknesses.Failing
    chart: Figure
    sentence: str  # the answer with its intervals
    scenarios: int
    engineer: Sequence[Fold]
    statistician: Sequence[Fold]
    film: Markup

    @property
    def figures(self) -> list[Figure]:
        """All figures of the tab."""
        parts = [part for fold in (*self.engineer, *self.statistician) for part in fold.parts]
        return [self.chart, *(part for part in parts if isinstance(part, Figure))]


def tab(played: Played, all_played: Sequence[Played]) -> Tab:
    """Return the tab of a matchup, whose bars may refer to the other matchups of the report."""
    matchup, steps, targets = played.matchup, chain.chain(played), bars.bars(played, all_played)
    result = answer.answer(played)
    told = answer.sentence(result, matchup) + chain.sentence(steps)
    if matchup.operated:
        told = f"{matchup.name} ({matchup.note}): {first_screen.assisted(played, intervals=True)}"
    return Tab(
        matchup, result, steps, targets, first_screen.headline(result, played), weaknesses.where_it_fails(played),
        first_screen.chart(result, played), told, played.count,
        _engineer(played, steps), _statistician(played, targets),
        Markup(fragment(watch(played), f"watch-{matchup.name}")),
    )  # fmt: skip


def _engineer(played: Played, steps: Sequence[chain.Step]) -> list[Fold]:
    heading = "Ablation: gain from limits, knowing where, shape, estimate, learning"
    own = [
        Fold(heading, [chain.table(steps, played.matchup.labels)], closed=False),
        Fold("What a limit of force would cost", [shield.table(played)]),
    ]
    first, last = ([], []) if played.matchup.operated else (own[:1], own[1:])  # an operator's command is none of these
    return [
        *first,
        Fold("What it learned", [differences.approach(played)], closed=False, key="learned"),
        Fold("Forces, and what the objects get", [differences.measures(played)], closed=False, key="forces"),
        *last,
        Fold("Does it hold?", [weaknesses.heat_map(played)], closed=False, key="robustness"),
        Fold(
            "Each of these by itself",
            [ONE_AT_A_TIME, robustness.changes_table(played), *robustness.travel_table(played)],
        ),
    ]


def _statistician(played: Played, targets: Sequence[bars.Bar]) -> list[Fold]:
    seeds = [answer.seeds_table(played)] if len(played.seeds) > 1 else []
    trade_off: list[Part] = [
        answer.trade_off(played),
        answer.weights_table(played),
        *seeds,
        answer.hypervolumes(played),
    ]
    chosen_on = {
        "table": "these scenarios themselves", "set": "the first half of the validation set",
        "ranges": "other scenarios from the same ranges",
    }  # fmt: skip
    kind = next(kind for kind in chosen_on if kind in played.matchup.scenarios)
    note = (f"The weight that makes a policy as late as the paper's rule was found on {chosen_on[kind]}, so the two "
            "are equally late only nearly here.")  # fmt: skip
    by_field: list[Part] = [note, *(differences.paired(played, field) for field in FIELDS)]
    return [
        Fold("The trade-off of every seed and every baseline", trade_off, key="trade-off"),
        Fold("Targets and results", [bars.table(targets)], key="bars"),
        Fold("Where the policy wins, and where not", by_field, key="differences"),
        Fold("Is it the simulator?", [SOLVERS, robustness.simulator(played)], key="simulator"),
    ]


def policies_table(all_played: Sequence[Played]) -> Table:
    """Return the median policies of all set-ups."""
    body = [
        (matchup.label, matchup.chosen, str(len(matchup.seeds)), matchup.provenance.get("command", "-"),
         f"{played.policy_as_late.weights[0]:.4g}", matchup.policy.checksum[:16])
        for played in all_played for matchup in [played.matchup]
    ]  # fmt: skip
    head = ("set-up", "median seed", "seeds", "trained by", "weight as late as the rule (m/s per s)", "checksum")
    return Table("The policies; checksums of all contestants are in results.json", head, body)


def watch(played: Played) -> dict[str, Any]:
    """Return the films of a dozen scenarios of a matchup: the rule and the policy, as late."""
    matchup, as_late = played.matchup, played.policy_as_late
    (weight,) = as_late.weights
    runs = {PAPER: played.paper.at(weight), POLICY: as_late.at(weight)}
    players = {PAPER: matchup.baselines[0], POLICY: matchup.policy}
    frozen, environment = frozen_of(matchup.scenarios), dict(matchup.environment)
    if frozen is None:
        environment["scenario"] = {name: tuple(pair) for name, pair in matchup.scenarios["ranges"].items()}
    return films(
        {name: controller_of(contestant.controller, weight, environment) for name, contestant in players.items()},
        choose(runs[PAPER], runs[POLICY]),
        runs,
        seed=frozen.seed if frozen else matchup.scenarios["seed"],
        frozen=frozen,
        environment=environment,
        time_weight=weight,
    )


def write(folder: Path, about: Mapping[str, Any], tabs: Sequence[Tab], all_played: Sequence[Played]) -> Path:
    """Write the page, and into `folder`/figures all its figures with their data; return its path."""
    (folder / "figures").mkdir()
    for figure in (figure for tab in tabs for figure in tab.figures):
        figure.save(folder / "figures")
    bundle = vl_convert.javascript_bundle()  # type: ignore[call-arg]  # its stub asks for what it does not need
    program = bundle.replace("</script", "<\\/script")  # what draws the charts
    tables = {
        "table": answer.answers_table([tab.answer for tab in tabs], all_played),
        "policies": policies_table(all_played),
        "seeds": max(len(played.seeds) for played in all_played),
    }
    return page.write(
        folder,
        "report",
        runs=[about],
        about={**about, **tables},
        tabs=tabs,
        vega=Markup(program),
        player=player,
        kind=lambda part: KINDS[type(part)],
        embedded=partial(htmlsafe_json_dumps, separators=(",", ":"), allow_nan=False),
    )

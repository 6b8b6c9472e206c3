"""The page: sections of figures and tables, one file that opens from disk."""

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import vl_convert
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from agents.evaluate.controllers import controller_of
from agents.evaluate.play import frozen_of
from agents.evaluate.stage import Episodes
from experiments.lab.player import choose, films, fragment
from experiments.report import answer, bars, differences, learned, robustness
from experiments.report.figures import Figure, Table
from experiments.report.matchups import PAPER, POLICY
from experiments.report.results import Played, Run

HERE = Path(__file__).parent
Section = list[Figure | Table]


def sections(played: list[Played], first: bool = False) -> dict[str, dict[str, Section]]:
    """Return what each section shows of each matchup; of a first page, that of the trade-off alone."""
    found: dict[str, dict[str, Section]] = {
        "trade-off": {}, "bars": {}, "differences": {}, "learned": {}, "robustness": {}, "simulator": {}
    }  # fmt: skip
    for one in played:
        name = one.matchup.name
        found["trade-off"][name] = [answer.trade_off(one), answer.weights_table(one), answer.fronts_table(one)]
        if first:
            continue
        found["differences"][name] = [
            differences.measures(one), differences.distribution(one), *differences.breakdown(one)
        ]  # fmt: skip
        reacted = [learned.reaction(one)] if one.reactions["since"].size else []  # else no alarm came
        found["learned"][name] = [learned.approach(one), *reacted, *learned.urgency(one)]
        found["bars"][name] = [bars.table(bars.bars(one, played))]
        found["robustness"][name] = [*robustness.figures(one), robustness.categories(one)]
        found["simulator"][name] = [robustness.simulator(one)]
    return found


def figures(parts: Mapping[str, Mapping[str, Section]]) -> list[Figure]:
    """Return all figures of the page."""
    return [
        one for by_matchup in parts.values() for part in by_matchup.values() for one in part if isinstance(one, Figure)
    ]


def watch(played: Played) -> tuple[str, dict[str, Any]]:
    """Return the name of a matchup and the films of a dozen of its scenarios: the rule and the policy, as late."""
    matchup = played.matchup
    late = played.policy_as_late
    weight = late.weights[0]
    players = {PAPER: matchup.baselines[0], POLICY: matchup.policy}
    runs = {PAPER: episodes_of(played.paper), POLICY: episodes_of(late)}
    frozen = frozen_of(matchup.scenarios)
    environment = dict(matchup.environment)
    if frozen is None:
        environment["scenario"] = {name: tuple(pair) for name, pair in matchup.scenarios["ranges"].items()}
    seed = frozen.seed if frozen else matchup.scenarios["seed"]
    shown = films(
        {name: controller_of(one.controller, weight, environment) for name, one in players.items()},
        choose(runs[PAPER], runs[POLICY]),
        runs,
        seed=seed,
        frozen=frozen,
        environment=environment,
        time_weight=weight,
    )
    return matchup.name, shown


def episodes_of(run: Run) -> Episodes:
    """Return the results at a run's first weight as episodes."""
    return Episodes(
        **{
            name: run[name][0] for name in ("object_velocity", "approach_time", "peak_force", "contact_count", "missed")
        },
        scenario=run.scenario,
    )


def render(about: Mapping[str, Any], parts: Mapping[str, Any], shown: Mapping[str, Any]) -> str:
    """Return the page."""
    pages = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    pages.globals["is_figure"] = lambda part: isinstance(part, Figure)
    pages.globals["embedded"] = embedded
    template = pages.get_template("page.html.jinja")
    players = {name: Markup(fragment(each, f"watch-{name}")) for name, each in shown.items()}
    return template.render(about=about, parts=parts, players=players, vega=vega())


@cache
def vega() -> Markup:
    """Return the program that draws the charts."""
    return Markup(vl_convert.javascript_bundle().replace("</script", "<\\/script"))


def embedded(content: Any) -> Markup:
    """Return JSON that may stand in a script element."""
    return Markup(json.dumps(content, separators=(",", ":"), allow_nan=False).replace("</", "<\\/"))

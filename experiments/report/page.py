"""The page: sections of figures and tables, one file that opens from disk."""

from collections import defaultdict
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import vl_convert
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps
from markupsafe import Markup

from agents.evaluate.controllers import controller_of
from agents.evaluate.play import frozen_of
from experiments.lab.player import choose, films, fragment
from experiments.report import answer, bars, differences, learned, robustness, shield
from experiments.report.figures import Figure, Table
from experiments.report.matchups import PAPER, POLICY
from experiments.report.results import Played

HERE = Path(__file__).parent
Section = list[Figure | Table]


def sections(played: list[Played], first: bool = False) -> dict[str, dict[str, Section]]:
    """Return what each section shows of each matchup; of a first page, that of the trade-off alone."""
    found: dict[str, dict[str, Section]] = defaultdict(dict)
    for one in played:
        name = one.matchup.name
        found["trade-off"][name] = [answer.trade_off(one), answer.weights_table(one), answer.fronts_table(one)]
        if len(one.seeds) > 1:
            found["trade-off"][name].append(answer.seeds_table(one))
        if first:
            continue
        found["bars"][name] = [bars.table(bars.bars(one, played))]
        shown = [differences.measures(one), differences.distribution(one), *differences.breakdown(one)]
        found["differences"][name] = shown
        reacted = [learned.reaction(one)] if one.reactions["since"].size else []  # else no alarm came
        found["learned"][name] = [learned.approach(one), *reacted, *learned.urgency(one)]
        found["robustness"][name] = [*robustness.figures(one), robustness.categories(one), shield.table(one)]
        found["simulator"][name] = [robustness.simulator(one)]
    return found


def figures(parts: Mapping[str, Mapping[str, Section]]) -> list[Figure]:
    """Return all figures of the page."""
    return [
        one for by_matchup in parts.values() for part in by_matchup.values() for one in part if isinstance(one, Figure)
    ]


def watch(played: Played) -> dict[str, Any]:
    """Return the films of a dozen scenarios of a matchup: the rule and the policy, as late."""
    matchup, late = played.matchup, played.policy_as_late
    (weight,) = late.weights
    runs = {PAPER: played.paper.at(weight), POLICY: late.at(weight)}
    players = {PAPER: matchup.baselines[0], POLICY: matchup.policy}
    frozen, environment = frozen_of(matchup.scenarios), dict(matchup.environment)
    if frozen is None:
        environment["scenario"] = {name: tuple(pair) for name, pair in matchup.scenarios["ranges"].items()}
    return films(
        {name: controller_of(one.controller, weight, environment) for name, one in players.items()},
        choose(runs[PAPER], runs[POLICY]),
        runs,
        seed=frozen.seed if frozen else matchup.scenarios["seed"],
        frozen=frozen,
        environment=environment,
        time_weight=weight,
    )


def render(about: Mapping[str, Any], parts: Mapping[str, Any], shown: Mapping[str, Any]) -> str:
    """Return the page."""
    pages = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    pages.globals["is_figure"] = lambda part: isinstance(part, Figure)
    pages.globals["embedded"] = partial(htmlsafe_json_dumps, separators=(",", ":"), allow_nan=False)
    players = {name: Markup(fragment(each, f"watch-{name}")) for name, each in shown.items()}
    vega = Markup(vl_convert.javascript_bundle().replace("</script", "<\\/script"))  # the program that draws the charts
    return pages.get_template("page.html.jinja").render(about=about, parts=parts, players=players, vega=vega)

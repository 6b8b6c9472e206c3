"""What a limit of force costs: the policy with a shield around it, and the shield by itself."""

from collections.abc import Iterator, Mapping
from typing import Any

from agents.baselines.permitted import permitted

from experiments.report.matchups import POLICY, Contestant, Matchup
from experiments.report.played import Played, Run
from experiments.report.tables import Table
from impact_gym.task import Task
from impact_gym.task.scenario import NAMED

LIMITS = (20.0, 50.0, 100.0, 200.0)  # N
ALONE = "the shield alone"


def speeds(matchup: Matchup) -> dict[float, float | str]:
    """Return by limit (N) the speed (m/s) at which objects may be met, or why there is no shield."""
    by_limit: dict[float, float | str] = {}
    for limit in LIMITS:
        try:
            by_limit[limit] = permitted(Task(**{**matchup.environment, "scenario": _ranges(matchup)}), limit)
        except ValueError as error:
            by_limit[limit] = str(error)
    return by_limit


def _ranges(matchup: Matchup) -> Mapping[str, Any] | str:
    """Return the ranges of the scenarios; a table, or a user's own set, has none."""
    ranges = matchup.scenarios.get("ranges", matchup.scenarios.get("set"))
    if not isinstance(ranges, Mapping) and ranges not in NAMED:
        raise ValueError("the scenarios are from no ranges that are known")
    return ranges


def shielded(matchup: Matchup) -> Iterator[tuple[float, Contestant]]:
    """Yield for each limit (N) the shield alone, which knows no weight, and around the median seed."""
    for limit, speed in speeds(matchup).items():
        for name, inner in {ALONE: None, POLICY: matchup.policy.controller}.items():
            if not isinstance(speed, str):
                spec = {"shield": limit, "scenario": _ranges(matchup), "of": inner}
                yield limit, Contestant(name, spec, (matchup.typical,), "")


def table(played: Played) -> Table:
    """Return the table of all limits."""
    weight, unshielded = played.matchup.typical, played.policy
    body = [_row("-", "-", POLICY, unshielded, unshielded, weight, "-")]
    for limit, speed in speeds(played.matchup).items():
        if isinstance(speed, str):
            body.append((f"{limit:g}", f"none: {speed}", *[""] * 7))
            continue
        for name in (ALONE, POLICY):
            run = played.shielded[limit, name]
            above_limit = f"{(run.at(weight).peak_force > limit).sum()}"
            if name == POLICY:
                above_limit += f", {(unshielded.at(weight).peak_force > limit).sum()} without it"
            body.append(_row(f"{limit:g}", f"{speed:.3f}", name, run, unshielded, weight, above_limit))
    head = ("limit (N)", "may meet objects at (m/s)", "contestant", "largest force (N)", "above the limit", "T (s)",
            "later than the policy without it (s)", "V_p (m/s)", "missed")  # fmt: skip
    caption = (
        f"What a limit of force costs: a shield slows commands down, so that the heaviest and stiffest object of these "
        f"ranges is met slowly enough, too. {played.count} scenarios, w = {weight:g}; a miss takes until the horizon"
    )
    return Table(caption, head, body)


def _row(
    limit: str, speed: str, name: str, run: Run, unshielded: Run, weight: float, above_limit: str
) -> tuple[str, ...]:
    mean, later = run.means(weight), run.means(weight)["T"] - unshielded.means(weight)["T"]
    largest = run.at(weight).peak_force.max()
    means = f"{mean['T']:.3f}", f"{later:+.3f}", f"{mean['V']:.3f}", f"{mean['missed']}"
    return limit, speed, name, f"{largest:.1f}", above_limit, *means

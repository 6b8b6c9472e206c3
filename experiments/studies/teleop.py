"""Which assistance helps an operator who acts late: couplings x delays x operators x channels, all contestants in each.

An operator steers towards an object that they believe up to 5 cm beside its place, over a channel, and stop a reaction
after they see the touch. An assistance at the arm senses the touch at once.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from markupsafe import Markup
from matplotlib.figure import Figure
from polars import selectors

from agents.baselines import LocalBrake, OperatorAlone
from agents.evaluate import ScenarioBatch
from agents.setups import load_setup
from experiments.lab import grid
from experiments.lab.charts import SERIES
from experiments.lab.grid import Contestant, Place
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.player import films, fragment
from experiments.lab.statistics import Estimate, Floats, Resamples, along, estimate
from experiments.lab.study import Cell, Findings, Frames, Measurement, Row, Study
from impact_gym.task import Task
from impact_gym.teleop.channels import FIFTH_GENERATION

COUPLINGS = ("rigid", "spring", "bistable")
DELAYS, TYPICAL = (0.0, 0.05, 0.1, 0.2, 0.4), 0.2  # s, there and back
BELIEF = {"place_error": [-0.05, 0.05], "creep": [0.05, 0.15]}
WAY, RECORDINGS, APART = 0.9, 8, 8.0  # m, of each recording; how many; s, between their starts


def recordings() -> dict[str, Any]:
    """Return recordings that no training saw: eight random speeds in each, with two hesitations."""
    rng, times, velocities = np.random.default_rng(0), list[float](), list[float]()
    for begin in APART * np.arange(RECORDINGS):
        speeds = np.concatenate([[0.0], rng.uniform(0.1, 0.45, 8), [0.0]])
        speeds[rng.choice(np.arange(2, 8), 2, replace=False)] = 0.03
        times += (begin + WAY / speeds.sum() * np.arange(len(speeds))).tolist()
        velocities += speeds.tolist()
    return {"type": "Replay", "time": times, "velocity": velocities, "length": APART, "recording": [0, RECORDINGS]}


REACH, SEEN = "reach", "training's recordings"
HELD_OUT: Mapping[str, Mapping[str, Any]] = {
    "tracker": {"type": "Tracker", **BELIEF},
    "hand": {"type": "SecondOrderLag", **BELIEF},
    "steady": {"type": "Trapezoid", "speed": [0.1, 0.4]},
    "recordings": recordings(),
}
"""Operators that no policy was trained with and no rule tuned for; those of the set-ups come before them."""
OPERATORS = (REACH, SEEN, *HELD_OUT)
ALONE, RULE, BRAKE, LIMIT, POLICY = "operator alone", "paper's rule", "local brake", "speed limit", "policy"
ASSISTANCE = (ALONE, RULE, BRAKE, LIMIT, POLICY)
GAINS = np.linspace(0.3, 1.0, 8)
MEASURES = ("object_velocity", "slide", "done_time", "taken", "missed")
RIVALS = {"gain": "constant gains", "brake": f"the {BRAKE}", "limit": f"the {LIMIT}"}
"""Whom contestants are compared with, by columns of the table of cells."""
WORSE = {f"{rival}_{name}": words.format(who) for rival, who in RIVALS.items() if rival != "limit"
         for name, words in {"slide": "slides further than with {}", "cost": "costs more than {}"}.items()}  # fmt: skip
COLOURS = {ALONE: SERIES[3], BRAKE: SERIES[4], LIMIT: SERIES[2], POLICY: SERIES[1]}
SHOWN = {"slide": (100.0, "slide (cm)"), "done_time": (1.0, "done (s)")}
"""Rows of the figure: columns of the table of cells, their factor and words."""


def environment_of(coupling: str, operator: str, link: Any) -> dict[str, Any]:
    """Return the environment of a cell, both channels alike."""
    setup = load_setup(f"teleop-{coupling}")
    others = {SEEN: setup.mixed[0][1]["operator"], **HELD_OUT}
    who = others.get(operator, setup.environment["operator"])
    return {**setup.environment, "operator": who, "uplink": link, "downlink": link}


def places(quick: bool) -> Iterator[Place]:
    """Yield where contestants meet: behind each operator at each delay, and over three measured grades of 5G."""
    delays, operators = ([TYPICAL], [REACH, "steady"]) if quick else (DELAYS, OPERATORS)
    cells = [(*cell, "") for cell in product(COUPLINGS, delays, operators)]
    cells += [
        (coupling, 2e-3 * float(name[3:-2]), REACH, name) for coupling, name in product(COUPLINGS, FIFTH_GENERATION)
    ]
    for coupling, delay, operator, channel in cells:
        link = asdict(FIFTH_GENERATION[channel]) if channel else {"delay": 0.5 * delay}
        labels = {"coupling": coupling, "delay": delay, "operator": operator, "channel": channel}
        environment = environment_of(coupling, operator, link)
        yield Place(f"teleop-{coupling}", f"{operator}, {1e3 * delay:g} ms", environment, labels)


def contestants(setup: str) -> list[Contestant]:
    """Return who assists, constant gains among them."""
    fixed = {ALONE: "operator-alone", RULE: "paper-trapezoid", BRAKE: "local-brake", LIMIT: f"{setup}-limit"}
    everybody = [Contestant(name, {"baseline": baseline}) for name, baseline in fixed.items()]
    gains = [Contestant(f"gain {gain:g}", {"rule": ["ConstantGain", [gain, 20.0]]}) for gain in GAINS[:-1]]
    return [*everybody, *grid.seeds_of(setup, POLICY), *gains]


def assisted(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each contestant in each place."""
    scenarios = {"set": "test", "count": 40 if quick else 500}
    for place in places(quick):
        weights = [load_setup(place.setup).evaluation.typical]
        yield from grid.cells([place], contestants(place.setup), scenarios, weights, lenient=True)


LABELS = ("coupling", "delay", "operator", "channel")


def cell_rows(labels: Row, rows: pl.DataFrame, weight: float, missed_cost: float) -> Iterator[dict[str, Any]]:
    """Yield a row for each contestant of a cell: means over scenarios and seeds with intervals, and beside its rivals.

    Its slide is compared with that of the constant gains at the mean time at which it is done itself, along the line
    through all of them, its cost with that of the best of them.
    """
    rows = rows.with_columns(grid.cost(weight, missed_cost).alias("cost"))
    values: dict[str, dict[str, Floats]] = {
        who: {name: grid.sample(each, name) for name in (*MEASURES, "cost")}
        for (who,), each in grid.groups(rows, "contestant")
    }
    resamples = Resamples(values[ALONE]["cost"].shape[1])
    gains = [*(values.pop(f"gain {gain:g}") for gain in GAINS[:-1]), values[ALONE]]
    means = {who: {name: resamples.means(sample) for name, sample in each.items()} for who, each in values.items()}
    times, slides, costs = (np.stack([resamples.means(gain[name]) for gain in gains], 1)
                            for name in ("done_time", "slide", "cost"))  # fmt: skip
    medians = np.array([[np.median(gain["slide"]) for gain in gains]])
    for who, ours in means.items():
        row: dict[str, Any] = {**labels, "contestant": who, "scenarios": resamples.scenarios, "weight": weight}
        row["median_slide"] = float(np.median(values[who]["slide"]))
        row["median_ratio"] = row["median_slide"] / float(along(times[:1], medians, ours["done_time"][:1])[0])
        for name, resampled in ours.items():
            row |= spread(name, estimate(resampled))
        front = {"slide": along(times, slides, ours["done_time"]), "cost": costs[:, int(costs[0].argmin())]}
        for rival, theirs in {"gain": front, "brake": means[BRAKE], "limit": means[LIMIT]}.items():
            for name in ("slide", "cost"):
                row |= spread(f"{rival}_{name}", estimate(theirs[name] - ours[name]))
        yield row


def spread(name: str, value: Estimate) -> dict[str, float]:
    """Return an estimate as columns."""
    return {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}


def table_of_cells(frames: Frames) -> list[dict[str, Any]]:
    """Return a row for each contestant in each cell."""
    rows = list[dict[str, Any]]()
    for labels, cell in grid.groups(frames["episodes"], *LABELS):
        setup = load_setup(f"teleop-{labels[0]}")
        cost = grid.missed_cost(setup.environment)
        rows += cell_rows(dict(zip(LABELS, labels, strict=True)), cell, setup.evaluation.typical, cost)
    return rows


def hurts(found: Sequence[Row]) -> Iterator[tuple[str, ...]]:
    """Yield, for each assistance and each way in which it may hurt, the cells where it does, beyond their intervals.

    Assistance, what, how many cells, the largest loss, and where.
    """
    for who in (POLICY, LIMIT, BRAKE, RULE):
        for column, words in WORSE.items():
            worse = [row for row in found if row["contestant"] == who and row[f"{column}_high"] < 0.0]
            if worse:
                where: dict[str, list[str]] = {}
                for row in worse:
                    where.setdefault(f"{row['coupling']}, {row['operator']}", []).append(f"{1e3 * row['delay']:.0f}")
                last = min(worse, key=lambda row: row[column])
                scale, unit = (-100.0, "cm") if "slide" in column else (-1.0, "m/s")
                most = Estimate(*(scale * last[column + end] for end in ("", "_high", "_low")))
                listed = "; ".join(f"{cells}: {', '.join(delays)} ms" for cells, delays in where.items())
                yield who, words, f"{len(worse)}", f"{most:.2f} {unit} ({words_of(last)})", listed


def words_of(row: Row) -> str:
    """Return a cell in words."""
    return f"{row['coupling']}, {row['operator']}, {1e3 * row['delay']:.0f} ms"


def duel(found: Sequence[Row], rival: str) -> dict[str, Any]:
    """Return in how many cells the policy costs clearly less and clearly more than a rival, and the extremes."""
    ours = [row for row in found if row["contestant"] == POLICY]
    column = f"{rival}_cost"
    best, worst = max(ours, key=lambda row: row[column]), min(ours, key=lambda row: row[column])
    return {
        "rival": RIVALS[rival], "column": column, "cells": len(ours), "best": best, "worst": worst,
        "less": sum(row[f"{column}_low"] > 0.0 for row in ours),
        "more": sum(row[f"{column}_high"] < 0.0 for row in ours),
        "share": 100.0 * sum(row[column] for row in ours) / sum(row["cost"] + row[column] for row in ours),
    }  # fmt: skip


COMPARED = f"""95 % intervals over {{count}} scenarios that nothing was tuned or trained on, and over the seeds of each
policy. The cost is V_p + w times the time until all is done, w = {{weight:g}} m/s per s. Constant gains of 0.3 to 1 on
the command: on the line through all eight, read at the time at which the assistance is done. Policies were trained
behind {REACH}, with beliefs up to 30 cm off, and {SEEN}, which stop for no touch. Held out: a tracker of what they
see, a pointing hand, a steady speed, other recordings."""


def duel_sentence(result: Mapping[str, Any]) -> str:
    """Return a duel in words."""
    best, worst = (f"{form(result['column'], 3).format(**row)} m/s ({words_of(row)})"
                   for row in (result["best"], result["worst"]))  # fmt: skip
    return (f"The policy costs clearly less than {result['rival']} in {result['less']} of {result['cells']} cells and "
            f"clearly more in {result['more']}; over all {result['share']:.1f} % less. By how much less (below 0: "
            f"more): at the most {best}, at the least {worst}.")  # fmt: skip


def chart(found: Sequence[Row]) -> Figure:
    """Return slide and done time over the delay, for each coupling, means over the operators with intervals."""
    figure = Figure(figsize=(9.0, 5.4))
    panels = figure.subplots(len(SHOWN), len(COUPLINGS), sharey="row", sharex=True)
    frame = pl.DataFrame(found, infer_schema_length=None)
    for line, (name, (scale, words)) in zip(panels, SHOWN.items(), strict=True):
        for axes, (coupling, (who, colour)) in zip(np.repeat(line, len(COLOURS)), product(COUPLINGS, COLOURS.items()),
                                                   strict=True):  # fmt: skip
            ours = (
                frame.filter(coupling=coupling, contestant=who)
                .group_by("delay")
                .agg(selectors.numeric().mean())
                .sort("delay")
            )
            value, low, high = (scale * ours[column].to_numpy() for column in (name, f"{name}_low", f"{name}_high"))
            times = 1e3 * ours["delay"].to_numpy()
            axes.plot(times, value, "o-", color=colour, label=who, markersize=4)
            axes.fill_between(times, low, high, color=colour, alpha=0.15, linewidth=0.0)
        line[0].set(ylabel=words, ylim=(0.0, None))
    for axes, coupling in zip(panels[0], COUPLINGS, strict=True):
        axes.set(title=coupling)
    for axes in panels[-1]:
        axes.set(xlabel="delay there and back (ms)")
    panels[0, -1].legend(fontsize=8)
    return figure


def form(name: str, digits: int) -> str:
    """Return the format string of a column with its interval."""
    return f"{{{name}:.{digits}f}} [{{{name}_low:.{digits}f}}, {{{name}_high:.{digits}f}}]"


def in_cm(row: Row) -> dict[str, Any]:
    """Return a row with its slides in cm."""
    return {name: 100.0 * value if "slide" in name else value for name, value in row.items()}


def listed(rows: Sequence[Row]) -> Table:
    """Return the table of cells."""
    scaled = [{**in_cm(row), "delay": 1e3 * row["delay"], "missed": 100.0 * row["missed"]} for row in rows]
    return Table.of("", scaled, {
        "coupling, operator": "{coupling}, {operator} {channel}", "delay (ms)": "{delay:.0f}",
        "assistance": "{contestant}", "slides (cm)": form("slide", 2), "median, over the gains'": "{median_ratio:.2f}",
        "done (s)": form("done_time", 2), "taken": "{taken:.2f}", "missed (%)": "{missed:.1f}",
        "less than gains as late (cm)": form("gain_slide", 2), "costs less than the brake (m/s)": form("brake_cost", 3),
    })  # fmt: skip


def answer(held_out: Sequence[Row]) -> str:
    """Return how far the object slides alone, with the brake and with the policy, at the typical delay."""
    frame = pl.DataFrame(held_out, infer_schema_length=None).filter(delay=TYPICAL)
    parts = []
    for coupling in frame["coupling"].unique(maintain_order=True):
        means = (
            np.mean(frame.filter(coupling=coupling, contestant=who)["slide"].to_numpy())
            for who in (ALONE, BRAKE, POLICY)
        )
        alone, brake, policy = (f"{100.0 * mean:.1f}" for mean in means)
        parts.append(f"{coupling} {alone} cm alone, {brake} with the brake, {policy} with the policy")
    return (f"How far the object slides, {1e3 * TYPICAL:.0f} ms there and back, mean of operators that were held out: "
            f"{'; '.join(parts)}.")  # fmt: skip


def watched(coupling: str, count: int) -> dict[str, Any]:
    """Return films of an operator alone and with a local brake, 100 ms away: a typical scenario, the worst of each."""
    environment = environment_of(coupling, REACH, {"delay": 0.1})
    rules: dict[str, Any] = {ALONE: OperatorAlone(), BRAKE: LocalBrake()}
    task = Task(**environment)
    players = {name: rule.for_task(task) for name, rule in rules.items()}
    stage = ScenarioBatch.of("test", count, task, threads=1, quiet=True)
    results = {name: stage.play(player) for name, player in players.items()}
    alone, brake = (np.asarray(results[name].slide, float) for name in (ALONE, BRAKE))
    numbers = {
        "Alone, it slides the median way": int(np.argsort(alone)[count // 2]),
        "Alone, it slides farthest": int(np.argmax(alone)),
        "With the brake, it slides farthest": int(np.argmax(brake)),
        "The brake helps least": int(np.argmin(alone - brake)),
    }
    return films(players, numbers, results, environment=environment)


def analyse(frames: Frames, _: bool) -> Findings:
    """Return what the episodes say."""
    found = table_of_cells(frames)
    plain = [row for row in found if not row["channel"]]
    typical = [row for row in plain if row["delay"] == TYPICAL]
    held_out = [row for row in plain if row["operator"] in HELD_OUT]
    trained = [row for row in plain if row["operator"] not in HELD_OUT]
    count, weight = found[0]["scenarios"], found[0]["weight"]
    duels = [duel(plain, rival) for rival in ("brake", "limit")]
    worse = list(hurts(plain))
    compared = COMPARED.format(count=count, weight=weight)
    alt = "How far objects slide and when all is done over the delay, for each coupling and assistance."
    caption = "Means over the operators; bands: the means of their intervals."
    film = Markup(fragment(watched("rigid", count)))
    against = Table.of("The policy beside its rivals, on the same scenarios", [
        {**in_cm(row), "cell": words_of(row)} for row in plain if row["contestant"] == POLICY
    ], {
        "cell": "{cell}",
        "slides less than with the brake (cm)": form("brake_slide", 2), "costs less (m/s)": form("brake_cost", 3),
        "slides less than with the speed limit (cm)": form("limit_slide", 2), "costs less": form("limit_cost", 3),
    })  # fmt: skip
    nowhere = "In no cell is an assistance worse than constant gains or than the brake, beyond its interval."
    head = ("assistance", "what", "cells", "at the most", "where")
    sections = [
        Section("Behind operators that were held out", [
            compared, Picture("held_out", chart(held_out), alt, caption, "Held-out operators"),
            Picture("trained", chart(trained), alt, caption, "Operators of the training"),
        ]),
        Section("Watch: alone, and with a local brake", [
            "Rigid tool, 100 ms each way. Dashed: what the operator sees at that moment.", film,
        ]),
        Section(f"At {1e3 * TYPICAL:.0f} ms", [listed(typical)], key="typical"),
        Section("The policy beside the brake and the speed limit", [*map(duel_sentence, duels), against], key="duels"),
        Section("Where assistance hurts", [
            Table("Cells where one is worse than a rival beyond its interval", head, worse) if worse else nowhere
        ], key="hurts"),
        Section("All cells", [
            "5G: three measured grades, each way.",
listed(found),
        ], folded=True, key="all"),
    ]  # fmt: skip
    return Findings(answer(held_out), sections, {"cells": pl.DataFrame(found, infer_schema_length=None)})


PLAYED = (*grid.PLAYED, "agents.setups", "impact_gym.teleop")
STUDY = Study(
    "teleop",
    "Which assistance helps an operator who acts late?",
    (Measurement("episodes", assisted, grid.play, PLAYED),),
    analyse,
)

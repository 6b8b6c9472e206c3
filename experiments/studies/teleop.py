"""Comparison of assistances: controllers at the arm that correct late commands of an operator."""

import base64
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import numpy as np
import polars as pl
from matplotlib.figure import Figure
from polars import selectors

from agents.policies import load_ensemble
from agents.setups import load_setup
from experiments.lab import grid
from experiments.lab.charts import SERIES
from experiments.lab.parts import Picture, Section, Table
from experiments.lab.statistics import Resamples, estimate
from experiments.lab.study import Cell, Findings, Frames, Measurement, Row, Study

COUPLINGS = ("rigid", "spring", "bistable")
DELAYS, TYPICAL = (0.0, 0.05, 0.1, 0.2, 0.4), 0.2  # s, of the round trip
BELIEF = {"place_error": [-0.05, 0.05], "creep": [0.05, 0.15]}
REACH, SEEN = "reach", "training's recordings"
HELD_OUT: Mapping[str, Mapping[str, Any]] = {  # operators with which no policy was trained
    "tracker": {"type": "Tracker", **BELIEF},
    "hand": {"type": "SecondOrderLag", **BELIEF},
    "steady": {"type": "Trapezoid", "speed": [0.1, 0.4]},
}
OPERATORS = (REACH, SEEN, *HELD_OUT)
ALONE, RULE, BRAKE, POLICY = "operator alone", "paper's rule", "local brake", "policy"
ASSISTANCE = (ALONE, RULE, BRAKE, POLICY)
MEASURES = ("object_velocity", "slide", "done_time", "taken", "missed", "cost")
COLOURS = {ALONE: SERIES[3], BRAKE: SERIES[4], POLICY: SERIES[1]}
SHOWN = {"slide": (100.0, "slide (cm)"), "done_time": (1.0, "done (s)")}  # factor and label of each row of panels


def environment_of(coupling: str, operator: str, delay: float) -> dict[str, Any]:
    """Return the arguments of the environment; each channel has half of `delay` (s)."""
    setup = load_setup(f"teleop-{coupling}")
    operators = {REACH: setup.environment["operator"], SEEN: setup.mixed[0][1]["operator"], **HELD_OUT}
    link = {"delay": 0.5 * delay}
    return {**setup.environment, "operator": operators[operator], "uplink": link, "downlink": link}


def contestants(setup: str) -> dict[tuple[str, int], dict[str, Any]]:
    """Return the controller (JSON) of each assistance and seed."""
    fixed = {ALONE: "operator-alone", RULE: "paper-trapezoid", BRAKE: "local-brake"}
    policies = {each.seed: base64.b64encode(each.to_bytes()).decode() for each in load_ensemble(setup).policies}
    return {(name, 0): {"baseline": baseline} for name, baseline in fixed.items()} | {
        (POLICY, seed): {"policy": content} for seed, content in policies.items()
    }


def assisted(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each controller (see `contestants`) with each coupling, operator and delay."""
    delays, operators = ([TYPICAL], [REACH, "steady"]) if quick else (DELAYS, OPERATORS)
    scenarios = {"set": "test", "count": 40 if quick else 500}
    for coupling, delay, operator in product(COUPLINGS, delays, operators):
        environment = environment_of(coupling, operator, delay)
        weights = [load_setup(f"teleop-{coupling}").evaluation.typical]
        for (name, seed), controller in contestants(f"teleop-{coupling}").items():
            labels = {"coupling": coupling, "delay": delay, "operator": operator, "contestant": name, "seed": seed}
            yield grid.cell(labels, controller, environment, scenarios, weights, lenient=True)


LABELS = ("coupling", "delay", "operator")


def table_of_cells(frames: Frames) -> list[dict[str, Any]]:
    """Return the means by LABELS and assistance, and how much lower slide and cost are than with the brake."""
    found = list[dict[str, Any]]()
    for labels, rows in grid.groups(frames["episodes"], *LABELS):
        resamples = Resamples(rows["episode"].n_unique())
        means = {
            who: {name: resamples.means(grid.sample(each, name)) for name in MEASURES}
            for (who,), each in grid.groups(rows, "contestant")
        }
        for who, ours in means.items():
            row = dict(zip(LABELS, labels, strict=True))
            row |= {"contestant": who, "scenarios": resamples.scenarios, "weight": rows["weight"][0]}
            estimates = {name: estimate(resampled) for name, resampled in ours.items()}
            for name in ("slide", "cost"):
                estimates[f"brake_{name}"] = estimate(means[BRAKE][name] - ours[name])
            for name, value in estimates.items():
                row |= {name: value.value, f"{name}_low": value.low, f"{name}_high": value.high}
            found.append(row)
    return found


def words_of(row: Row) -> str:
    """Return coupling, operator and delay of a row as text."""
    return f"{row['coupling']}, {row['operator']}, {1e3 * row['delay']:.0f} ms"


def duel(found: Sequence[Row]) -> str:
    """Return in words how the costs of policy and brake differ; 'clearly': the interval does not include 0."""
    ours, column = [row for row in found if row["contestant"] == POLICY], "brake_cost"
    less, more = (sum(sign * row[f"{column}_{end}"] > 0.0 for row in ours) for sign, end in ((1, "low"), (-1, "high")))
    share = 100.0 * sum(row[column] for row in ours) / sum(row["cost"] + row[column] for row in ours)
    best, worst = (f"{form(column, 3).format(**row)} m/s ({words_of(row)})"
                   for row in (chosen(ours, key=lambda row: row[column]) for chosen in (max, min)))  # fmt: skip
    return (f"The policy costs clearly less than the {BRAKE} in {less} of {len(ours)} cells and clearly more "
            f"in {more}; over all {share:.1f} % less. It costs less by {best} at the most and {worst} at the least "
            "(below 0: it costs more).")  # fmt: skip


COMPARED = f"""95 % intervals over {{count}} scenarios on which nothing was tuned or trained, and over the seeds of each
policy. The cost is V_p + w times the time until all is done, w = {{weight:g}} m/s per s. Policies were trained with the
operator '{REACH}', whose beliefs were up to 30 cm wrong, and with {SEEN}, which do not stop at a touch. Held out: a
tracker of the displayed object, a pointing hand, a steady speed."""


def chart(found: Sequence[Row]) -> Figure:
    """Return a figure of slide and `done_time` against the delay: means over the operators, with mean intervals."""
    figure = Figure(figsize=(9.0, 5.4))
    panels = figure.subplots(len(SHOWN), len(COUPLINGS), sharey="row", sharex=True)
    frame = pl.DataFrame(found, infer_schema_length=None)
    for line, (name, (scale, words)) in zip(panels, SHOWN.items(), strict=True):
        for axes, (coupling, (who, colour)) in zip(np.repeat(line, len(COLOURS)), product(COUPLINGS, COLOURS.items()),
                                                   strict=True):  # fmt: skip
            rows = frame.filter(coupling=coupling, contestant=who)
            ours = rows.group_by("delay").agg(selectors.numeric().mean()).sort("delay")
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
    """Return a format string for a column and its interval."""
    return f"{{{name}:.{digits}f}} [{{{name}_low:.{digits}f}}, {{{name}_high:.{digits}f}}]"


def in_cm(row: Row) -> dict[str, Any]:
    """Return a row with slides in cm, and with a column `cell` that names coupling, operator and delay."""
    return {name: 100.0 * value if "slide" in name else value for name, value in row.items()} | {"cell": words_of(row)}


def answer(held_out: Sequence[Row]) -> str:
    """Return in words the slides at the typical delay: with the operator alone, with the brake, with the policy."""
    frame = pl.DataFrame(held_out, infer_schema_length=None).filter(delay=TYPICAL)
    parts = []
    for coupling in frame["coupling"].unique(maintain_order=True):
        slides = (frame.filter(coupling=coupling, contestant=who)["slide"] for who in (ALONE, BRAKE, POLICY))
        alone, brake, policy = (f"{100.0 * np.mean(slide.to_numpy()):.1f}" for slide in slides)
        parts.append(f"{coupling} {alone} cm alone, {brake} with the brake, {policy} with the policy")
    return (f"Slide of the object at a delay of {1e3 * TYPICAL:.0f} ms there and back, mean of the held-out operators: "
            f"{'; '.join(parts)}.")  # fmt: skip


def analyse(frames: Frames, _: bool) -> Findings:
    """Compare the assistances."""
    found = table_of_cells(frames)
    held_out = [row for row in found if row["operator"] in HELD_OUT]
    trained = [row for row in found if row["operator"] not in HELD_OUT]
    count, weight = found[0]["scenarios"], found[0]["weight"]
    alt = "Slide and time until all is done over the delay, for each coupling and assistance."
    caption = "Means over the operators; bands: the means of their intervals."
    everything = Table.of("", map(in_cm, found), {
        "coupling, operator, delay": "{cell}", "assistance": "{contestant}",
        "slides (cm)": form("slide", 2), "done (s)": form("done_time", 2), "taken": "{taken:.2f}",
        "missed": "{missed:.1%}", "slides less than with the brake (cm)": form("brake_slide", 2),
        "costs less than the brake (m/s)": form("brake_cost", 3),
    })  # fmt: skip
    return Findings(answer(held_out), [
        Section("With held-out operators", [
            COMPARED.format(count=count, weight=weight),
            Picture("held_out", chart(held_out), alt, caption, "Held-out operators"),
            Picture("trained", chart(trained), alt, caption, "Operators of the training"),
        ]),
        Section("The policy beside the brake", [duel(found)], key="duel"),
        Section("All cells", [everything], folded=True, key="all"),
    ], {"cells": pl.DataFrame(found, infer_schema_length=None)})  # fmt: skip


PLAYED = (*grid.PLAYED, "agents.setups", "impact_gym.teleop")
STUDY = Study(
    "teleop",
    "Which assistance helps if the operator's commands arrive late?",
    (Measurement("episodes", assisted, grid.play, PLAYED),),
    analyse,
)

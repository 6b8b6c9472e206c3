"""`impact-gym arm`: hold the one mass on a spring against whole arms, write reports/arm/index.html."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from matplotlib.figure import Figure

from experiments.arm import blows, gain, robots
from experiments.lab import experiment
from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.lab.experiment import Shown, Tables
from experiments.lab.statistics import Estimate, estimate
from experiments.lab.tables import Gather, Row

COLOURS = dict(zip(blows.MODELS, (OBJECT, TOOL, "#CC79A7", FLANGE), strict=True))
GAINS = ("viper", "panda")
NOTICED = 0.1  # share of V_p that the arm's own compliance must take or add to be noticed
RESAMPLES = 1_000


def tables(quick: bool, gather: Gather) -> Tables:
    """Return all rows, after running what is missing of them."""
    arms = ["two links"] if quick else robots.present()
    played = ["viper"] if quick else [arm for arm in GAINS if arm in arms]
    count = 2 * gain.BATCH if quick else gain.SCENARIOS
    return {
        "scenes": blows.rows(gather, arms, 9 if quick else blows.SCENES // (blows.LINES * len(arms))),
        "linear": blows.linear_rows(gather, arms),
        "gain": gain.rows(gather, played, list(gain.WEIGHTS)[: 1 if quick else None], count),
    }


def shown(tables: Tables) -> Shown:
    """Return the figures and what the page says."""
    found = [row for row in tables["scenes"] if row["status"] == "ok"]
    slow = [row for row in found if row["coupling"] == "rigid"]
    changed = np.array([row["object_velocity"] / row["rigid all"] - 1.0 for row in slow])
    return {"errors": error_chart(found), "compliance": compliance_chart(slow, changed)}, {
        "by_coupling": decisions(found, "coupling", {name: name for name in blows.COUPLINGS}),
        "by_line": decisions(found, "line", {0: "easy", 1: "easy, another", 2: "near a singularity"}),
        "by_factor": decisions(found, "factor", {factor: f"x {factor:g}" for factor in blows.FACTORS}),
        "models": blows.MODELS, "measures": blows.MEASURES, "count": len(found),
        "failed": [row for row in tables["scenes"] if row["status"] != "ok"],
        "arms": {name: robots.KINDS[name] for name in dict.fromkeys(row["arm"] for row in found)},
        "absent": [kind.words for name, kind in robots.KINDS.items() if name not in robots.present()],
        "extra": robots.EXTRA, "source": robots.source_of, "kinds": robots.KINDS,
        "sideways": quantiles([1e3 * row["sideways"] for row in found]),
        "turn": quantiles([np.degrees(row["turn"]) for row in found]),
        "takes": int((changed < -NOTICED).sum()), "adds": int((changed > NOTICED).sum()),
        "changed": changed, "share": NOTICED, "linear": linearised(tables["linear"]),
        "gain": gain.table(tables["gain"]), "weights": gain.WEIGHTS,
    }  # fmt: skip


def quantiles(values: Any) -> tuple[float, float]:
    """Return the median and what 95 % stay below."""
    middle, most = np.quantile(values, [0.5, 0.95]) if np.size(values) else (np.nan, np.nan)
    return float(middle), float(most)


def decisions(found: Sequence[Row], column: str, words: dict[Any, str]) -> list[dict[str, Any]]:
    """Return, for each value of a column, the errors of all models and which of the three masses is best in V_p."""
    groups = {text: [row for row in found if row[column] == value] for value, text in words.items()}
    return [decision(text, group) for text, group in groups.items() if group]


def decision(words: str, found: Sequence[Row]) -> dict[str, Any]:
    """Return median, with its interval over the lines, and 95 % of the errors; and the mass with the least."""
    errors = {measure: {model: spread(found, model, measure) for model in blows.MODELS} for measure in blows.MEASURES}
    of = {mass: errors["object_velocity"][mass] for mass in blows.MASSES}
    nearest = np.argmin([np.abs(blows.errors(found, mass)) for mass in blows.MASSES], axis=0)
    return {
        "words": words, "count": len(found), "errors": errors,
        "median": min(of, key=lambda mass: of[mass][0].value), "most": min(of, key=lambda mass: of[mass][1]),
        "nearest": [int((nearest == k).sum()) for k in range(len(blows.MASSES))],
    }  # fmt: skip


def spread(found: Sequence[Row], model: str, measure: str) -> tuple[Estimate, float]:
    """Return the median of a model's errors and what 95 % of them stay below.

    The interval is a bootstrap's over the lines: scenes on one line are alike.
    """
    keys = dict.fromkeys((row["arm"], row["line"]) for row in found)
    lines = [[row for row in found if (row["arm"], row["line"]) == key] for key in keys]
    errors = [np.abs(blows.errors(rows, model, measure)) for rows in lines]
    drawn = np.random.default_rng(0).integers(len(lines), size=(RESAMPLES, len(lines)))
    medians = [quantiles(np.concatenate([errors[k] for k in each]))[0] for each in [range(len(lines)), *drawn]]
    return estimate(np.array(medians)), quantiles(np.concatenate(errors))[1]


def linearised(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return how far the paper's eq. 11 is off its eq. 10 in V_p, for each arm: median and largest share."""
    lines = list[dict[str, Any]]()
    for arm in dict.fromkeys(row["arm"] for row in rows):
        off = [abs(row["linear"] / row["object_velocity"] - 1.0) for row in rows
               if row["arm"] == arm and row["status"] == "ok"]  # fmt: skip
        lines.append({"arm": arm, "count": len(off), "median": quantiles(off)[0], "most": max(off, default=np.nan)})
    return lines


def error_chart(found: Sequence[Row]) -> Figure:
    """Return the errors of each model over the stiffness of the joints, for each measure and coupling."""
    figure = Figure(figsize=(9.0, 9.6))
    grid = figure.subplots(len(blows.MEASURES), len(blows.COUPLINGS), sharey="row", sharex=True)
    for line, (measure, words) in zip(grid, blows.MEASURES.items(), strict=True):
        for axes, coupling in zip(line, blows.COUPLINGS, strict=True):
            cells = [[row for row in found if (row["coupling"], row["factor"]) == (coupling, factor)]
                     for factor in blows.FACTORS]  # fmt: skip
            for model, colour in COLOURS.items():
                spreads = [quantiles(100.0 * np.abs(blows.errors(cell, model, measure))) for cell in cells]
                axes.plot(blows.FACTORS, [each[0] for each in spreads], "o-", color=colour, label=model)
                axes.plot(blows.FACTORS, [each[1] for each in spreads], ":", color=colour)
            axes.set(
                title=coupling if measure == "object_velocity" else "", xscale="log", yscale="log", xlim=(0.2, 4.5)
            )
            axes.set_xticks(blows.FACTORS, [f"x {factor:g}" for factor in blows.FACTORS])
            axes.minorticks_off()
        line[0].set(ylabel=f"error in {words} (%)")
    for axes in grid[-1]:
        axes.set(xlabel="stiffness of the joints")
    grid[0, -1].legend(fontsize=8)
    return figure


def compliance_chart(slow: Sequence[Row], changed: Any) -> Figure:
    """Return what an arm's own compliance does to V_p with a tool that is fixed to the flange."""
    figure = Figure(figsize=(6.0, 3.6))
    axes = figure.subplots()
    points = axes.scatter([row["contact_stiffness"] for row in slow], [row["object_mass"] for row in slow],
                          c=100.0 * changed, cmap="coolwarm", vmin=-50.0, vmax=50.0, edgecolors="#777777")  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="contact stiffness (N/m^1.5)", ylabel="object mass (kg)")
    figure.colorbar(points, extend="both", label="change of V_p by the arm's compliance (%)")
    return figure


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Hold the one mass on a spring against whole arms; what is on disk is not run again.

    Args:
        out: folder for tables, figures and page: reports/arm, or arm_quick beside it.
        quick: one arm, few scenes.
        force: run everything again.
    """
    packages = [
        "mujoco",
        *{kind.package for name, kind in robots.KINDS.items() if kind.package and name in robots.present()},
    ]
    experiment.command("arm", partial(tables, quick), shown, out, quick, again=force, packages=packages)


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym arm")

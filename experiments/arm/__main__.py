"""`impact-gym arm`: hold the one mass on a spring against whole arms, write reports/arm/index.html."""

from functools import partial
from pathlib import Path

import numpy as np
import tyro
from matplotlib.figure import Figure

from experiments.arm import blows, gain, robots
from experiments.lab import experiment
from experiments.lab.charts import FLANGE, OBJECT, TOOL
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather, Row

COLOURS = dict(zip(blows.MODELS, (OBJECT, TOOL, "#CC79A7", FLANGE), strict=True))
GAINS = ("viper", "panda")
NOTICED = 0.1  # share of V_p that the arm's own compliance must take to be noticed


def tables(quick: bool, gather: Gather) -> Tables:
    """Return all rows, after running what is missing of them."""
    arms = robots.present()
    played = [arm for arm in GAINS if arm in arms]
    if quick:
        return {"scenes": blows.rows(gather, arms[:1], 6), "gain": gain.rows(gather, played[:1], gain.BATCH)}
    return {
        "scenes": blows.rows(gather, arms, 300 // (blows.LINES * len(arms))),
        "gain": gain.rows(gather, played, 500),
    }


def shown(tables: Tables) -> Shown:
    """Return the figures and what the page says."""
    found = [row for row in tables["scenes"] if row["status"] == "ok"]
    decisions = [decision(name, [row for row in found if row["coupling"] == name]) for name in blows.COUPLINGS]
    arms = {name: robots.KINDS[name] for name in dict.fromkeys(row["arm"] for row in found)}
    absent = [kind.words for name, kind in robots.KINDS.items() if name not in robots.present()]
    slow = [row for row in found if row["coupling"] == "rigid"]
    noticed = [row["object_velocity"] < (1.0 - NOTICED) * row["rigid all"] for row in slow]
    return {"errors": error_chart(found), "compliance": compliance_chart(slow)}, {
        "decisions": decisions, "models": blows.MODELS, "measures": blows.MEASURES, "arms": arms, "absent": absent,
        "count": len(found), "failed": [row for row in tables["scenes"] if row["status"] != "ok"],
        "by_line": [decision(words, [row for row in found if (row["line"] == 2) == near])
                    for words, near in (("away from singularities", False), ("past one", True))],
        "by_factor": [decision(f"x {factor:g}", [row for row in found if row["factor"] == factor])
                      for factor in blows.FACTORS],
        "sideways": quantiles([1e3 * row["sideways"] for row in found]),
        "turn": quantiles([np.degrees(row["turn"]) for row in found]),
        "noticed": sum(noticed), "slow": len(slow), "share": NOTICED, "gain": gain.table(tables["gain"]),
        "weight": gain.WEIGHT, "kinds": robots.KINDS,
    }  # fmt: skip


def quantiles(values: list[float]) -> tuple[float, float]:
    """Return the median and what 95 % stay below."""
    middle, most = np.quantile(values or [np.nan], [0.5, 0.95])
    return float(middle), float(most)


def decision(words: str, found: list[Row]) -> dict[str, object]:
    """Return the median and the 95 % error of each model in each measure, and which is best in V_p."""
    errors = {
        measure: {model: quantiles(np.abs(blows.errors(found, model, measure)).tolist()) for model in blows.MODELS}
        for measure in blows.MEASURES
    }
    of = errors["object_velocity"]
    best = {"median": min(of, key=lambda model: of[model][0]), "most": min(of, key=lambda model: of[model][1])}
    return {"words": words, "count": len(found), "errors": errors, "best": best}


def error_chart(found: list[Row]) -> Figure:
    """Return the error in V_p of each model over the stiffness of the joints, for each coupling."""
    figure = Figure(figsize=(9.0, 3.2))
    for axes, coupling in zip(figure.subplots(1, len(blows.COUPLINGS), sharey=True), blows.COUPLINGS, strict=True):
        for model, colour in COLOURS.items():
            cells = [
                [row for row in found if (row["coupling"], row["factor"]) == (coupling, factor)]
                for factor in blows.FACTORS
            ]
            spread = [
                quantiles((100.0 * np.abs(blows.errors(cell, model))).tolist()) if cell else (np.nan, np.nan)
                for cell in cells
            ]
            axes.plot(blows.FACTORS, [each[0] for each in spread], "o-", color=colour, label=model)
            axes.plot(blows.FACTORS, [each[1] for each in spread], ":", color=colour)
        axes.set(title=coupling, xlabel="stiffness of the joints, times", xscale="log", yscale="log")
    figure.axes[0].set(ylabel="error in V_p (%): median, dotted 95 %")
    figure.axes[-1].legend(fontsize=8)
    return figure


def compliance_chart(slow: list[Row]) -> Figure:
    """Return where an arm's own compliance takes something off V_p with a tool that is fixed to the flange."""
    figure = Figure(figsize=(6.0, 3.6))
    axes = figure.subplots()
    takes = [100.0 * (1.0 - row["object_velocity"] / row["rigid all"]) for row in slow]
    points = axes.scatter([row["contact_stiffness"] for row in slow], [row["object_mass"] for row in slow], c=takes,
                          cmap="viridis", vmin=0.0, vmax=40.0)  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="contact stiffness (N/m^1.5)", ylabel="object mass (kg)")
    figure.colorbar(points, label="V_p that the arm's compliance takes (%)")
    return figure


def main(out: Path | None = None, quick: bool = False, force: bool = False) -> None:
    """Hold the one mass on a spring against whole arms; what is on disk is not run again.

    Args:
        out: folder for tables, figures and page: reports/arm, or arm_quick beside it.
        quick: one arm, few scenes.
        force: run everything again.
    """
    packages = ["mujoco", robots.DESCRIPTIONS] if len(robots.present()) > 2 else ["mujoco"]
    experiment.command("arm", partial(tables, quick), shown, out, quick, again=force, packages=packages)


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym arm")

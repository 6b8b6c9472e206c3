"""`impact-gym fits`: what `impact_gym.identify` finds in logs of the independent solver, how surely."""

from functools import partial
from pathlib import Path

import tyro

from agents.jobs import digest_of
from experiments import reference
from experiments.identify import draws, measures, recorder
from experiments.lab import experiment
from experiments.lab.experiment import Shown, Tables
from experiments.lab.tables import Gather, solver_and

SCENES = 100


def tables(scenes: int, gather: Gather) -> Tables:
    """Return the fits of all logs of so many scenes, and what they come to."""
    logs = digest_of(reference.__name__, recorder.__name__)
    depends = f"{logs} {solver_and('impact_gym.identify', draws.__name__)}"
    fitted = gather("fits", draws.fit, [{"number": number} for number in range(scenes)], depends)
    return {"fits": fitted, "coverage": measures.coverage(fitted), "errors": measures.errors(fitted)}


def shown(tables: Tables) -> Shown:
    """Return the figure and what the page says."""
    fitted = tables["fits"]
    return {"errors": measures.figure(fitted)}, {
        "coverage": tables["coverage"], "errors": tables["errors"], "seconds": measures.seconds(fitted),
        "failures": [row for row in fitted if row["failure"]], "logs": len(fitted),
        "random": sum(row["log"] < draws.RANDOM for row in fitted),
    }  # fmt: skip


def main(
    scenes: int | None = None, out: Path | None = None, quick: bool = False, force: bool = False,
    processes: int | None = None,
) -> None:  # fmt: skip
    """Fit logs of the independent solver and write a page about it; what is on disk is not computed again.

    Args:
        scenes: how many, five logs each: 100, or 4 of a quick run.
        out: folder for tables, figure and the page: reports/identify, or identify_quick beside it.
        quick: a first look.
        force: compute everything again.
        processes: at a time; one a core.
    """
    compute = partial(tables, scenes or (4 if quick else SCENES))
    experiment.command("identify", compute, shown, out, quick, "fits", again=force, processes=processes)


if __name__ == "__main__":
    tyro.cli(main, prog="impact-gym fits")

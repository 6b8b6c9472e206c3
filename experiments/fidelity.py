"""`python -m experiments.fidelity`: what simpler models of the storm's scenes cost, and how much time they save."""

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from experiments.lab.results import REPORTS
from experiments.stability.scenes import draw
from impact_gym.fidelity import ROUNDS, Model, advise


@dataclass(frozen=True)
class Settings:
    """Ask for advice on random scenes one by one; write a table of the models tried."""

    scenes: int = 300
    """How many of the storm."""
    tolerance: float = 0.05
    """Relative error of V_p allowed."""
    out: Path = REPORTS / "fidelity"
    """Folder of the table."""


def main() -> None:
    """Read the settings from the command line, ask, write `fidelity.md`."""
    settings = tyro.cli(Settings)
    tried: dict[str, list[Model]] = defaultdict(list)
    taken: list[Model] = []
    for number in range(settings.scenes):
        approach = draw(number)
        told = advise(approach.scene, approach.motion, settings.tolerance, duration=approach.duration)
        taken.append(told.model)
        for model in told.tried[1:]:
            tried[model.name].append(model)
    lines = [
        f"{settings.scenes} scenes of the storm, V_p within {settings.tolerance:g}, best of {ROUNDS} runs",
        "",
        "| model | scenes | within | median error | largest | median time saved |",
        "|---|---|---|---|---|---|",
    ]
    for name, models in sorted(tried.items()):
        errors = np.array([model.bound for model in models])
        saved = np.median([model.time_saved for model in models])
        kept = np.count_nonzero(errors <= settings.tolerance)
        lines.append(
            f"| {name} | {len(models)} | {kept} | {np.median(errors):.1e} | {errors.max():.1e} | {saved:.0%} |"
        )
    simpler = [model.time_saved for model in taken if model.bound > 0]
    median = f", which then took {np.median(simpler):.0%} less time (median)" if simpler else ""
    lines += ["", f"Something could be left out in {len(simpler)} of {settings.scenes}{median}."]
    settings.out.mkdir(parents=True, exist_ok=True)
    text = "\n".join(lines) + "\n"
    (settings.out / "fidelity.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()

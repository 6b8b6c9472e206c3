"""Costs and processor times of shorter trainings with other settings, beside the set-up's own training."""

import io
import tempfile
import time
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import polars as pl

from agents import load_policy
from agents.setups import load_setup
from agents.train.ppo import Run, train
from experiments.lab.parts import Section, Table
from experiments.lab.study import Cell, Frames, Row

SETUP = "linear-blind"
HALF, OWN = {"steps": 6_000_000}, "own settings, 12 million steps"
IDEAS: dict[str, dict[str, Any]] = {  # changes of the set-up's own settings
    OWN: {},
    "6 million steps": HALF,
    "6 million, twice the learning rate, which falls to 0": HALF | {"learning_rate": 1.5e-3, "final_rate": 0.0},
    "6 million, gradients of 1,024 samples": HALF | {"batch": 1024},
    "6 million, gradients of 4,096 samples": HALF | {"batch": 4096, "learning_rate": 1.2e-3},
    "6 million, 256 environments": HALF | {"envs": 256},
    "7.5 million, two passes over the samples": {"steps": 7_500_000, "epochs": 2, "learning_rate": 1e-3},
    "10 million, one pass over the samples": {"steps": 10_000_000, "epochs": 1, "batch": 1024, "learning_rate": 1e-3},
    "6 million, begins as the tuned profile": HALF | {"teacher": "blind-profile"},
    "6 million, 32 neurons in a layer": HALF | {"width": 32},
    "5 million, 128 neurons in a layer": {"steps": 5_000_000, "width": 128},
    "6 million, ReLU": HALF | {"activation": "relu"},
}
MANY, SEEDS = (OWN, "6 million steps"), (10, 3)  # ideas with ten trainings; numbers of trainings of these and others


def cells(quick: bool, _: Frames) -> Iterator[Cell]:
    """Yield a cell for each idea and seed, the ideas in turn, so that other work on the machine slows all alike."""
    short = {"steps": 50_000, "imitation_steps": 10_000} if quick else {}
    for seed in range(1 if quick else max(SEEDS)):
        for idea, changes in IDEAS.items():
            if seed < SEEDS[idea not in MANY]:
                yield Cell({"idea": idea}, {"changes": changes | short, "seed": seed})


def trained(changes: dict[str, Any], seed: int) -> list[Row]:
    """Train on one thread; return the processor time (s), with the validations, and the best validation score (m/s)."""
    setup = load_setup(SETUP)
    settings = setup.training.changed({"threads": 1, "simulation_threads": 1} | changes)
    with tempfile.TemporaryDirectory() as out, redirect_stdout(io.StringIO()):
        begun = time.process_time()
        folder = train(Run(setup, settings, seed), Path(out) / "run")
        seconds = time.process_time() - begun
        return [{"seconds": seconds, "score": load_policy(folder / "best.npz").provenance["validation"]["score"]}]


def about(frame: pl.DataFrame) -> tuple[str, list[Section]]:
    """Return answer and sections of the table `frame`."""
    score, shipped = pl.col("score"), load_policy(SETUP).provenance["validation"]["score"]
    found = frame.group_by("idea", maintain_order=True).agg(
        pl.median("seconds"), median=score.median(), low=score.min(), high=score.max(), count=pl.len()
    )
    whole = found.filter(idea=OWN)["seconds"].item()
    rows = [[row["idea"], f"{row['seconds'] / whole:.2f}", "{median:.4f} [{low:.4f}, {high:.4f}]".format(**row),
             str(row["count"])] for row in found.iter_rows(named=True)]  # fmt: skip
    least = min(found.filter(pl.col("idea") != OWN)["median"])
    answer = f"The best shorter training has a median cost of {least:.4f} m/s, the shipped policy {shipped:.4f} m/s."
    caption = (f"Trainings of {SETUP}: processor time beside that of its own training, validation cost (m/s, lower is "
               "better): median [least, largest] of the seeds")  # fmt: skip
    heads = ("training", "processor time", "cost (m/s)", "seeds")
    return answer, [Section("Shorter trainings", [Table(caption, heads, rows, "speed-trainings")])]

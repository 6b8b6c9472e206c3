"""Evaluation sets: files of fixed scenarios, each file with a checksum.

A shipped set has the scenario of the first episode for each of the seeds `seed`, `seed` + 1, ... To play
a set, call `envs.reset(options={"scenario": set.scenario})` of a batch of `set.count` environments.
"""

import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from impact_gym.quantities import SCENARIO
from impact_gym.support.archive import refuse_altered
from impact_gym.support.files import named_file, parsed
from impact_gym.support.validation import unit_text

SHIPPED = Path(__file__).with_name("sets")


@dataclass(frozen=True, eq=False)
class EvaluationSet:
    """A set of scenarios: for each field an array of its values."""

    seed: int  # seed of the first scenario
    count: int  # number of scenarios
    scenario: dict[str, NDArray[np.float64]]  # fields and units as in `ScenarioRanges`


def load(name: str | Path) -> EvaluationSet:
    """Return a shipped set by its name, or the set in a file; ValueError: the file is missing, altered or not a set."""
    return parsed(named_file("evaluation set", name, SHIPPED, ".csv"), "evaluation set", _frozen)


def _frozen(text: str) -> EvaluationSet:
    head, _, table = text.partition("\n")
    about = json.loads(head.removeprefix("# "))
    refuse_altered(about["sha256"], f"{about['seed']},{about['count']}\n{table}")
    heads, _, rows = table.partition("\n")
    columns = np.loadtxt(io.StringIO(rows), delimiter=",", comments=None, ndmin=2).T.copy()
    by_head = dict(zip(heads.split(","), columns, strict=True))
    return EvaluationSet(int(about["seed"]), columns.shape[1], {name: by_head[head] for name, head in _COLUMNS.items()})


_COLUMNS = {row.id: f"{row.id} [{unit_text(row.unit)}]" for row in SCENARIO}

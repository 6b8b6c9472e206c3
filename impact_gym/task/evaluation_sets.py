"""Frozen evaluation sets: scenarios as small data files with a checksum, so that a comparison outlives any generator.

A shipped set holds the first draws of the environments seeded `seed`, `seed + 1`, ... from its named ranges. It is
played by `envs.reset(options={"scenario": set.scenario})` on a batch of `set.count` environments.
"""

import csv
import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_gym.files import named_file, parsed, write_file
from impact_gym.kernels import draw
from impact_gym.quantities import SCENARIO
from impact_gym.task.episodes import first_uniforms
from impact_gym.task.scenario import FIELDS, ScenarioRanges
from impact_gym.validation import unit_text, whole

SHIPPED = Path(__file__).with_name("sets")


@dataclass(frozen=True, eq=False)
class EvaluationSet:
    """Scenarios, an array entry each."""

    seed: int  # of the first
    scenario: dict[str, NDArray[np.float64]]  # fields and units as in `ScenarioRanges`

    @property
    def count(self) -> int:
        """Number of scenarios."""
        return len(self.scenario[FIELDS[0]])


def load(name: str | Path) -> EvaluationSet:
    """Return a shipped set by its name, or the one in a file.

    Raises:
        ValueError: there is no such set, or the file was altered.
    """
    return parsed(named_file("evaluation set", name, SHIPPED, ".csv"), "evaluation set", _frozen)


def _frozen(text: str) -> EvaluationSet:
    """Return the set in the text of a file."""
    head, _, table = text.partition("\n")
    about = json.loads(head.removeprefix("# "))
    checksum = _checksum(about["seed"], about["count"], table)
    if checksum != about["sha256"]:
        raise ValueError(f"its checksum is {checksum}, not {about['sha256']}: it was altered")
    rows = list(csv.DictReader(io.StringIO(table)))
    scenario = {name: np.array([float(row[head]) for row in rows]) for name, head in _COLUMNS.items()}
    return EvaluationSet(int(about["seed"]), scenario)


def freeze(path: str | Path, ranges: ScenarioRanges | Mapping[str, Any] | str, seed: int, count: int) -> Path:
    """Write the scenarios that environments seeded `seed` ... `seed + count - 1` draw first from `ranges`.

    Raises:
        FileExistsError: there is a file; a frozen set is not overwritten.
    """
    path = Path(path)
    pairs = ScenarioRanges.of(ranges).by_id()
    seed, count = whole("seed", seed, at_least=0), whole("count", count, at_least=1)
    if path.exists():
        raise FileExistsError(f"{path} is there already; a frozen set is not overwritten")
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS.values())
    for uniforms in first_uniforms(seed, count):
        scenario = []
        for row in SCENARIO:
            (low, high), place = pairs[row.id], row.draw.place if row.draw else 0
            scenario.append(draw(low, high, row.by_ratio(low), uniforms[place]))
        writer.writerow(scenario)
    checksum = _checksum(seed, count, text.getvalue())
    about = json.dumps({"seed": seed, "count": count, "sha256": checksum})
    return write_file(path, f"# {about}\n{text.getvalue()}")


def _checksum(seed: int, count: int, table: str) -> str:
    return hashlib.sha256(f"{seed},{count}\n{table}".encode()).hexdigest()


_COLUMNS = {row.id: f"{row.id} [{unit_text(row.unit)}]" for row in SCENARIO}

"""What each reduction really costs: the full scene against the reduced one, row by row, kept on disk as they come."""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import impact_gym as ig
from experiments.fidelity.population import Kind, draw
from impact_gym.fidelity import advise
from impact_gym.fidelity.prediction import Prediction, chain, closed_velocity, inspect, predictions, softened
from impact_gym.fidelity.situation import final, situation
from impact_gym.files import whole_file

CHUNK = 250
TOLERANCES = (1e-3, 1e-2, 5e-2)

Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Answer:
    """V_p of a chain, and what it took."""

    velocity: float  # m/s
    seconds: float = 0.0  # of the run; 0 for a closed form
    chain: str = ""


def run(scene: ig.Scene, motion: ig.Trapezoid, duration: float) -> Answer:
    """Simulate `scene` for `duration` (s)."""
    begun = time.perf_counter()
    velocity = ig.simulate(scene, motion, duration).object_velocity
    return Answer(velocity, time.perf_counter() - begun, chain(scene))


def rows(kind: Kind, purpose: int, number: int) -> Iterator[Row]:
    """Every reduction that applies to scene `number`, one at a time."""
    scene, motion = draw(kind, purpose, number)
    seen = inspect(scene, motion)
    known, duration = predictions(seen), final(seen.now)
    full = run(scene, motion, duration)
    if full.velocity <= 0.0:
        return
    rigid = still = full
    if scene.robot is not None:
        rigid = run(replace(scene, robot=None), motion, duration)
        yield _row(known["robot"], full, rigid)
    if "frozen" in known:
        still = run(replace(scene, robot=seen.robot), motion, duration)
        yield _row(known["frozen"], full, still)
    if rigid.velocity > 0.0:
        yield _row(known["closed"], rigid, Answer(closed_velocity(seen.now)))
        if "free" in known:
            yield _row(known["free"], rigid, Answer(closed_velocity(seen.now, coupled=False)))
    if seen.one is not None:
        yield _row(known["lumped"], still, Answer(closed_velocity(seen.one)))
    if isinstance(scene.coupling, ig.Bistable):
        factor = 10.0 ** np.random.default_rng([purpose, number]).uniform(0.3, 2.2)
        coupling = replace(scene.coupling, stop_stiffness=scene.coupling.stop_stiffness / factor)
        soft = run(replace(scene, coupling=coupling), motion, duration)
        prediction = softened(seen, coupling.stop_stiffness)
        yield _row(prediction, full, soft) | {"factor": factor}


def _row(prediction: Prediction, exact: Answer, reduced: Answer) -> Row:
    return {
        "kind": prediction.kind,
        "quiet": prediction.quiet,
        "error": abs(reduced.velocity - exact.velocity) / exact.velocity,
        "chain": exact.chain,
        "seconds": exact.seconds,
        "reduced_seconds": reduced.seconds,
        "groups": prediction.groups,
    }


def advised(kind: Kind, purpose: int, number: int) -> Iterator[Row]:
    """What `advise` makes of scene `number` at each tolerance."""
    scene, motion = draw(kind, purpose, number)
    full = run(scene, motion, final(situation(replace(scene, robot=None), motion)))
    if full.velocity <= 0.0:
        return
    for tolerance in TOLERANCES:
        begun = time.perf_counter()
        advice = advise(scene, motion, tolerance)
        asked = time.perf_counter()
        velocity = advice.object_velocity()
        ended = time.perf_counter()
        yield {
            "tolerance": tolerance,
            "applied": [entry.name for entry in advice.reductions if entry.applied],
            "chain": full.chain,
            "predicted": advice.error,
            "error": abs(velocity - full.velocity) / full.velocity,
            "seconds": full.seconds,
            "reduced_seconds": ended - asked,
            "advice_seconds": asked - begun,
        }


def collect(folder: Path, name: str, kind: Kind, purpose: int, count: int, of: Any) -> list[Row]:
    """Return the rows of `of` for scenes 0 to `count`; those on disk are not computed again."""
    found: list[Row] = []
    for first in tqdm(range(0, count, CHUNK), desc=name, unit=f"{CHUNK} scenes"):
        file = folder / f"{name}-{first:06d}.jsonl"
        if not file.is_file():
            lines = []
            for number in range(first, first + CHUNK):
                lines += [json.dumps({"number": number, **row}) for row in of(kind, purpose, number)]
            with whole_file(file) as out:
                out.write("\n".join(lines).encode())
        found += [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    return found

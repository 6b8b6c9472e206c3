"""What really happens: the slow independent solver at rtol 1e-13, and how far a second method is from it."""

from collections.abc import Sequence
from dataclasses import asdict

from agents.jobs import Result, digest_of
from experiments import reference
from experiments.lab.tables import Gather, Row, result_of
from experiments.speed_vs_error import quantities, scenes
from experiments.speed_vs_error.quantities import Solution, errors
from experiments.speed_vs_error.scenes import Approach, approach_of

RTOL = 1e-13


def truth(scene: str, second_rtol: float) -> Result:
    """Return what DOP853 says at RTOL, and its distance from Radau at `second_rtol`."""
    approach = approach_of(scene)
    best = approach.solved(reference.simulate, rtol=RTOL, method="DOP853")
    second = approach.solved(reference.simulate, rtol=second_rtol, method="Radau")
    doubt = {f"{name}_doubt": value for name, value in errors(second, best).items()}
    counts = {"second_contacts": second.contacts, "second_passes": second.passes}
    return result_of([{"scene": scene, "description": approach.description, **asdict(best), **counts, **doubt}])


def rows(gather: Gather, approaches: Sequence[Approach], second_rtol: float) -> list[Row]:
    """Return the rows of all approaches."""
    depends = digest_of(reference.__name__, quantities.__name__, __name__, *scenes.SOURCES)
    asked = [{"scene": approach.name, "second_rtol": second_rtol} for approach in approaches]
    return gather("truth", truth, asked, depends)


def solutions(rows: Sequence[Row]) -> dict[str, Solution]:
    """Return the true solutions by the name of the approach."""
    return {row["scene"]: Solution(**{name: row[name] for name in Solution.__dataclass_fields__}) for row in rows}

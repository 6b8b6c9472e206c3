"""What really happens: the slow independent solver at rtol 1e-13, and how far a second method is from it."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from agents.jobs import Result, digest_of
from experiments import reference
from experiments.lab.tables import Row, gathered, result_of
from experiments.speed_vs_error import quantities, scenes
from experiments.speed_vs_error.quantities import Answer, answer_of, errors
from experiments.speed_vs_error.scenes import Approach, approach_of

RTOL = 1e-13


def truth(scene: str, second_rtol: float) -> Result:
    """Return what DOP853 says at RTOL, and its distance from Radau at `second_rtol`."""
    approach = approach_of(scene)

    def solve(rtol: float, method: str) -> Answer:
        outcome = reference.simulate(approach.scene, approach.motion, approach.duration, rtol=rtol, method=method)
        return answer_of(outcome, approach.duration)

    best, second = solve(RTOL, "DOP853"), solve(second_rtol, "Radau")
    doubt = {f"{name}_doubt": value for name, value in errors(second, best).items()}
    about = {"scene": scene, "description": approach.description}
    return result_of(
        [about | asdict(best) | {"second_contacts": second.contacts, "second_passes": second.passes} | doubt]
    )


def rows(folder: Path, approaches: Sequence[Approach], second_rtol: float, processes: int | None = None) -> list[Row]:
    """Return the rows of all approaches."""
    depends = digest_of(reference.__name__, quantities.__name__, __name__, *scenes.SOURCES)
    asked = [{"scene": approach.name, "second_rtol": second_rtol} for approach in approaches]
    return gathered(folder, "truth", truth, asked, depends, processes=processes)


def answers(rows: Sequence[Row]) -> dict[str, Answer]:
    """Return the true answers by the name of the approach."""
    return {row["scene"]: Answer(**{name: row[name] for name in Answer.__dataclass_fields__}) for row in rows}

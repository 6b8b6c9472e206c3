"""`impact-gym recordings`: what was played as an operator, for training."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from tyro.conf import Positional

from agents.command_line import run_command
from experiments.play import tries
from experiments.play.assistance import PERIOD
from experiments.play.tries import Try
from impact_gym.files import write_file

SPARE = 3  # ticks between the horizon and the next recording


def played(folder: Path, marked: bool = False) -> list[Try]:
    """Return the tries of persons in a folder that count, or all of them.

    Raises:
        ValueError: there is none, or they are of several environments.
    """
    found = [this for _, this in tries.folder_of(folder) if this.person and (marked or this.counts)]
    if not found:
        raise ValueError(f"{folder} has no try of a person that counts")
    if any(this.environment != found[0].environment for this in found):
        raise ValueError(f"{folder} has tries with several couplings or set-ups: take those of one, a folder each")
    return found


def operator_of(found: Sequence[Try]) -> dict[str, Any]:
    """Return a `Replay` that draws one of the tries for each episode: for `operator` of a set-up or an environment."""
    ticks = round(found[0].environment["horizon"] / PERIOD) + SPARE
    times, velocities = list[float](), list[float]()
    for number, this in enumerate(found):
        given = this.operator["velocity"][: ticks - 1]
        begin = number * (ticks * PERIOD)
        times += [begin + k * PERIOD for k in (*range(len(given)), ticks - 1)]  # the last is held
        velocities += [*given, given[-1]]
    return {
        "type": "Replay",
        "time": times,
        "velocity": velocities,
        "length": ticks * PERIOD,
        "recording": [0, len(found)],
    }


@dataclass(frozen=True)
class Recordings:
    """Make an operator of what was played, for the [environment] of a set-up."""

    folder: Positional[Path]
    """Folder of tries, as impact-gym play leaves them."""
    out: Positional[Path] = Path("operator.toml")
    """TOML file to write."""
    marked: bool = False
    """Take tries that are marked as interrupted or late, too."""


def work(options: Recordings) -> None:
    """Do what the options ask for."""
    found = played(options.folder, options.marked)
    content = {"environment": {"operator": operator_of(found)}}
    print(f"{len(found)} recordings: {write_file(options.out, tomli_w.dumps(content))}")


if __name__ == "__main__":
    run_command("recordings", Recordings, work)

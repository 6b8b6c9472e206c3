"""`impact-gym recordings`: what was played as a dataset of Minari, and as an operator for training."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
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


def dataset(found: Sequence[Try], name: str) -> Any:
    """Play tries again in one environment and keep them as a dataset of Minari; return it.

    Each step has the observation, the action of the assistance, and in its info the operator's command as it arrived
    (m/s), what the flange was sent to (m/s) and the record, with which `reset` plays the episode again.
    """
    import minari

    from impact_gym.minari import EpisodeInfo

    class StepInfo(EpisodeInfo):
        def __call__(self, env: Any, **step: Any) -> dict[str, Any]:
            data, sensors = super().__call__(env, **step), env.unwrapped.sensors()
            return {**data, "info": {**data["info"], **{key: sensors[key] for key in ("command", "executed")}}}

    env = gym.make("ImpactTeleop-v0", **found[0].environment, operator=operator_of(found))
    collector = minari.DataCollector(env, StepInfo, record_infos=True)
    for number, this in enumerate(found):
        collector.reset(seed=this.seed, options={"record": {**this.record, "operator.recording": number + 0.5}})
        for action in this.actions:
            *_, ended, _, info = collector.step(np.array(action, np.float32))
        if not ended or info["done_time"] != this.result["done_time"]:
            raise RuntimeError("a try does not end as it did: it was made with another version of the environment")
    return collector.create_dataset(name, algorithm_name=", ".join(sorted({this.assist for this in found})))


@dataclass(frozen=True)
class Recordings:
    """Make a dataset of Minari of what was played, or an operator for a set-up."""

    folder: Positional[Path]
    """Folder of tries, as impact-gym play leaves them."""
    name: str = "impact/play-v0"
    """Of the dataset."""
    operator: Path | None = None
    """Write a TOML file with the operator instead, for the [environment] of a set-up."""
    marked: bool = False
    """Take tries that are marked as interrupted or late, too."""


def work(options: Recordings) -> None:
    """Do what the options ask for."""
    found = played(options.folder, options.marked)
    if options.operator is not None:
        import tomli_w

        content = {"environment": {"operator": operator_of(found)}}
        print(f"{len(found)} recordings: {write_file(options.operator, tomli_w.dumps(content))}")
        return
    made = dataset(found, options.name)
    print(f"{made.total_episodes} episodes, {made.total_steps} steps: {options.name}")


if __name__ == "__main__":
    run_command("recordings", Recordings, work)

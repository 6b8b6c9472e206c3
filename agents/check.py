"""The command `impact-gym check`: print what a set-up's file means, and draw the set-up."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from gymnasium.error import DependencyNotInstalled

from agents.baselines import PaperTrapezoid
from agents.evaluate.scenario_batch import VALIDATION_SEED, ScenarioBatch
from agents.setups import Setup, load_setup
from agents.setups.evaluation import variants
from agents.setups.feasible import corners, doubts, hardest_hit, lag, least_speed
from agents.setups.keys import prefixed_errors
from agents.train.ppo import Run
from impact_gym.quantities import QUANTITIES
from impact_gym.support.command_line import run_command
from impact_gym.support.files import whole_file
from impact_gym.task import ObservationSpec

SAMPLE = 500  # number of scenarios that the paper's rule plays


@dataclass(frozen=True)
class Check:
    """Check a set-up, and describe it.

    A set-up is a file that describes an arm, the objects that its tool touches, and the training and evaluation of
    controllers. The command prints the main settings. It plays the paper's rule in 500 scenarios, and prints the
    results. It draws robot, tool and object to scale.
    """

    setup: tyro.conf.Positional[str]
    """Name of a shipped set-up, or file of a set-up."""
    picture: Path | None = None
    """PNG file for the picture; by default reports/setups/NAME.png. Drawing needs the package's extra `render`."""


def lines(setup: Setup) -> Iterator[str]:
    """Yield the lines to print about a set-up."""
    task = setup.task
    yield f"{setup.name}: {setup.title}"
    yield f"  {setup.about}"
    yield "\nobservation"
    for place, entry in enumerate(ObservationSpec(task).entries):
        yield f"  {place}: {entry.words} ({entry.unit}), {entry.scale.low:g} to {entry.scale.high:g}"
    yield "\nactions"
    for action in task.action.entries:
        yield f"  {action.words}: {action.low:g} to {action.high:g} {action.unit}"
    yield "\neach episode"
    for name, (low, high) in task.ranges.items():
        quantity = QUANTITIES[name]
        how = "fixed" if low == high else "log-uniform" if quantity.by_ratio(low) else "uniform"
        ends = f"{low:g}" if low == high else f"{low:g} to {high:g}"
        if name != "time_weight":
            yield f"  {name}: {ends}{'' if quantity.unit == '-' else f' {quantity.unit}'}, {how}"
    yield "\nwhat follows"
    yield from (f"  warning: {sentence}" for sentence in doubts(task, setup.evaluation.weights))
    yield f"  {least_speed(task)}"
    lags = [1e3 * lag(corner) for corner in corners(task)]
    behind = " to ".join(dict.fromkeys((f"{min(lags):.3g}", f"{max(lags):.3g}")))
    yield f"  the tool lags {behind} mm behind at the full {task.acceleration_range[1]:g} m/s^2"
    with prefixed_errors(f"{setup.cli_name}: the paper's rule"):
        played = ScenarioBatch.of("validation", SAMPLE, task).play(PaperTrapezoid().for_task(task))
    velocity = played.object_velocity[~played.missed]
    leaves = f"leaves the touched objects at {velocity.mean():.3f} m/s (mean)" if velocity.size else "touches no object"
    yield (
        f"  in {SAMPLE} scenarios, the paper's rule {leaves}, {'is done' if task.operator else 'arrives'} after"
        f" {played.approach_time.mean():.3f} s and misses {int(played.missed.sum())}"
    )
    yield (
        f"  an object that is missed costs {task.missed_cost:g} m/s besides the time, V_p of the hardest hit is about"
        f" {hardest_hit(task):.2g} m/s; each percent of misses adds {0.01 * task.missed_cost:g} m/s to the mean cost"
    )
    if 0.0 < (force := task.coupling.holding_force) < math.inf:
        yield f"  the front stop holds the tool with {force:.3g} N; below that force the coupling is rigid"
    yield "\ntrained by"
    yield f"  {Run(setup, setup.training).command}"
    yield f"baselines: {', '.join(setup.against) or 'none'}; tuned here: {', '.join(setup.tuned)}"
    yield "\nevaluation"
    weights = ", ".join(f"{weight:g}" for weight in setup.evaluation.weights)
    yield f"  on {setup.evaluation.scenarios:,} scenarios ({setup.evaluation.set}), time weights of {weights} m/s per s"
    changes = variants(setup.evaluation, setup.environment)
    counts = dict.fromkeys((change.argument for change in changes), 0)
    counts |= Counter(change.argument for change in changes if not change.same)
    varied = ", ".join(f"{name} ({count})" for name, count in counts.items())
    yield f"  changed one at a time, with the number of values: {varied or 'nothing'}"


def run(options: Check) -> None:
    """Print the `lines` about a set-up, and draw the robot, the tool and the object at rest."""
    setup = load_setup(options.setup)
    for line in lines(setup):
        print(line)
    path = options.picture or Path("reports/setups") / f"{setup.name}.png"
    env = setup.make(render_mode="rgb_array")
    env.reset(seed=VALIDATION_SEED)
    try:
        pixels = np.asarray(env.render())
    except DependencyNotInstalled as error:
        print(f"no picture: {error}")
        return
    import pygame

    with whole_file(path) as file:
        pygame.image.save(pygame.surfarray.make_surface(np.swapaxes(pixels, 0, 1)), file, "picture.png")
    print(f"picture: {path}")


if __name__ == "__main__":
    run_command("check", Check, run)

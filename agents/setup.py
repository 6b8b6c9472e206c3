"""Check a set-up and see what follows from it: `python -m agents.setup my.toml`, or the name of one that is shipped."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby, product
from operator import attrgetter
from pathlib import Path

import numpy as np
import tyro

from agents.baselines import PaperTrapezoid
from agents.baselines.tuned import FIXED, names
from agents.command_line import command_line
from agents.evaluate.stage import VALIDATION_SEED, Stage
from agents.setups import Setup, load_setup, shipped
from agents.setups.evaluation import variants
from agents.setups.keys import known
from agents.train.settings import command, default_settings
from impact_gym.envs import observation
from impact_gym.envs.scenario import FIELDS, LOGARITHMIC, UNITS, Range
from impact_gym.envs.setting import HOLDER_NUMBERS, NUMBERS
from impact_gym.envs.task import Task
from impact_gym.files import whole_file
from impact_gym.physics.impact import free_tool, rigid_tool
from impact_gym.scene import Bistable, Rigid, Robot, RobotTable, SpringDamper

PAPERS_SPEED = 1.0  # m/s
SAMPLE = 500  # scenarios that the paper's rule is played through
FARTHEST_SEEN = observation.ENTRIES[0].high  # m, of the flange


@dataclass(frozen=True)
class Check:
    """Check a set-up and print what follows from it."""

    setup: tyro.conf.Positional[str]
    """A name or a file."""
    picture: Path | None = None
    """Where the picture of the chain goes, to scale, a PNG; default: reports/setups/NAME.png. Needs extra render."""


def check(setup: Setup, called: str) -> None:
    """Refuse what would only show hours later: a setting, a baseline or a bound that there is not.

    Raises:
        ValueError: names the file and what is wrong.
    """
    default_settings(called)
    there = {*setup.tuned, *names(), *FIXED}
    try:
        for name in setup.against:
            if ":" not in name:
                known("baselines.against.", [name], there)
        known("baselines.bound.", [setup.bound], [setup.name, *shipped()])
        known("evaluation.of.", [setup.evaluation.of], ["paper-trapezoid", *shipped()])
    except ValueError as error:
        raise ValueError(f"{setup.path}: {error}") from None


def drawn(task: Task) -> list[str]:
    """Return a line for each number that episodes draw."""
    pairs: dict[str, tuple[Range, str, bool]] = {
        name: (pair, unit, logarithmic)
        for name, pair, unit, logarithmic in zip(FIELDS, task.ranges.pairs(), UNITS, LOGARITHMIC, strict=True)
    }
    pairs["reaction_delay"] = task.delays, "s", False
    pairs |= {name: (pair, NUMBERS[name].unit, NUMBERS[name].logarithmic) for name, pair in task.drawn.items()}
    lines = []
    for name, ((low, high), unit, logarithmic) in pairs.items():
        how = "fixed" if low == high else "log-uniform" if logarithmic else "uniform"
        values = f"{low:g}" if low == high else f"{low:g} to {high:g}"
        lines.append(f"  {name}: {values} {unit.replace('(no unit)', '')}".rstrip() + f", {how}")
    return lines


def corners(task: Task) -> Iterator[Task]:
    """Yield the task with every end of every range of what holds the tool."""
    names = [name for name in task.drawn if name in HOLDER_NUMBERS]
    middles = {name: sum(pair) / 2 for name, pair in task.drawn.items()}
    for ends in product(*(task.drawn[name] for name in names)):
        yield task.at(middles | dict(zip(names, ends, strict=True)))


def lag(task: Task) -> float:
    """How far the tool stays behind the imposed motion at full acceleration, m, in equilibrium.

    The force on all that is behind a spring, over its stiffness: the coupling's and the robot's, one behind the other.
    """
    acceleration = task.acceleration_range[1]
    behind = 0.0
    if isinstance(task.coupling, SpringDamper):
        behind = acceleration * task.tool_mass / task.coupling.stiffness
    robots = [task.robot] if isinstance(task.robot, Robot) else []
    if isinstance(task.robot, RobotTable):
        robots = [task.robot.at(position) for position in task.robot.position]
    return behind + max((acceleration * (one.mass + task.tool_mass) / one.stiffness for one in robots), default=0.0)


def held(task: Task) -> float:
    """Return the acceleration up to which the front stop of a bistable mechanism keeps its slider, m/s^2; else inf."""
    if not isinstance(task.coupling, Bistable):
        return np.inf
    return float(task.coupling.force(task.coupling.rest)) / task.tool_mass


def estimate(task: Task, scenario: dict[str, float]) -> float:
    """V_p of the paper's rule by an instantaneous impact (paper, eq. 1-4), m/s; what pushes afterwards is left out."""
    speed = min(PAPERS_SPEED, task.velocity_range[1])
    mass = task.tool_mass
    if isinstance(task.coupling, Rigid):
        if task.robot is None:
            return float(rigid_tool(speed, 0.0, scenario["restitution"]))
        mass += (task.robot if isinstance(task.robot, Robot) else task.robot.at(scenario["distance"])).mass
    return float(free_tool(mass, scenario["object_mass"], speed, 0.0, scenario["restitution"])[1])


def lines(setup: Setup, called: str) -> Iterator[str]:
    """Yield the lines to print about a set-up; `called` is how the command line named it."""
    task = Task(**setup.environment)
    yield f"{setup.name}: {setup.title}"
    yield f"  {setup.about}"
    yield "\nobservation"
    for place, entry in enumerate(observation.entries(task)):
        yield f"  {place}: {entry.name} ({entry.unit}), {entry.low:g} to {entry.high:g}"
    yield "\nactions"
    for name, (low, high), unit in (
        ("velocity to go to", task.velocity_range, "m/s"),
        ("acceleration to use for it", task.acceleration_range, "m/s^2"),
    ):
        yield f"  {name}: {low:g} to {high:g} {unit}"
    yield "\neach episode"
    yield from drawn(task)
    yield "\nwhat follows"
    lags = [1e3 * lag(one) for one in corners(task)]
    spread = f"{min(lags):.3g}" if min(lags) == max(lags) else f"{min(lags):.3g} to {max(lags):.3g}"
    yield f"  the tool lags {spread} mm behind at the full {task.acceleration_range[1]:g} m/s^2"
    yield from _impact(task)
    rule = PaperTrapezoid().for_environment(setup.environment)
    played = Stage.of("validation", SAMPLE, **setup.environment).play(rule)
    yield (
        f"  played through {SAMPLE} scenarios, the paper's rule leaves the object {played.object_velocity.mean():.3f}"
        f" m/s (mean), arrives after {played.approach_time.mean():.3f} s and misses {int(played.missed.sum())}"
    )
    weakest = min(held(one) for one in corners(task))
    if weakest < task.acceleration_range[1]:
        yield (
            f"  warning: the front stop holds the tool up to {weakest:.3g} m/s^2, the arm can make"
            f" {task.acceleration_range[1]:g}: above that the mechanism leaves its stop without a touch"
        )
    if task.ranges.distance[1] > FARTHEST_SEEN:
        yield (
            f"  warning: objects stand up to {task.ranges.distance[1]:g} m ahead, but the observation ends at a flange"
            f" position of {FARTHEST_SEEN:g} m"
        )
    check(setup, called)
    yield "\ntrained by"
    yield f"  {command(default_settings(called))}"
    yield f"baselines: {', '.join(setup.against) or 'none'}; tuned here: {', '.join(setup.tuned)}"
    yield "\nevaluation"
    weights = ", ".join(f"{weight:g}" for weight in setup.evaluation.weights)
    yield f"  on {setup.evaluation.scenarios:,} scenarios ({setup.evaluation.set}), time weights of {weights} m/s per s"
    changes = groupby(variants(setup.evaluation, setup.environment), attrgetter("argument"))
    varied = [f"{name} ({len([one for one in found if not one.same])})" for name, found in changes]
    yield f"  changed one at a time, so many values each: {', '.join(varied) or 'nothing'}"


def _impact(task: Task) -> Iterator[str]:
    """Yield the closed-form estimate at the easiest and the hardest scenario."""
    pairs = dict(zip(FIELDS, task.ranges.pairs(), strict=True))
    ends = [
        {"object_mass": mass, "restitution": e, "distance": pairs["distance"][1]}
        for mass, e in product(pairs["object_mass"], pairs["restitution"])
    ]
    found = [estimate(one, scenario) for one in corners(task) for scenario in ends]
    yield (
        f"  the paper's rule, at {min(PAPERS_SPEED, task.velocity_range[1]):g} m/s, leaves the object"
        f" {min(found):.3g} to {max(found):.3g} m/s by an instantaneous impact (the coupling's push left out)"
    )


def draw(setup: Setup, path: Path) -> None:
    """Write a picture of the chain at rest, to scale.

    Raises:
        DependencyNotInstalled: pygame is not there.
    """
    env = setup.make(render_mode="rgb_array")
    env.reset(seed=VALIDATION_SEED)
    pixels = env.render()
    import pygame

    with whole_file(path) as file:
        pygame.image.save(pygame.surfarray.make_surface(np.swapaxes(pixels, 0, 1)), file, "picture.png")


def main() -> None:
    """Read from the command line which set-up, and say what follows from it."""
    with command_line("agents.setup"):
        wanted = tyro.cli(Check, prog="python -m agents.setup")
        setup = load_setup(wanted.setup)
        for line in lines(setup, wanted.setup):
            print(line)
        path = wanted.picture or Path("reports/setups") / f"{setup.name}.png"
        try:
            draw(setup, path)
            print(f"picture: {path}")
        except ImportError as error:
            print(f"no picture: {error}")


if __name__ == "__main__":
    main()

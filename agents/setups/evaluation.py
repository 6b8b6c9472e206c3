"""How a set-up is evaluated, the table `[evaluation]` of its file: at which weights, on which scenarios."""

import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from agents.setups.keys import known, table, within
from impact_gym.scene import SpringDamper
from impact_gym.task import ScenarioRanges, Task, evaluation_sets
from impact_gym.task.task import ARGUMENTS
from impact_gym.validation import distinct, number, numbers, whole

WEIGHTS = (0.7, 1.0, 2.0, 4.0)  # m/s per s
RESERVED = ("time_weight", "privileged", "max_episode_steps")
"""Arguments of the environment that training and evaluation see to."""
SET_UP_ARGUMENTS = tuple(name for name in ARGUMENTS if name not in RESERVED)
"""Those that say what an environment is, not what it is used for."""
AS_TRAINED = "as trained"

COMPLIANT = {"type": "Robot", "mass": 5.225, "stiffness": 1.9e5, "damping": 50.4}  # docs/provenance.md
VARIED: Mapping[str, Any] = {
    "reaction_delay": [0.0, 0.008, 0.016, 0.024, 0.032, 0.048, 0.064],
    "alarm_threshold": {"times": [0.25, 0.5, 1.0, 2.0, 4.0]},
    "force_noise": [0.0, 0.5, 1.0, 2.0, 5.0],
    "range_noise": [0.0, 0.005, 0.01, 0.02, 0.03],
    "tool_mass": {"times": [0.7, 0.85, 1.0, 1.15, 1.3]},
    "coupling.stiffness": {"times": [0.7, 0.85, 1.0, 1.15, 1.3]},
    "coupling.front_stop": {"times": [0.5, 1.0, 2.0, 4.0]},
    "range_sensor.share": {"times": [0.5, 1.0, 2.0]},
    "range_sensor.bias": [0.0, 0.005, 0.01],
    "range_sensor.dropout": [0.0, 0.25, 0.5],
    "range_sensor.delay": [0.0, 0.016, 0.032],
    "robot": ["rigid"],
    "robot.stiffness": {"times": [0.5, 1.0, 2.0]},
}
"""What is varied unless a file says otherwise, see `usual`; what a set-up does not have is left out."""
MAY_BE_NONE = ("robot", "coupling.stroke")
"""Of that: what an environment may have though its set-up says nothing of it."""


@dataclass(frozen=True)
class Evaluation:
    """How a set-up is evaluated."""

    weights: tuple[float, ...] = WEIGHTS
    """Time weights, m/s per s: baselines are tuned for each, policies are validated and compared at each."""
    curve: tuple[float, ...] = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
    """Those at which a policy is played for its trade-off, as far as it was trained for them."""
    typical: float = 2.0
    """Where one weight must do."""
    set: str = "test"
    """Frozen set of the report; an environment with a scenario of its own meets as many from its own ranges."""
    scenarios: int = 2000
    """How many of it."""
    varied: Mapping[str, Any] = field(default_factory=lambda: usual({}, COMPLIANT))
    """What is changed, one at a time, to see whether policies hold: arguments of the environment by dotted names, each
    with a list of values or a table {times = [...]} of multiples; `scenario` with names of frozen sets."""
    nominal: Mapping[str, Any] = field(default_factory=dict)
    """Arguments that the environment has before these changes, instead of what its episodes draw: in a file, a robot
    "rigid" is none."""

    @classmethod
    def of_table(
        cls, content: Mapping[str, Any], environment: Mapping[str, Any], robot: Mapping[str, Any] | None = None
    ) -> "Evaluation":
        """Return what a file's table says for an environment; `robot` is that of `usual`.

        Raises:
            TypeError, ValueError: a key is unknown, a value out of range, or a change makes no environment; names it.
        """
        known("evaluation.", content, [item.name for item in fields(cls)])
        known("evaluation.nominal.", table(content, "nominal", "evaluation."), SET_UP_ARGUMENTS)
        nominal = {name: _argument(value) for name, value in content.get("nominal", {}).items()}
        environment, given = {**environment, **nominal}, dict(content) | {"nominal": nominal}
        with within("evaluation.nominal"):
            Task(**environment)
        for name in {"weights", "curve"} & content.keys():
            given[name] = tuple(sorted(numbers(f"evaluation.{name}", content[name], "m/s per s", above=0)))
            distinct(f"evaluation.{name}", given[name])
            if not given[name]:
                raise ValueError(f"evaluation.{name} must hold weights, got {content[name]!r}")
        if "typical" in content:
            given["typical"] = number("evaluation.typical", content["typical"], "m/s per s", above=0)
        if not isinstance(given.get("set", ""), str):
            raise ValueError(f"evaluation.set must be a name, got {given['set']!r}")
        count = evaluation_sets.load(given.get("set", cls.set)).count
        scenarios = whole("evaluation.scenarios", given.get("scenarios", min(cls.scenarios, count)), at_least=2)
        if scenarios > count:
            raise ValueError(f"evaluation.scenarios must be at most the {count} of the set, got {scenarios}")
        for name, values in table(content, "varied", "evaluation.").items():
            list(changes(name, values, environment, strict=True))
        return cls(**{"varied": usual(environment, robot), **given, "scenarios": scenarios})


def usual(environment: Mapping[str, Any], robot: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return what is varied of an environment unless its file says otherwise: VARIED, and its own numbers.

    A `robot` is tried where the environment has none, a stroke too short for the spring where it has no stops, and
    the frozen set `hard` where objects come from the usual ranges, outside of which it lies.
    """
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        task = Task(**environment)
    varied = dict(VARIED)
    for name in ("reaction_delay", "force_noise", "range_noise"):
        own = task.by_path()[name]
        varied[name] = sorted({*VARIED[name], *([own] if isinstance(own, float) else [])})
    if isinstance(task.coupling, SpringDamper) and task.coupling.stroke is None and not task.drawn:
        needed = task.tool_mass * task.acceleration_range[1] / task.coupling.stiffness
        varied["coupling.stroke"] = [float(f"{0.4 * needed:.2g}")]  # m
    if task.robot is None:
        varied["robot"] = ["rigid", robot] if robot else []
    if task.scenario == ScenarioRanges():
        varied["scenario"] = [AS_TRAINED, "hard"]
    return {name: values for name, values in varied.items() if values}


@dataclass(frozen=True)
class Change:
    """One change of an environment."""

    argument: str  # dotted
    label: str
    value: float  # in the argument's unit, or a multiple; nan where it is no number
    multiple: bool  # of what the environment has
    environment: Mapping[str, Any]  # as changed
    scenarios: str = ""  # the frozen set it is played on, if that is the change
    same: bool = False  # it is no change


def variants(evaluation: Evaluation, environment: Mapping[str, Any]) -> list[Change]:
    """Return all changes that `evaluation` asks for and `environment` knows, argument by argument."""
    begun = {**environment, **evaluation.nominal}
    return [change for name, values in evaluation.varied.items() for change in changes(name, values, begun)]


def changes(name: str, values: Any, environment: Mapping[str, Any], strict: bool = False) -> Iterator[Change]:
    """Yield the changes of one argument; what the environment does not have, or refuses, is left out.

    Raises:
        TypeError, ValueError: no list of values; or, where `strict`, an argument that there is not or a value that the
            environment refuses. Names it.
    """
    where = f"evaluation.varied.{name}"
    multiples = isinstance(values, Mapping)
    if multiples:
        known(f"{where}.", values, ("times",))
    listed = values.get("times") if multiples else values
    if not isinstance(listed, list) or not listed:
        raise ValueError(f"{where} must be a list of values, or a table with one, {{ times = [...] }}, got {values!r}")
    distinct(where, list(map(_label, listed)))
    if name == "scenario":
        for scenarios in listed:
            same = scenarios == AS_TRAINED
            with within(where):
                _ = same or evaluation_sets.load(scenarios)  # raises where there is none
            yield Change(name, scenarios, math.nan, False, environment, "" if same else scenarios, same)
        return
    task = Task(**environment)
    given = {path: value for path, value in task.by_path().items() if path.partition(".")[0] in SET_UP_ARGUMENTS}
    if strict:
        known("evaluation.varied.", [name], ["scenario", *given, *MAY_BE_NONE])
    if given.get(name) is None and name not in MAY_BE_NONE:
        return
    for value in listed:
        try:
            with within(where), warnings.catch_warnings(action="ignore", category=UserWarning):  # meant to be hard
                other = _multiple(given[name], value) if multiples else _argument(value)
                varied = task.changed({name: other})
        except ValueError:
            if strict:
                raise
            continue
        size = float(value) if isinstance(value, (int, float)) else math.nan
        yield Change(name, _label(value), size, multiples, varied.arguments(), same=varied == task)


def _argument(value: Any) -> Any:
    """Return a value in a file as an argument of the environment; a robot that is rigid is none."""
    return None if value == "rigid" else value


def _multiple(own: Any, value: Any) -> Any:
    """Return a multiple of a number or of a range."""
    factor = number("times", value, "-", above=0)
    return [factor * end for end in own] if isinstance(own, (list, tuple)) else factor * own


def _label(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_label(part)}" for name, part in value.items() if name != "type")
    return f"{value:g}" if isinstance(value, (int, float)) else str(value)

"""Evaluation of a set-up: the table `[evaluation]` of its file."""

import math
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from agents.setups.keys import from_table, prefixed_errors, refuse_unknown, table
from impact_gym.couplings import SpringDamper
from impact_gym.parameters import SI, Options
from impact_gym.quantities import QUANTITIES
from impact_gym.support.validation import Range, distinct, interval, number, one_of, shown
from impact_gym.task import ScenarioRanges, Task, evaluation_sets
from impact_gym.task.scenario import FIELDS
from impact_gym.task.task import ARGUMENTS

Weights = Annotated[tuple[float, ...], SI("m/s per s", above=0)]
WEIGHTS = (0.7, 1.0, 2.0, 4.0)  # m/s per s, default time weights
RESERVED = ("time_weight", "privileged", "max_episode_steps")
"""Arguments of the environment that a set-up must not have."""
SET_UP_ARGUMENTS = tuple(name for name in ARGUMENTS if name not in RESERVED)
AS_TRAINED = "as trained"
OUTSIDE = 0.2  # width of a range of `surroundings`, as a fraction of the set-up's range
LEAST_BIAS = 0.005  # m, smallest bias of a distance in `surroundings`
FORCE_BIASES = (0.0, 0.5, 1.0)  # N, added to the set-up's standard deviation in `surroundings`

COMPLIANT = {"type": "Robot", "mass": 5.225, "stiffness": 1.9e5, "damping": 50.4}  # origin: docs/provenance.md
VARIED: Mapping[str, Any] = {
    "reaction_delay": [0.0, 0.008, 0.016, 0.024, 0.032, 0.048, 0.064],
    "alarm_threshold": {"times": [0.25, 0.5, 1.0, 2.0, 4.0]},
    "force_noise": [0.0, 0.5, 1.0, 2.0, 5.0],
    "range_noise": [0.0, 0.005, 0.01, 0.02, 0.03],
    "tool_mass": {"times": [0.7, 0.85, 1.0, 1.15, 1.3]},
    "coupling.stiffness": {"times": [0.7, 0.85, 1.0, 1.15, 1.3]},
    "coupling.front_stop": {"times": [0.5, 1.0, 2.0, 4.0]},
    "range_sensor.share": {"times": [0.5, 1.0, 2.0]},
    "range_sensor.bias": [-0.0125, -0.01, -0.005, 0.0, 0.005, 0.01, 0.0125],
    "range_sensor.scale": [-0.1, 0.0, 0.1],
    "range_sensor.correlation": [0.0, 0.9],
    "range_sensor.dropout": [0.0, 0.25, 0.5],
    "range_sensor.delay": [0.0, 0.016, 0.032],
    "robot": ["rigid"],
    "robot.stiffness": {"times": [0.5, 1.0, 2.0]},
}
"""Values from which `usual` makes the default of `Evaluation.varied`."""
MAY_BE_NONE = ("robot", "coupling.stroke")
"""Arguments that can be varied even if the set-up does not have them."""


@dataclass(frozen=True)
class Evaluation(Options):
    """Time weights, scenarios and variations of the evaluation of a set-up."""

    weights: Weights = WEIGHTS
    """Time weights, m/s per s. Baselines are tuned, and policies are validated and compared, at these weights."""
    curve: Weights = (0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0)
    """Time weights, m/s per s, for the trade-off curve. Default weights outside the range of the training are left
    out."""
    typical: Annotated[float, SI("m/s per s", above=0)] = 2.0
    """Time weight, m/s per s, of the results that a report shows for one weight only."""
    set: str = "test"
    """Evaluation set that the report plays. If the environment has its own `scenario` ranges, scenarios are drawn from
    these ranges instead, unless the set is `hard`."""
    scenarios: Annotated[int, SI("-", at_least=2)] = 2000
    """Number of scenarios to play, from the first of the set on."""
    varied: Mapping[str, Any] = field(default_factory=lambda: usual(Task(), COMPLIANT))
    """Values of arguments, such as robot.stiffness; one argument is changed at a time. An argument has a list of values
    or a table {times = [...]} of multiples of the set-up's value. For `scenario`: names of sets, or "as trained"; for
    scenario.distance and the other numbers of a scenario: ranges. A user's set-up always gets `surroundings`, too."""
    nominal: Mapping[str, Any] = field(default_factory=dict)
    """Values of arguments that replace the set-up's values or ranges in all variations of `varied`. In a file, robot =
    "rigid" means no robot compliance."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("weights", "curve"):
            distinct(name, weights := getattr(self, name))
            if not weights:
                raise ValueError(f"{name} must hold weights, got {shown([*weights])}")
            object.__setattr__(self, name, tuple(sorted(weights)))
        number("scenarios", self.scenarios, "-", at_most=evaluation_sets.load(self.set).count)

    @classmethod
    def of_table(
        cls, content: Mapping[str, Any], environment: Mapping[str, Any], robot: Mapping[str, Any] | None = None,
        own: bool = True,
    ) -> "Evaluation":  # fmt: skip
        """Return the evaluation in the table of a file (`own`: of a user); TypeError, ValueError: a wrong entry."""
        nominal = table(content, "nominal", "evaluation.")
        refuse_unknown("evaluation.nominal.", nominal, SET_UP_ARGUMENTS)
        nominal = {name: None if value == "rigid" else value for name, value in nominal.items()}
        environment = {**environment, **nominal}
        with prefixed_errors("evaluation.nominal"):
            task = Task(**environment)
        for name, values in table(content, "varied", "evaluation.").items():
            list(changes(name, values, environment, strict=True))
        count = evaluation_sets.load(content.get("set", cls.set)).count
        defaults = {"varied": usual(task, robot), "scenarios": min(cls.scenarios, count)}
        content = {**defaults, **content, "nominal": nominal}
        if own:
            content["varied"] = {**surroundings(task), **content["varied"]}
        return from_table(cls, content, "evaluation")


def usual(task: Task, robot: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the default variations of a task: VARIED, and some values that depend on the task.

    A rigid robot is also replaced by `robot`. A spring without stops also gets a `stroke` of 40 % of its deflection at
    full acceleration, if `Task.drawn` is empty. With the default scenario ranges, the set `hard` is also played.
    """
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


def surroundings(task: Task) -> dict[str, Any]:
    """Return ranges of objects just below and just beyond those of a task, and biases of its sensors.

    The place comes first. A range that is outside has a fifth of the width of the task's range, in logarithms for
    numbers that are drawn log-uniformly. A distance sensor gets a bias of either sign by the standard deviation of its
    error; the bias of the force reading is drawn, with either sign.
    """
    varied, own = dict[str, Any](), task.by_path() | task.ranges
    for name in sorted(FIELDS, key=lambda each: each != "distance"):
        row, (low, high) = QUANTITIES[name], getattr(task.scenario, name)
        factor, width = max((high / low) ** OUTSIDE, 1.0 + OUTSIDE), max(OUTSIDE * (high - low), 0.1 * high)
        ends = (low / factor, high * factor) if row.by_ratio(low) else (max(low - width, 0.5 * low), high + width)
        below, beyond = (float(f"{min(end, row.limits.at_most):.3g}") for end in ends)
        outside = (below, low), (high, beyond)
        varied[f"scenario.{name}"] = [[start, end] for start, end in outside if start < end]
    for noise, bias in (("range_noise", "range_bias"), ("range_sensor.noise", "range_sensor.bias")):
        if own.get(noise) is not None:
            step = max(*QUANTITIES[noise].interval(own[noise]), LEAST_BIAS)
            low, high = QUANTITIES[bias].interval(own[bias])
            varied[bias] = [round(low - step, 6), *([low] if low == high else []), round(high + step, 6)]
    _, most = QUANTITIES["force_bias"].interval(own["force_bias"])
    varied["force_bias"] = [round(most + more, 6) for more in FORCE_BIASES]
    return varied


@dataclass(frozen=True)
class Change:
    """One change of an environment."""

    argument: str  # name of the changed argument, such as robot.stiffness
    label: str
    value: float  # new value in the argument's unit, or a factor, see `multiple`; nan: the new value is not a number
    multiple: bool  # whether `value` is a factor that multiplies the environment's own value
    environment: Mapping[str, Any]  # arguments of the environment after the change
    scenarios: str = ""  # name of the evaluation set to play; empty: `Evaluation.set`
    same: bool = False  # whether the new value equals the environment's own value
    ranges: Mapping[str, Range] = field(default_factory=dict)  # ranges of scenarios that replace those of the set-up


def variants(evaluation: Evaluation, environment: Mapping[str, Any]) -> list[Change]:
    """Return the changes of `evaluation` that are possible in `environment`, see `changes`."""
    begun = {**environment, **evaluation.nominal}
    return [change for name, values in evaluation.varied.items() for change in changes(name, values, begun)]


def changes(name: str, values: Any, environment: Mapping[str, Any], strict: bool = False) -> Iterator[Change]:
    """Yield the changes of one argument. Without `strict`, invalid values are left out, but not unknown sets."""
    where = f"evaluation.varied.{shown(name)[1:-1]}"
    multiples = isinstance(values, Mapping)
    if multiples:
        refuse_unknown(f"{where}.", values, ("times",))
    listed = values.get("times") if multiples else values
    if not isinstance(listed, list) or not listed:
        raise ValueError(
            f"{where} must be a list of one or more values or a table {{ times = [...] }}, got {shown(values)}"
        )
    distinct(where, list(map(_label, listed)))
    of_scenario = name.removeprefix("scenario.")
    if of_scenario in FIELDS and of_scenario != name:
        one_of(where, values, list)
        for pair in listed:
            low, high = QUANTITIES[of_scenario].interval(pair, where)
            label = f"{low:g} to {high:g} {QUANTITIES[of_scenario].unit}".removesuffix(" -")
            yield Change(name, label, 0.5 * (low + high), False, environment, ranges={of_scenario: (low, high)})
        return
    if name == "scenario":
        for scenarios in listed:
            same = scenarios == AS_TRAINED
            with prefixed_errors(where):
                _ = same or evaluation_sets.load(scenarios)  # ValueError: no such set
            yield Change(name, scenarios, math.nan, False, environment, "" if same else scenarios, same)
        return
    task = Task(**environment)
    given = {path: value for path, value in task.by_path().items() if path.partition(".")[0] in SET_UP_ARGUMENTS}
    known = [*(f"scenario.{field}" for field in FIELDS), *(given | dict.fromkeys(MAY_BE_NONE))]
    if strict:
        refuse_unknown("evaluation.varied.", [name], ["scenario", *known])
    if given.get(name) is None and name not in MAY_BE_NONE:
        return
    for value in listed:
        try:
            # hard tasks are intended here, so a UserWarning about a hard task is ignored
            with prefixed_errors(where), warnings.catch_warnings(action="ignore", category=UserWarning):
                other = None if value == "rigid" else value
                if multiples:
                    factor, own = number("times", value, "-", above=0), given.get(name)
                    ends = interval(f"times multiplies {name}, which", own, "(in the set-up)")
                    other = [factor * end for end in ends] if isinstance(own, (list, tuple)) else factor * ends[0]
                varied = task.changed({name: other})
        except ValueError:
            if strict:
                raise
            continue
        size = float(value) if isinstance(value, (int, float)) else math.nan
        yield Change(name, _label(value), size, multiples, varied.arguments(), same=varied == task)


def _label(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_label(part)}" for name, part in value.items() if name != "type")
    return f"{value:g}" if isinstance(value, float) or (isinstance(value, int) and abs(value) < 1e300) else str(value)

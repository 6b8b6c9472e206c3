"""Does it hold? One thing at a time is changed in the environment; the policies and baselines stay as they are."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from typing import Any, NamedTuple

from impact_gym.envs import evaluation_sets
from impact_gym.envs.task import Task

Environment = Mapping[str, Any]


class Variant(NamedTuple):
    """One change."""

    factor: str
    label: str
    value: float  # where it stands on the axis
    change: Callable[[Environment], dict[str, Any] | None]  # None: it does not apply
    scenarios: dict[str, Any] | None = None  # others than the report's

    def environment(self, environment: Environment) -> dict[str, Any] | None:
        """Return the changed environment, or None where the change does not apply or leaves no environment."""
        change = self.change(environment)
        if change is None:
            return None
        try:
            Task(**{**environment, **change})
        except ValueError:
            return None
        return {**environment, **change}


DELAY, THRESHOLD, NOISE = "reaction delay (ms)", "alarm threshold (N)", "noise of the force (N)"
ESTIMATE, MASS, STIFFNESS = "error of the distance estimate (mm)", "tool mass (%)", "stiffness of the coupling (%)"
MECHANISM, ROBOT, SCENARIOS = "front stop before the alignment (mm)", "robot", "scenarios"
CONTINUOUS = (DELAY, THRESHOLD, NOISE, ESTIMATE, MASS, STIFFNESS, MECHANISM)


def _option(name: str, value: Any) -> Callable[[Environment], dict[str, Any]]:
    return lambda environment: {name: value}


def _estimate(error: float) -> Callable[[Environment], dict[str, Any] | None]:
    return lambda environment: None if environment.get("range_noise") is None else {"range_noise": error}


def _times(share: float, value: Any) -> Any:
    """Return a share of a number, or of both ends of a range."""
    return [share * one for one in value] if isinstance(value, (list, tuple)) else share * value


def _mass(share: float) -> Callable[[Environment], dict[str, Any]]:
    return lambda environment: {"tool_mass": _times(share, environment.get("tool_mass", Task.tool_mass))}


def _coupling(environment: Environment) -> dict[str, Any]:
    """The coupling as JSON, with every default."""
    given = environment.get("coupling", {})
    record = Task(**environment).coupling
    return {"type": type(record).__name__, **{one.name: getattr(record, one.name) for one in fields(record)}, **given}


def _stiffness(share: float) -> Callable[[Environment], dict[str, Any] | None]:
    def change(environment: Environment) -> dict[str, Any] | None:
        coupling = _coupling(environment)
        if "stiffness" not in coupling:
            return None
        return {"coupling": {**coupling, "stiffness": _times(share, coupling["stiffness"])}}

    return change


def _front_stop(distance: float) -> Callable[[Environment], dict[str, Any] | None]:
    """A mechanism that lets go at another speed: its front stop stands nearer to the alignment or farther."""

    def change(environment: Environment) -> dict[str, Any] | None:
        coupling = _coupling(environment)
        return {"coupling": {**coupling, "front_stop": distance}} if coupling["type"] == "Bistable" else None

    return change


def _variants() -> Iterator[Variant]:
    for delay in (0.0, 0.008, 0.016, 0.024, 0.032, 0.048, 0.064):
        yield Variant(DELAY, f"{1e3 * delay:g}", 1e3 * delay, _option("reaction_delay", delay))
    for threshold in (0.25, 0.5, 1.0, 2.0, 4.0):
        yield Variant(THRESHOLD, f"{threshold:g}", threshold, _option("alarm_threshold", threshold))
    for noise in (0.0, 0.5, 1.0, 2.0, 5.0):
        yield Variant(NOISE, f"{noise:g}", noise, _option("force_noise", noise))
    for error in (0.0, 0.005, 0.01, 0.02, 0.03):
        yield Variant(ESTIMATE, f"{1e3 * error:g}", 1e3 * error, _estimate(error))
    for share in (0.7, 0.85, 1.0, 1.15, 1.3):
        yield Variant(MASS, f"{100 * share:g}", 100 * share, _mass(share))
        yield Variant(STIFFNESS, f"{100 * share:g}", 100 * share, _stiffness(share))
    for stop in (0.0005, 0.001, 0.002, 0.004):
        yield Variant(MECHANISM, f"{1e3 * stop:g}", 1e3 * stop, _front_stop(stop))
    yield Variant(ROBOT, "rigid", 0.0, _option("robot", None))
    compliant = {"type": "Robot", "mass": 5.225, "stiffness": 1.5e5, "damping": 53.75}  # paper, section 4
    yield Variant(ROBOT, "compliant", 1.0, _option("robot", compliant))
    yield Variant(SCENARIOS, "as trained", 0.0, lambda environment: {})
    hard = {"set": "hard", "count": min(500, evaluation_sets.load("hard").count)}
    yield Variant(SCENARIOS, "hard", 1.0, lambda environment: {}, hard)


VARIANTS = tuple(_variants())

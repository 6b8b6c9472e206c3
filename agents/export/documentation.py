"""Controllers to export, and the documentation: text for users in every exported file."""

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict
from functools import cached_property
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from agents.baselines import FIXED, Rule, tuned_rule
from agents.policies import Policy, load_policy
from agents.policies.networks import to_arrays
from agents.setups import Setup, load_setup, setup_tuning, shipped, shipped_baselines
from agents.setups.setup import UNSAID
from agents.setups.tuned import read_tuned
from impact_gym.support.archive import checksum
from impact_gym.support.provenance import modern_command
from impact_gym.support.validation import nearest
from impact_gym.task import QUANTITIES, ObservationSpec
from impact_gym.teleop.link import FADE

FORMAT = "impact_gym controller 1"
CALLS = (
    "call NAME_step once in each control period, and once more at the moment of the alarm; use the command until the "
    "next call"
)
RESETS = (
    "call NAME_reset before each approach, with the time weight; the weight is clipped to the range of {}, and a "
    "missing one (NaN or infinite) becomes the smallest; the call resets time, readings, alarm and memory, and "
    "commands no motion"
)
MISSING = (
    "a call without time, or with a time that is not later than before, repeats the last command; a missing number "
    "(NaN or infinite) keeps its last value; before the first value a number is 0, and a range is not used; {}"
)
ALARMS = {
    "reading": "the alarm is on or off as read; during the alarm, the time since the alarm advances with the time",
    "force": "the alarm stays on, and the time since the alarm advances with the time",
}
COORDINATES = (
    "the flange is at position 0 and at rest when an approach begins; positions, velocities and distances are positive "
    "towards the object; the distance of an object is the gap between the faces of tool and object when the approach "
    "begins; a force is positive if tool and object press against each other"
)
OF_SENSORS = {
    "distance_estimate": "distance_estimate is the estimate of that gap minus the present position",
    "range": "range is the gap between the faces when it was read, range_age is the age of the reading",
    "deflection": "deflection is the tool's displacement from its place at rest on the flange, positive to the object",
}
LIMITS = (
    "made for the objects, the delay and the arm that are listed below; outside of these ranges it was neither tuned "
    "nor trained: it may miss objects, or hit them at up to {:g} m/s"
)
OPERATOR = (
    "the flange's velocity is gain * u - withdrawal, where u is the operator's command; the withdrawal is complete for "
    "{:g} s after an alarm, and then fades over {:g} s; if u is 0 or missing, or no command has come for {:g} s, the "
    "flange stops at the arm's limit; pass a command that arrives between two calls to NAME_obey; a missing command "
    "counts as 0"
)


class Exported:
    """A controller to export: a policy, or a rule with its parameters for one time weight or several."""

    def __init__(self, controller: Policy | Rule, validation: Any = None, command: str = "", fails: str = "") -> None:
        """Describe a controller. Empty `validation` (JSON), `command` and `fails` come from a policy's provenance."""
        if not isinstance(controller, Policy | Rule):
            raise ValueError(f"controller must be a policy or a rule to be exported, got {type(controller).__name__}")
        self.controller, self.task = controller, controller.task
        self.weights = [*controller.weights] if isinstance(controller, Rule) and controller.weights else [2.0]
        self.spec, self.actions = ObservationSpec(self.task), self.task.action.entries
        self.policy = controller if isinstance(controller, Policy) else None
        provenance = self.policy.provenance if self.policy else {}
        self.command = command or modern_command(str(provenance.get("command", "by hand")))
        self.validation = validation or provenance.get("validation")
        settings = provenance.get("settings", {})
        name = settings.get("setup", settings.get("preset"))
        self.fails = fails or (load_setup(name).fails if name in shipped() else UNSAID)

    def at(self, time_weight: ArrayLike) -> Policy | Rule:
        """Return the controller for a time weight (m/s per s), or for the time weight of each row of a batch."""
        return self.controller.at(time_weight) if isinstance(self.controller, Rule) else self.controller

    @cached_property
    def documentation(self) -> dict[str, str]:
        """The entries by name. Each entry is JSON that is safe inside a comment in C, see `_plain`."""
        content = {name: _plain(value) for name, value in self._entries()}
        arrays = [self.controller.parameters] if isinstance(self.controller, Rule) else []
        digest = checksum(json.dumps(content), *(to_arrays(self.policy.network).values() if self.policy else arrays))
        return content | {"checksum": _plain(f"SHA-256 {digest} of all of the above and the parameters")}

    def _entries(self) -> Iterator[tuple[str, Any]]:
        task = self.task
        yield "format", FORMAT
        yield "kind", "network" if self.policy else type(self.controller).__name__
        yield "version", f"impact-gym {version('impact-gym')}"
        yield "made_by", self.command
        yield "limits", LIMITS.format(max(map(abs, task.velocity_range)))
        yield "fails", self.fails
        read = (OF_SENSORS[each] for each in self.spec.sensors if each in OF_SENSORS)
        yield "coordinates", "; ".join([COORDINATES, *read])
        yield "calls", CALLS
        yield "resets", RESETS.format("its input" if self.policy else "time_weight")
        yield "missing", MISSING.format(ALARMS[task.alarm])
        if task.operator:
            yield "operator", OPERATOR.format(task.after_alarm, FADE, task.uplink.timeout)
        yield "control_period", {"value": task.control_period, "unit": "s"}
        weight = task.ranges["time_weight"] if self.policy else (self.weights[0], self.weights[-1])
        if len(self.weights) == 1 and not self.policy:
            yield "time_weight_use", "ignored: one set of parameters serves all time weights"
        for name, (low, high), unit in (
            ("time_weight", weight, "m/s per s"), ("reaction_delay", task.ranges["reaction_delay"], "s"),
            ("velocity_limits", task.velocity_range, "m/s"), ("acceleration_limits", task.acceleration_range, "m/s^2"),
        ):  # fmt: skip
            yield name, {"low": low, "high": high, "unit": unit}
        yield "objects", {name: {"low": low, "high": high, "unit": QUANTITIES[name].unit}
                          for name, (low, high) in task.scenario.by_id().items()}  # fmt: skip
        yield "environment", task.arguments()
        yield "validation", self.validation or "unknown"
        yield "sensors", self.spec.sensors
        for place, entry in enumerate(self.spec.entries):
            scale = dict(zip(("low", "high", "scaled_low", "curve"), entry.scale[:4], strict=True))
            yield f"input {place:02}", {"id": entry.id, "words": entry.words, "unit": entry.unit, **scale}
        for place, action in enumerate(self.actions):
            yield f"output {place:02}", action._asdict()


def _plain(value: Any) -> str:
    """Return JSON in ASCII that neither begins nor ends a comment in C, and has no trigraph."""
    text = json.dumps(value, default=lambda record: {"type": type(record).__name__, **asdict(record)})
    return text.replace("*/", "*\\u002f").replace("/*", "/\\u002a").replace("??", "?\\u003f")


def failures(folder: Path, key: str) -> str:
    """Return where the controller with a checksum or name fails by the report in `folder`/report; "": not measured."""
    with suppress(OSError, LookupError, TypeError, ValueError, AttributeError):
        of_setups = json.loads((folder / "report" / "results.json").read_text())["runs"][-1]["numbers"]["fails"]
        (found,) = (fails[key] for fails in of_setups.values() if key in fails)
        return str(found)
    return ""


def of_baseline(name: str, setup: Setup | None = None, folder: Path | None = None) -> Exported:
    """Return a tuned baseline, by its name or file (see `read_tuned`), or one of FIXED for the task of `setup`."""
    if name in FIXED:
        rule = FIXED[name]()
        return Exported(rule.for_task(setup.task), fails=failures(setup.path.parent, name)) if setup else Exported(rule)
    content = read_tuned(name, folder, setup)
    validation = {weight: found.get("validation") for weight, found in content["weights"].items()}
    made_for = setup_tuning(content["baseline"], setup)
    command = f"impact-gym tune {made_for.cli_name} --names {content['baseline']}" if made_for else "impact-gym tune"
    fails = failures((folder or Path(name).parent).parent, content["sha256"])
    return Exported(tuned_rule(content), validation, command, fails)


def of_name(name: str, setup: Setup | None = None) -> Exported:
    """Return the controller that `name` means: a baseline, a tuned baseline's file, or a policy, see `load_policy`."""
    if setup and Path(name).stem not in (own := [*FIXED, *setup.tuned]):
        raise ValueError(
            f"{name} is no baseline of {setup.cli_name}: leave out --setup, or name one of {', '.join(own)}"
        )
    if name in (*FIXED, *shipped_baselines(), *(setup.tuned if setup else ())) or name.endswith(".json"):
        return of_baseline(name, setup)
    if name.endswith(".toml"):
        raise ValueError(f"{name} is a set-up: add --all, or name a controller")
    if not Path(name).exists() and name not in shipped():
        raise ValueError(nearest("controller", name, [*shipped(), *FIXED, *shipped_baselines()]))
    return of_policy(Path(name))


def of_policy(path: Path) -> Exported:
    """Return the policy in a file `path`, or the shipped policy with this name."""
    policy = load_policy(path)
    return Exported(policy, fails=failures(path.parent.parent, sha256(policy.to_bytes()).hexdigest()))


def of_setup(setup: Setup, folder: Path | None = None) -> dict[str, Exported]:
    """Return a set-up's controllers by name: untuned rules, and the controllers in `folder`."""
    folder, found = folder or setup.folder, {}
    for name in ("paper-trapezoid", "local-brake", *(["operator-alone"] if setup.environment.get("operator") else [])):
        found[name] = of_baseline(name, setup)
    for name in setup.tuned:
        try:
            found[name] = of_baseline(name, setup, folder / "tuned")
        except ValueError as reason:
            print(f"{name} is left out: {reason}")
    if (path := folder / "policies" / f"{setup.name}.npz").is_file():
        found[setup.name] = of_policy(path)
    else:
        remedy = f"run impact-gym train {setup.cli_name} --seeds {setup.seeds} --policies {path.parent}"
        print(f"{setup.name} is left out: there is no {path}; {remedy}")
    return found

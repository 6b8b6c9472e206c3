"""A controller as a C header for a control loop: C99 or C++, no memory allocation, only math.h and string.h.

The function `NAME_act` computes a policy's network. `NAME_step` computes a command from sensor readings, in SI units.
The header's templates are controller.h.jinja and rule.h.jinja.
"""

import re
import textwrap
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined, UndefinedError
from numpy.typing import NDArray

from agents.baselines import FilteredProfile, Rule, filtered, profile
from agents.baselines import rule as rules
from agents.export.documentation import Exported
from agents.policies.policy import Policy
from impact_gym.quantities import Quantity
from impact_gym.support.files import write_file
from impact_gym.task import ObservationSpec
from impact_gym.task.action import RESOLUTION
from impact_gym.task.observation import CURVES, affine
from impact_gym.teleop.link import FADE

CLOCK = 1e-9  # s, tolerance in comparisons of the times of operator commands
C_ACTIVATIONS = {"tanh": "tanhf((float)sum)", "relu": "sum > 0.0 ? (float)sum : 0.0f", "none": "(float)sum"}


def identifier(name: str) -> str:
    """Return `name` as an identifier of C."""
    return re.sub(r"\W", "_", re.sub(r"^(?=\d)", "policy_", name), flags=re.ASCII)


def write_header(controller: Policy | Rule | Exported, path: Path) -> Path:
    """Write the header to `path`; its functions and constants have names that begin with `identifier(path.stem)`."""
    return write_file(path, header(controller, identifier(path.stem)).encode("ascii"))


def header(controller: Policy | Rule | Exported, name: str) -> str:
    """Return the text of the header; the names of its functions and constants begin with `name`."""
    exported = controller if isinstance(controller, Exported) else Exported(controller)
    task, spec, value_of = exported.task, exported.spec, values(exported.spec)
    wrap = textwrap.TextWrapper(118, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False).wrap
    lines = [line for entry, value in exported.documentation.items() for line in wrap(f"{entry}: {value}")]
    content = _network(exported.policy) if exported.policy else _rule(exported, name)
    content = {
        "documentation": lines, "actions": exported.actions, "name": name, "task": task, "inputs": len(spec),
        "controlled": has_controller(exported), "resolution": RESOLUTION, "fade": FADE, "clock": CLOCK,
        "fields": spec.sensors, "remembered": [each for each in ("force", "deflection") if f"{each}_1" in value_of],
        "scales": [_scale(entry, value_of[entry.id]) for entry in spec.entries] if has_controller(exported) else [],
        "network": None, "lightest": exported.weights[0],
    } | content  # fmt: skip
    try:
        return c_text("controller.h.jinja", **content)
    except UndefinedError as error:
        kind = type(exported.controller).__name__
        raise ValueError(f"{kind} has no part in rule.h.jinja, so it cannot be exported: {error}") from error


def _network(policy: Policy) -> dict[str, Any]:
    network = policy.network
    layers = [layer for layer in network.layers() if layer.name != "log_std"]
    used = sorted({"none", *([network.activation] if network.hidden else [])})
    return {
        "network": network,
        "layers": layers,
        "widest": max(max(layer.weight.shape) for layer in layers),
        "activations": {activation: C_ACTIVATIONS[activation] for activation in used},
        "lightest": policy.spec.scale("time_weight").low,
    }


def _rule(exported: Exported, name: str) -> dict[str, Any]:
    rule: Any = exported.controller
    if not has_controller(exported):
        raise ValueError(f"{type(rule).__name__} uses values that no sensor measures, so it cannot be exported")
    value_of, swings = values(exported.spec), exported.task.coupling.oscillator(exported.task.tool_mass) is not None
    return {
        "rule": rule,
        "kinds": [kind.__name__ for kind in type(rule).__mro__],
        "place": {label: number for number, label in enumerate(rule.names())},
        "weights": np.log(exported.weights).tolist(),
        "tuned": np.atleast_2d(rule.parameters).tolist(),
        "seen": {entry.id: _seen(entry, value_of[entry.id], name) for entry in exported.spec.entries},
        "swing": np.stack(rule.swing(*np.eye(3))).tolist() if isinstance(rule, FilteredProfile) and swings else None,
        "profile": profile,
        "filtered": filtered,
        "rules": rules,
        "ranges": rules.ranges_for(exported.task),
    }


def c_text(template: str, folder: Path = Path(__file__).parent, **content: Any) -> str:
    """Return C code from a template in a folder; default: the folder of this module."""
    return _templates(folder).get_template(template).render(**content)


@lru_cache(maxsize=4)  # an environment keeps its compiled templates
def _templates(folder: Path) -> Environment:
    templates = Environment(
        loader=FileSystemLoader(folder), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    templates.filters["rows"] = _rows
    return templates


def has_controller(exported: Exported) -> bool:
    """Whether all observed values are available in C; if not, a policy's header holds only the network."""
    return set(exported.spec.ids) <= set(values(exported.spec))


def values(spec: ObservationSpec) -> dict[str, str]:
    """Return the C expressions (SI units), by id, of the observed numbers that are available in C."""
    now = {name: f"now->{name}" for name in spec.sensors}
    before = {name: name.rpartition("_") for name, entry in zip(spec.ids, spec.entries, strict=True)
              if entry.observed == "past_readings"}  # fmt: skip
    past = {name: f"state->{sensor}_before[{int(number) - 1}]" for name, (sensor, _, number) in before.items()}
    return now | past | {"time_weight": "state->time_weight"}


def _scale(entry: Quantity, value: str) -> tuple[str, float, float, float]:
    """Return C code that applies the scale's curve to `value`, the offset and gain of `affine`, and `scaled_low`."""
    low, gain = affine(entry.scale)
    bent = value if entry.scale.curve == "linear" else f"{entry.scale.curve}({value})"
    return bent, low, gain, entry.scale.scaled_low


def _seen(entry: Quantity, value: str, name: str) -> str:
    """Return the C expression that scales and decodes a value as `ObservationSpec` does."""
    bent, low, gain, scaled_low = _scale(entry, value)
    curve = CURVES[entry.scale.curve]
    begin, end = (float(curve.of(each)) for each in (entry.scale.low, entry.scale.high))
    read = f"{name}_read({name}_scaled({bent}, {low}, {gain}, {scaled_low}), {scaled_low}, {begin}, {end - begin})"
    return {"linear": read, "log": f"exp({read})", "log1p": f"expm1({read})"}[entry.scale.curve]


def _rows(values: NDArray[np.float32]) -> str:
    """Return numbers for C, six in a line; nine digits represent a float32 exactly."""
    numbers = [f"{float(value):.8e}f" for value in values.ravel()]
    return ",\n".join("    " + ", ".join(numbers[first : first + 6]) for first in range(0, len(numbers), 6))

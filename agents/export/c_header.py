"""A policy as a C header: C99 or C++, no allocation, only math.h and string.h. Made for a controller's cycle.

The header holds the network, `NAME_act`, and around it the whole controller, `NAME_reset` and `NAME_step`: from what
the sensors say, in SI units, to the command. Its text is in controller.h.jinja.
"""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy.typing import NDArray

from agents.policies.policy import Policy
from impact_gym.files import write_file
from impact_gym.task import ActionSpec, ObservationSpec, Task
from impact_gym.task.action import RESOLUTION
from impact_gym.task.observation import Entry
from impact_gym.teleop.checks import FADE

CLOCK = 1e-9  # s, within which times are the same
C_ACTIVATIONS = {"tanh": "tanhf((float)sum)", "relu": "sum > 0.0 ? (float)sum : 0.0f", "none": "(float)sum"}


def identifier(name: str) -> str:
    """Return `name` as C can call something."""
    return re.sub(r"\W", "_", re.sub(r"^(?=\d)", "policy_", name), flags=re.ASCII)


def write_header(policy: Policy, path: Path) -> Path:
    """Write the header to `path`; its stem names what is in it."""
    return write_file(path, header(policy, identifier(path.stem)).encode("ascii", "replace"))


def header(policy: Policy, name: str) -> str:
    """Return the text of the header, every name in which begins with `name`."""
    task, network = Task(**policy.environment), policy.network
    layers = [layer for layer in network.layers() if layer.name != "log_std"]
    used = sorted({"none", *([network.activation] if network.hidden else [])})
    spec, value_of = policy.spec, values(policy.spec)
    return c_text(
        "controller.h.jinja",
        policy=policy,
        actions=ActionSpec(task).entries,
        name=name,
        task=task,
        network=network,
        layers=layers,
        widest=max(max(layer.weight.shape) for layer in layers),
        activations={activation: C_ACTIVATIONS[activation] for activation in used},
        controlled=has_controller(policy),
        resolution=RESOLUTION,
        fade=FADE,
        clock=CLOCK,
        fields=spec.sensors,
        remembered=[field for field in ("force", "deflection") if f"{field}_1" in value_of],
        scales=[_scale(entry, value_of[entry.id]) for entry in spec.entries] if has_controller(policy) else [],
        lightest=spec.scale("time_weight").low,
    )


def c_text(template: str, **content: Any) -> str:
    """Return C code from a template of this folder."""
    folder = FileSystemLoader(Path(__file__).parent)
    templates = Environment(
        loader=folder, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    templates.filters |= {"rows": _rows, "comment": comment}
    return templates.get_template(template).render(**content)


def has_controller(policy: Policy) -> bool:
    """Whether the header holds a controller around the network: sensors tell all that the policy sees."""
    return set(policy.spec.ids) <= set(values(policy.spec))


def values(spec: ObservationSpec) -> dict[str, str]:
    """Return as expressions in C what the controller has of the numbers it observes."""
    now = {name: f"now->{name}" for name in spec.sensors}
    before = {name: name.rpartition("_") for name, entry in zip(spec.ids, spec.entries, strict=True)
              if entry.argument == "past_readings"}  # fmt: skip
    past = {name: f"state->{sensor}_before[{int(number) - 1}]" for name, (sensor, _, number) in before.items()}
    return now | past | {"time_weight": "state->time_weight"}


def _scale(entry: Entry, value: str) -> tuple[str, float, float, float]:
    """Return an entry's value as an expression in C, and its low end, gain and scaled low end."""
    low, gain = entry.affine
    bent = value if entry.scale.curve == "linear" else f"{entry.scale.curve}({value})"
    return bent, low, gain, entry.scale.scaled_low


def comment(text: Any) -> str:
    """Return a text as a comment in C may hold it: a line of ASCII that neither ends it nor begins another."""
    return re.sub(r"(?<=\*)(?=/)|(?<=/)(?=\*)|(?<=\?)(?=\?)", " ", json.dumps(str(text))[1:-1])


def _rows(values: NDArray[np.float32]) -> str:
    """Return numbers for C, six in a row; nine digits give a float32 back exactly."""
    numbers = [f"{float(value):.8e}f" for value in values.ravel()]
    return ",\n".join("    " + ", ".join(numbers[first : first + 6]) for first in range(0, len(numbers), 6))

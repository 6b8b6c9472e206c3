"""A policy as a C header: plain C99 or C++, no allocation, nothing beside math.h. Made for a controller's cycle.

The header holds the network, `NAME_act`, and around it the whole controller, `NAME_reset` and `NAME_step`: from what
the sensors say, in SI units, to the command. Its text is in controller.h.jinja.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
from impact_gym.kernels import LINEAR, LOGARITHM
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy.typing import NDArray

from agents.policies.policy import Policy
from impact_gym.envs.observation import Entry, entries, sensor_fields
from impact_gym.envs.task import COMMAND_RESOLUTION, Task
from impact_gym.files import whole_file

C_ACTIVATIONS = {"tanh": "tanhf((float)sum)", "relu": "sum > 0.0 ? (float)sum : 0.0f", "none": "(float)sum"}


def identifier(name: str) -> str:
    """Return `name` as C can call something."""
    return re.sub(r"\W", "_", re.sub(r"^(?=\d)", "policy_", name), flags=re.ASCII)


def write_header(policy: Policy, path: Path) -> Path:
    """Write the header to `path`; its stem names what is in it."""
    with whole_file(path) as file:
        file.write(header(policy, identifier(path.stem)).encode("ascii", "replace"))
    return path


def header(policy: Policy, name: str) -> str:
    """Return the text of the header, every name in which begins with `name`."""
    task, network = Task(**policy.environment), policy.network
    layers = [layer for layer in network.layers() if layer.name != "log_std"]
    used = sorted({"none", *([network.activation] if network.hidden else [])})
    value_of, seen = values(task), entries(task)
    return c_text(
        "controller.h.jinja",
        policy=policy,
        name=name,
        task=task,
        network=network,
        layers=layers,
        widest=max(max(layer.weight.shape) for layer in layers),
        activations={activation: C_ACTIVATIONS[activation] for activation in used},
        controlled=has_controller(policy),
        resolution=COMMAND_RESOLUTION,
        fields=list(sensor_fields(task)),
        remembered=[field for field in ("force", "deflection") if f"{field}_1" in value_of],
        scales=[_scale(entry, value_of[entry.sensor]) for entry in seen] if has_controller(policy) else [],
        lightest=next(entry.low for entry in seen if entry.sensor == "time_weight"),
    )


def c_text(template: str, **content: Any) -> str:
    """Return C code from a template of this folder."""
    folder = FileSystemLoader(Path(__file__).parent)
    templates = Environment(
        loader=folder, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    templates.filters |= {"rows": _rows, "comment": lambda text: text.replace("*/", "* /")}
    return templates.get_template(template).render(**content)


def has_controller(policy: Policy) -> bool:
    """Whether the header holds a controller around the network: sensors tell all that the policy sees."""
    task = Task(**policy.environment)
    return {entry.sensor for entry in entries(task)} <= set(values(task))


def values(task: Task) -> dict[str, str]:
    """Return what the controller has of each sensor as an expression in C."""
    now = {sensor: f"now->{field}" for field, sensor in sensor_fields(task).items()}
    before = range(task.past_readings)
    past = {f"{sensor}_{n + 1}": f"state->{sensor}_before[{n}]" for sensor in ("force", "deflection") for n in before}
    past = {sensor: value for sensor, value in past.items() if sensor[:-2] in now}
    return now | past | {"time_weight": "state->time_weight"}


def _scale(entry: Entry, value: str) -> tuple[str, float, float, float]:
    """Return an entry's value as an expression in C, and its low end, gain and scaled low end."""
    if entry.curve != LINEAR:
        value = f"{'log' if entry.curve == LOGARITHM else 'log1p'}({value})"
    _, _, low, scaled_low, gain = entry.record()
    return value, low, gain, scaled_low


def _rows(values: NDArray[np.float32]) -> str:
    """Return numbers for C, six in a row; nine digits give a float32 back exactly."""
    numbers = [f"{float(value):.8e}f" for value in values.ravel()]
    return ",\n".join("    " + ", ".join(numbers[first : first + 6]) for first in range(0, len(numbers), 6))

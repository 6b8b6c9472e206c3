"""The chosen design as a set-up's file, which can be tuned, trained and reported on like any other."""

import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from agents.design.free import designed
from agents.design.pads import on_pad
from agents.design.study import Entry
from agents.setups import Setup, load_setup
from impact_gym.envs.task import Task
from impact_gym.files import whole_file

ELSEWHERE = ("teacher", "taught")
"""Settings of training that name a baseline of the set-up that was begun with."""
DRAWN = (
    "this file draws stiffness and restitution of the contact independently from the ranges that the pad leaves, "
    "where on the pad both follow from the object's own: the softer it is, the more it keeps of its own restitution"
)


def write_setup(path: Path, setup: Setup, entry: Entry, command: str) -> Path:
    """Write a design as a set-up to `path`, and return it.

    With a pad the contact's ranges are those that the pad leaves of them; see DRAWN.
    """
    content = tomllib.loads(setup.path.read_text())
    environment = designed(setup.environment, entry.design)
    if entry.pad:
        environment["scenario"] = _padded(environment, entry.pad)
    training = {name: value for name, value in content.get("training", {}).items() if name not in ELSEWHERE}
    about = "; ".join(f"{name} {value:.4g}" for name, value in entry.design.items())
    padded = f", on a pad of {entry.pad}; {DRAWN}" if entry.pad else ""
    made = {
        "version": content.get("version", 1),
        "title": f"{setup.title}: a designed coupling",
        "about": f"designed from {setup.name}: {about}{padded}",
        "environment": environment,
        "training": training,
        "baselines": {"tuned": {f"{path.stem}-profile": entry.rule}, "against": [f"{path.stem}-profile"]},
        "evaluation": {k: v for k, v in content.get("evaluation", {}).items() if k not in ("at_most", "of")},
    }
    controller = f"{entry.rule} with {', '.join(f'{value:.6g}' for value in entry.parameters)}"
    with whole_file(path) as file:
        file.write((f"# {command}\n# Its controller: the {controller}\n" + "\n".join(toml_lines(made)) + "\n").encode())
    load_setup(path)
    return path


def _padded(environment: Mapping[str, Any], pad: str) -> dict[str, list[float]]:
    """Return ranges of the scenario with what a pad leaves of contact stiffness and restitution."""
    names = ("object_mass", "contact_stiffness", "restitution", "distance")
    ranges = dict(zip(names, map(list, Task(**environment).ranges.pairs()), strict=True))
    corners = np.array([on_pad(pad, *np.meshgrid(ranges["contact_stiffness"], ranges["restitution"]))])
    for name, values in zip(("contact_stiffness", "restitution"), corners[0], strict=True):
        ranges[name] = [float(values.min()), float(values.max())]
    return ranges


def toml_lines(table: Mapping[str, Any], name: str = "") -> Iterator[str]:
    """Yield the lines of a table: its values, then its tables below `[name]`; records are written inline."""
    tables = {key: value for key, value in table.items() if isinstance(value, Mapping) and "type" not in value}
    for key, value in table.items():
        if key not in tables:
            yield f"{key} = {_value(value)}"
    for key, value in tables.items():
        if value:
            yield f"\n[{name}{key}]"
            yield from toml_lines(value, f"{name}{key}.")


def _value(value: Any) -> str:
    """Return a value as TOML writes it; JSON does alike, but for tables."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    return json.dumps(value)

"""The chosen design as a set-up's file, which can be tuned, trained and reported on like any other."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from agents.setups import Setup, load_setup
from experiments.design.pads import on_pad
from experiments.design.search import CONTACT, Rig
from impact_gym.files import parsed, write_file
from impact_gym.task import Task
from impact_gym.task.arguments import changed

OF_TEACHER = ("teacher", "imitation_steps")
"""Settings of training that concern a baseline of the set-up that was begun with."""
DRAWN = (
    "this file draws stiffness and restitution of the contact independently from the ranges that the pad leaves, "
    "where on the pad both follow from the object's own: the softer it is, the more it keeps of its own restitution"
)


def write_setup(path: Path, setup: Setup, rig: Rig, command: str) -> Path:
    """Write a design as a set-up to `path`, and return it; `command` made it.

    With a pad the contact's ranges are those that the pad leaves of them; see DRAWN.
    """
    content = parsed(setup.path, "TOML", tomllib.loads)
    environment = changed(setup.environment, rig.design)
    if rig.pad:
        environment["scenario"] = _on_pad(environment, rig.pad)
    about = "; ".join(f"{name} {value:.4g}" for name, value in rig.design.items())
    baseline = f"{path.stem}-profile"
    tables = {
        "version": content.get("version", 1),
        "title": f"{setup.title}: a designed coupling",
        "about": f"designed from {setup.name}: {about}" + (f", on a pad of {rig.pad}; {DRAWN}" if rig.pad else ""),
        "environment": environment,
        "training": {k: v for k, v in content.get("training", {}).items() if k not in OF_TEACHER},
        "baselines": {"tuned": {baseline: rig.rule}, "against": [baseline]},
        "evaluation": {k: v for k, v in content.get("evaluation", {}).items() if k not in ("at_most", "of")},
    }
    written = tomli_w.dumps({name: value for name, value in tables.items() if value})
    controller = f"{rig.rule} with {', '.join(f'{value:.6g}' for value in rig.parameters)}"
    write_file(path, f"# {command}\n# Its controller: the {controller}\n{written}")
    load_setup(path)
    return path


def _on_pad(environment: Mapping[str, Any], pad: str) -> dict[str, list[float]]:
    """Return ranges of the scenario with what a pad leaves of contact stiffness and restitution."""
    ranges = {name: list(ends) for name, ends in Task(**environment).scenario.by_id().items()}
    corners = on_pad(pad, *np.meshgrid(*(ranges[name] for name in CONTACT)))
    return ranges | {name: [float(v.min()), float(v.max())] for name, v in zip(CONTACT, corners, strict=True)}

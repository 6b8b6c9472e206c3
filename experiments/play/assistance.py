"""Assistances (controllers at the arm that may change a person's command), and environments for a person."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from agents import load_policy
from agents.baselines import BlindProfile, LocalBrake, OperatorAlone, PaperTrapezoid
from agents.policies import Controller
from agents.setups import Setup, load_baseline, load_setup
from agents.setups.setup import shipped
from experiments.lab.player.films import chain_of
from impact_gym.task import Task
from impact_gym.teleop.channels import WAYS

NAMES = {  # assistances, with the labels on the page
    "none": "nobody", "brake": "a brake at the arm", "limit": "a tuned speed limit", "policy": "the learned policy",
    "rule": "the paper's rule",
}  # fmt: skip
COUPLINGS = {"rigid": "tool fixed", "spring": "on a spring", "bistable": "bistable"}  # labels on the page, by coupling
PERSON = {"type": "Person"}
PERIOD: float = Task.control_period  # s, control period that a set-up must have to be played
# unit, least and largest value of the settings: delay of the round trip, jitter of each channel, spring stiffness
RANGES = {"delay": ("s", 0.0, 1.0), "jitter": ("s", 0.0, 0.05), "stiffness": ("N/m", 20.0, 2000.0)}


def playable(name: str) -> Setup:
    """Return the set-up `name`; ValueError: no such set-up, no operator, or a control period other than PERIOD."""
    setup = load_setup(name)
    if "operator" not in setup.environment:
        others = ", ".join(each.name for each in map(load_setup, shipped()) if "operator" in each.environment)
        raise ValueError(
            f'{setup.cli_name} has no operator: add operator = {{ type = "Reach", place_error = 0.0, creep = 0.1 }}, '
            f"friction = 0.3 and horizon = 8.0 to its [environment], or take {others}"
        )
    if (period := setup.task.control_period) != PERIOD:
        raise ValueError(f"{setup.cli_name}: control_period must be {PERIOD} s for impact-gym play, got {period} s")
    return setup


def related(setup: Setup) -> dict[str, str]:
    """Return the names of `setup` and, if shipped, of its variants with other couplings, by the name's last part."""
    family, _, kind = setup.cli_name.rpartition("-")
    if setup.shipped and kind in COUPLINGS:
        return {each: f"{family}-{each}" for each in COUPLINGS}
    return {kind: setup.cli_name}


def environment_of(setup: Setup) -> dict[str, Any]:
    """Return a set-up's arguments without operator, with RANGES for the settings. Each channel has half the delay."""
    environment = {name: value for name, value in setup.environment.items() if name != "operator"}
    for way in WAYS:
        delay, jitter = [0.5 * limit for limit in RANGES["delay"][1:]], [*RANGES["jitter"][1:]]
        environment[way] = {**environment.get(way, {}), "delay": delay, "jitter": jitter}
    if (coupling := environment.get("coupling", {})).get("type") == "SpringDamper":
        environment["coupling"] = {**coupling, "stiffness": [*RANGES["stiffness"][1:]]}
    return environment


def usual(setup: Setup) -> dict[str, float]:
    """Return the initial settings: the values of the set-up, or the middles of its ranges, limited to RANGES."""
    parts, given = {"delay": WAYS, "jitter": WAYS[:1], "stiffness": ("coupling",)}, setup.task.by_path()
    if setup.environment.get("coupling", {}).get("type") != "SpringDamper":
        del parts["stiffness"]
    settings = {}
    for name, of_setting in parts.items():
        _, low, high = RANGES[name]
        middles = [np.mean(given.get(f"{part}.{name}", 0.0)) for part in of_setting]
        settings[name] = float(sum(np.clip(middles, low / len(middles), high / len(middles))))
    return settings


def about(setup: Setup) -> dict[str, Any]:
    """Return data of a set-up for the page: settings, coupling, ranges of distance (m) and speed (m/s), horizon (s)."""
    task = Task(**environment_of(setup), operator=PERSON)
    return {"usual": usual(setup), "chain": chain_of(task), "distance": task.scenario.distance,
            "horizon": task.horizon, "speeds": task.velocity_range}  # fmt: skip


def record_of(settings: Mapping[str, float]) -> dict[str, float]:
    """Convert `settings` (see `usual`) to numbers of an episode's record."""
    record = {f"{way}.delay": 0.5 * settings["delay"] for way in WAYS}
    record |= {f"{way}.jitter": settings["jitter"] for way in WAYS}
    return record | ({"coupling.stiffness": settings["stiffness"]} if "stiffness" in settings else {})


def assistance(name: str, setup: Setup) -> Controller:
    """Return the assistance `name`; ValueError: no such assistance, or it was not tuned or trained for the set-up."""
    if name not in NAMES:
        raise ValueError(f"assist must be one of {', '.join(NAMES)}, got {name!r:.80}")
    if name == "policy":
        return load_policy(setup.folder / "policies" / f"{setup.name}.npz")
    if name == "limit":
        limits = [known for known, tuned in setup.tuned.items() if tuned.rule is BlindProfile]
        if not limits:
            raise ValueError(
                f"assist limit needs a tuned BlindProfile: add one to [baselines.tuned] of {setup.cli_name}"
            )
        rule: Any = load_baseline(limits[0], setup.evaluation.typical, setup.folder / "tuned")
    else:
        rule = {"none": OperatorAlone, "brake": LocalBrake, "rule": PaperTrapezoid}[name]()
    return rule.for_task(Task(**environment_of(setup), operator=PERSON))

"""Approaches solved once by the independent solver; our solver must give the same results.

The table tests/solver/reference_runs.json is made by `experiments.reference` alone (SciPy; it shares no code with our
solver), with this command from the top folder; it takes a minute:

    PYTHONPATH=tests/helpers .venv/bin/python -m reference_table

Each line has the scene, the motion and the duration as well, so the draws below may differ in the last digit on another
machine. A slow test solves all lines again, and a quick test some of them (test_agreement.py).
"""

import json
from collections import defaultdict
from dataclasses import asdict
from functools import cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from solver_scenes import COUPLINGS, CRUISE, LINEAR, MOTION, ROBOTS, SPRING, on_rough_ground, random_approach, scene

import impact_gym as ig
from experiments import reference
from experiments.reference.motion import ContactRecord
from impact_gym.scene import LAWS
from impact_gym.support.dotted_paths import parts

FILE = Path(__file__).parents[1] / "solver" / "reference_runs.json"
GROUND = "friction", "stroke", "fixed", "friction and stroke and fixed"  # families of `on_rough_ground`
FIGURES = {  # of the paper: coupling, contact stiffness (N/m^1.5) and restitution
    "13a": (ig.Rigid(), 1e5, 1.0), "25": (ig.Rigid(), 1e3, 0.1),
    "16, before the break": (ig.SpringDamper(85.0), 1e5, 1.0), "16, at the break": (ig.SpringDamper(90.0), 1e5, 1.0),
    "16, behind the break": (ig.SpringDamper(92.0), 1e5, 1.0), "17a": (SPRING, 1e5, 1.0), "17b": (SPRING, 1e4, 1.0),
    "18": (SPRING, 1e4, 0.1), "19a": (SPRING, 1e5, 0.1), "19b": (SPRING, 1e3, 0.1), "23a": (ig.Bistable(), 1e3, 0.1),
    "23a, rear stop at -10 mm": (ig.Bistable(rear_stop=-0.01), 1e3, 0.1),
    "23a, rear stop at -30 mm": (ig.Bistable(rear_stop=-0.03), 1e3, 0.1), "23b": (LINEAR, 1e3, 0.1),
}  # fmt: skip


class Run(NamedTuple):
    """One line of the table."""

    family: str
    name: str
    approach: tuple  # scene, motion and duration (s)
    outcome: reference.Reference | None = None
    rtol: float = 1e-11
    method: str = "DOP853"

    def solved(self):
        return reference.simulate(*self.approach, rtol=self.rtol, method=self.method)


def barely_parting(coupling_stiffness):
    """Between two stiffnesses of the spring the second contact stops parting, so that there is no third."""
    return scene(1e6, 0.3, ig.SpringDamper(float(coupling_stiffness))), MOTION, 1.5


def overdamped(ratio, stiffness=1e5):
    """A light tool on a stiff overdamped spring against a soft, heavy object: the coupling decays fastest."""
    return scene(1e2, 0.5, ig.SpringDamper(stiffness, ratio), m_t=0.01, m_p=2.5, distance=0.1)


def cases():
    """All runs, without their results."""
    for seed in range(150):
        yield Run("imposed", str(seed), random_approach(seed))
    t0 = (0.25 / 1e5) ** 0.4
    # at the end of the contact the tool brakes with `push`, in v/t0, so that the force is clamped at zero
    for push, delay in product((-1.0, -2.0, -3.0), np.linspace(0.0, 0.6, 13).tolist()):
        brake = ig.Brake(threshold=0.0, delay=delay * t0, deceleration=-push / t0)
        approach = scene(1e5, 0.2, distance=0.1), ig.Trapezoid(1.0, 8.0, brake), 0.1 + 1 / 16 + 30 * t0
        yield Run("clamped", f"{push}, {delay}", approach)
    for coupling, robot, seed in product(COUPLINGS, ROBOTS, range(5)):
        approach = random_approach(seed, coupling, robot, LAWS[:-1], (10, 2000))
        yield Run(f"{coupling}, {robot}", str(seed), approach, rtol=1e-12)
    for family in GROUND:
        for seed in range(12 if " " in family else 24):  # 12: each chain once
            yield Run(family, str(seed), on_rough_ground(seed, *family.split(" and ")))
    for figure, (coupling, k_c, e) in FIGURES.items():
        yield Run("figure", figure, (scene(k_c, e, coupling), MOTION, 1.5))
    yield Run("hard", "chatter", (scene(1e10, 0.7, SPRING), CRUISE, 0.6))
    for k_c, zeta in [(1e3, 0.0), (3e4, 1.0), (1e3, 3.0)]:  # the rear stop hits while the tool pushes a heavy object
        stops = ig.Bistable(rear_stop=-0.002, front_stop=0.004, stop_damping_ratio=zeta, stop_stiffness=1e6)
        yield Run("hard", f"pressed stop, {k_c}, {zeta}", (scene(k_c, 0.1, stops, m_p=5.0), MOTION, 0.8))
    yield Run("hard", "overdamped", (overdamped(30.0, 1e4), CRUISE, 0.3), None, 1e-10, "Radau")
    # at a millionth of the depth u^(m - n) + d w still falls steeply: hard to tell whether force or contact ends
    for exponent in (1.501, 1.51, 1.53, 1.54):
        soft = scene(1e5, 0.5, SPRING, distance=0.25, stiffness_exponent=exponent)
        yield Run("hard", f"early end, {exponent}", (soft, CRUISE, 1.5))
    for stiffness in (13.86003, 13.86004):  # N/m; three contacts and two
        yield Run("barely parting", str(stiffness), barely_parting(stiffness))


def record_from(fields):
    """The record of an object in the file that has a `type`, the name of its class."""
    kind = fields.pop("type", None)
    return getattr(ig, kind)(**fields) if kind else fields


@cache
def table():
    """Runs by family."""
    by_family = defaultdict(list)
    for line in json.loads(FILE.read_text(), object_hook=record_from):
        result = line["outcome"]
        contacts = tuple(ContactRecord(**contact) for contact in result["contacts"])
        result |= {"contacts": contacts, "snap_through": tuple(result["snap_through"]), "contact_seconds": 0.0}
        line |= {"approach": tuple(line["approach"]), "outcome": reference.Reference(**result)}
        by_family[line["family"]].append(Run(**line))
    return dict(by_family)


if __name__ == "__main__":
    lines, encode = [], json.JSONEncoder(default=lambda record: {"type": type(record).__name__, **parts(record)}).encode
    for run in cases():
        outcome = asdict(run.solved())
        del outcome["contact_seconds"]  # of a machine
        lines.append(encode(run._asdict() | {"outcome": outcome}))
    FILE.write_text("[\n" + ",\n".join(lines) + "\n]\n")

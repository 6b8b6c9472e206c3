"""The slow independent solver on a random sample of the storm, and whether it finds the same.

It works at rtol 1e-11 with DOP853, or at 1e-10 with Radau where the contact is stiff; what one of them cannot do in the
time it is given the other may try. Where V_p differs, three more runs of ours say how well the scene defines it: one
at the finest tolerance, two with the object moved by a few rounding errors of its distance.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path

import impact_gym as ig
from experiments import reference
from experiments.lab.tables import Row
from experiments.reference.dissipation import damping_factor
from experiments.speed_vs_error.quantities import answer_of
from experiments.speed_vs_error.scenes import Approach
from experiments.stability.scenes import draw, labels, relative_error, velocity
from experiments.stability.storm import LIMIT, sources
from experiments.stability.workers import filled

EVERY = 50  # one scene in so many: 2 %
FIRST = 17  # of them; the scenes are random themselves
RTOL = {"DOP853": 1e-11, "Radau": 1e-10}
STIFF = 20.0  # d, above which Radau begins
FINEST = 1e-12  # rtol of ours
SHIFT = 1e-13  # of the distance, relative
SHARE = 1e-6  # error of V_p beyond which a scene is looked at again, relative


def order(approach: Approach) -> tuple[str, str]:
    """Return the methods, the better one for this contact first."""
    contact = approach.scene.contact
    exponents = contact.stiffness_exponent, contact.damping_exponent
    d = damping_factor(contact.dissipation, contact.restitution, *exponents)
    return ("Radau", "DOP853") if d > STIFF else ("DOP853", "Radau")


def truth(row: Row) -> Row:
    """Return the row with what the independent solver finds."""
    approach, method = draw(int(row["scene"])), row["contender"]
    found = reference.simulate(approach.scene, approach.motion, approach.duration, rtol=RTOL[method], method=method)
    return row | asdict(answer_of(found, approach.duration)) | {"tool_velocity": found.tool_velocity}


def truths(path: Path, numbers: Iterable[int], seconds: float, processes: int | None = None) -> dict[int, Row]:
    """Return the truth by the number of the scene, each method having so many seconds for it."""
    found: dict[int, Row] = {}
    for turn in range(2):
        left = [number for number in numbers if number not in found or found[number]["failure"]]
        approaches = [draw(number) for number in left]
        tasks = [(labels(approach) | {"contender": order(approach)[turn]},) for approach in approaches]
        found |= zip(left, filled(path, truth, tasks, seconds, processes=processes)[0], strict=True)
    return found


def compared(row: Row, true: Row) -> Row:
    """Return the row of a scene with what ours finds beside the truth."""
    approach = draw(int(row["scene"]))
    speed = approach.motion.speed
    outcome = ig.simulate(approach.scene, approach.motion, approach.duration)
    row |= {
        "velocity": outcome.object_velocity,
        "velocity_error": relative_error(outcome.object_velocity, true["velocity"], speed),
        "contacts": len(outcome.contacts),
        "passes": len(outcome.snap_through),
        "peak_error": abs(outcome.peak_force - true["peak_force"]) / max(abs(true["peak_force"]), 1e-300),
        "tool_error": abs(outcome.tool_velocity - true["tool_velocity"]) / speed,
        "finest_velocity": math.nan,
        "spread": math.nan,
        **{f"true_{name}": true[name] for name in ("velocity", "contacts", "passes")},
    }
    if not row["velocity_error"] <= SHARE:
        fine, *moved = (velocity(shifted(approach, share), FINEST) for share in (0.0, SHIFT, -SHIFT))
        row |= {"finest_velocity": fine, "spread": max(abs(one - fine) for one in moved)}
    return row


def shifted(approach: Approach, share: float) -> Approach:
    """Return the approach with the object farther by a share of its distance."""
    target = approach.scene.object
    target = replace(target, distance=target.distance * (1.0 + share))
    return replace(approach, scene=replace(approach.scene, object=target))


def comparisons(path: Path, truths: Mapping[int, Row], processes: int | None = None) -> list[Row]:
    """Return the row of each scene whose truth is known."""
    known = {number: true for number, true in truths.items() if not true["failure"]}
    tasks = [(labels(draw(number)) | {"contender": t["contender"], "run": sources()}, t) for number, t in known.items()]
    return filled(path, compared, tasks, LIMIT, processes=processes)[0]

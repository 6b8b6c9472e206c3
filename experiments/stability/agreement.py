"""The slow independent solver on a random sample of the storm, and whether it finds the same.

It works at rtol 1e-11 with DOP853, or at 1e-10 with Radau where the contact is stiff; what one of them cannot do in the
time it is given the other may try. Where V_p differs, three more runs of ours say how well the scene defines it: one
at the finest tolerance, two with the object moved by a few rounding errors of its distance.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from typing import Any

import impact_gym as ig
from agents.jobs import Result, digest_of
from experiments import reference
from experiments.lab.tables import Gather, Row, result_of, solver_and
from experiments.reference.dissipation import damping_factor
from experiments.speed_vs_error.quantities import solution_of
from experiments.speed_vs_error.scenes import Approach
from experiments.stability.scenes import draw, judging, known, labels, relative_error, velocity
from experiments.stability.storm import LIMIT

EVERY = 50  # one scene in so many: 2 %
FIRST = 17  # of them; the scenes are random themselves
RTOL = {"DOP853": 1e-11, "Radau": 1e-10}
STIFF = 20.0  # d, above which Radau begins
FINEST = 1e-12  # rtol of ours
SHIFT = 1e-13  # of the distance, relative
JUDGED = ("contender", "velocity", "contacts", "passes", "peak_force", "tool_velocity")
SHARE = 1e-6  # error of V_p beyond which a scene is looked at again, relative


def order(approach: Approach) -> tuple[str, str]:
    """Return the methods, the better one for this contact first."""
    contact = approach.scene.contact
    exponents = contact.stiffness_exponent, contact.damping_exponent
    d = damping_factor(contact.dissipation, contact.restitution, *exponents)
    return ("Radau", "DOP853") if d > STIFF else ("DOP853", "Radau")


def sampled(scenes: int) -> range:
    """Return the numbers of the random sample of so many scenes."""
    return range(FIRST, scenes, EVERY)


def truth(scene: int, contender: str) -> Result:
    """Return the row of what the independent solver finds by one of its methods."""
    approach = draw(scene)
    found = reference.simulate(*approach.run, rtol=RTOL[contender], method=contender)
    solution = asdict(solution_of(found, approach.duration)) | {"tool_velocity": found.tool_velocity}
    return result_of([labels(approach) | {"contender": contender} | solution])


def truths(gather: Gather, scenes: Iterable[int], seconds: float) -> dict[int, Row]:
    """Return the truth by the number of the scene, each method having so many seconds for it."""
    depends = digest_of(reference.__name__, "experiments.stability.scenes", __name__)
    found: dict[int, Row] = {}
    for turn in range(2):
        left = [scene for scene in scenes if scene not in found or found[scene]["failure"]]
        asked = [{"scene": scene, "contender": order(draw(scene))[turn]} for scene in left]
        rows = gather("truth", truth, asked, depends, known, seconds=seconds)
        found |= zip(left, rows, strict=True)
    return found


def compared(scene: int, truth: Mapping[str, Any]) -> Result:
    """Return the row of a scene with what ours finds beside the truth."""
    approach = draw(scene)
    speed = approach.motion.speed
    outcome = ig.simulate(*approach.run)
    row = labels(approach) | {
        "contender": truth["contender"],
        "velocity": outcome.object_velocity,
        "velocity_error": relative_error(outcome.object_velocity, truth["velocity"], speed),
        "contacts": len(outcome.contacts),
        "passes": len(outcome.snap_through),
        "peak_error": abs(outcome.peak_force - truth["peak_force"]) / max(abs(truth["peak_force"]), 1e-300),
        "tool_error": abs(outcome.tool_velocity - truth["tool_velocity"]) / speed,
        "finest_velocity": math.nan,
        "spread": math.nan,
        **{f"true_{name}": truth[name] for name in ("velocity", "contacts", "passes")},
    }
    if not row["velocity_error"] <= SHARE:
        fine, *moved = (velocity(shifted(approach, share), FINEST) for share in (0.0, SHIFT, -SHIFT))
        row |= {"finest_velocity": fine, "spread": max(abs(one - fine) for one in moved)}
    return result_of([row])


def shifted(approach: Approach, share: float) -> Approach:
    """Return the approach with the object farther by a share of its distance."""
    scene = approach.scene
    moved = replace(scene.object, distance=scene.object.distance * (1.0 + share))
    return replace(approach, scene=replace(scene, object=moved))


def comparisons(gather: Gather, truths: Mapping[int, Row]) -> list[Row]:
    """Return the row of each scene whose truth is known."""
    asked = [{"scene": scene, "truth": true} for scene, true in judging(truths, JUDGED).items()]
    depends = solver_and("experiments.stability.scenes", __name__)
    return gather("agreement", compared, asked, depends, known, seconds=LIMIT)

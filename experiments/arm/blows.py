"""Scenes on whole arms, and what each one-mass model of the arm says of the same scene."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from agents.jobs import Result
from experiments.arm.robots import approach_of
from experiments.lab.tables import Gather, Row, result_of, solver_and
from impact_gym.motion import Brake, Trapezoid
from impact_gym.robot import whole
from impact_gym.robot.approach import Mass
from impact_gym.scene import Bistable, Contact, Coupling, Object, Rigid, Scene, SpringDamper, Tool
from impact_gym.simulation import simulate

COUPLINGS: dict[str, Coupling] = {"rigid": Rigid(), "spring": SpringDamper(50.0), "bistable": Bistable()}
FACTORS = (0.3, 1.0, 3.0)  # of the stiffness of all joints
MODELS = (*get_args(Mass), "rigid robot")
"""What stands for the arm: one of its three masses on a spring, or a flange that follows the motion exactly."""
MEASURES = {"impact_velocity": "impact velocity", "object_velocity": "V_p", "peak_force": "peak force",
            "contact_time": "time in contact"}  # fmt: skip
DISTANCE = 0.2505  # m
AFTERWARDS = 0.2  # s, that a run goes on after the touch
LINES = 3


def played(arm: str, line: int, count: int) -> Result:
    """Return a row for each of `count` scenes of an arm along one of its lines."""
    rng = np.random.default_rng((LINES * len(arm) + line, count))
    return result_of([_row(arm, line, scene, float(speed), factor) for scene, speed, factor in _scenes(rng, count)])


def _scenes(rng: np.random.Generator, count: int) -> Iterable[tuple[Scene, float, float]]:
    """Yield scenes, speeds (m/s) and factors of the joints' stiffness: each coupling as often."""
    for k in range(count):
        stiffness, mass = 10.0 ** rng.uniform(3.0, 6.0), 0.1 * 25.0 ** rng.random()
        contact = Contact(float(stiffness), float(rng.uniform(0.1, 1.0)))
        coupling = list(COUPLINGS.values())[k % len(COUPLINGS)]
        scene = Scene(Tool(0.125), Object(float(mass), DISTANCE), contact, coupling)
        yield scene, rng.uniform(0.3, 1.0), FACTORS[(k // len(COUPLINGS)) % len(FACTORS)]


def _row(name: str, line: int, scene: Scene, speed: float, factor: float) -> Row:
    """Return the scene, what the whole arm makes of it and what each model does."""
    arm, approach = approach_of(name, line, factor)
    motion = Trapezoid(speed, 8.0, Brake())
    duration = DISTANCE / speed + speed / 16.0 + AFTERWARDS
    blow = whole.simulate(arm, approach, scene, motion, duration=duration)
    coupling = next(each for each, made in COUPLINGS.items() if made == scene.coupling)
    row: Row = {
        "arm": name, "line": line, "coupling": coupling, "factor": factor, "speed": speed,
        "object_mass": scene.object.mass, "contact_stiffness": scene.contact.stiffness,
        "restitution": scene.contact.restitution, "status": blow.status, "contacts": blow.contact_count,
        "sideways": blow.sideways, "turn": blow.turn,
        "condition": max(arm.condition(angles) for angles in approach.joint_angles),
    }  # fmt: skip
    row |= {measure: float(getattr(blow, measure)) for measure in MEASURES}
    for model in MODELS:
        robot = None if model == "rigid robot" else approach.robot_table(model)
        row |= {f"{measure}: {model}": value for measure, value in _simulated(scene, robot, motion, duration).items()}
    held = replace(scene, coupling=Rigid())
    row["rigid all"] = simulate(held, motion, duration=duration).object_velocity
    return row


def _simulated(scene: Scene, robot: Any, motion: Trapezoid, duration: float) -> Mapping[str, float]:
    """Return the measures of the chain."""
    outcome = simulate(replace(scene, robot=robot), motion, duration=duration)
    if not outcome.contacts:
        return dict.fromkeys(MEASURES, np.nan)
    first = outcome.contacts[0]
    return {
        "impact_velocity": first.approach_velocity, "object_velocity": outcome.object_velocity,
        "peak_force": max(each.peak_force for each in outcome.contacts),
        "contact_time": np.nan if first.end is None else first.end - first.start,
    }  # fmt: skip


def rows(gather: Gather, arms: Sequence[str], count: int) -> list[Row]:
    """Return the rows of all arms and lines."""
    cells = [{"arm": arm, "line": line, "count": count} for arm in arms for line in range(LINES)]
    return gather("scenes", played, cells, solver_and("experiments.arm"))


def errors(found: Sequence[Row], model: str, measure: str = "object_velocity") -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return how far a model is off, as a share, where there was a touch that ended, (n,)."""
    ours = np.array([row[f"{measure}: {model}"] for row in found])
    whole_arm = np.array([row[measure] for row in found])
    return np.asarray((ours / whole_arm - 1.0)[np.isfinite(ours / whole_arm)])

"""Scenes on whole arms, and what each one-mass model of the arm says of the same scene."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, get_args
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from agents.jobs import Result
from experiments.arm.robots import AHEAD, approach_of
from experiments.lab.tables import Gather, Row, result_of, solver_and
from impact_gym.motion import Brake, Trapezoid
from impact_gym.robot import whole
from impact_gym.robot.approach import Mass
from impact_gym.scene import Bistable, Contact, Coupling, Object, Rigid, Scene, SpringDamper, Tool
from impact_gym.simulation import simulate

COUPLINGS: dict[str, Coupling] = {"rigid": Rigid(), "spring": SpringDamper(50.0), "bistable": Bistable()}
FACTORS = (0.3, 1.0, 3.0)  # of the stiffness of all joints
MASSES = get_args(Mass)
MODELS = (*MASSES, "rigid robot")
"""What stands for the arm: one of its three masses on a spring, or a flange that follows the motion exactly."""
MEASURES = {"object_velocity": "V_p", "impact_velocity": "impact velocity", "peak_force": "peak force",
            "contact_time": "time in contact"}  # fmt: skip
AFTERWARDS = 0.2  # s, that a run goes on after the touch
LINES, SCENES = 3, 300
MODULES = ("experiments.arm.blows", "experiments.arm.robots")


def played(arm: str, line: int, count: int) -> Result:
    """Return a row for each of `count` scenes of an arm along one of its lines."""
    rng = np.random.default_rng((crc32(arm.encode()), line, count))
    return result_of([_row(arm, line, *drawn) for drawn in _scenes(rng, count)])


def _scenes(rng: np.random.Generator, count: int) -> Iterable[tuple[str, Contact, float, float, float]]:
    """Yield coupling, contact, the object's mass (kg), speed (m/s) and factor of the joints' stiffness."""
    for k in range(count):
        stiffness, mass = 10.0 ** rng.uniform(3.0, 6.0), 0.1 * 25.0 ** rng.random()
        contact = Contact(float(stiffness), float(rng.uniform(0.1, 1.0)))
        coupling = list(COUPLINGS)[k % len(COUPLINGS)]
        factor = FACTORS[(k // len(COUPLINGS)) % len(FACTORS)]
        yield coupling, contact, float(mass), float(rng.uniform(0.3, 1.0)), factor


def linearised(arm: str) -> Result:
    """Return the paper's step from eq. 10 to eq. 11 at 1 m/s: a row for each line and coupling of an arm."""
    contact = Contact(1e5, 0.5)
    cells = product(range(LINES), COUPLINGS)
    return result_of([_row(arm, line, name, contact, 0.25, 1.0, 1.0, linear=True) for line, name in cells])


def _row(
    arm: str, line: int, coupling: str, contact: Contact, mass: float, speed: float, factor: float, linear: bool = False
) -> Row:
    """Return a scene, what the whole arm makes of it and what each model does; a status says what has no result."""
    names = ["sideways", "turn", "condition", "rigid all", "linear", *MEASURES]
    names += [f"{measure}: {model}" for model in MODELS for measure in MEASURES]
    row: Row = {
        "arm": arm, "line": line, "coupling": coupling, "factor": factor, "speed": speed, "object_mass": mass,
        "contact_stiffness": contact.stiffness, "restitution": contact.restitution, "status": "", "contacts": 0,
    } | dict.fromkeys(names, np.nan)  # fmt: skip
    try:
        row |= _measured(arm, line, coupling, contact, mass, speed, factor, linear)
    except (ValueError, RuntimeError) as problem:  # one bad scene does not spoil the others
        row["status"] = " ".join(str(problem).split())
    return row


def _measured(
    name: str, line: int, coupling: str, contact: Contact, mass: float, speed: float, factor: float, linear: bool
) -> Row:
    """Return what differs from scene to scene of a row."""
    arm, approach = approach_of(name, line, factor)
    scene = Scene(Tool(0.125), Object(mass, AHEAD), contact, COUPLINGS[coupling])
    motion = Trapezoid(speed, 8.0, Brake())
    duration = AHEAD / speed + speed / 16.0 + AFTERWARDS
    blow = whole.simulate(arm, approach, scene, motion, duration=duration)
    row: Row = {"status": blow.status, "contacts": blow.contact_count, "sideways": blow.sideways, "turn": blow.turn}
    row["condition"] = max(arm.condition(angles) for angles in approach.joint_angles)
    row |= {measure: _number(getattr(blow, measure)) for measure in MEASURES}
    if linear:
        row["linear"] = whole.simulate(arm, approach, scene, motion, duration=duration, linear=True).object_velocity
    for model in MODELS:
        robot = approach.robot_table(model) if model in MASSES else None
        row |= {f"{measure}: {model}": value for measure, value in _simulated(scene, robot, motion, duration).items()}
    row["rigid all"] = simulate(replace(scene, coupling=Rigid()), motion, duration=duration).object_velocity
    return row


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)


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
    return gather("scenes", played, cells, solver_and(*MODULES))


def linear_rows(gather: Gather, arms: Sequence[str]) -> list[Row]:
    """Return the rows of eq. 10 beside eq. 11."""
    return gather("linear", linearised, [{"arm": arm} for arm in arms], solver_and(*MODULES))


def errors(found: Sequence[Row], model: str, measure: str = "object_velocity") -> NDArray[np.float64]:
    """Return how far a model is off, as a share, where both have the measure, (n,)."""
    ours = np.array([row[f"{measure}: {model}"] for row in found])
    whole_arm = np.array([row[measure] for row in found])
    return np.asarray((ours / whole_arm - 1.0)[np.isfinite(ours / whole_arm)])

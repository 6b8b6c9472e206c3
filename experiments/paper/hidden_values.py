"""What the paper does not print, fitted at once to all numbers that it does, with the profile likelihood of each value.

The likelihood of a printed number is flat within its rounding, 0.98 being anything from 0.975 to 0.985, and falls off
outside like a normal density whose deviation is half a unit of the last digit. The profile likelihood of a hidden value
is the largest that the other four allow. Where it is 1, all printed numbers hold together, but one: of the impact
velocities in Fig. 13b and 14a, between which nothing before the impact differs, only one can. Both are tried.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import approx_fprime, minimize

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.paper import figure_05
from experiments.paper.figure_14 import HEAVY
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import (
    DISTANCE,
    MECHANISM,
    MOTION,
    OBJECT_MASS,
    ROBOT,
    TOOL_MASS,
    decoupled,
    held,
    on_robot,
)
from experiments.paper.statements import Basis, Statements, section_3_2
from experiments.paper.tables import Table, from_rows, where

TITLE = "Joint fit to all printed numbers, and profile likelihood of each value"
ALT = """Five panels, profile likelihood from 0 to 1 against acceleration, distance, the robot's stiffness and damping
ratio, and the front stop. Each curve is 1 over an interval and falls off beside it; a line marks the value used. Read
with 0.95 instead of 0.98 m/s the robot is a little softer and less damped."""
ROBOT_AND_TOOL = ROBOT.mass + TOOL_MASS  # kg, printed


@dataclass(frozen=True)
class Hidden:
    """A value that the paper does not print, SI, and the range that is looked at."""

    used: float
    low: float
    high: float
    label: str
    scale: float  # from SI to the unit of the label


HIDDEN = {
    "acceleration": Hidden(MOTION.acceleration, 7.0, 9.0, "acceleration, also of the brake (m/s²)", 1.0),
    "distance": Hidden(DISTANCE, 0.24, 0.26, "distance of the object (mm)", 1e3),
    "stiffness": Hidden(ROBOT.stiffness, 1.6e5, 2.4e5, "stiffness of the robot k_r (kN/m)", 1e-3),
    "damping_ratio": Hidden(
        0.5 * ROBOT.damping / math.sqrt(ROBOT.stiffness * ROBOT_AND_TOOL), 0.0, 0.06, "its damping ratio (%)", 1e2
    ),
    "front_stop": Hidden(MECHANISM.front_stop, 0.016, 0.025, "front stop of the slider (mm)", 1e3),
}
USED, LOW, HIGH = np.array([(value.used, value.low, value.high) for value in HIDDEN.values()]).T
PRINTED = (
    ("Fig. 5: damping force negative after", "s", 0.321, 0.0005),
    ("Fig. 13b: object velocity", "m/s", 1.94, 0.005),
    ("Fig. 14a: object velocity", "m/s", 1.88, 0.005),
    ("Fig. 13b: impact at a minimum of the velocity, after it by", "ms", 0.0, 2.0),  # the 2 ms are those of figure_13
    ("Fig. 16: slope breaks at k_t about", "N/m", 90.0, 5.0),  # two digits off a curve: rounded to tens
    ("Fig. 25: object velocity reduced by", "%", 51.0, 0.5),
    ("Fig. 13b or 14a: impact velocity", "m/s", np.nan, 0.005),
)
"""Where, unit, number, half a unit of its last digit: all predictions but the preload, which only has a lower limit."""
READINGS = (0.98, 0.95)  # m/s, the impact velocities
MET = 1e-4  # misfit up to which all numbers hold: to a hundredth of half a unit
GONE = 9.0  # misfit at which the likelihood is exp(-4.5), 1 %

Floats = NDArray[np.float64]


@cache
def recovery() -> float:
    """Return how long after the first touch the damping force of Fig. 5 turns negative, s."""
    touch = ig.simulate(figure_05.SCENES["a"], figure_05.STEADY, 0.5).contacts[0].start
    return figure_05.turn(figure_05.compute()) - touch


def motion(acceleration: float) -> ig.Trapezoid:
    """Return the paper's motion with this acceleration and deceleration, m/s^2."""
    return replace(MOTION, acceleration=acceleration, brake=replace(MOTION.brake, deceleration=acceleration))


@cache
def robot_blows(acceleration: float, distance: float, stiffness: float, damping_ratio: float) -> tuple[float, ...]:
    """Return V_p of Fig. 13b and 14a (m/s), how long after a minimum the tool strikes (ms), and how fast (m/s).

    Once the robot no longer accelerates its velocity swings as Im(X exp(s t)), whose minima are where s X exp(s t) is
    real and positive.
    """
    frequency = math.sqrt(stiffness / ROBOT_AND_TOOL)
    robot = ig.Robot(ROBOT.mass, stiffness, 2.0 * damping_ratio * frequency * ROBOT_AND_TOOL)
    scenes = (on_robot(robot, 1e5, 1.0, mass, distance) for mass in (OBJECT_MASS, HEAVY))
    light, heavy = (ig.simulate(scene, motion(acceleration)) for scene in scenes)
    (contact, *_) = light.contacts
    s = frequency * complex(-damping_ratio, math.sqrt(1.0 - damping_ratio**2))
    phase = np.angle(s * (np.exp(-s * MOTION.speed / acceleration) - 1.0) * np.exp(s * contact.start))
    return light.object_velocity, heavy.object_velocity, 1e3 * phase / s.imag, contact.approach_velocity


def second_contact(acceleration: float, distance: float) -> float:
    """Return the stiffness of the coupling from which Fig. 16 has two contacts at k_c = 1e5, N/m."""
    low, high = 20.0, 200.0
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        contacts = ig.simulate(decoupled(1e5, 1.0, middle, distance=distance), motion(acceleration)).contacts
        low, high = (low, middle) if len(contacts) > 1 else (middle, high)
    return low


@cache
def second_contacts() -> RectBivariateSpline:
    """Return `second_contact` over acceleration and distance: the fits ask for it some thousand times."""
    accelerations, distances = (np.linspace(low, high, 9) for low, high in zip(LOW[:2], HIGH[:2], strict=True))
    return RectBivariateSpline(
        accelerations, distances, [[second_contact(a, x) for x in distances] for a in accelerations]
    )


@cache
def reduction(acceleration: float, distance: float, front_stop: float) -> float:
    """Return by how much the mechanism of Fig. 23 lowers the object velocity of Fig. 25, %."""
    mechanism = replace(MECHANISM, front_stop=front_stop)
    scenes = held(mechanism, 1e3, 0.1, distance), on_robot(None, 1e3, 0.1, distance=distance)
    bistable, fixed = (ig.simulate(scene, motion(acceleration)).object_velocity for scene in scenes)
    return 100.0 * (1.0 - bistable / fixed)


def predictions(values: Floats) -> Floats:
    """Return what PRINTED has of the numbers, and the preload of the tool on its front stop in m_t a: (8,).

    Args:
        values: of HIDDEN, SI, (5,).
    """
    a, distance, stiffness, damping_ratio, front_stop = map(float, values)
    *velocities_and_phase, impact_velocity = robot_blows(a, distance, stiffness, damping_ratio)
    turn = distance / MOTION.speed + 0.5 * MOTION.speed / a + recovery()
    preload = float(MECHANISM.force(front_stop)) / (TOOL_MASS * a)
    middle = float(second_contacts()(a, distance, grid=False)), reduction(a, distance, front_stop)
    return np.array([turn, *velocities_and_phase, *middle, impact_velocity, preload])


def room(values: Floats, reading: float) -> Floats:
    """Return how far each prediction is from both ends of its rounding, in half units of the last digit: (15,).

    Negative outside. The last is what the preload on the front stop is above m_t a, in %: the tool stays there.

    Args:
        values: of HIDDEN, SI, (5,).
        reading: impact velocity, m/s.
    """
    number, half = np.array([row[2:] for row in PRINTED]).T
    number[-1] = reading
    *found, preload = predictions(values)
    off = (np.array(found) - number) / half
    return np.concatenate([1.0 - off, 1.0 + off, [100.0 * (preload - 1.0)]])


def fit(start: Floats, reading: float, fixed: int | None = None, push: float = 0.0) -> tuple[Floats, float]:
    """Return the values near `start` (5,) that fit best, and their misfit: the sum of squares of what is outside.

    What is outside are variables of their own, so that what SLSQP sees is smooth.

    Args:
        start: in fractions of the range that is looked at, as are the values returned.
        reading: impact velocity, m/s.
        fixed: which value stays as it is, None for none.
        push: -1 or 1 to let that value go as far down or up as all printed numbers allow, instead.
    """

    def rooms(values: Floats) -> Floats:
        return room(LOW + np.clip(values, 0.0, 1.0) * (HIGH - LOW), reading)

    n, outside = len(start), np.maximum(-rooms(start), 0.0)
    goal, share = np.zeros(n), np.eye(len(outside))
    bounds = [(0.0, 1.0)] * n + [(0.0, 0.0 if push else None)] * len(outside)
    if push:
        goal[fixed] = -push
    elif fixed is not None:
        bounds[fixed] = (start[fixed], start[fixed])
    found = minimize(
        lambda both: goal @ both[:n] + 0.5 * both[n:] @ both[n:],
        np.concatenate([start, outside * (not push)]),
        jac=lambda both: np.concatenate([goal, both[n:]]),
        method="SLSQP",
        bounds=bounds,
        constraints={
            "type": "ineq",
            "fun": lambda both: rooms(both[:n]) + both[n:],
            "jac": lambda both: np.hstack([approx_fprime(both[:n], rooms, 5e-3), share]),
        },
        options={"ftol": 1e-5, "maxiter": 15},
    )
    values = found.x[:n]
    return values, float(np.sum(np.minimum(rooms(values), 0.0) ** 2))


def profile(reading: float, fixed: int, step: float) -> Iterator[tuple[Floats, float]]:
    """Yield the best values and their misfit all along value `fixed`, from the best of all outwards until it is GONE.

    Each fit starts from its neighbour's values; the two ends of the interval without misfit are among them.
    """
    best = fit((USED - LOW) / (HIGH - LOW), reading)
    yield best
    for way in (-1.0, 1.0):
        ahead = way * step * np.eye(len(HIDDEN))[fixed]
        values, misfit = best
        while misfit < GONE and 0.0 <= (values + ahead)[fixed] <= 1.0:
            beyond, more = fit(values + ahead, reading, fixed)
            if misfit <= MET < more:
                yield fit(values, reading, fixed, way)
            yield beyond, more
            values, misfit = beyond, more


def compute(step: float = 1 / 25) -> Table:
    """Compute the profiles of all values, with either impact velocity; `step` in fractions of a value's range."""
    cases, rows = [], []
    for fixed, case in enumerate(HIDDEN):
        for reading in READINGS:
            points = sorted(profile(reading, fixed, step), key=lambda point: point[0][fixed])
            cases += [case] * len(points)
            rows += [(reading, misfit, *(LOW + values * (HIGH - LOW))) for values, misfit in points]
    return {"case": np.array(cases), **from_rows(("reading", "misfit", *HIDDEN), rows)}


def interval(table: Table, case: str, reading: float) -> tuple[float, float]:
    """Return the least and the greatest of a hidden value, SI, with which all printed numbers can hold."""
    rows = where(table, case=case, reading=reading)
    met = rows[case][rows["misfit"] <= MET]
    return float(met.min()), float(met.max())


def intervals(table: Table) -> Iterator[list[str]]:
    """Yield for each hidden value its label, the value used, and its interval with either impact velocity."""
    for case, value in HIDDEN.items():
        ends = [[f"{value.scale * end:.4g}" for end in interval(table, case, reading)] for reading in READINGS]
        yield [value.label, f"{value.scale * value.used:.4g}", *(" to ".join(pair) for pair in ends)]


@panels(12.6, 6.0, columns=3, rows=2, sharey=True)
def plot(table: Table, grid: Panels) -> None:
    """Draw the profile likelihood of each value relative to its maximum, with either impact velocity."""
    *axes_of_values, spare = grid.ravel()
    for axes, (case, value) in zip(axes_of_values, HIDDEN.items(), strict=True):
        for colour, style, reading in zip(SERIES, ("-", "--"), READINGS, strict=False):
            rows = where(table, case=case, reading=reading)
            label = f"impact velocity {reading:g} m/s"
            likelihood = np.exp(-0.5 * rows["misfit"])
            axes.plot(value.scale * rows[case], likelihood, style, color=colour, label=label)
        axes.axvline(value.scale * value.used, color="#888888", linewidth=0.8, linestyle=":", label="used")
        axes.set(xlabel=value.label, ylabel="profile likelihood", ylim=(0.0, 1.05))
    spare.remove()
    axes.figure.legend(*axes.get_legend_handles_labels(), loc="lower right", bbox_to_anchor=(0.95, 0.2))


def statements(table: Table) -> Statements:
    """Compare with section 3.2."""
    (soft, stiff), ends = interval(table, "stiffness", 0.98), interval(table, "stiffness", 0.95)
    yield section_3_2.claim(
        "Fig. 13b and 14a show one robot that meets one object face, that of the other figures (0.98 or 0.95, 1.94, "
        "1.88 m/s)",
        room(USED, READINGS[0]).min() > 0.0,
        f"{', '.join(f'{number:.4f}' for number in predictions(USED)[[6, 1, 2]])} m/s",
        "all numbers within their rounding at once, but for one of the impact velocities",
        basis=Basis.IDENTIFIED,
        why="Acceleration, distance, the robot's stiffness and damping, and the front stop were identified with these "
        "numbers and with 0.321 s (Fig. 5), 90 N/m (Fig. 16) and 51 % (Fig. 25).",
    )
    yield section_3_2.undecided(
        "Whether the tool strikes at 0.98 m/s (Fig. 13b) or at 0.95 m/s (Fig. 14a)",
        f"k_r from {1e-3 * soft:.1f} to {1e-3 * stiff:.1f} kN/m with the first, {1e-3 * ends[0]:.1f} to "
        f"{1e-3 * ends[1]:.1f} kN/m with the second",
        "Each can hold together with all other printed numbers. With the acceleration of 8 m/s² the second needs a "
        "damping ratio below 1 %, which is little for a robot's joints: the first is used. The second would also make "
        "the tool lose twice as much velocity in Fig. 14b as in 14a, by our rule there.",
        basis=Basis.REPEATED,
    )

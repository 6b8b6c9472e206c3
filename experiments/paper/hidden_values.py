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
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import approx_fprime, minimize

import impact_gym as ig
from experiments.lab.charts import SERIES
from experiments.paper import figure_05, scenes
from experiments.paper.layouts import Panels, panels
from experiments.paper.scenes import BRAKE, MECHANISM, MOTION, ROBOT, ROBOT_AND_TOOL, TOOL_MASS
from experiments.paper.statements import Statements, section_3_2
from experiments.paper.tables import Array, Row, Table, from_rows, where

TITLE = "Joint fit to all printed numbers, and profile likelihood of each value"
ALT = """Five panels, profile likelihood from 0 to 1 against acceleration, distance, the robot's stiffness and damping
ratio, and the front stop. Each curve is 1 over an interval and falls off beside it; a line marks the value used. Read
with 0.95 instead of 0.98 m/s the robot is a little softer and less damped."""


@dataclass(frozen=True)
class Hidden:
    """A value that the paper does not print, SI, and the range that is looked at."""

    used: float
    low: float
    high: float
    label: str
    scale: float  # from SI to the unit of the label


DAMPING_RATIO = 0.5 * ROBOT.damping / math.sqrt(ROBOT.stiffness * ROBOT_AND_TOOL)
HIDDEN = {
    "acceleration": Hidden(MOTION.acceleration, 7.0, 9.0, "acceleration, also of the brake (m/s²)", 1.0),
    "distance": Hidden(scenes.DISTANCE, 0.24, 0.26, "distance of the object (mm)", 1e3),
    "stiffness": Hidden(ROBOT.stiffness, 1.6e5, 2.4e5, "stiffness of the robot k_r (kN/m)", 1e-3),
    "damping_ratio": Hidden(DAMPING_RATIO, 0.0, 0.06, "its damping ratio (%)", 1e2),
    "front_stop": Hidden(MECHANISM.front_stop, 0.016, 0.025, "front stop of the slider (mm)", 1e3),
}
USED, LOW, HIGH = np.array([(value.used, value.low, value.high) for value in HIDDEN.values()]).T
PRINTED = (
    (0.321, 0.0005),  # s, Fig. 5: damping force negative after
    (1.94, 0.005),  # m/s, Fig. 13b: object velocity
    (1.88, 0.005),  # m/s, Fig. 14a: object velocity
    (0.0, 2.0),  # ms, Fig. 13b: impact at a minimum of the velocity, after it by; the 2 ms are those of figure_13
    (90.0, 5.0),  # N/m, Fig. 16: slope breaks at k_t about; two digits off a curve, rounded to tens
    (51.0, 0.5),  # %, Fig. 25: object velocity reduced by
)
"""Number and half a unit of its last digit: the first predictions. Impact velocity and preload follow."""
READINGS = (0.98, 0.95)  # m/s, the impact velocities of Fig. 13b and 14a, each with half a unit of 0.005
MET = 1e-4  # misfit up to which all numbers hold: to a hundredth of half a unit
LARGEST_MISFIT = 9.0  # at which the likelihood is exp(-4.5), 1 %


@cache
def recovery() -> float:
    """Return how long after the first touch the damping force of Fig. 5 turns negative, s."""
    touch = ig.simulate(figure_05.SCENES["a"], scenes.STEADY, 0.5).contacts[0].start
    return figure_05.turn(figure_05.compute()) - touch


def motion(acceleration: float) -> ig.Trapezoid:
    """Return the paper's motion with this acceleration and deceleration, m/s^2."""
    return replace(MOTION, acceleration=acceleration, brake=replace(BRAKE, deceleration=acceleration))


@cache
def robot_impacts(acceleration: float, distance: float, stiffness: float, damping_ratio: float) -> tuple[float, ...]:
    """Return V_p of Fig. 13b and 14a (m/s), how long after a minimum the tool strikes (ms), and how fast (m/s).

    Once the robot no longer accelerates its velocity swings as Im(X exp(s t)), whose minima are where s X exp(s t) is
    real and positive.
    """
    frequency = math.sqrt(stiffness / ROBOT_AND_TOOL)
    robot = ig.Robot(ROBOT.mass, stiffness, 2.0 * damping_ratio * frequency * ROBOT_AND_TOOL)
    light, heavy = (
        ig.simulate(scenes.scene(1e5, 1.0, robot=robot, object_mass=mass, distance=distance), motion(acceleration))
        for mass in (scenes.OBJECT_MASS, scenes.HEAVY_MASS)
    )
    contact = light.contacts[0]
    s = frequency * complex(-damping_ratio, math.sqrt(1.0 - damping_ratio**2))
    phase = np.angle(s * (np.exp(-s * MOTION.speed / acceleration) - 1.0) * np.exp(s * contact.start))
    return light.object_velocity, heavy.object_velocity, 1e3 * phase / s.imag, contact.approach_velocity


@cache
def second_contacts() -> RectBivariateSpline:
    """Return the stiffness of the coupling from which Fig. 16 has two contacts at k_c = 1e5, N/m.

    Over acceleration and distance; a spline, as the fits ask for it some thousand times.
    """

    def onset(acceleration: float, distance: float) -> float:
        low, high = 20.0, 200.0
        while high - low > 1e-6:
            middle = 0.5 * (low + high)
            scene = scenes.decoupled(1e5, 1.0, middle, distance=distance)
            contacts = ig.simulate(scene, motion(acceleration)).contacts
            low, high = (low, middle) if len(contacts) > 1 else (middle, high)
        return low

    accelerations, distances = (np.linspace(low, high, 9) for low, high in zip(LOW[:2], HIGH[:2], strict=True))
    return RectBivariateSpline(accelerations, distances, [[onset(a, x) for x in distances] for a in accelerations])


@cache
def reduction(acceleration: float, distance: float, front_stop: float) -> float:
    """Return by how much the mechanism of Fig. 23 lowers the object velocity of Fig. 25, %."""
    bistable, fixed = (
        ig.simulate(scenes.scene(1e3, 0.1, coupling, distance=distance), motion(acceleration)).object_velocity
        for coupling in (replace(MECHANISM, front_stop=front_stop), None)
    )
    return 100.0 * (1.0 - bistable / fixed)


def predictions(values: Array) -> Array:
    """Return our PRINTED numbers, the impact velocity (m/s), and the preload on the front stop in m_t a: (8,).

    Args:
        values: of HIDDEN, SI, (5,).
    """
    a, distance, stiffness, damping_ratio, front_stop = map(float, values)
    *velocities_and_phase, impact_velocity = robot_impacts(a, distance, stiffness, damping_ratio)
    turn = distance / MOTION.speed + 0.5 * MOTION.speed / a + recovery()
    preload = float(MECHANISM.force(front_stop)) / (TOOL_MASS * a)
    onset = float(second_contacts()(a, distance, grid=False))
    return np.array([turn, *velocities_and_phase, onset, reduction(a, distance, front_stop), impact_velocity, preload])


def margins(values: Array, reading: float) -> Array:
    """Return how far each prediction is from both ends of its rounding, in half units of the last digit: (15,).

    Negative outside. The last is what the preload on the front stop is above m_t a, in %: the tool stays there.

    Args:
        values: of HIDDEN, SI, (5,).
        reading: impact velocity, m/s.
    """
    number, half = np.array([*PRINTED, (reading, 0.005)]).T
    *ours, preload = predictions(values)
    error = (np.array(ours) - number) / half
    return np.concatenate([1.0 - error, 1.0 + error, [100.0 * (preload - 1.0)]])


def fit(start: Array, reading: float, fixed: int | None = None, push: float = 0.0) -> tuple[Array, float]:
    """Return the values near `start` (5,) that fit best, and their misfit: the sum of squares of what is outside.

    What is outside are variables of their own, so that what SLSQP sees is smooth.

    Args:
        start: in fractions of the range that is looked at, as are the values returned.
        reading: impact velocity, m/s.
        fixed: which value stays as it is, None for none.
        push: -1 or 1 to let that value go as far down or up as all printed numbers allow, instead.
    """

    def margins_at(values: Array) -> Array:
        return margins(LOW + np.clip(values, 0.0, 1.0) * (HIGH - LOW), reading)

    n, outside = len(start), np.maximum(-margins_at(start), 0.0)
    goal, share = np.zeros(n), np.eye(len(outside))
    bounds = [(0.0, 1.0)] * n + [(0.0, 0.0 if push else None)] * len(outside)
    if push:
        goal[fixed] = -push
    elif fixed is not None:
        bounds[fixed] = (start[fixed], start[fixed])
    solution = minimize(
        lambda stacked: goal @ stacked[:n] + 0.5 * stacked[n:] @ stacked[n:],
        np.concatenate([start, outside * (not push)]),
        jac=lambda stacked: np.concatenate([goal, stacked[n:]]),
        method="SLSQP",
        bounds=bounds,
        constraints={
            "type": "ineq",
            "fun": lambda stacked: margins_at(stacked[:n]) + stacked[n:],
            "jac": lambda stacked: np.hstack([approx_fprime(stacked[:n], margins_at, 5e-3), share]),
        },
        options={"ftol": 1e-5, "maxiter": 15},
    )
    values = solution.x[:n]
    return values, float(np.sum(np.minimum(margins_at(values), 0.0) ** 2))


def profile(reading: float, fixed: int, step: float) -> Iterator[tuple[Array, float]]:
    """Yield the best values and their misfit all along value `fixed`, from the best of all to LARGEST_MISFIT.

    Each fit starts from its neighbour's values; the two ends of the interval without misfit are among them.
    """
    best = fit((USED - LOW) / (HIGH - LOW), reading)
    yield best
    for way in (-1.0, 1.0):
        ahead = way * step * np.eye(len(HIDDEN))[fixed]
        values, misfit = best
        while misfit < LARGEST_MISFIT and 0.0 <= (values + ahead)[fixed] <= 1.0:
            beyond, more = fit(values + ahead, reading, fixed)
            if misfit <= MET < more:
                yield fit(values, reading, fixed, way)
            yield beyond, more
            values, misfit = beyond, more


def compute(step: float = 1 / 25) -> Table:
    """Compute the profiles of all values, with either impact velocity; `step` in fractions of a value's range."""
    rows: list[Row] = []
    for fixed, case in enumerate(HIDDEN):
        for reading in READINGS:
            for values, misfit in sorted(profile(reading, fixed, step), key=lambda point: point[0][fixed]):
                si = dict(zip(HIDDEN, LOW + values * (HIGH - LOW), strict=True))
                rows.append({"case": case, "reading": reading, "misfit": misfit, **si})
    return from_rows(rows)


def interval(table: Table, case: str, reading: float) -> tuple[float, float]:
    """Return the least and the greatest of a hidden value, SI, with which all printed numbers can hold."""
    rows = where(table, case=case, reading=reading)
    plausible = rows[case][rows["misfit"] <= MET]
    return float(plausible.min()), float(plausible.max())


def intervals(table: Table) -> Iterator[list[str]]:
    """Yield for each hidden value its label, the value used, and its interval with either impact velocity."""
    for case, value in HIDDEN.items():
        ends = [[f"{value.scale * end:.4g}" for end in interval(table, case, reading)] for reading in READINGS]
        yield [value.label, f"{value.scale * value.used:.4g}", *(" to ".join(pair) for pair in ends)]


@panels(12.6, 6.0, columns=3, rows=2, sharey=True)
def plot(table: Table, grid: Panels) -> None:
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
    (soft, stiff), ends = interval(table, "stiffness", 0.98), interval(table, "stiffness", 0.95)
    yield section_3_2.identified.claim(
        "Fig. 13b and 14a show one robot that meets one object face, that of the other figures (0.98 or 0.95, 1.94, "
        "1.88 m/s)",
        margins(USED, READINGS[0]).min() > 0.0,
        f"{', '.join(f'{number:.4f}' for number in predictions(USED)[[6, 1, 2]])} m/s",
        "all numbers within their rounding at once, but for one of the impact velocities",
        why="Acceleration, distance, the robot's stiffness and damping, and the front stop were identified with these "
        "numbers and with 0.321 s (Fig. 5), 90 N/m (Fig. 16) and 51 % (Fig. 25).",
    )
    yield section_3_2.repeated.undecided(
        "Whether the tool strikes at 0.98 m/s (Fig. 13b) or at 0.95 m/s (Fig. 14a)",
        f"k_r from {1e-3 * soft:.1f} to {1e-3 * stiff:.1f} kN/m with the first, {1e-3 * ends[0]:.1f} to "
        f"{1e-3 * ends[1]:.1f} kN/m with the second",
        "Each can hold together with all other printed numbers. With the acceleration of 8 m/s² the second needs a "
        "damping ratio below 1 %, which is little for a robot's joints: the first is used. The second would also make "
        "the tool lose twice as much velocity in Fig. 14b as in 14a, by our rule there.",
    )

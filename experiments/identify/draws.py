"""Random blows and sensors, each a function of its number alone, and what one must know of them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from agents.jobs import Result
from experiments.identify.recorder import Blow, blow, sampled
from experiments.lab.tables import result_of

Array = NDArray[np.float64]

NAMES = ("contact.stiffness", "contact.restitution", "object.mass")
RANDOM, ALIKE = 3, 2  # logs of a scene: by random sensors, and by the STANDARD one
LOGS = RANDOM + ALIKE
STANDARD = {"rate": 4000.0, "noise": 0.02, "low_pass": None, "bias": None}
BEFORE, AFTER = (0.005, 0.02), (0.02, 0.04)  # s of a log, about the first touch
NUDGE = 1e-3  # of a coordinate, for the information in a log
MOTION = ig.Trapezoid(1.0, 8.0, ig.Brake())


@dataclass(frozen=True)
class Recording:
    """How a blow is recorded."""

    rate: float  # Hz
    noise: float  # standard deviation over the peak of each column
    low_pass: float | None  # Hz
    bias: float | None  # over the peak; None: there is none, and that is known
    noise_known: bool
    with_velocity: bool
    before: float  # s
    after: float  # s
    share: float  # of a sample, by which the first one is late
    clock: float  # s, what the log calls the motion's start


def scene(number: int) -> tuple[ig.Scene, ig.Trapezoid]:
    """Return a random scene and motion."""
    rng = np.random.default_rng((number, 1))

    def log_uniform(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    spring = ig.SpringDamper(log_uniform(40.0, 300.0), rng.uniform(0.3, 1.5))
    robot = ig.Robot(rng.uniform(3.5, 7.0), log_uniform(1e5, 1e6), rng.uniform(30.0, 80.0))
    coupling, behind = ((spring, None), (spring, None), (ig.Rigid(), None), (spring, robot))[number % 4]
    contact = ig.Contact(log_uniform(1e4, 1e6), rng.uniform(0.15, 0.9))
    struck = ig.Object(log_uniform(0.05, 0.4), rng.uniform(0.15, 0.35))
    return ig.Scene(ig.Tool(0.125), struck, contact, coupling, behind), replace(MOTION, speed=rng.uniform(0.3, 1.2))


def recording(number: int, log: int) -> Recording:
    """Return a random way to record scene `number`."""
    rng = np.random.default_rng((number, 2, log))
    drawn = {
        "rate": float(np.exp(rng.uniform(np.log(1e3), np.log(8e3)))),
        "noise": float(np.exp(rng.uniform(np.log(0.01), np.log(0.1)))),
        "low_pass": float(np.exp(rng.uniform(np.log(200.0), np.log(2000.0)))) if rng.random() < 2 / 3 else None,
        "bias": float(rng.normal(0.0, 0.05)) if rng.random() < 0.5 else None,
    }
    known, velocity = bool(rng.random() < 0.5), bool(rng.random() < 1 / 3)
    if log >= RANDOM:
        drawn, known, velocity = STANDARD, False, False
    return Recording(
        **drawn, noise_known=known, with_velocity=velocity, before=rng.uniform(*BEFORE), after=rng.uniform(*AFTER),
        share=float(rng.random()), clock=float(rng.uniform(-0.5, 0.5)),
    )  # fmt: skip


def coordinates(of: ig.Scene) -> Array:
    """Return ln k_c, ln(e/(1-e)), ln m_p."""
    e = of.contact.restitution
    return np.log([of.contact.stiffness, e / (1.0 - e), of.object.mass])


def at(of: ig.Scene, u: Array) -> ig.Scene:
    """Return a scene with these coordinates."""
    contact = replace(of.contact, stiffness=float(np.exp(u[0])), restitution=float(1.0 / (1.0 + np.exp(-u[1]))))
    return replace(of, contact=contact, object=replace(of.object, mass=float(np.exp(u[2]))))


def clean(struck: Blow, how: Recording, times: Array) -> Array:
    """Return what noiseless sensors read at `times` (n,) of the motion, without bias: (columns, n)."""
    columns = [struck.force, struck.object_velocity][: 1 + how.with_velocity]
    return np.array([sampled(struck, values, times, how.low_pass) for values in columns])


def logs(number: int) -> Result:
    """Return the samples of all logs of a scene as rows, and in each the Cramer-Rao bound of the three coordinates.

    The bound is of the true noise, with start time and, where they are not known, biases to be found as well.
    """
    truth, motion = scene(number)
    longest = max(recording(number, log).after for log in range(LOGS)) + 1e-3
    here = blow(truth, motion, longest)
    u = coordinates(truth)
    nudged = [[blow(at(truth, u + NUDGE * side * row), motion, longest) for side in (1, -1)] for row in np.eye(3)]
    rows = []
    for log in range(LOGS):
        how = recording(number, log)
        first = here.time[0] - how.before + how.share / how.rate
        times = first + np.arange(int((how.before + how.after) * how.rate)) / how.rate
        values = clean(here, how, times)
        noise = how.noise * values.max(axis=1)
        bound = _bound(nudged, here, how, times, noise)
        rng = np.random.default_rng((number, 3, log))
        offset = 0.0 if how.bias is None else how.bias * values.max(axis=1)
        values = values + rng.normal(size=values.shape) * noise[:, None] + np.reshape(offset, (-1, 1))
        for k, time in enumerate(times + how.clock):
            columns = {"time": time, "force": values[0, k], "object_velocity": values[-1, k]}
            noises = {"force_noise": noise[0], "velocity_noise": noise[-1]}
            rows.append({"scene": number, "log": log, **columns, **noises, **dict(zip(NAMES, bound, strict=True))})
    return result_of(rows)


def _bound(nudged: Any, here: Blow, how: Recording, times: Array, noise: Array) -> Array:
    """Return the least standard deviation of the three coordinates (3,)."""
    columns = [(clean(up, how, times) - clean(down, how, times)) / (2.0 * NUDGE) for up, down in nudged]
    late = 1e-2 / how.rate
    columns.append((clean(here, how, times - late) - clean(here, how, times + late)) / (2.0 * late))
    scaled = [(column / noise[:, None]).ravel() for column in columns]
    if how.bias is not None:
        scaled += list(np.kron(np.eye(len(noise)), np.ones(len(times))))
    jacobian = np.array(scaled).T
    size = np.linalg.norm(jacobian, axis=0)
    return np.sqrt(np.diag(np.linalg.pinv((jacobian / size).T @ (jacobian / size), rcond=1e-14)))[:3] / size[:3]

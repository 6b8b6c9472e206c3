"""Random blows and sensors, each a function of its number alone, and what `identify` makes of their logs."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import impact_gym as ig
from agents.jobs import Result
from experiments.identify.recorder import Blow, blow, sample_signal
from experiments.lab.tables import Row, result_of

Array = NDArray[np.float64]

NAMES = ("contact.stiffness", "contact.restitution", "object.mass")
RANDOM, ALIKE = 3, 2  # logs of a scene: by random sensors, and by the standard one, 4 kHz and 2 % of noise
LOGS = RANDOM + ALIKE
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
    before: float  # s of the log before the first touch
    after: float  # s behind it
    share: float  # of a sample, by which the first one is late
    clock: float  # s, what the log calls the motion's start

    def sensor(self, noise: float) -> ig.Sensor:
        """Return what a fit is told of a column with this noise, in its unit."""
        known = noise if self.noise_known else None
        return ig.Sensor(self.rate, self.low_pass, 0.0 if self.bias is None else "estimated", known)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def scene(number: int) -> tuple[ig.Scene, ig.Trapezoid]:
    """Return a random scene and motion."""
    rng = np.random.default_rng((number, 1))
    spring = ig.SpringDamper(_log_uniform(rng, 40.0, 300.0), rng.uniform(0.3, 1.5))
    robot = ig.Robot(rng.uniform(3.5, 7.0), _log_uniform(rng, 1e5, 1e6), rng.uniform(30.0, 80.0))
    contact = ig.Contact(_log_uniform(rng, 1e4, 1e6), rng.uniform(0.15, 0.9))
    struck = ig.Object(_log_uniform(rng, 0.05, 0.4), rng.uniform(0.15, 0.35))
    coupling, behind = ig.Rigid() if number % 4 == 2 else spring, robot if number % 4 == 3 else None
    return ig.Scene(ig.Tool(0.125), struck, contact, coupling, behind), replace(MOTION, speed=rng.uniform(0.3, 1.2))


def recording(number: int, log: int) -> Recording:
    """Return a random way to record scene `number`."""
    rng = np.random.default_rng((number, 2, log))
    rate, noise = _log_uniform(rng, 1e3, 8e3), _log_uniform(rng, 0.01, 0.1)
    low_pass = _log_uniform(rng, 200.0, 2000.0) if rng.random() < 2 / 3 else None
    bias = float(rng.normal(0.0, 0.05)) if rng.random() < 0.5 else None
    known, velocity = bool(rng.random() < 0.5), bool(rng.random() < 1 / 3)
    if log >= RANDOM:
        rate, noise, low_pass, bias, known, velocity = 4000.0, 0.02, None, None, False, False
    when = rng.uniform(0.005, 0.02), rng.uniform(0.02, 0.04), float(rng.random()), rng.uniform(-0.5, 0.5)
    return Recording(rate, noise, low_pass, bias, known, velocity, *when)


def numbers(of: ig.Scene) -> tuple[float, float, float]:
    """Return the numbers called NAMES."""
    return of.contact.stiffness, of.contact.restitution, of.object.mass


def coordinates(of: ig.Scene) -> Array:
    """Return ln k_c, ln(e/(1-e)), ln m_p."""
    k_c, e, m_p = numbers(of)
    return np.log([k_c, e / (1.0 - e), m_p])


def at(of: ig.Scene, u: Array) -> ig.Scene:
    """Return a scene with these coordinates."""
    contact = replace(of.contact, stiffness=float(np.exp(u[0])), restitution=float(1.0 / (1.0 + np.exp(-u[1]))))
    return replace(of, contact=contact, object=replace(of.object, mass=float(np.exp(u[2]))))


def clean(struck: Blow, how: Recording, times: Array) -> Array:
    """Return what noiseless sensors read at `times` (n,) of the motion, without bias: (columns, n)."""
    columns = [struck.force, struck.object_velocity][: 1 + how.with_velocity]
    return np.array([sample_signal(struck, values, times, how.low_pass) for values in columns])


def logs(number: int) -> Iterator[tuple[Recording, dict[str, Array], Array, Array]]:
    """Yield the logs of a scene: how it is recorded, columns (n,), the true noise of those beside the time, a bound.

    The bound is that of Cramer and Rao for the standard deviations of the three coordinates (3,), with the true noise
    and with start time and, where they are not known, biases to be found as well.
    """
    truth, motion = scene(number)
    recordings = [recording(number, log) for log in range(LOGS)]
    longest = max(how.after for how in recordings) + 1e-3
    here, u = blow(truth, motion, longest), coordinates(truth)
    nudged = [[blow(at(truth, u + NUDGE * side * row), motion, longest) for side in (1, -1)] for row in np.eye(3)]
    for log, how in enumerate(recordings):
        first = here.time[0] - how.before + how.share / how.rate
        times = first + np.arange(int((how.before + how.after) * how.rate)) / how.rate
        values = clean(here, how, times)
        peaks = values.max(axis=1)
        noise = how.noise * peaks
        bound = _bound(nudged, here, how, times, noise)
        values += np.random.default_rng((number, 3, log)).normal(size=values.shape) * noise[:, None]
        values += np.reshape((how.bias or 0.0) * peaks, (-1, 1))
        columns = dict(zip(("time", "force", "object_velocity"), (times + how.clock, *values), strict=False))
        yield how, columns, noise, bound


def _bound(nudged: Any, here: Blow, how: Recording, times: Array, noise: Array) -> Array:
    """Return the least standard deviation of the three coordinates (3,); `nudged` are blows up and down each."""
    columns = [(clean(up, how, times) - clean(down, how, times)) / (2.0 * NUDGE) for up, down in nudged]
    late = 1e-2 / how.rate
    columns.append((clean(here, how, times - late) - clean(here, how, times + late)) / (2.0 * late))
    scaled = [(column / noise[:, None]).ravel() for column in columns]
    if how.bias is not None:
        scaled += list(np.kron(np.eye(len(noise)), np.ones(len(times))))
    jacobian = np.array(scaled).T
    size = np.linalg.norm(jacobian, axis=0)
    covariance = np.linalg.pinv((jacobian / size).T @ (jacobian / size), rcond=1e-14)
    return np.sqrt(np.diag(covariance))[:3] / size[:3]


GUESS = np.log([1e5, 1.0, 0.25])  # stiffness, e/(1-e), mass: what every fit is told
MEASURES = ("estimate", "low", "high", "error", "over bound")  # of each number: relative error, and over the bound


def fit(number: int) -> Result:
    """Return a row for each log of a scene: MEASURES of its numbers, whether intervals hold the truth, time, words."""
    return result_of([_row(number, log, *recorded) for log, recorded in enumerate(logs(number))])


def _row(number: int, log: int, how: Recording, columns: dict[str, Array], noise: Array, bound: Array) -> Row:
    truth, motion = scene(number)
    sensor = {name: how.sensor(deviation) for name, deviation in zip(list(columns)[1:], noise.tolist(), strict=True)}
    row: dict[str, Any] = {"scene": number, "log": log, "failure": "", "seconds": np.nan, "clock": np.nan, "words": ""}
    row |= {f"{name} {measure}": np.nan for name in NAMES for measure in MEASURES}
    row |= {f"{name} covered": False for name in NAMES}
    begun = time.process_time(), time.perf_counter()
    try:
        result = ig.identify(columns, at(truth, GUESS), motion, sensor=sensor)
    except (ValueError, RuntimeError) as error:
        return row | {"failure": str(error)}
    row |= {"seconds": time.process_time() - begun[0], "clock": time.perf_counter() - begun[1]}
    row["words"] = " | ".join(result.indistinguishable)
    errors = np.abs(coordinates(result.scene) - coordinates(truth)) / bound
    for name, true, over_bound in zip(NAMES, numbers(truth), errors, strict=True):
        estimate, (low, high) = result.estimate[name], result.interval[name]
        measures = zip(MEASURES, (estimate, low, high, abs(estimate / true - 1.0), over_bound), strict=True)
        row |= {f"{name} {measure}": value for measure, value in measures}
        row[f"{name} covered"] = low <= true <= high
    return row

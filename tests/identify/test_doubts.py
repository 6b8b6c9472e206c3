"""Each refusal and each warning at its border: just inside there is none, just beyond there is one."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_hits import CLEAN, FLAT, FORCE, MOTION, NOISE, SCENE, TIME, log, put, scene
from refusal import refused
from scipy.optimize import brentq
from scipy.stats import chi2, f, norm

import impact_gym as ig
from impact_gym.identify.log import Log, check, read
from impact_gym.identify.model import free_coordinates
from impact_gym.identify.result import _words, misfits

RISE = CLEAN / CLEAN.max()
TOUCH = ig.simulate(SCENE, MOTION, 0.4).contacts[0].start
BEFORE = int(np.sum(TIME < TOUCH))
ALARM = 1e-4  # probability of a false warning, see `misfits`
N, FEW = len(TIME), ("contact.stiffness",)
COARSE = np.round(CLEAN + 0.002 * CLEAN.max() * NOISE)  # N; several equal values at the top


def checked(column, values, time=TIME, **sensor):
    check(read({"time": time, column: values}, "log"), SCENE, MOTION, {column: ig.Sensor(**sensor)})


def dropped(count):
    kept = np.delete(np.arange(N), 80 + np.arange(count))
    checked("force", FORCE[kept], TIME[kept])


def two_blows(height):  # the first lasts for a sample; height in standard deviations of the noise
    noise = CLEAN.max() / 25.0
    log = {"time": TIME, "force": put(CLEAN, 9, height * noise)}
    ig.identify(log, SCENE, MOTION, FEW, ig.Sensor(noise=noise))


def edge(limit):
    return limit * (1.0 - 1e-6), limit * (1.0 + 1e-6)


BLOWS = RISE[RISE > 0.2].sum() / 4000  # s, impulse of the blow for a peak of 1 N
PLASTIC = 1.0 / (1.0 / 0.125 + 1.0 / 0.25)  # N s, impulse of a plastic impact at 1 m/s
LIMITS = {  # accepted and refused value, a call with the value, words of the refusal
    "force": (*edge(1e5), lambda x: checked("force", x * RISE), "100000 N", "is it in mN?"),
    "velocity": (*edge(10.0), lambda x: checked("object_velocity", x * RISE), "10 m/s", "is it in mm/s?"),
    "acceleration": (*edge(1e6), lambda x: checked("tool_acceleration", -x * RISE), "1e+06 m/s^2", "in mm/s^2?"),
    "fast sensor": (*edge(4040.0), lambda x: checked("force", FORCE, rate=x), "4000 samples per s", "Hz"),
    "slow sensor": (*edge(3960.0)[::-1], lambda x: checked("force", FORCE, rate=x), "4000 samples per s", "Hz"),
    "time step": (*edge(0.05), lambda x: read({"time": x * np.arange(N), "force": FORCE}, "log"), "0.05 s", "in ms?"),
    "lost samples": (3, 4, dropped, "3 samples lost", "got 4"),
    "few samples": (8, 7, lambda n: read({"time": TIME[:n], "force": FORCE[:n]}, "log"), "8 samples at least"),
    "noise": (*edge(np.ptp(FORCE) / 10.0), lambda x: checked("force", FORCE, noise=x), "rises above the noise"),
    "impulse": (*edge(BLOWS / (0.03 * PLASTIC)), lambda x: checked("force", RISE / x), "N s", "is it in kN?"),
    "flat top": (2, 3, lambda n: checked("force", put(FORCE, np.s_[80 : 80 + n], 50.0)), "saturated"),
    "flat bottom": (np.where(FLAT == 2.5, 2.0, FLAT), FLAT, lambda y: checked("force", y, TIME[: len(y)]), "saturated"),
    "coarse readings": (COARSE, COARSE + 4.0 * (COARSE.max() == COARSE), partial(checked, "force"), "saturated"),
    "another blow": (5.5, 6.5, two_blows, f"has 2 blows, at {TIME[9]:g}, ", "the fit has no more than 1"),
}  # fmt: skip


@pytest.mark.parametrize(("accepted", "beyond", "call", "words"), [(*row[:3], row[3:]) for row in LIMITS.values()],
                         ids=LIMITS)  # fmt: skip
def test_log_is_refused_just_beyond_a_limit(accepted, beyond, call, words):
    call(accepted)
    refused(lambda: call(beyond), words[0], *words[1:])


def white(seed=2):
    """Residuals of mean 0 and standard deviation 1 before the touch, mean square 1 after it."""
    rest = np.random.default_rng(seed).normal(size=N)
    before, behind = rest[:BEFORE], rest[BEFORE:]
    before -= before.mean()
    before /= before.std(ddof=1)
    behind /= np.sqrt(np.mean(behind**2))
    return rest


def ljung_box(rest, lags=10):
    y = rest - rest.mean()
    r = [np.sum(y[k:] * y[:-k]) / np.sum(y * y) for k in range(1, lags + 1)]
    return N * (N + 2) * sum(r[k - 1] ** 2 / (N - k) for k in range(1, lags + 1))


def doubts(rest, *, values=None, known=False, bias=0.0, mass=0.0, first=0, name="force"):
    """Warnings of a fit with these residuals (noise 1 N), and `mass`, ln(mass / guess) with a deviation of 0.5."""
    number, *_ = numbers = free_coordinates(SCENE, ("object.mass",))
    model = SimpleNamespace(
        free=numbers, scene=SCENE, scene_at=lambda x: SCENE, residuals=lambda x: -rest[first:], motions=[MOTION],
        logs=[Log("log", TIME[first:], {name: (rest if values is None else values)[first:]})], noise={name: 1.0},
        slots={(0, name): slice(0, N - first)}, sensors={name: ig.Sensor(noise=1.0 if known else None, bias=bias)},
    )  # fmt: skip
    x = np.array([number.start(SCENE) + mass, 0.0])
    return " ".join(misfits(SimpleNamespace(model=model, x=x, deviations=np.array([0.5]))))


BEHIND = np.arange(N) >= BEFORE
HUM = np.sin(0.4 * np.arange(N)) * BEHIND
MEAN = norm.isf(ALARM / 2) / np.sqrt(BEFORE)
RATIO = f.isf(ALARM, N - BEFORE, BEFORE - 1)
LOUD = chi2.isf(ALARM, N) / np.sum(white() ** 2)
HUMS = brentq(lambda a: ljung_box(white() + a * HUM) - chi2.isf(ALARM, 10), 0.0, 3.0)
WARNINGS = {  # value at the border, warnings at a value, words
    "mean": (MEAN, lambda x: doubts(white() - x * ~BEHIND), "has a mean of -", "not tared"),
    "ratio": (RATIO, lambda x: doubts(white() * np.where(BEHIND, x**0.5, 1.0)), f"{RATIO**0.5:.2g}", "noise before"),
    "noise": (LOUD, lambda x: doubts(white() * x**0.5, known=True), f"{LOUD**0.5:.2g}", "times the noise given"),
    "hum": (HUMS, lambda x: doubts(white() + x * HUM), "not white noise"),
    "far above": (np.log(100.0) + 1.0, lambda x: doubts(white(), mass=x), "object.mass is ", "units of the log"),
    "far below": (np.log(100.0) + 1.0, lambda x: doubts(white(), mass=-x), "object.mass is ", "units of the log"),
}  # fmt: skip


@pytest.mark.parametrize(("border", "call", "words"), [(*row[:2], row[2:]) for row in WARNINGS.values()], ids=WARNINGS)
def test_fit_is_doubted_just_beyond_a_border(border, call, words):
    """By the quantiles of normal, F and chi-squared distributions."""
    assert call(0.999 * border) == ""
    assert not [each for each in words if each not in call(1.001 * border)]


def test_doubts_need_enough_samples_noise_and_a_known_bias():
    untared = white() + 9.0 * ~BEHIND
    assert "not tared" in doubts(untared, first=BEFORE - 8)
    others = {"first": BEFORE - 7}, {"bias": "estimated"}, {"name": "tool_velocity"}
    assert "not tared" not in " ".join(doubts(untared, **other) for other in others)
    assert doubts(untared, name="flange_velocity") == ""
    assert "dead band" in doubts(white() * BEHIND)
    assert "dead band" not in doubts(put(white() * BEHIND, 3, 0.01))
    for flat in (2, 3):  # samples at the extreme
        there = np.s_[40 : 40 + flat]
        top, rest = put(NOISE, there, 9.0), put(white(), there, [-0.4, -0.5, -0.4][:flat])
        assert ("saturated" in doubts(rest, values=top)) == (flat == 3)


@pytest.mark.parametrize(("name", "most"), [("object.mass", 0.8), ("contact.restitution", 0.7)])
def test_wide_interval_and_correlation_are_said_at_a_border(name, most):
    """Twice the lower end, or 0.3 more for the restitution; a correlation of 0.95."""
    for high, correlation, count in ((most * 0.999, 0.99, 0), (most * 1.001, 0.949, 1), (most * 1.001, -0.951, 2)):
        ends, matrix = {name: (0.4, high), "tool.mass": (0.1, 0.11)}, np.array([[1.0, correlation], [correlation, 1.0]])
        said = [*_words(SCENE, ends, matrix)]
        assert len(said) == count
        assert not said or said[0].startswith(f"the log hardly determines {name}: it lies between 0.4 and {high:.3g}")
    assert f"a larger {name} with a smaller tool.mass" in said[1]
    assert f"a larger {name} with a larger tool.mass" in [*_words(SCENE, ends, np.abs(matrix))][1]


@pytest.mark.parametrize(("spoil", "words"), [
    (lambda time, force: force + 3.0 * np.sin(2.0 * np.pi * 300.0 * time), "not white"),
    (lambda time, force: np.where(np.abs(force) < 0.1 * force.max(), 0.0, force), "a dead band"),
    (lambda time, force: np.round(np.minimum(20.0 * force / force.max(), 16.0)), "longer than the fit"),
], ids=["hum", "dead band", "saturated"])  # fmt: skip
def test_misfit_is_a_warning(spoil, words):
    good = log(truth := scene(1e5, 0.4))
    with pytest.warns(UserWarning, match="force|object.mass") as said:
        fit = ig.identify(good | {"force": spoil(good["time"], good["force"])}, truth, MOTION, ("object.mass",))
    assert [(str(each.message), each.filename) for each in said] == [(text, __file__) for text in fit.warnings]
    assert any(words in text for text in fit.warnings)
    assert "95 %" not in str(fit)

"""Controllers in C command what they command in Python, with good and with faulty readings."""

import json
import re
import shutil
from functools import partial

import numpy as np
import pytest
from made_up_policies import made_up_policy

from agents import load_setup
from agents.baselines import FIXED, RULES
from agents.baselines.rule import ranges_for
from agents.export.c_header import write_header
from agents.export.documentation import Exported, of_name
from agents.export.replay import compiled, logged, replay
from agents.setups import shipped_baselines, trained
from impact_gym.envs import IDS
from impact_gym.task import Task
from impact_gym.task.action import RESOLUTION

pytestmark = pytest.mark.skipif(not (shutil.which("gcc") and shutil.which("g++")), reason="no compiler")
TELEOP, NOISE = IDS["ImpactTeleop-v0"], {"force_noise": [0.02, 5.0], "reaction_delay": [0.0, 0.05]}
FAR, FAST = {"scenario": {"distance": [0.05, 0.6]}}, {"acceleration_range": [0.5, 30.0], "velocity_range": [-1.0, 2.0]}
RULES_IN_C = {
    "filter, false alarms": ("FilteredProfile", {"alarm": "reading", "force_noise": 1.0, "range_sensor": {
        "noise": 0.002, "share": 0.1}, "coupling": {"type": "SpringDamper", "stiffness": 50.0}}),
    "filter, late and lost": ("FilteredProfile", {"range_sensor": {
        "noise": 0.01, "share": 0.05, "bias": 0.01, "dropout": 0.3, "delay": [0.0, 0.08]}} | FAR),
    "calibration, false alarms": ("SelfCalibratingProfile", {"alarm": "reading", "force_noise": 1.0, "range_sensor": {
        "share": 0.05, "scale": [-0.1, 0.2], "correlation": [0.0, 0.9], "delay": 0.04}}),
    "calibration, rigid": ("SelfCalibratingProfile", {"coupling": {"type": "Rigid"}, "range_sensor": {
        "noise": [0.0, 0.01], "bias": [-0.02, 0.01], "dropout": 0.3, "nearest": 0.03}} | FAR),
    "deceleration, far": ("ConstantDeceleration", FAR), "profile, far": ("BlindProfile", FAR),
    "detector with a range": ("DetectorRanged", load_setup("ranged-robust").environment | FAST),
    "threshold": ("ThresholdBrake", NOISE),
    "speed": ("ConstantSpeed", {"alarm": "reading", "force_noise": 0.5, "control_period": 0.008}),
}  # fmt: skip
POLICIES_IN_C = {
    "past readings": NOISE | {"alarm": "reading", "deflection_sensor": True, "past_readings": 3,
                              "range_noise": [0.002, 0.03], "observe_range_noise": True},
    "its own arm": {"velocity_range": [-0.2, 0.6], "acceleration_range": [0.5, 4.0], "tool_mass": [0.3, 0.5],
                    "reaction_delay": [0.0, 0.05], "time_weight": [0.05, 50.0]},  # beyond the observed range
    "an operator whose commands get lost": TELEOP | {
        "uplink": {"delay": 0.096, "loss": 0.4, "burst": 8.0, "timeout": 0.096}, "alarm": "reading"},
}  # fmt: skip
FAULTY = {"force": {}, "reading": {"alarm": "reading"}, "past": {"past_readings": 2}}


def careless(exported, folder):
    """Compile it as C++, with a compiler that may remove tests for NaN, and has no macros that say so."""
    not_told = [f"-U__{name}__" for name in ("FAST_MATH", "FINITE_MATH_ONLY", "ASSOCIATIVE_MATH")]
    return compiled(exported, write_header(exported, folder / "it.h"), folder, "-Ofast", *not_told, language="C++17")


def commands_of(program, sensors, weights, late=None):
    """Return the commands (steps, rows, 2) of a compiled controller for readings (steps, rows, fields)."""
    commands = np.zeros((*sensors.shape[:2], 2))
    late = np.full(sensors.shape[:2], np.nan) if late is None else late
    steps = np.full(len(weights), len(sensors), np.int32)
    arrays = np.ascontiguousarray(sensors), steps, np.asarray(weights, float), late, commands
    program.play(len(weights), *(array.ctypes for array in arrays))
    return commands


def made_up_rule(rule, environment):
    """Return a rule with three rows of parameters within the limits, for three time weights."""
    ranges, rng = ranges_for(Task(**environment)), np.random.default_rng(1)
    low, high, start = np.array([(each.low, each.high, each.start) for each in RULES[rule].limited(ranges)]).T
    table = np.clip(start + 0.1 * rng.normal(size=(3, len(start))) * (high - low), low, high)
    controller = RULES[rule].of(table, ranges).for_task(Task(**environment))
    controller.weights = (0.5, 1.0, 4.0)
    return Exported(controller)


CONTROLLERS = {
    **{name: partial(of_name, name) for name in (*trained(), *shipped_baselines(), *FIXED) if name != "random"},
    **{name: partial(made_up_rule, *how) for name, how in RULES_IN_C.items()},
    **{name: lambda each=each: Exported(made_up_policy(2, each)) for name, each in POLICIES_IN_C.items()},
}  # fmt: skip


@pytest.mark.parametrize("name", CONTROLLERS)
def test_controller_gives_the_same_commands_in_c_and_numpy(name, tmp_path):
    """The difference is below 1e-6 of the range, or below one step of the grid on which commands lie."""
    exported = CONTROLLERS[name]()
    program = compiled(exported, write_header(exported, tmp_path / "it.h"), tmp_path, "-O0")
    log, task = logged(exported, 60), exported.task
    said = {key: json.loads(value) for key, value in exported.documentation.items()}
    assert log.commands[..., 0].std() > 0.01
    grid = RESOLUTION / min(np.ptp(task.velocity_range), np.ptp(task.acceleration_range))
    difference, seconds = replay(exported, program, log, calls=10)
    assert difference < (1.001 * max(1e-6, grid) if name not in POLICIES_IN_C else 1e-5)
    assert (seconds > 0.0).all()
    weight, limits = said["time_weight"], said["velocity_limits"]
    assert exported.policy or (weight["low"], weight["high"]) == (exported.weights[0], exported.weights[-1])
    time = log.sensors[..., exported.spec.sensors.index("time")]
    assert np.diff(time, axis=0).max() == pytest.approx(said["control_period"]["value"])  # the longest step
    commanded = log.commands[np.arange(len(time))[:, None] < log.steps, 0]
    assert limits["low"] - 1e-9 <= commanded.min() <= commanded.max() <= limits["high"] + 1e-9


FIELDS = ["time", "position", "velocity", "alarm", "time_since_alarm", "force", "force_peak", "distance_estimate"]


def faulty_readings(seed, steps=60):
    """Return faulty readings (steps, fields): late, repeated, without a time, incomplete, with random alarms."""
    rng = np.random.default_rng(seed)
    low, high = [0.0, 0.0, -0.5, 0.0, 0.0, -5.0, 0.0, -0.1], [0.0, 0.3, 1.5, 0.0, 0.1, 20.0, 20.0, 0.4]
    readings = rng.uniform(low, high, (steps, len(FIELDS)))
    readings[:, 0] = np.cumsum(rng.uniform(0.001, 0.03, steps))
    readings[:, 0] *= rng.choice([1.0, 0.9, np.nan], steps, p=[0.8, 0.1, 0.1])
    readings[:, 3] = rng.random(steps) < 0.5 * (np.arange(steps) > 5)
    missing = rng.random(readings.shape) < 0.2
    readings[:, 1:][missing[:, 1:]] = rng.choice([np.nan, np.inf, -np.inf], missing[:, 1:].sum())
    repeated = np.flatnonzero(rng.random(steps - 1) < 0.1) + 1
    readings[repeated, 0] = readings[repeated - 1, 0]
    return readings


def observed_by_hand(history, by_reading):
    """Return the observed values, by field, after the accepted readings `history`.

    A missing number keeps its last value. Without `by_reading` an alarm stays on; the time since the alarm continues.
    """
    now = dict.fromkeys(FIELDS, 0.0)
    for reading in history:
        before, given = now, {field: value for field, value in reading.items() if np.isfinite(value)}
        now = before | given
        was_on = before["alarm"] > 0.5
        on = now["alarm"] > 0.5 or (was_on and not by_reading)
        since = before["time_since_alarm"] + now["time"] - before["time"] if was_on else 0.0
        since = given.get("time_since_alarm", since) if by_reading or not was_on else since
        peak = max(before["force_peak"], given.get("force_peak", 0.0), given.get("force", 0.0))
        now |= {"alarm": float(on), "time_since_alarm": since if on else 0.0, "force_peak": peak}
    return now | {"force": max(now["force"], 0.0)}


def commands_by_hand(policy, readings, weight, by_reading):
    """Return the commands of a policy for faulty readings, and how many of the readings count."""
    history, commands, low, high = [], [np.array([0.0, 20.0])], np.array([-0.5, 1.0]), np.array([1.5, 20.0])
    for reading in (dict(zip(FIELDS, values, strict=True)) for values in readings):
        if not np.isfinite(reading["time"]) or (history and reading["time"] <= history[-1]["time"]):
            commands.append(commands[-1])  # before the first reading: stay at rest
            continue
        history.append(reading)
        seen = observed_by_hand(history, by_reading) | {"time_weight": weight}
        seen |= {f"force_{k}": observed_by_hand(history[:-k], False)["force"] for k in (1, 2)}
        row = np.array([policy.spec.encode(name, seen[name]) for name in policy.spec.ids], np.float32)
        commands.append(low + 0.5 * (policy.predict(row)[0].astype(float) + 1.0) * (high - low))
    return np.array(commands[1:]), len(history)


@pytest.mark.parametrize("name", FAULTY)
def test_faulty_readings_are_treated_as_the_contract_says(name, tmp_path):
    exported = Exported(made_up_policy(environment={"range_noise": 0.01, **FAULTY[name]}))
    program, weight = careless(exported, tmp_path), 2.0
    said = {key: json.loads(value) for key, value in exported.documentation.items()}
    by_reading = "alarm" in FAULTY[name]
    for part in ("not later than before, repeats the last command", "(NaN or infinite) keeps its last value",
                 "before the first value a number is 0",
                 "the alarm is on or off as read" if by_reading else "the alarm stays on"):  # fmt: skip
        assert part in said["missing"]  # as `commands_by_hand` computes
    for part in ("clipped to the range of its input", "a missing one (NaN or infinite) becomes the smallest"):
        assert part in said["resets"]
    place = exported.spec.ids.index("time_weight")
    least, most = (said[f"input {place:02}"][side] for side in ("low", "high"))
    for seed in range(3):
        readings = faulty_readings(seed)
        commands = commands_of(program, readings[:, None], [weight])
        expected, count = commands_by_hand(exported.policy, readings, weight, by_reading)
        assert count > 30
        assert commands[:, 0] == pytest.approx(expected, rel=0, abs=2e-5)
        assert commands[:, 0].std(axis=0).min() > 0.05
        ends = [least, 0.0, -1.0, np.nan, np.inf, -np.inf, most, 2.0 * most]
        weights = commands_of(program, np.repeat(readings[:, None], len(ends), axis=1), ends)
        assert np.ptp(weights[:, :6], axis=1).max() == 0.0 == np.ptp(weights[:, 6:], axis=1).max()
        assert "time_weight_use" not in said  # which says that the weight is ignored
        assert abs(weights[:, :1] - commands).max() > 0.0 < abs(weights[:, 6:7] - commands).max()


def test_operators_controller_stops_and_withdraws_as_it_says(tmp_path):
    """The alarm comes at 1.5 s; no command comes from 1.0 to 1.3 s. The documentation says the three times."""
    policy, time = made_up_policy(environment=TELEOP), 0.016 * np.arange(150)
    last = policy.network.mean  # always a gain of 1, a stop at 10.5 m/s^2 and the full withdrawal
    last.weight[:], last.bias[:] = 0.0, [2.0, 0.0, 2.0]
    exported = Exported(policy)
    hold, fade, timeout = map(float, re.findall(r"([\d.]+) s\b", exported.documentation["operator"]))
    most = json.loads(exported.documentation["acceleration_limits"])["high"]
    fields = dict.fromkeys(exported.spec.sensors, np.zeros(150)) | {"time": time, "alarm": time >= 1.5}
    fields["time_since_alarm"] = np.maximum(time - 1.5, 0.0)
    fields["command"] = np.where(np.abs(time - 0.5) < 0.02, np.nan, 0.2)
    fields["command_age"] = 0.1 + np.clip(time - 1.0, 0.0, 0.3) * (time < 1.3)
    fields["command_age"][[40, 44, 48]] = -np.inf, np.nan, np.inf
    late = np.where(np.isin(np.arange(150), (20, 22)), np.inf, np.nan)[:, None]
    readings = np.stack(list(fields.values()), axis=-1)[:, None]
    commands = commands_of(careless(exported, tmp_path), readings, [2.0], late)
    silent = np.isnan(fields["command"]) | np.isinf(late[:, 0]) | ((time >= 1.008 + timeout) & (time < 1.3))
    back = 0.3 * np.clip(1.0 - (time - 1.5 - hold) / fade, 0.0, 1.0) * (time >= 1.5)
    assert silent.sum() > 12
    assert commands[:, 0, 0] == pytest.approx(np.where(silent, 0.0, 0.2 - back), abs=1e-9)
    assert commands[:, 0, 1] == pytest.approx(np.where(silent, most, 10.5), abs=1e-6)

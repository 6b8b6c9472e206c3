"""Controllers in C command what they command in Python, with good and with faulty readings, and compile as promised."""

import math
import shutil
import subprocess
from itertools import product

import numpy as np
import pytest
from episode_runs import assert_identical
from made_up_policies import made_up_policy

from agents import load_setup
from agents.baselines.rule import ranges_for
from agents.baselines.tuned import FIXED, RULES
from agents.export.c_header import write_header
from agents.export.contract import Subject, of_name
from agents.export.replay import LANGUAGES, compiled, logged, replay
from agents.policies import SHIPPED
from agents.setups import shipped_baselines
from impact_gym.envs import IDS
from impact_gym.task import Task
from impact_gym.task.action import RESOLUTION

pytestmark = pytest.mark.skipif(not (shutil.which("cc") or shutil.which("gcc")), reason="no C compiler")


@pytest.mark.parametrize("name", [
    *sorted(path.stem for path in SHIPPED.glob("*.npz")), *sorted({*FIXED} - {"random"}), *shipped_baselines(),
])  # fmt: skip
def test_every_shipped_controller_gives_the_same_commands_in_c_and_numpy(tmp_path, name):
    """In 300 episodes; for rules, time weights reach beyond the tuned ones."""
    assert_commands_alike(tmp_path, of_name(name))


def assert_commands_alike(folder, subject):
    """Assert a difference below 1e-6 of the range, or below one step of the grid on which commands lie."""
    log = logged(subject, 300)
    assert log.commands[..., 0].std() > 0.01
    program = compiled(subject, write_header(subject, folder / "it.h"), folder)
    task = subject.task
    grid = RESOLUTION / min(np.ptp(task.velocity_range), np.ptp(task.acceleration_range))
    assert replay(subject, program, log, calls=1000)[0] < 1.001 * max(1e-6, grid)


SENSED = {"range_sensor": {"noise": 0.002, "share": 0.1}, "coupling": {"type": "SpringDamper", "stiffness": 50.0}}
FAR, FAST = {"scenario": {"distance": [0.05, 0.6]}}, {"acceleration_range": [0.5, 30.0], "velocity_range": [-1.0, 2.0]}
ROBUST = {name: load_setup("ranged-robust").environment[name] for name in
          ("alarm", "alarm_threshold", "force_noise", "deflection_sensor", "past_readings", "range_noise",
           "observe_range_noise")}  # fmt: skip
RULES_IN_C = {
    "filter, false alarms": ("FilteredProfile", SENSED | {"alarm": "reading", "force_noise": 1.0}),
    "filter, late and lost": ("FilteredProfile", {"range_sensor": {
        "noise": 0.01, "share": 0.05, "bias": 0.01, "dropout": 0.3, "delay": [0.0, 0.08]}} | FAR),
    "filter, rigid": ("FilteredProfile", {"range_sensor": {"noise": 0.01}, "coupling": {"type": "Rigid"}}),
    "first reading": ("FirstReadingProfile", SENSED | {"alarm": "reading", "force_noise": 0.3}),
    "deceleration, far": ("ConstantDeceleration", FAR), "profile, far": ("BlindProfile", FAR),
    "detector": ("DetectorProfile", ROBUST | {"force_noise": 2.0}),
    "detector with a range": ("DetectorRanged", ROBUST | FAST),
    "brake": ("Ranged", FAST | {"range_noise": 0.02}),
    "speed": ("ConstantSpeed", {"alarm": "reading", "force_noise": 0.5, "control_period": 0.008}),
}  # fmt: skip


@pytest.mark.parametrize(("rule", "environment"), RULES_IN_C.values(), ids=RULES_IN_C)
def test_rule_with_any_parameters_gives_the_same_commands_in_c_and_numpy(tmp_path, rule, environment):
    """With three sets of parameters near the start values, for three time weights."""
    ranges, rng = ranges_for(Task(**environment)), np.random.default_rng(1)
    limits = RULES[rule].limited(ranges)
    low, high, start = np.array([(each.low, each.high, each.start) for each in limits]).T
    table = np.clip(start + 0.1 * rng.normal(size=(3, len(limits))) * (high - low), low, high)
    controller = RULES[rule].of(table, ranges).for_task(Task(**environment))
    controller.weights = (0.5, 1.0, 4.0)
    assert_commands_alike(tmp_path, Subject(controller))


TELEOP, NOISE = IDS["ImpactTeleop-v0"], {"force_noise": [0.02, 5.0], "reaction_delay": [0.0, 0.05]}
CONTROLLERS = {
    "plain": {},
    "all sensors": {"range_noise": 0.01, "deflection_sensor": True, "force_noise": 0.5},
    "past readings": NOISE | {"alarm": "reading", "deflection_sensor": True, "past_readings": 3,
                              "range_noise": [0.002, 0.03], "observe_range_noise": True},
    "past forces": {"past_readings": 2},
    "its own arm": {"velocity_range": [-0.2, 0.6], "acceleration_range": [0.5, 4.0], "tool_mass": [0.3, 0.5],
                    "reaction_delay": [0.0, 0.05], "time_weight": [0.05, 50.0]},  # beyond the observed range
    "an operator": TELEOP,
    "an operator whose commands get lost": TELEOP | {
        "uplink": {"delay": 0.096, "loss": 0.4, "burst": 8.0, "timeout": 0.096}, "alarm": "reading"},
}  # fmt: skip


@pytest.mark.parametrize("environment", CONTROLLERS.values(), ids=list(CONTROLLERS))
def test_controller_compiles_without_a_warning_and_gives_the_policys_commands(tmp_path, environment):
    policy = made_up_policy(environment=environment)
    file = write_header(policy, tmp_path / "it.h")
    includes = {line for line in file.read_text().splitlines() if line.startswith("#include")}
    assert includes == {"#include <math.h>", "#include <string.h>"}
    log, commands = logged(Subject(policy), 300), []
    assert log.commands.std() > 0.0
    for language, level in product(LANGUAGES if shutil.which("g++") else ["C99"], ("-O0", "-O2", "-O3")):
        program = compiled(Subject(policy), file, tmp_path, level, language=language)
        difference, seconds = replay(Subject(policy), program, log, calls=1000)
        assert difference < 1e-5  # a command lies on a grid, and may be the next point of the grid
        assert np.quantile(seconds, 0.999) > 0.0
        commands.append(replayed(program, log.sensors, log.steps, log.time_weight, log.late))
    assert_identical(commands, commands[:1] * len(commands))


def replayed(program, sensors, steps, weights, late=None):
    """Return the commands (steps, rows, 2) of a compiled controller for readings (steps, rows, fields)."""
    commands = np.zeros((*sensors.shape[:2], 2))
    late = np.full(sensors.shape[:2], np.nan) if late is None else late
    arrays = np.ascontiguousarray(sensors), np.asarray(steps, np.int32), np.asarray(weights, float), late, commands
    program.play(len(weights), *(array.ctypes for array in arrays))
    return commands


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


NOT_TOLD = [f"-U__{name}__" for name in ("FAST_MATH", "FINITE_MATH_ONLY", "ASSOCIATIVE_MATH")]
"""Flags that make a compiler one that does not define these macros."""
HOW = [["-O2"], ["-Ofast", *NOT_TOLD], ["-ffinite-math-only", *NOT_TOLD]]


@pytest.mark.parametrize("flag", ["-Ofast", "-ffinite-math-only", "-funsafe-math-optimizations"])
def test_header_does_not_compile_with_flags_that_remove_tests_for_nan(tmp_path, flag, capfd):
    policy = made_up_policy(sizes=())
    with pytest.raises(subprocess.CalledProcessError):
        compiled(Subject(policy), write_header(policy, tmp_path / "it.h"), tmp_path, flag)
    assert "it.h tests for NaN: compile it without -Ofast" in capfd.readouterr().err


@pytest.mark.parametrize("how", HOW, ids=" ".join)
@pytest.mark.parametrize("environment", [{}, {"alarm": "reading"}, {"past_readings": 2}], ids=str)
def test_controller_treats_faulty_readings_as_the_header_says(tmp_path, environment, how):
    policy, weight = made_up_policy(environment={"range_noise": 0.01, **environment}), 2.0
    program = compiled(Subject(policy), write_header(policy, tmp_path / "it.h"), tmp_path, *how)
    for seed in range(8):
        readings = faulty_readings(seed)
        commands = replayed(program, readings[:, None], [60], [weight])
        history, expected = [], [np.array([0.0, 20.0])]  # before the first reading: stay at rest
        for reading in (dict(zip(FIELDS, values, strict=True)) for values in readings):
            if not np.isfinite(reading["time"]) or (history and reading["time"] <= history[-1]["time"]):
                expected.append(expected[-1])
                continue
            history.append(reading)
            seen = observed_by_hand(history, "alarm" in environment)
            seen |= {f"force_{k}": observed_by_hand(history[:-k], False)["force"] for k in (1, 2)}
            seen["time_weight"] = weight
            row = np.array([policy.spec.encode(name, seen[name]) for name in policy.spec.ids], np.float32)
            low, high = np.array([[-0.5, 1.0], [1.5, 20.0]])
            expected.append(low + 0.5 * (policy.predict(row)[0].astype(float) + 1.0) * (high - low))
        assert len(history) > 30
        assert commands[:, 0] == pytest.approx(np.array(expected[1:]), rel=0, abs=2e-5)
        assert commands[:, 0].std(axis=0).min() > 0.05
        weights = np.array([policy.spec.scale("time_weight").low, 0.0, -1.0, np.nan, np.inf, -np.inf])
        lightest = replayed(program, np.repeat(readings[:, None], len(weights), axis=1), [60] * len(weights), weights)
        assert np.ptp(lightest, axis=1).max() == 0.0 < abs(lightest[:, :1] - commands).max()


@pytest.mark.parametrize("how", HOW, ids=" ".join)
def test_controller_in_c_stops_without_commands_and_withdraws_only_after_an_alarm(tmp_path, how):
    """The biases of the last layer command a gain of 1 and the full withdrawal; the alarm comes at 1.5 s."""
    policy = made_up_policy(environment=IDS["ImpactTeleop-v0"])
    policy.network.mean.weight[:], policy.network.mean.bias[:] = 0.0, [2.0, 0.0, 2.0]
    program = compiled(Subject(policy), write_header(policy, tmp_path / "it.h"), tmp_path, *how)
    time = 0.016 * np.arange(150)
    fields = dict.fromkeys(policy.spec.sensors, np.zeros(150)) | {"time": time, "alarm": time >= 1.5}
    fields["time_since_alarm"] = np.maximum(time - 1.5, 0.0)
    fields["command"] = np.where(np.abs(time - 0.5) < 0.02, math.nan, 0.2)
    fields["command_age"] = 0.1 + np.clip(time - 1.0, 0.0, 0.3) * (time < 1.3)  # no command comes from 1.0 to 1.3 s
    fields["command_age"][[40, 44, 48]] = -math.inf, math.nan, math.inf
    late = np.where(np.isin(np.arange(150), (20, 22)), math.inf, math.nan)[:, None]
    commands = replayed(program, np.stack(list(fields.values()), axis=-1)[:, None], [150], [2.0], late)
    silent = np.isnan(fields["command"]) | np.isinf(late[:, 0]) | ((time >= 1.0 + 0.1 + 0.008) & (time < 1.3))
    back = 0.3 * np.clip(1.0 - (time - 1.5 - 0.15) / 0.1, 0.0, 1.0) * (time >= 1.5)
    assert silent.sum() > 12
    assert commands[:, 0, 0] == pytest.approx(np.where(silent, 0.0, 0.2 - back), abs=1e-9)
    assert commands[:, 0, 1] == pytest.approx(np.where(silent, 20.0, 10.5), abs=1e-6)


def test_header_has_no_controller_for_a_policy_that_observes_the_true_scenario(tmp_path):
    policy = made_up_policy(environment={"privileged": True})
    file = write_header(policy, tmp_path / "it.h")
    assert "_step" not in file.read_text().partition("*/")[2]
    assert not hasattr(compiled(Subject(policy), file, tmp_path), "play")

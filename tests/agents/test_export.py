"""Exported policies compute what the policy computes."""

import hashlib
import importlib.util
import json
import math
import re
import shutil
import subprocess
import sys
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from episodes import assert_identical
from policies import KINDS, made_up_policy, observations

from agents import load_policy, load_setup
from agents.baselines.tuned import FIXED, RULES, read_tuned
from agents.export import __main__ as exporting
from agents.export.__main__ import AGREEMENT, Export, judged, judged_replay, network_in_onnx, rounding
from agents.export.c_header import header, identifier, write_header
from agents.export.contract import Subject, of_name
from agents.export.onnx_graph import write_onnx
from agents.export.replay import LANGUAGES, WARNINGS, Replay, compiled, logged, network_in_c, replay
from agents.policies import SHIPPED
from agents.setups import shipped_baselines
from impact_gym.envs import IDS
from impact_gym.envs.batch import Batch
from impact_gym.task import ActionSpec, Task
from impact_gym.task.action import RESOLUTION

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "deploy-c.md"
COMPILER = shutil.which("cc") or shutil.which("gcc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")
WITH_ONNX = all(map(importlib.util.find_spec, ("onnx", "onnxruntime")))
needs_onnx = pytest.mark.skipif(not WITH_ONNX, reason="onnx or onnxruntime is missing")


@pytest.fixture
def saved(tmp_path):
    """The file of a made-up policy."""
    return str(made_up_policy().save(tmp_path / "my policy-2.npz"))


@needs_onnx
def test_run_writes_both_forms_and_says_how_they_agree_and_what_cannot_be_checked(saved, tmp_path, monkeypatch, capsys):
    options = Export(saved, tmp_path / "out", episodes=300, calls=1000)
    assert [file.name for file in exporting.run(options)] == ["my policy-2.h", "my policy-2.onnx"]
    printed = capsys.readouterr().out
    assert (printed.count("16,000 us"), printed.count("differs from the policy by at most")) == (1, 2)
    monkeypatch.setenv("PATH", str(tmp_path))
    exporting.run(options)
    printed = capsys.readouterr().out
    assert "my policy-2.h: its network is not checked, no C compiler is here" in printed
    assert "my policy-2.h: its controller is not checked: no C compiler" in printed


@needs_onnx
@pytest.mark.parametrize("kind", KINDS)
def test_forms_compute_what_the_network_does_in_double_precision(tmp_path, kind):
    """Every part is exercised: actions at their limits would compare limits."""
    policy = made_up_policy(**KINDS[kind])
    seen = observations(policy)
    original = policy.predict(seen)[0]
    assert (np.abs(original) < 1.0).any(axis=0).all()
    own = rounding(policy, seen, original)
    assert own < AGREEMENT
    program = compiled(Subject(policy), write_header(policy, tmp_path / "it.h"), tmp_path)
    onnx = write_onnx(Subject(policy), tmp_path / "it.onnx")
    for actions in (network_in_c(program, seen, policy.actions), network_in_onnx(onnx, seen)):
        assert np.abs(actions - original).max() <= AGREEMENT + own
        assert rounding(policy, seen, actions) < 1.5 * AGREEMENT


def test_judged_refuses_a_form_that_computes_something_else(tmp_path):
    """In one action of 10,000, by little more than rounding."""
    actions, computed = np.zeros((2, 10_000, 2), np.float32)
    assert "by at most 0.0e+00" in judged(tmp_path, computed, "", actions, 1e-6)
    computed[-1, 1] += 2e-6
    with pytest.raises(ValueError, match="differs from the policy by 2"):
        judged(tmp_path, computed, "", actions, 1e-6)
    with pytest.raises(ValueError, match=r"commands differ by 2.0e-05 of the range"):
        judged_replay(tmp_path, Replay(3, 9, 2e-5, 1e-6, 1e-6), 0.016)


def test_headers_of_two_policies_can_stand_in_one_program_twice(tmp_path):
    calls = ""
    for name, policy in (("first", made_up_policy()), ("other", made_up_policy(seed=1, activation="relu"))):
        (tmp_path / f"{name}.h").write_text(header(policy, name))
        calls += f"void play_{name}(void);\nvoid play_{name}(void) {{ {name}_state s; {name}_reset(&s, 1.0); }}\n"
    source = '#include "first.h"\n#include "other.h"\n#include "first.h"\n' + calls
    flags = [*LANGUAGES["C99"], *WARNINGS, "-fsyntax-only", "-I", str(tmp_path), "-"]
    subprocess.run([COMPILER, *flags], input=source, text=True, check=True)


def entries(text):
    """The contract in the comment of a header: JSON by name; later lines of an entry begin with spaces."""
    lines = text.partition("\n\n")[2].partition("\n\n")[0].replace("\n    ", " ").splitlines()
    return dict(line.split(": ", 1) for line in lines)


@needs_onnx
@pytest.mark.parametrize("environment", [{"range_noise": 0.01, "past_readings": 2}, IDS["ImpactTeleop-v0"]], ids=str)
def test_header_and_onnx_have_the_same_contract_which_is_the_task(tmp_path, environment):
    import onnx

    policy = made_up_policy(environment=environment)
    policy.provenance["command"] = "train */ /* ??/ evil"
    subject = Subject(policy)
    text = header(subject, "it")
    assert text.partition("#ifndef")[0].count("*/") == 1
    model = onnx.load(write_onnx(subject, tmp_path / "it.onnx"))
    assert entries(text) == {item.key: item.value for item in model.metadata_props} == subject.contract
    said, task = {name: json.loads(value) for name, value in subject.contract.items()}, Task(**environment)
    assert Task(**said["environment"]) == task
    assert (said["control_period"], said["made_by"]) == ({"value": 0.016, "unit": "s"}, policy.provenance["command"])
    assert said["objects"]["object_mass"] == {"low": 0.1, "high": 2.5, "unit": "kg"}
    assert said["acceleration_limits"] == {"low": 1.0, "high": 20.0, "unit": "m/s^2"}
    assert ("operator" in said) == bool(task.operator)
    inputs = [said[f"input {place:02}"] for place in range(policy.inputs)]
    outputs = [said[f"output {place:02}"] for place in range(policy.actions)]
    assert [row["id"] for row in inputs] == [*policy.spec.ids]
    assert [(row["id"], row["unit"]) for row in outputs] == [(row.id, row.unit) for row in ActionSpec(task).entries]
    for row in inputs:
        ends = policy.spec.encode(row["id"], [row["low"], row["high"]])
        assert ends == pytest.approx([row["scaled_low"], 1.0])


def test_checksum_is_another_where_a_weight_or_the_task_is():
    policy, other = made_up_policy(), made_up_policy()
    other.network.mean.weight[0, 0] += 1e-6
    longer = made_up_policy(environment={"reaction_delay": 0.017})
    assert len({Subject(each).contract["checksum"] for each in (policy, other, longer)}) == 3
    assert Subject(policy).contract == Subject(made_up_policy()).contract


def test_names_in_c_are_those_of_files():
    names = [identifier(name) for name in ("linear-blind", "2 fast", "grün")]
    assert names == ["linear_blind", "policy_2_fast", "gr_n"]


@needs_onnx
@pytest.mark.parametrize("name", ["linear-ranged", "linear-robust", "teleop-spring"])
def test_loader_of_the_page_runs_onnx_from_its_metadata_alone(tmp_path, name):
    """Commands of 50 episodes, from readings in SI units."""
    (code,) = re.findall(r'```python title="loader.py"\n(.*?)```', PAGE.read_text(), re.DOTALL)
    exec(code, loader := {})
    subject, policy = of_name(name), load_policy(name)
    command = loader["load"](write_onnx(subject, tmp_path / "it.onnx"))
    batch = Batch(50, subject.task)
    batch.begin_seeded(0, {})
    for _ in range(30):
        actions = policy.predict(batch.observations)[0]
        expected = ActionSpec(subject.task).decode(actions)
        now = batch.episodes.view(np.float64).reshape(50, -1)
        for row in range(0, 50, 7):
            seen = {entry.id: now[row, entry.place] for entry in subject.spec.entries}
            span = [action.high - action.low for action in subject.actions]
            assert np.abs((np.array([*command(seen).values()]) - expected[row]) / span).max() < 2e-6
        batch.step(actions, batch.ended)
    empty = onnx_without_metadata(tmp_path / "it.onnx")
    with pytest.raises(ValueError, match="has no contract"):
        loader["load"](empty)


def onnx_without_metadata(path):
    import onnx

    model = onnx.load(path)
    del model.metadata_props[:]
    onnx.save(model, path)
    return path


CONTROLLERS_SHIPPED = [
    *sorted(path.stem for path in SHIPPED.glob("*.npz")), *sorted({*FIXED} - {"random"}), *shipped_baselines(),
]  # fmt: skip


@pytest.mark.parametrize("name", CONTROLLERS_SHIPPED)
def test_every_shipped_controller_commands_in_c_what_it_does_in_numpy(tmp_path, name):
    """300 episodes; rules at time weights from below to above those they were tuned for."""
    assert_commands_alike(tmp_path, of_name(name))


def assert_commands_alike(folder, subject):
    """Within 1e-6 of the range, or a step of the grid that commands lie on."""
    log = logged(subject, 300)
    assert log.commands[..., 0].std() > 0.01
    program = compiled(subject, write_header(subject, folder / "it.h"), folder)
    task = subject.task
    grid = RESOLUTION / min(np.ptp(task.velocity_range), np.ptp(task.acceleration_range))
    assert replay(subject, program, log, calls=1000).difference < 1.001 * max(1e-6, grid)


SENSED = {"range_sensor": {"noise": 0.002, "share": 0.1}, "coupling": {"type": "SpringDamper", "stiffness": 50.0}}
FAR = {"scenario": {"distance": [0.05, 0.6]}}
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
    "detector": ("DetectorProfile", ROBUST | {"force_noise": 2.0}), "detector with a range": ("DetectorRanged", ROBUST),
    "brake": ("Ranged", {"range_noise": 0.02, "acceleration_range": [0.5, 30.0], "velocity_range": [-1.0, 2.0]}),
    "speed": ("ConstantSpeed", {"alarm": "reading", "force_noise": 0.5, "control_period": 0.008}),
}  # fmt: skip


@pytest.mark.parametrize(("rule", "environment"), RULES_IN_C.values(), ids=RULES_IN_C)
def test_rule_commands_in_c_what_it_does_in_numpy_whatever_its_parameters(tmp_path, rule, environment):
    """Three sets near the start of tuning, for three time weights."""
    limits, rng = RULES[rule].PARAMETERS, np.random.default_rng(1)
    low, high, start = np.array([(each.low, each.high, each.start) for each in limits]).T
    table = np.clip(start + 0.1 * rng.normal(size=(3, len(limits))) * (high - low), low, high)
    subject = Subject(RULES[rule].of(table).for_task(Task(**environment)), (0.5, 1.0, 4.0))
    assert_commands_alike(tmp_path, subject)


def test_all_controllers_of_a_set_up_are_exported_to_one_folder(tmp_path, capsys):
    setup = load_setup("linear-blind")
    shutil.copytree(setup.folder / "tuned", tmp_path / "tuned")
    (tmp_path / "tuned" / "constant-speed.json").unlink()
    run = Export("linear-blind", tmp_path / "out", all=True, folder=tmp_path, episodes=10, calls=100)
    written = {path.name for path in exporting.run(run)}
    assert written == {
        f"{name}.h" for name in ("paper-trapezoid", "local-brake", "blind-profile", "constant-deceleration")
    }
    printed = capsys.readouterr().out
    for left_out in ("constant-speed is left out: baseline 'constant-speed' was not tuned", "linear-blind is left out"):
        assert left_out in printed
    run = Export("paper-trapezoid", tmp_path / "rule", setup="paper-limits", episodes=10, calls=100)
    assert '"low": 1.0, "high": 8.0, "unit": "m/s^2"' in exporting.run(run)[0].read_text()


@pytest.mark.parametrize(("change", "says"), [
    (lambda content: content | {"format": "impact_gym tuned baseline 0"}, "was tuned for another format"),
    (lambda content: content["weights"]["2"]["parameters"].update({"top speed": 9.0}) or content,
     r"top speed must be .* at most 1.5 m/s, got 9"),
    (lambda content: content | {"weights": {}}, "'ranged' holds no weight"),
], ids=["version", "limits", "weights"])  # fmt: skip
def test_tuned_file_of_another_version_or_beyond_its_limits_is_not_exported(tmp_path, change, says):
    content = change({name: value for name, value in read_tuned("ranged").items() if name != "sha256"})
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    (tmp_path / "ranged.json").write_text(json.dumps(content | {"sha256": digest}))
    with pytest.raises(ValueError, match=says):
        of_name(str(tmp_path / "ranged.json"))


def test_run_names_a_missing_package(saved, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ValueError, match="ONNX needs the package onnx: pip install"):
        exporting.run(Export(saved, tmp_path / "out", episodes=30, calls=1000))


TELEOP, NOISE = IDS["ImpactTeleop-v0"], {"force_noise": [0.02, 5.0], "reaction_delay": [0.0, 0.05]}
CONTROLLERS = {
    "plain": {},
    "all sensors": {"range_noise": 0.01, "deflection_sensor": True, "force_noise": 0.5},
    "past readings": NOISE | {"alarm": "reading", "deflection_sensor": True, "past_readings": 3,
                              "range_noise": [0.002, 0.03], "observe_range_noise": True},
    "past forces": {"past_readings": 2},
    "its own arm": {"velocity_range": [-0.2, 0.6], "acceleration_range": [0.5, 4.0], "tool_mass": [0.3, 0.5],
                    "reaction_delay": [0.0, 0.05], "time_weight": [0.05, 50.0]},  # beyond what is observed
    "an operator": TELEOP,
    "an operator whose commands get lost": TELEOP | {
        "uplink": {"delay": 0.096, "loss": 0.4, "burst": 8.0, "timeout": 0.096}, "alarm": "reading"},
}  # fmt: skip


@pytest.mark.parametrize("environment", CONTROLLERS.values(), ids=list(CONTROLLERS))
def test_controller_compiles_without_a_warning_and_commands_what_the_policy_commands(tmp_path, environment):
    policy = made_up_policy(environment=environment)
    file = write_header(policy, tmp_path / "it.h")
    includes = {line for line in file.read_text().splitlines() if line.startswith("#include")}
    assert includes == {"#include <math.h>", "#include <string.h>"}
    log, commands = logged(Subject(policy), 300), []
    assert log.commands.std() > 0.0
    for language, level in product(LANGUAGES if shutil.which("g++") else ["C99"], ("-O0", "-O2", "-O3")):
        program = compiled(Subject(policy), file, tmp_path, level, language=language)
        played = replay(Subject(policy), program, log, calls=1000)
        assert played.difference < 1e-5  # a command is on a grid, and may fall on the next point of it
        assert 0.0 < played.usual <= played.worst
        commands.append(replayed(program, log.sensors, log.steps, log.time_weight, log.late))
    assert_identical(commands, commands[:1] * len(commands))


def replayed(program, sensors, steps, weights, late=None):
    """Commands (steps, rows, 2) of a compiled controller for readings (steps, rows, fields)."""
    commands = np.zeros((*sensors.shape[:2], 2))
    late = np.full(sensors.shape[:2], np.nan) if late is None else late
    arrays = np.ascontiguousarray(sensors), np.asarray(steps, np.int32), np.asarray(weights, float), late, commands
    program.play(len(weights), *(array.ctypes for array in arrays))
    return commands


FIELDS = ["time", "position", "velocity", "alarm", "time_since_alarm", "force", "force_peak", "distance_estimate"]


def faulty_readings(seed, steps=60):
    """Readings (steps, fields) of a bad line: late, repeated, without a time, incomplete, with alarms at random."""
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


def observed_by_hand(history, field, by_reading):
    """What a controller observes of a field, from all readings that it has taken, the last one in the end.

    A missing number is the last that there was. An alarm stays, unless it follows the readings, and its clock goes on.
    """
    values = [reading[field] for reading in history if np.isfinite(reading[field])]
    last = values[-1] if values else 0.0
    if field == "force":
        return max(last, 0.0)
    if field == "force_peak":
        return max([0.0, *values, *(reading["force"] for reading in history if np.isfinite(reading["force"]))])
    if field == "alarm":
        return float(last > 0.5 if by_reading else max(values, default=0.0) > 0.5)
    if field != "time_since_alarm":
        return last
    if not history or not observed_by_hand(history, "alarm", by_reading):
        return 0.0
    *before, now = history
    on_before = observed_by_hand(before, "alarm", by_reading)
    if np.isfinite(now[field]) and (by_reading or not on_before):
        return now[field]
    return observed_by_hand(before, field, by_reading) + now["time"] - before[-1]["time"] if on_before else 0.0


NOT_TOLD = ["-U__FAST_MATH__", "-U__FINITE_MATH_ONLY__", "-U__ASSOCIATIVE_MATH__"]  # as by a compiler that has none
HOW = [["-O2"], ["-Ofast", *NOT_TOLD], ["-ffinite-math-only", *NOT_TOLD]]


@pytest.mark.parametrize("flag", ["-Ofast", "-ffast-math", "-ffinite-math-only", "-funsafe-math-optimizations"])
def test_header_does_not_compile_where_a_test_for_nan_may_be_removed(tmp_path, flag, capfd):
    policy = made_up_policy(sizes=())
    with pytest.raises(subprocess.CalledProcessError):
        compiled(Subject(policy), write_header(policy, tmp_path / "it.h"), tmp_path, flag)
    assert "it.h tests for NaN: compile it without -Ofast" in capfd.readouterr().err


@pytest.mark.parametrize("how", HOW, ids=" ".join)
@pytest.mark.parametrize("environment", [{}, {"alarm": "reading"}, {"past_readings": 2}], ids=str)
def test_controller_takes_faulty_readings_as_the_header_says(tmp_path, environment, how):
    policy, weight = made_up_policy(environment={"range_noise": 0.01, **environment}), 2.0
    program = compiled(Subject(policy), write_header(policy, tmp_path / "it.h"), tmp_path, *how)
    for seed in range(8):
        readings = faulty_readings(seed)
        commands = replayed(program, readings[:, None], [60], [weight])
        history, expected = [], [np.array([0.0, 20.0])]  # at first to stay at rest
        for reading in (dict(zip(FIELDS, values, strict=True)) for values in readings):
            if not np.isfinite(reading["time"]) or (history and reading["time"] <= history[-1]["time"]):
                expected.append(expected[-1])
                continue
            history.append(reading)
            seen = {name: observed_by_hand(history, name, "alarm" in environment) for name in FIELDS}
            seen |= {f"force_{k}": observed_by_hand(history[:-k], "force", False) for k in (1, 2)}
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
def test_controller_in_c_stops_where_the_operator_is_silent_and_withdraws_after_an_alarm_alone(tmp_path, how):
    """A gain of 1 and all of the withdrawal, by the biases of the last layer; the alarm comes at 1.5 s."""
    policy = made_up_policy(environment=IDS["ImpactTeleop-v0"])
    policy.network.mean.weight[:], policy.network.mean.bias[:] = 0.0, [2.0, 0.0, 2.0]
    program = compiled(Subject(policy), write_header(policy, tmp_path / "it.h"), tmp_path, *how)
    time = 0.016 * np.arange(150)
    fields = dict.fromkeys(policy.spec.sensors, np.zeros(150)) | {"time": time, "alarm": time >= 1.5}
    fields["time_since_alarm"] = np.maximum(time - 1.5, 0.0)
    fields["command"] = np.where(np.abs(time - 0.5) < 0.02, math.nan, 0.2)
    fields["command_age"] = 0.1 + np.clip(time - 1.0, 0.0, 0.3) * (time < 1.3)  # none comes from 1.0 to 1.3 s
    fields["command_age"][[40, 44, 48]] = -math.inf, math.nan, math.inf
    late = np.where(np.isin(np.arange(150), (20, 22)), math.inf, math.nan)[:, None]
    commands = replayed(program, np.stack(list(fields.values()), axis=-1)[:, None], [150], [2.0], late)
    silent = np.isnan(fields["command"]) | np.isinf(late[:, 0]) | ((time >= 1.0 + 0.1 + 0.008) & (time < 1.3))
    back = 0.3 * np.clip(1.0 - (time - 1.5 - 0.15) / 0.1, 0.0, 1.0) * (time >= 1.5)
    assert silent.sum() > 12
    assert commands[:, 0, 0] == pytest.approx(np.where(silent, 0.0, 0.2 - back), abs=1e-9)
    assert commands[:, 0, 1] == pytest.approx(np.where(silent, 20.0, 10.5), abs=1e-6)


def test_header_has_no_controller_for_a_policy_that_sees_the_truth(tmp_path):
    policy = made_up_policy(environment={"privileged": True})
    file = write_header(policy, tmp_path / "it.h")
    assert "_step" not in file.read_text().partition("*/")[2]
    assert not hasattr(compiled(Subject(policy), file, tmp_path), "play")

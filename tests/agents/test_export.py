"""Exported policies compute what the policy computes."""

import ctypes
import importlib.util
import shutil
import subprocess
import sys
from itertools import product

import numpy as np
import pytest
from policies import KINDS, made_up_policy, observations

from agents.export import __main__ as exporting
from agents.export.__main__ import AGREEMENT, Export, Form
from agents.export.c_header import header, identifier, write_header
from agents.export.onnx_graph import write_onnx
from agents.export.replay import LANGUAGES, WARNINGS, Replay, address, compiled, logged, replay

COMPILER = shutil.which("cc") or shutil.which("gcc")
needs_c = pytest.mark.skipif(COMPILER is None, reason="no C compiler")
needs_onnx = pytest.mark.skipif(
    not all(map(importlib.util.find_spec, ("onnx", "onnxruntime"))), reason="onnx or onnxruntime is missing"
)


@pytest.fixture
def saved(tmp_path):
    """The file of a made-up policy."""
    return str(made_up_policy().save(tmp_path / "my policy-2.npz"))


@needs_c
@needs_onnx
def test_run_writes_both_forms_and_says_how_they_agree_and_what_cannot_be_checked(saved, tmp_path, monkeypatch, capsys):
    written = exporting.run(Export(saved, tmp_path / "out", episodes=300, calls=1000))
    assert [file.name for file in written] == ["my policy-2.h", "my policy-2.onnx"]
    printed = capsys.readouterr().out
    assert printed.count("16 ms") == 3
    assert printed.count("differs by at most") == 2
    monkeypatch.setattr(shutil, "which", lambda _: None)
    exporting.run(Export(saved, tmp_path / "out", episodes=30, calls=1000))
    printed = capsys.readouterr().out
    assert "my policy-2.h: not checked, no C compiler is here" in printed
    assert "my policy-2.h: its controller is not checked: no C compiler" in printed


@needs_c
@needs_onnx
@pytest.mark.parametrize("kind", KINDS)
def test_forms_compute_what_the_network_does_in_double_precision(tmp_path, kind):
    """Every part is exercised: actions at their limits would compare limits."""
    policy = made_up_policy(**KINDS[kind])
    seen = exporting.observations(policy)
    assert len(seen) == 10_000
    original = exporting.with_numpy(policy, seen).actions
    assert (np.abs(original) < 1.0).any(axis=0).all()
    rounding = exporting.rounding(policy, seen, original)
    assert rounding < AGREEMENT
    for form in (
        exporting.with_c(compiled(policy, write_header(policy, tmp_path / "it.h"), tmp_path), seen),
        exporting.with_onnx(write_onnx(policy, tmp_path / "it.onnx"), seen),
    ):
        assert np.abs(form.actions - original).max() <= AGREEMENT + rounding
        assert exporting.rounding(policy, seen, form.actions) < 1.5 * AGREEMENT


def test_judged_refuses_a_form_that_computes_something_else(tmp_path):
    """In one action of 10,000, by little more than rounding."""
    original = Form(np.zeros((10_000, 2), np.float32), 1e-6)
    other = Form(original.actions.copy(), 1e-6)
    assert "differs by at most 0.0e+00" in exporting.judged(tmp_path, other, "", original, 1e-6, 0.016)
    other.actions[-1, 1] += 2e-6
    with pytest.raises(ValueError, match="differs from the policy by 2"):
        exporting.judged(tmp_path, other, "", original, 1e-6, 0.016)
    with pytest.raises(ValueError, match=r"commands otherwise, by 2.0e-05 of the range"):
        exporting.judged_replay(tmp_path, Replay(3, 9, 2e-5, 1e-6, 1e-6), 0.016)


@needs_c
def test_header_can_stand_twice_in_a_program(tmp_path):
    """Two policies in one file, the headers included twice, compiled with all warnings as errors."""
    policies = {"one": made_up_policy(), "other": made_up_policy(seed=1, activation="relu")}
    for name, policy in policies.items():
        (tmp_path / f"{name}.h").write_text(header(policy, name))
    source, library = '#include "one.h"\n#include "other.h"\n#include "one.h"\n', str(tmp_path / "both.so")
    for name in policies:
        declared = f"void play_{name}(const float *seen, float *action)"
        source += f"{declared};\n{declared} {{ {name}_act(seen, action); }}\n"
    flags = [*LANGUAGES["C99"], *WARNINGS, "-O1", "-shared", "-fPIC", "-", "-I", str(tmp_path), "-o", library, "-lm"]
    subprocess.run([COMPILER, *flags], input=source, text=True, check=True)
    program, seen = ctypes.CDLL(library), observations(policies["one"], 1)[0]
    for name, policy in policies.items():
        action = np.zeros(2, np.float32)
        getattr(program, f"play_{name}")(address(seen), address(action))
        assert action == pytest.approx(policy.predict(seen)[0], rel=0, abs=1e-6)
        assert "malloc" not in header(policy, name)


def test_header_says_what_goes_in_and_out():
    policy = made_up_policy(environment={"range_noise": 0.01})
    policy.provenance["command"] = "python */ evil"
    text = header(policy, "it")
    assert "[1] flange velocity, m/s: -0.5 ... 1.5 to -1 ... 1" in text
    assert "[8] distance estimate minus flange position" in text
    assert "acceleration to use for it: 1 ... 20 m/s^2" in text
    assert text.partition("#ifndef")[0].count("*/") == 1


@pytest.mark.parametrize(("name", "expected"), [
    ("linear-blind", "linear_blind"), ("2 fast", "policy_2_fast"), ("grün", "gr_n"),
])  # fmt: skip
def test_identifier_is_a_name_in_c(name, expected):
    assert identifier(name) == expected


def test_run_names_a_missing_package(saved, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ValueError, match="ONNX needs the package onnx: pip install"):
        exporting.run(Export(saved, tmp_path / "out", episodes=30, calls=1000))


CONTROLLERS = {
    "plain": {},
    "all sensors": {"environment": {"range_noise": 0.01, "deflection_sensor": True, "force_noise": 0.5}},
    "past readings": {"environment": {
        "alarm": "reading", "force_noise": [0.02, 5.0], "deflection_sensor": True, "past_readings": 3,
        "range_noise": [0.002, 0.03], "observe_range_noise": True, "reaction_delay": [0.0, 0.05],
    }},
    "past forces": {"environment": {"past_readings": 2}},
    "its own arm": {"environment": {
        "velocity_range": [-0.2, 0.6], "acceleration_range": [0.5, 4.0], "tool_mass": [0.3, 0.5],
        "time_weight": [0.05, 50.0],  # beyond what is observed
        "reaction_delay": [0.0, 0.05],
    }},
}  # fmt: skip


@needs_c
@pytest.mark.parametrize("kind", CONTROLLERS.values(), ids=list(CONTROLLERS))
def test_controller_compiles_without_a_warning_and_commands_what_the_policy_commands(tmp_path, kind):
    policy, file = made_up_policy(**kind), tmp_path / "it.h"
    text = header(policy, "it")
    file.write_text(text)
    assert {line for line in text.splitlines() if line.startswith("#include")} == {"#include <math.h>"}
    languages = [language for language in LANGUAGES if language != "C++17" or shutil.which("g++")]
    program, *_ = (compiled(policy, file, tmp_path, language) for language in languages)
    log = logged(policy, 300)
    assert log.commands.std() > 0.0
    played = replay(policy, program, log, calls=1000)
    assert played.difference < 1e-5  # a command is on a grid, and may fall on the next point of it
    assert 0.0 < played.usual <= played.worst


@pytest.fixture(scope="module")
def commands_of(tmp_path_factory, request):
    """Commands of a made-up policy for readings (steps, fields), at one time weight."""
    if COMPILER is None:
        pytest.skip("no C compiler")
    policy = made_up_policy(environment={"range_noise": 0.01, **getattr(request, "param", {})})
    folder = tmp_path_factory.mktemp("controller")
    program = compiled(policy, write_header(policy, folder / "it.h"), folder)

    def commands(readings):
        sensors = np.ascontiguousarray(np.array(readings, float)[:, None, :])
        steps, weights = np.array([len(sensors)], np.int32), np.array([2.0])
        played = np.zeros((len(sensors), 1, 2))
        program.play(1, address(sensors), address(steps), address(weights), address(played))
        return played[:, 0]

    return commands


def reading(time, position=0.1, velocity=0.5, alarm=0.0, since=0.0, force=0.0, peak=0.0, estimate=0.2):
    return [time, position, velocity, alarm, since, force, peak, estimate]


def test_controller_ignores_a_late_or_repeated_reading_or_one_without_a_time(commands_of):
    first, second, third = reading(0.0), reading(0.016, 0.15), reading(0.032, 0.2, force=5.0)
    plain = commands_of([first, second, third])
    assert len(np.unique(plain, axis=0)) == 3
    other = reading(0.016, 0.9, force=50.0)
    for wrong in (second, other, reading(0.008, 0.9, force=50.0), reading(np.nan, 0.9), reading(np.inf, 0.9)):
        played = commands_of([first, second, wrong, third])
        assert np.array_equal(played[[0, 1, 3]], plain)
        assert np.array_equal(played[2], plain[1])


def test_controller_rests_before_the_first_reading(commands_of):
    assert commands_of([reading(np.nan)]).tolist() == [[0.0, 20.0]]


def test_controller_keeps_the_last_value_of_a_missing_number(commands_of):
    first, second = reading(0.0, 0.1, 0.5, force=3.0), reading(0.016, 0.15, 0.6, force=4.0, estimate=0.1)
    for place, missing in product((1, 2, 5, 7), (np.nan, np.inf, -np.inf)):
        gap, kept = list(second), list(second)
        gap[place], kept[place] = missing, first[place]
        assert np.array_equal(commands_of([first, gap]), commands_of([first, kept]))
        assert not np.array_equal(commands_of([first, gap]), commands_of([first, second]))


def test_controller_keeps_an_alarm_and_its_clock(commands_of):
    before, heard = reading(0.0, force=2.0), reading(0.016, alarm=1.0, force=2.0)
    plain = commands_of([before, heard, reading(0.046, alarm=1.0, since=0.03, force=2.0)])
    for alarm, since in ((0.0, 0.0), (np.nan, np.nan), (1.0, np.nan), (np.inf, np.nan)):
        again = commands_of([before, heard, reading(0.046, alarm=alarm, since=since, force=2.0)])
        assert again == pytest.approx(plain, abs=1e-5)
    assert not np.array_equal(commands_of([before, reading(0.046, force=2.0)])[1], plain[2])
    unheard = [before, reading(0.016, alarm=np.inf, force=2.0)]
    assert np.array_equal(commands_of(unheard), commands_of([before, reading(0.016, force=2.0)]))


@pytest.mark.parametrize("commands_of", [{"alarm": "reading"}], indirect=True)
def test_controller_clears_an_alarm_by_readings_and_hears_a_new_one(commands_of):
    on, off = reading(0.016, alarm=1.0), reading(0.032)
    assert np.array_equal(commands_of([reading(0.0), on, off])[2], commands_of([reading(0.0), reading(0.016), off])[2])
    later = reading(0.048, alarm=1.0, since=0.032)
    for since in (np.nan, 0.032):  # its clock goes on by the time, unless it says otherwise
        found = commands_of([reading(0.0), on, reading(0.048, alarm=1.0, since=since)])[2]
        assert found == pytest.approx(commands_of([reading(0.0), later])[1], abs=1e-5)
    anew = reading(0.048, alarm=1.0, since=0.0)
    assert commands_of([reading(0.0), on, anew])[2] == pytest.approx(commands_of([reading(0.0), anew])[1], abs=1e-5)
    missing = reading(0.032, alarm=np.nan, since=np.nan)
    kept = commands_of([reading(0.0), on, reading(0.032, alarm=1.0, since=0.016)])
    assert commands_of([reading(0.0), on, missing]) == pytest.approx(kept, abs=1e-5)


@pytest.mark.parametrize("commands_of", [{"past_readings": 2}], indirect=True)
def test_controller_remembers_past_readings_but_no_repeated_one(commands_of):
    def forces(*values):  # the largest comes first, and is the same for all
        return [reading(0.016 * k, force=force) for k, force in enumerate((9.0, *values))]

    seen = forces(8.0, 3.0, 1.0, 1.0, 1.0)
    commands, others = commands_of(seen), commands_of(forces(8.0, 5.0, 1.0, 1.0, 1.0))
    changed = [not np.array_equal(one, other) for one, other in zip(commands, others, strict=True)]
    assert changed == [False, False, True, True, True, False]
    assert np.array_equal(commands_of([*seen[:2], seen[1], *seen[2:]])[[0, 1, 3, 4, 5, 6]], commands)


def test_controller_keeps_the_largest_force(commands_of):
    seen = [reading(0.0), reading(0.016, force=40.0), reading(0.032, force=1.0)]
    assert np.array_equal(commands_of(seen)[2], commands_of([*seen[:2], reading(0.032, force=1.0, peak=40.0)])[2])
    assert not np.array_equal(commands_of(seen)[2], commands_of([*seen[:2], reading(0.032, force=1.0, peak=80.0)])[2])
    assert np.array_equal(commands_of([reading(0.0, force=-5.0)]), commands_of([reading(0.0)]))


@needs_c
def test_header_has_no_controller_for_a_policy_that_sees_the_truth(tmp_path):
    policy = made_up_policy(environment={"privileged": True})
    assert "_step" not in header(policy, "it").partition("*/")[2]
    assert not hasattr(compiled(policy, write_header(policy, tmp_path / "it.h"), tmp_path), "play")

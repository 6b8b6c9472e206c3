"""Exported policies compute what the policy computes."""

import ctypes
import importlib.util
import shutil
import subprocess
import sys

import numpy as np
import pytest
from policies import KINDS, made_up_policy, observations

from agents.export import __main__ as exporting
from agents.export.__main__ import Export, export
from agents.export.c_header import header, identifier
from agents.export.replay import LANGUAGES, Replay, address, compiled, logged, replay

COMPILER = shutil.which("cc") or shutil.which("gcc")
needs_c = pytest.mark.skipif(COMPILER is None, reason="no C compiler")
needs_onnx = pytest.mark.skipif(
    not all(map(importlib.util.find_spec, ("onnx", "onnxruntime"))), reason="onnx or onnxruntime is missing"
)


@pytest.fixture
def saved(tmp_path):
    """The file of a made-up policy."""
    return str(made_up_policy().save(tmp_path / "policy.npz"))


@needs_c
@needs_onnx
@pytest.mark.parametrize("kind", KINDS)
def test_both_forms_agree_with_the_policy(tmp_path, kind, capsys):
    path = made_up_policy(**KINDS[kind]).save(tmp_path / "my policy-2.npz")
    written = export(Export(str(path), tmp_path / "out"))
    assert [file.name for file in written] == ["my policy-2.h", "my policy-2.onnx"]
    said = capsys.readouterr().out
    assert said.count("16 ms") == 3
    assert said.count("differs by at most") == 2


@pytest.mark.parametrize(("form", "other"), [("with_c", "with_onnx"), ("with_onnx", "with_c")])
def test_a_form_that_computes_something_else_is_refused(saved, tmp_path, monkeypatch, form, other):
    """In one action of 10,000, by little more than rounding."""

    def spoiled(policy, _, seen):
        found = exporting.with_numpy(policy, seen)
        found.actions[-1, 1] += 2e-6
        return found

    monkeypatch.setattr(exporting, other, lambda *_: None)
    monkeypatch.setattr(exporting, form, spoiled)
    with pytest.raises(ValueError, match="differs from the policy by 2"):
        export(Export(saved, tmp_path))


def test_every_part_of_every_form_is_exercised():
    """Observations that leave actions at their limits would compare limits."""
    for arguments in KINDS.values():
        policy = made_up_policy(**arguments)
        seen = exporting.observations(policy)
        assert len(seen) == 10_000
        inside = np.abs(exporting.with_numpy(policy, seen).actions) < 1.0
        assert inside.any(axis=0).all()


@needs_c
def test_the_header_is_plain_c99_and_can_stand_twice_in_a_program(tmp_path):
    """Two policies in one file, the headers included twice, compiled with all warnings as errors."""
    one, other = made_up_policy(), made_up_policy(seed=1, activation="relu")
    (tmp_path / "one.h").write_text(header(one, "one"))
    (tmp_path / "other.h").write_text(header(other, "other"))
    source = (
        '#include "one.h"\n#include "other.h"\n#include "one.h"\n'
        "void play(const float *seen, float *first, float *second) {\n"
        "    one_act(seen, first);\n    other_act(seen, second);\n}\n"
    )
    (tmp_path / "main.c").write_text(source)
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-O1"]
    command = [COMPILER, *flags, "-shared", "-fPIC", str(tmp_path / "main.c"), "-o", str(tmp_path / "main.so"), "-lm"]
    subprocess.run(command, check=True)
    seen = observations(one, 1)[0]
    actions = [np.zeros(2, np.float32) for _ in range(2)]
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (seen, *actions)]
    ctypes.CDLL(str(tmp_path / "main.so")).play(*pointers)
    for action, policy in zip(actions, (one, other), strict=True):
        assert action == pytest.approx(policy.predict(seen)[0], rel=0, abs=1e-6)
    assert "malloc" not in header(one, "one")


def test_the_header_says_what_goes_in_and_out():
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
def test_names_are_ones_that_c_knows(name, expected):
    assert identifier(name) == expected


def test_a_missing_package_is_named(saved, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ValueError, match="ONNX needs the package onnx: pip install"):
        export(Export(saved, tmp_path / "out"))


@needs_c
@needs_onnx
def test_what_cannot_be_checked_is_said(saved, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    export(Export(saved, tmp_path / "out"))
    assert "policy.h: not checked, no C compiler is here" in capsys.readouterr().out


CONTROLLERS = {
    "plain": {},
    "all sensors": {"environment": {"range_noise": 0.01, "deflection_sensor": True, "force_noise": 0.5}},
    "past readings": {"environment": {
        "alarm": "reading", "force_noise": [0.02, 5.0], "deflection_sensor": True, "past_readings": 3,
        "range_noise": [0.002, 0.03], "range_told": True, "reaction_delay": [0.0, 0.05],
    }},
    "told what holds the tool": {"environment": {
        "coupling": {"type": "SpringDamper", "stiffness": [10.0, 300.0], "damping_ratio": [0.0, 2.0]},
        "tool_mass": [0.05, 0.2], "deflection_sensor": True, "past_readings": 1, "holder_told": True,
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
def test_the_controller_in_c_compiles_without_a_warning_and_commands_what_the_policy_commands(tmp_path, kind):
    policy, file = made_up_policy(**kind), tmp_path / "it.h"
    text = header(policy, "it")
    file.write_text(text)
    assert {line for line in text.splitlines() if line.startswith("#include")} == {"#include <math.h>"}
    for language in LANGUAGES:
        if language != "C++17" or shutil.which("g++"):
            assert compiled(policy, file, tmp_path, language)
    log = logged(policy, 300)
    assert log.commands.std() > 0.0
    found = replay(policy, file, log, calls=1000)
    assert found.difference < 1e-5  # a command is on a grid, and may fall on the next point of it
    assert 0.0 < found.usual <= found.worst


@pytest.fixture
def told(tmp_path, request):
    """Commands of a made-up policy for readings (steps, fields), at one time weight."""
    if COMPILER is None:
        pytest.skip("no C compiler")
    policy = made_up_policy(environment={"range_noise": 0.01, **getattr(request, "param", {})})
    (tmp_path / "it.h").write_text(header(policy, "it"))
    program = compiled(policy, tmp_path / "it.h", tmp_path)

    def commands(readings):
        sensors = np.ascontiguousarray(np.array(readings, float)[:, None, :])
        steps, weights = np.array([len(sensors)], np.int32), np.array([2.0])
        found = np.zeros((len(sensors), 1, 2))
        program.play(1, address(sensors), address(steps), address(weights), address(found))
        return found[:, 0]

    return commands


def reading(time, position=0.1, velocity=0.5, alarm=0.0, since=0.0, force=0.0, peak=0.0, estimate=0.2):
    return [time, position, velocity, alarm, since, force, peak, estimate]


def test_a_late_or_repeated_reading_or_one_without_a_time_changes_nothing(told):
    first, second, third = reading(0.0), reading(0.016, 0.15), reading(0.032, 0.2, force=5.0)
    plain = told([first, second, third])
    assert len(np.unique(plain, axis=0)) == 3
    other = reading(0.016, 0.9, force=50.0)
    for wrong in (second, other, reading(0.008, 0.9, force=50.0), reading(np.nan, 0.9), reading(np.inf, 0.9)):
        played = told([first, second, wrong, third])
        assert np.array_equal(played[[0, 1, 3]], plain)
        assert np.array_equal(played[2], plain[1])


def test_before_the_first_reading_the_arm_is_to_rest(told):
    assert told([reading(np.nan)]).tolist() == [[0.0, 20.0]]


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", [1, 2, 5, 7])
def test_a_number_that_is_missing_keeps_its_last_value(told, place, missing):
    first, second = reading(0.0, 0.1, 0.5, force=3.0), reading(0.016, 0.15, 0.6, force=4.0, estimate=0.1)
    gap, kept = list(second), list(second)
    gap[place], kept[place] = missing, first[place]
    assert np.array_equal(told([first, gap]), told([first, kept]))
    assert not np.array_equal(told([first, gap]), told([first, second]))


def test_an_alarm_once_heard_stays_and_its_clock_goes_on(told):
    before, heard = reading(0.0, force=2.0), reading(0.016, alarm=1.0, force=2.0)
    plain = told([before, heard, reading(0.046, alarm=1.0, since=0.03, force=2.0)])
    for alarm, since in ((0.0, 0.0), (np.nan, np.nan), (1.0, np.nan), (np.inf, np.nan)):
        again = told([before, heard, reading(0.046, alarm=alarm, since=since, force=2.0)])
        assert again == pytest.approx(plain, abs=1e-5)
    assert not np.array_equal(told([before, reading(0.046, force=2.0)])[1], plain[2])
    unheard = [before, reading(0.016, alarm=np.inf, force=2.0)]
    assert np.array_equal(told(unheard), told([before, reading(0.016, force=2.0)]))


@pytest.mark.parametrize("told", [{"alarm": "reading"}], indirect=True)
def test_an_alarm_by_readings_goes_off_again_and_comes_anew(told):
    on, off = reading(0.016, alarm=1.0), reading(0.032)
    assert np.array_equal(told([reading(0.0), on, off])[2], told([reading(0.0), reading(0.016), off])[2])
    later = reading(0.048, alarm=1.0, since=0.032)
    for since in (np.nan, 0.032):  # its clock goes on by the time, unless it says otherwise
        found = told([reading(0.0), on, reading(0.048, alarm=1.0, since=since)])[2]
        assert found == pytest.approx(told([reading(0.0), later])[1], abs=1e-5)
    anew = reading(0.048, alarm=1.0, since=0.0)
    assert told([reading(0.0), on, anew])[2] == pytest.approx(told([reading(0.0), anew])[1], abs=1e-5)
    missing = reading(0.032, alarm=np.nan, since=np.nan)
    kept = told([reading(0.0), on, reading(0.032, alarm=1.0, since=0.016)])
    assert told([reading(0.0), on, missing]) == pytest.approx(kept, abs=1e-5)


@pytest.mark.parametrize("told", [{"past_readings": 2}], indirect=True)
def test_past_readings_are_remembered_from_call_to_call_and_not_from_a_repeated_one(told):
    def forces(*values):  # the largest comes first, and is the same for all
        return [reading(0.016 * k, force=force) for k, force in enumerate((9.0, *values))]

    seen = forces(8.0, 3.0, 1.0, 1.0, 1.0)
    commands, others = told(seen), told(forces(8.0, 5.0, 1.0, 1.0, 1.0))
    changed = [not np.array_equal(one, other) for one, other in zip(commands, others, strict=True)]
    assert changed == [False, False, True, True, True, False]
    assert np.array_equal(told([*seen[:2], seen[1], *seen[2:]])[[0, 1, 3, 4, 5, 6]], commands)


def test_the_largest_force_is_kept(told):
    seen = [reading(0.0), reading(0.016, force=40.0), reading(0.032, force=1.0)]
    assert np.array_equal(told(seen)[2], told([*seen[:2], reading(0.032, force=1.0, peak=40.0)])[2])
    assert not np.array_equal(told(seen)[2], told([*seen[:2], reading(0.032, force=1.0, peak=80.0)])[2])
    assert np.array_equal(told([reading(0.0, force=-5.0)]), told([reading(0.0)]))


@needs_c
def test_a_controller_that_commands_otherwise_is_refused(saved, tmp_path, monkeypatch):
    monkeypatch.setattr(exporting, "replay", lambda *_: Replay(2e-5, 1e-6, 1e-6))
    with pytest.raises(ValueError, match=r"commands otherwise, by 2.0e-05 of the range"):
        export(Export(saved, tmp_path))


def test_a_policy_that_sees_the_truth_gets_no_controller(tmp_path):
    policy = made_up_policy(environment={"privileged": True})
    assert "_step" not in header(policy, "it").partition("*/")[2]
    assert replay(policy, tmp_path / "it.h", logged(policy, 3)) is None

"""Exported policies compute what the policy computes."""

import builtins
import ctypes
import importlib.util
import shutil
import subprocess

import numpy as np
import pytest
from policies import KINDS, made_up_policy, observations

from agents import export as exporting
from agents.export import Export, export
from agents.export_c import header, identifier

needs_c = pytest.mark.skipif(shutil.which("cc") is None and shutil.which("gcc") is None, reason="no C compiler")
needs_onnx = pytest.mark.skipif(
    not all(map(importlib.util.find_spec, ("onnx", "onnxruntime"))), reason="onnx or onnxruntime is missing"
)


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


def spoiled(form):
    def play(*arguments):
        found = form(*arguments)
        found.actions[-1, -1, 1] += 2e-6
        return found

    return play


@pytest.mark.parametrize("form", ["with_c", "with_onnx"])
def test_a_form_that_computes_something_else_is_refused(tmp_path, monkeypatch, form):
    """In one action of 10,000, by little more than rounding."""
    path = made_up_policy().save(tmp_path / "policy.npz")
    other = {"with_c": "with_onnx", "with_onnx": "with_c"}[form]
    monkeypatch.setattr(exporting, other, lambda *_: None)
    monkeypatch.setattr(exporting, form, spoiled(lambda policy, _, seen: exporting.with_numpy(policy, seen)))
    with pytest.raises(ValueError, match="differs from the policy by 2"):
        export(Export(str(path), tmp_path))


def test_every_part_of_every_form_is_exercised():
    """Observations that leave actions at their limits would compare limits."""
    for arguments in KINDS.values():
        policy = made_up_policy(**arguments)
        seen = exporting.observations(policy)
        assert seen.shape[0] * seen.shape[1] == 10_000
        inside = np.abs(exporting.with_numpy(policy, seen).actions) < 1.0
        assert inside.any(axis=(0, 1)).all()


@needs_c
def test_the_header_is_plain_c99_and_can_stand_twice_in_a_program(tmp_path):
    """Two policies in one file, the headers included twice, compiled with all warnings as errors."""
    one, other = made_up_policy(), made_up_policy(seed=1, cells=6, squash=True)
    (tmp_path / "one.h").write_text(header(one, "one"))
    (tmp_path / "other.h").write_text(header(other, "other"))
    source = (
        '#include "one.h"\n#include "other.h"\n#include "one.h"\n'
        "void play(const float *seen, float *first, float *second) {\n"
        "    other_state state = {{0}, {0}};\n    one_act(seen, first);\n    other_act(&state, seen, second);\n}\n"
    )
    (tmp_path / "main.c").write_text(source)
    compiler = shutil.which("cc") or shutil.which("gcc")
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-O1"]
    command = [compiler, *flags, "-shared", "-fPIC", str(tmp_path / "main.c"), "-o", str(tmp_path / "main.so"), "-lm"]
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
    assert text.count("*/") == 1


@pytest.mark.parametrize(("name", "expected"), [
    ("linear-blind", "linear_blind"), ("2 fast", "policy_2_fast"), ("grün", "gr_n"),
])  # fmt: skip
def test_names_are_ones_that_c_knows(name, expected):
    assert identifier(name) == expected


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    real = builtins.__import__

    def without(name, *arguments, **options):
        if name == "onnx":
            raise ModuleNotFoundError(name)
        return real(name, *arguments, **options)

    path = made_up_policy().save(tmp_path / "policy.npz")
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ValueError, match="ONNX needs the package onnx: pip install"):
        export(Export(str(path), tmp_path / "out"))


@needs_c
@needs_onnx
def test_what_cannot_be_checked_is_said(tmp_path, monkeypatch, capsys):
    path = made_up_policy().save(tmp_path / "policy.npz")
    monkeypatch.setattr(shutil, "which", lambda _: None)
    export(Export(str(path), tmp_path / "out"))
    assert "policy.h: not checked, no C compiler is here" in capsys.readouterr().out

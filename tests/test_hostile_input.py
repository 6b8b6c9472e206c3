"""Hostile input: a value, text or file works, or is refused in one line that names the place."""

import json
import os
import random
import re
import shutil
import subprocess
import tomllib
import zipfile
from copy import deepcopy
from functools import partial
from html import unescape
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, all_finite, begin
from made_up_policies import made_up_policy
from own_set_up import TEXT
from random_tasks import EVERYTHING_DRAWN
from recorded_hits import FORCE, MOTION, SCENE, SCENE_FILE, TIME
from refusal import refused
from refused_calls import MAKERS, set_up_file

import impact_gym as ig
from agents import load_baseline, load_policy, load_setup
from agents.export.c_header import header, identifier
from agents.export.replay import LANGUAGES, WARNINGS
from agents.policies import Ensemble, Policy
from agents.policies.networks import from_arrays, to_arrays
from agents.policies.policy import FORMAT
from experiments.report.__main__ import ReportOptions, write
from impact_gym.identification import log as logs_of
from impact_gym.identification.__main__ import parse
from impact_gym.support import archive, files, validation
from impact_gym.task import evaluation_sets

PLAIN = [  # values in a file
    True, False, 0, -1, 3, 10**30, -0.0, 1e-320, 1e300, -1.5, 0.5, np.nan, np.inf, -np.inf, "", "0.1", "nan",
    "Rigid", "a\nb", "x" * 5000, "\x00", [], [1.0], [1.0, 2.0], [2.0, 1.0], [[1.0], [1.0, 2.0]], [1, "a"], [True], {},
    {"type": "Rigid"}, {"a": {"b": [1]}}, [np.nan, 1.0], [0.0, 1e300],
]  # fmt: skip
ANY = [  # and values that only a Python call can have
    *PLAIN, None, 1j, 10**400, b"1", {1, 2}, range(3), object, object(), len, (1.0,), np.float32(np.nan),
    *map(np.array, (1.0, [1.0, 2.0], [1j], ["a"], [[1.0]], [None], [])), np.zeros(10**5), np.int64(-5),
]  # fmt: skip
KEYS = ["", "mass", "tool_mas", "__class__", "type", "scenario", "Stiffness", "a.b", "x\ny", "1", "k" * 300]
RESET = {"seed": 3, "options": {
    "scenario": {"object_mass": 0.3, "contact_stiffness": 1e5, "restitution": 0.5, "distance": 0.2},
    "record": {"noise_seed": 7, "reaction_delay": 0.01, "tool_mass": 0.1},
}}  # fmt: skip
ARGUMENTS = EVERYTHING_DRAWN["mechanism"] | {
    "alarm": "reading", "dissipation": "exact", "force_weight": 0.01, "control_period": 0.02, "rtol": 1e-6,
    "velocity_range": [-0.5, 1.0], "past_readings": 2, "privileged": True, "deflection_sensor": True,
}  # fmt: skip
ARGUMENTS = {name: list(value) if isinstance(value, tuple) else value for name, value in ARGUMENTS.items()}
SETUP = tomllib.loads(TEXT)
SETUP["training"] |= {"time_weight": [0.5, 8.0], "nominal": 0.5, "teacher": "mine", "activation": "relu"}
SETUP["training"]["imitation_steps"] = SETUP["training"]["steps"]
SETUP["baselines"] |= {"against": ["mine"], "tuned": {"mine": {"rule": "Ranged"}}, "bound": "linear-blind"}
SETUP["evaluation"] |= {"nominal": {"robot": "rigid"}, "varied": {"tool_mass": {"times": [0.8]}, "robot": ["rigid"]}}
VECTOR = {"num_envs": 2, "threads": 1, "autoreset_mode": "SameStep", "max_episode_steps": 9, "tool_mass": 0.2,
          "per_slot": [{"tool_mass": 0.1}, {"coupling": {"type": "Rigid"}}]}  # fmt: skip
LOG, MEASURED = {"time": TIME[::5].tolist(), "force": FORCE[::5].tolist()}, tomllib.loads(SCENE_FILE)
POLICY, BATCH = made_up_policy(), gym.make_vec(ID, num_envs=2)
CONTENT, ARRAYS = Ensemble([made_up_policy(sizes=(3,))], 0).packed()


def read_policy(content):
    Path("it.npz").write_bytes(archive.archive_of(FORMAT, content, ARRAYS))
    return load_policy("it.npz")


def read_log(source):
    log = logs_of.read(source, "log")
    logs_of.check(log, SCENE, MOTION, dict.fromkeys(log.columns, ig.Sensor()))


BORDERS = {
    "make": (ARGUMENTS, ANY, lambda tree: gym.make(ID, **tree).reset(seed=0)[0]),
    "make a batch": (VECTOR, ANY, lambda tree: gym.make_vec(ID, **tree).reset(seed=0)[0]),
    "scene": (MEASURED, PLAIN, lambda tree: parse(tree, ("contact.stiffness",))),
    "log": (LOG, ANY, read_log),
    "actions": ({"action": [[0.4, -0.2]] * 2}, ANY, lambda tree: list(BATCH.step(tree.get("action"))[:2])),
    "set-up": (SETUP, PLAIN, lambda tree: set_up_file(**tree)),
    "policy": (CONTENT, PLAIN, lambda tree: read_policy(tree).predict(np.zeros(8))[0]),
    "observation": ({"observation": [0.0] * 8}, ANY, lambda tree: POLICY.predict(tree.get("observation"))[0]),
    **{f"reset {place}": (RESET, ANY, lambda tree, make=make: begin(
        make(ID, tool_mass=(0.1, 0.2)), tree.get("seed"), tree.get("options")))
       for place, make in enumerate(MAKERS[:2])},
    **{f"{kind}'s name": ({kind: "test"}, ANY, lambda tree, load=load, kind=kind: load(tree.get(kind)))
       for kind, load in {"set-up": load_setup, "policy": load_policy, "set": evaluation_sets.load,
                           "baseline": load_baseline}.items()},
}  # fmt: skip


def spoiled(good, hostile, chance):
    """An input with a hostile value at one place, or without it; and keys of which a refusal names one."""
    inputs = [deepcopy(good)]
    node, key, keys = inputs, 0, []
    while not keys or (isinstance(node[key], (dict, list)) and node[key] and chance.random() < 0.8):
        node = node[key]
        key = chance.choice([*node] if isinstance(node, dict) else range(len(node)))
        keys.append(key)
    if isinstance(node, dict) and chance.random() < 0.2:
        del node[key]
    else:
        key = chance.choice(KEYS) if isinstance(node, dict) and chance.random() < 0.2 else key
        node[key] = deepcopy(chance.choice(hostile))
    beside = node if isinstance(node, dict) else ()
    return inputs[0], [name for name in (*keys, key, *beside) if isinstance(name, str)]


@pytest.mark.filterwarnings("ignore::UserWarning")  # an unlikely unit, or objects out of reach
@pytest.mark.parametrize("border", BORDERS)
def test_one_hostile_place_works_or_is_named_in_one_line(tmp_path, monkeypatch, border):
    monkeypatch.chdir(tmp_path)
    BATCH.reset(seed=0)
    good, hostile, use = BORDERS[border]
    also = {"policy": "is no policy of", "set-up": "evaluation.weights", "reset 0": "option", "reset 1": "option"}
    chance = random.Random(os.environ.get("HOSTILE", border))
    for _ in range(200):
        tree, keys = spoiled(good, hostile, chance)
        try:
            result = use(tree)
        except ValueError as error:
            says = str(error).partition(" was raised from the environment creator")[0]  # the rest is Gymnasium's
        else:
            assert all_finite(result)
            continue
        parts = {part for key in keys for part in (key, repr(key)[1:-1], key.rpartition(".")[2])}
        assert any(part in says for part in (*parts, also.get(border, keys[0]))), says
        assert len(says) < 3000 * ("\n" not in says)


TEXTS = [
    "", ".", "..", "...", "../evil", "../../evil", "a/../../evil", "/abs", "/tmp/evil", "//evil", "~", "~/evil", "a/b",
    ".hidden", "-rf", "--help", "$HOME", "$(touch evil)", "`touch evil`", "a;b", "a|b", "a&b", "a>b", "a b", " a", "a ",
    "*", "?", "*/", "/*", "*/ evil(); /*", "??/", "*??/", "\\", "*\\", "C:\\evil", "..\\evil", '"', "'", '"; evil();',
    "</script>", "<script>alert(1)</script>", "<!--", "]]>", "&lt;", "{{ 7 * 7 }}", "%s%n", "%2e%2e", "a\nb", "*\\\n/",
    "a\0b", "a\tb", "\x1b[2J", "\x7f", "\u202e", "\u2028", "gr\u00fcn", "\u2215etc", "\U0001f4a5",
    "a" * 101, "a" * 5000,
]  # fmt: skip


def test_texts_that_become_paths_are_names_of_files_in_a_folder(tmp_path):
    for text in (*TEXTS, None, 3, b"a"):
        refused(partial(validation.identifier, "name", text), "name")
    for name in ("con", "nul.toml", "a..b", "all", "a" * 100):  # odd and harmless
        assert (tmp_path / f"{validation.identifier('name', name)}.toml").resolve().parent == tmp_path
    for text in (text for text in TEXTS if "/" not in text and "\0" not in text and len(text) < 200):
        (path := tmp_path / f"{text}.toml").touch()
        refused(partial(load_setup, path), "name")


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_headers_are_valid_c_for_any_text_in_a_policy():
    policy = made_up_policy(sizes=(4,) * len(TEXTS))
    arrays = to_arrays(policy.network)
    for layer, text in enumerate(TEXTS):
        arrays |= {f"{text}.{part}": arrays.pop(f"hidden_{layer}.{part}") for part in ("weight", "bias")}
    network = from_arrays(policy.network.description() | {"layers": [*TEXTS, "mean", "log_std"]}, arrays)
    made = Policy(network, policy.task, {"command": "\n".join(TEXTS)})
    headers = [header(made, identifier(f"{text}_{place}")) for place, text in enumerate(TEXTS[::10])]
    assert not [written for written in headers if "evil();" in written.partition("#ifndef")[2]]
    flags = [*LANGUAGES["C99"], *WARNINGS, "-Wno-unused-function", "-fsyntax-only", "-"]
    subprocess.run(["gcc", *flags], input="".join(headers).encode("ascii"), check=True)


def test_report_shows_hostile_texts_as_texts(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    title = "".join(text for text in TEXTS if text.isprintable() and len(text) < 100)
    setup = set_up_file(**tomllib.loads(TEXT) | {"title": title, "about": title, "baselines": {"against": []}})
    made = made_up_policy(environment={**setup.environment, "time_weight": [0.3, 8.0]})
    about = {"settings": {"seed": 0, "steps": 2000}, "command": title, "versions": {"</script>": "<b>"}}
    Policy(made.network, made.task, about).save(tmp_path / "policies" / "bad.npz")
    options = ReportOptions(setups=("bad.toml",), folder=tmp_path, count=4, out=tmp_path / "out", processes=0)
    page = write(options).read_text()
    scripts = re.findall(r"<script([^>]*)>(.*?)</script>", page, re.DOTALL)
    assert title in unescape(re.sub(r"<script.*?</script>|<[^>]*>", "", page, flags=re.DOTALL))  # visible text
    assert not [code for kind, code in scripts if "json" not in kind and "alert(1)" in code]
    assert [json.loads(film)["scenes"] for kind, film in scripts if "application/json" in kind]
    assert {path.name for path in tmp_path.iterdir()} == {"bad.toml", "policies", "out"}


@pytest.mark.parametrize(("shape", "size", "how", "message"), [
    ((100_000_000_000,), 8, zipfile.ZIP_STORED, "is damaged"), ((2**70, 0), 0, zipfile.ZIP_STORED, "is damaged"),
    ((2_000_000,), 16_000_000, zipfile.ZIP_DEFLATED, "its parts add up to"),
    ((0,), 0, zipfile.ZIP_LZMA, "is compressed"), ((1,), 16, zipfile.ZIP_STORED, "checksum"),
])  # fmt: skip
def test_load_policy_refuses_an_array_larger_than_its_file(shape, size, how, message, tmp_path):
    path = made_up_policy().save(tmp_path / "it.npz")
    with zipfile.ZipFile(path, "a", how) as file, file.open("0/more.weight.npy", "w") as array:
        np.lib.format.write_array_header_1_0(array, {"descr": "<f8", "fortran_order": False, "shape": shape})
        array.write(bytes(size))
    refused(partial(load_policy, path), message)


def test_archive_is_of_bounded_size_and_no_parts_overlap(tmp_path, monkeypatch):
    path = made_up_policy().save(tmp_path / "it.npz")
    for room in (0, -1):
        load_policy(path)
        monkeypatch.setattr(files, "LARGEST", path.stat().st_size + room)
    refused(partial(load_policy, path), f"it must have at most {path.stat().st_size - 1:,} bytes")
    monkeypatch.undo()
    with zipfile.ZipFile(path, "a") as file:
        first, second, *_ = file.infolist()
        second.header_offset = first.header_offset
        file.writestr("more", "")
    refused(partial(load_policy, path), f"its parts {first.filename!r} and {second.filename!r} overlap")


@pytest.mark.parametrize(("load", "suffix"), [(load_setup, ".toml"), (load_policy, ".npz"), (load_baseline, ".json")])
def test_what_is_there_and_no_file_is_called_that(suffix, load, tmp_path):
    os.mkfifo(tmp_path / f"pipe{suffix}")
    (tmp_path / f"ring{suffix}").symlink_to(f"ring{suffix}")
    (tmp_path / f"folder{suffix}").mkdir()
    for path in tmp_path.iterdir():
        refused(partial(load, path), path.name, "but it is a folder, a device, a pipe, a socket, or a link that leads")


def test_file_is_written_through_links_and_over_nothing_else(tmp_path):
    (tmp_path / "link").symlink_to("there/it.txt")  # does not exist yet
    (tmp_path / "link to link").symlink_to("link")
    for text in ("first", "second"):
        files.write_file(tmp_path / "link to link", text)
        assert (os.listdir(tmp_path / "there"), (tmp_path / "there/it.txt").read_text()) == (["it.txt"], text)
    with (tmp_path / "link").open() as reader:
        files.write_file(tmp_path / "link", "third")
        assert reader.read() == "second"  # who reads a file while it is written gets all of what was there
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "ring").symlink_to("ring")
    (tmp_path / "link to a pipe").symlink_to("pipe")
    before = {path: os.lstat(path)[:2] for path in tmp_path.iterdir()}  # kind and number of each
    for name in ("pipe", "ring", "link to a pipe"):
        with pytest.raises(OSError, match=f"{name} must be a file .*nothing is written"):
            files.write_file(tmp_path / name, "text")
    for name in ("pipe", "there", "link to a pipe"):
        refused(files.locked(tmp_path / name).__enter__, f"{name} must be a regular file")
    assert {path: os.lstat(path)[:2] for path in tmp_path.iterdir()} == before
    (tmp_path / "there" / f".it.1{files.UNFINISHED}").touch()  # of a killed process
    with files.locked(tmp_path / "lock"):
        assert os.listdir(tmp_path / "there") == ["it.txt"]

"""Hostile texts in files that become paths, pages and C; archives that are larger than they say."""

import io
import json
import re
import shutil
import subprocess
import tomllib
import zipfile
from functools import partial
from html import unescape

import numpy as np
import pytest
import tomli_w
from made_up_policies import made_up_policy
from own_set_up import TEXT
from refusal import changed, refused

from agents import archive, load_policy, load_setup
from agents.export.c_header import header, identifier
from agents.export.replay import LANGUAGES, WARNINGS
from agents.policies import Ensemble, Policy
from agents.policies.networks import from_arrays, to_arrays
from agents.policies.policy import FORMAT
from experiments.report.__main__ import ReportOptions, write
from impact_gym import validation

TEXTS = [
    "", ".", "..", "...", "../evil", "../../evil", "a/../../evil", "/abs", "/tmp/evil", "//evil", "~", "~/evil", "a/b",
    ".hidden", "-rf", "--help", "$HOME", "$(touch evil)", "`touch evil`", "a;b", "a|b", "a&b", "a>b", "a b", " a", "a ",
    "*", "?", "*/", "/*", "*/ evil(); /*", "??/", "*??/", "\\", "*\\", "C:\\evil", "..\\evil", '"', "'", '"; evil();',
    "</script>", "<script>alert(1)</script>", "<!--", "]]>", "&lt;", "{{ 7 * 7 }}", "%s%n", "%2e%2e", "a\nb", "*\\\n/",
    "a\0b", "a\tb", "\x1b[2J", "\x7f", "\u202e", "\u2028", "gr\u00fcn", "\u2215etc", "\U0001f4a5",
    "a" * 101, "a" * 5000,
]  # fmt: skip
NAMES = ["con", "nul.toml", "int", "a..b", "vega", "all", "a" * 100]  # odd and harmless


def test_identifier_accepts_only_names_of_a_file_in_a_folder(tmp_path):
    for text in (*TEXTS, None, 3, b"a"):
        refused(partial(validation.identifier, "name", text), "name")
    for name in NAMES:
        assert (tmp_path / f"{validation.identifier('name', name)}.toml").resolve().parent == tmp_path


def set_up(folder, content, stem="mine"):
    path = folder / f"{stem}.toml"
    path.write_bytes(tomli_w.dumps(content).encode())
    return load_setup(path)


def test_load_setup_refuses_texts_that_become_paths(tmp_path):
    for text in TEXTS[::4]:
        for place in ("baselines.against", "baselines.bound", "baselines.tuned", "evaluation.set", "training.teacher"):
            wrong = {"against": [text], "tuned": {text: "BlindProfile"}, "teacher": text or ".."}
            field = place.rpartition(".")[2]
            refused(partial(set_up, tmp_path, changed({}, {place: wrong.get(field, text)})), field)
        if "/" not in text and "\0" not in text and len(text) < 200:
            refused(partial(set_up, tmp_path, {}, text), "name")
        if any(ord(sign) < 32 or ord(sign) == 127 for sign in text):
            refused(partial(set_up, tmp_path, {"title": text}), "title")


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_headers_are_valid_c_for_any_text_in_a_policy():
    program, size = "", 10
    for place in range(0, len(TEXTS), size):
        texts = TEXTS[place : place + size]
        policy = made_up_policy(sizes=(4,) * len(texts))
        arrays, kind = to_arrays(policy.network), policy.network.description()
        for layer, text in enumerate(texts):
            arrays |= {f"{text}.{part}": arrays.pop(f"hidden_{layer}.{part}") for part in ("weight", "bias")}
        network = from_arrays(kind | {"layers": [*texts, "mean", "log_std"]}, arrays)
        name = identifier(f"{texts[0]}_{place}")
        written = header(Policy(network, policy.task, {"command": "\n".join(texts)}), name)
        assert "evil();" not in written.partition("#ifndef")[2]
        program += written
    flags = [*LANGUAGES["C99"], *WARNINGS, "-Wno-unused-function", "-fsyntax-only", "-"]
    subprocess.run(["gcc", *flags], input=program.encode("ascii"), check=True)


def test_report_shows_hostile_texts_as_texts(tmp_path):
    title = "".join(text for text in TEXTS if text.isprintable() and len(text) < 100)
    texts = {"title": title, "about": title, "baselines": {"against": []}}
    setup = set_up(tmp_path, tomllib.loads(TEXT) | texts)
    about = {"settings": {"seed": 0, "steps": 2000}, "command": title, "versions": {"</script>": "<b>"}}
    made = made_up_policy(environment={**setup.environment, "time_weight": [0.3, 8.0]})
    Policy(made.network, made.task, about).save(tmp_path / "policies" / "mine.npz")
    out = tmp_path / "out"
    page = write(ReportOptions((str(setup.path),), folder=tmp_path, count=4, out=out, processes=0)).read_text()
    scripts = re.findall(r"<script([^>]*)>(.*?)</script>", page, re.DOTALL)
    assert title in unescape(re.sub(r"<script.*?</script>|<[^>]*>", "", page, flags=re.DOTALL))  # visible text
    assert not [code for kind, code in scripts if "json" not in kind and "alert(1)" in code]
    assert [json.loads(film)["scenes"] for kind, film in scripts if "application/json" in kind]
    assert {path.name for path in tmp_path.iterdir()} == {"mine.toml", "policies", "out", ".out.episodes"}


def member(shape, content):
    """A NumPy file whose header says this shape."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return file.getvalue() + content


@pytest.mark.parametrize(("content", "how", "message"), [
    (member((100_000_000_000,), bytes(8)), zipfile.ZIP_STORED, "is damaged"),
    (member((100_000, 1000, 1000), b""), zipfile.ZIP_STORED, "is damaged"),
    (member((2_000_000,), bytes(16_000_000)), zipfile.ZIP_DEFLATED, "its parts add up to"),
    (member((0,), b""), zipfile.ZIP_LZMA, "is compressed"),
    (member((1,), bytes(16)), zipfile.ZIP_STORED, "checksum"),
])  # fmt: skip
def test_load_policy_refuses_an_array_larger_than_its_file(content, how, message, tmp_path):
    path = made_up_policy().save(tmp_path / "it.npz")
    with zipfile.ZipFile(path, "a", how) as file:
        file.writestr("0/more.weight.npy", content)
    refused(partial(load_policy, path), message)


@pytest.mark.parametrize("part", ["mean.weight", "hidden_0.bias", "log_std.bias"])
def test_load_policy_refuses_wrong_or_infinite_weights(part, tmp_path):
    content, arrays = Ensemble([made_up_policy(sizes=(4,))], 0).packed()
    weights = arrays[f"0/{part}"]
    wrong = [(np.where(weights == weights.flat[-1], np.float32(each), weights), "finite") for each in (np.nan, np.inf)]
    for other, said in (*wrong, (weights.astype(float), "float32"), (weights.astype(bool), "float32")):
        (tmp_path / "it.npz").write_bytes(archive.archive_of(FORMAT, content, {**arrays, f"0/{part}": other}))
        refused(partial(load_policy, tmp_path / "it.npz"), part.partition(".")[0], said)
